"""Flights, states and noise read from a film whose truth is known."""

from dataclasses import replace

import numpy as np
import pytest

from rock2d.diagnosis.cross_validation import cross_validate
from rock2d.diagnosis.data import FilmData
from rock2d.diagnosis.derivatives import START_SCATTER, Point, jacobian_by_differences, residual_covariance
from rock2d.diagnosis.fitting import fit
from rock2d.diagnosis.likelihood import chi_square
from rock2d.diagnosis.model import Model
from rock2d.effects import catalogue
from rock2d.errors import InputError
from rock2d.kinematics.film_findings import flightless_remarks, slow_error_remarks
from rock2d.kinematics.flights import Flights, find_flights, flight_noise, load_film
from rock2d.kinematics.partition import CONTACT, FLIGHT, REST, partition
from rock2d.kinematics.setup_world import base_law_start, setup_world
from rock2d.kinematics.states import fit_states, move_freely
from rock2d.records.columns import VX
from rock2d.scene.world import View
from tests.kinematics.synthetic_films import data_of, film, world


def test_partition_finds_flight_contact_and_rest():
    rng = np.random.default_rng(1)
    t = np.arange(160) / 1000
    up = t[60:110] - t[60]
    y = np.concatenate([0.1 - 2.0 * t[:50] - 4.905 * t[:50] ** 2, np.zeros(10), 0.8 * up - 4.905 * up**2, np.zeros(50)])
    y[50:60] = np.interp(np.arange(50, 60), [49, 54, 60], [y[49], -0.02, 0.0]) + 0.003 * np.sin(np.arange(10) * 2.5)
    y[110:] = 0.05
    pose = np.column_stack([np.where(t < 0.11, 1.0 * t, 0.11), y, np.where(t < 0.11, -30 * t, -3.3)])
    noise = np.array([3e-4, 3e-4, 0.02])
    data = (pose + rng.normal(size=pose.shape) * noise) / noise
    kinds, numbers = partition(t, data, np.array([0, -4.905, 0]) / noise, np.array([0.75, 0.75, 1000.0]) / noise, 8)
    assert (kinds[2:48] == FLIGHT).all() and (kinds[62:108] == FLIGHT).all()
    assert (kinds[112:] == REST).all()
    assert (kinds[52:58] == CONTACT).any()
    assert numbers[20] != numbers[80]


def test_a_release_without_flights_is_named():
    experiment = film(world(), 4)
    assert flightless_remarks(data_of(experiment)[1]) == []
    table = experiment.trajectories
    shaken = (table["release"] == 2) * np.random.default_rng(0).normal(size=len(table)) * 0.01
    noisy = replace(experiment, trajectories=table.assign(x_m=table["x_m"] + shaken))
    (said,) = flightless_remarks(data_of(noisy)[1])
    assert said.startswith("no flight was recognised in 1 release (2): ")


def test_noise_is_read_from_the_flights():
    experiment = film(world(), 8, noise_m=2e-4, noise_rad=0.01)
    experiment.position_noise_m = 1e-3  # what the file says is not believed
    read = load_film(experiment)
    FilmData.of(read, setup_world(experiment))
    assert read.noise == pytest.approx([2e-4, 2e-4, 0.01], rel=0.08)
    assert read.long_noise == pytest.approx(read.noise, rel=0.35)  # white


def test_a_flight_that_holds_an_impact_does_not_make_the_film_noisy():
    experiment = film(world(), 8, noise_m=2e-4, noise_rad=0.01)
    read = load_film(experiment)
    flights = find_flights(setup_world(experiment), read)
    first, last = int(flights.first[0]), int(flights.last[0])
    read.pose[first:last] += 0.01 * np.abs(np.linspace(-1.0, 1.0, last - first))[:, None]
    assert flight_noise(read, flights)[0] == pytest.approx([2e-4, 2e-4, 0.01], rel=0.08)


@pytest.mark.parametrize("view", [View(), View(scale=1.3, time_scale=0.8), View(0.1, lens_per_m2=0.5)])
def test_states_are_unbiased_and_as_sure_as_they_say(view):
    """Whatever camera recorded it, if it is known: noise is taken back through it with the motion."""
    true = replace(world(), view=view)
    experiment = film(true, 12, seed=3)
    clean = film(true, 12, seed=3, noise_m=0.0, noise_rad=0.0)
    read = load_film(experiment)
    data = FilmData.of(read, true)
    exact = load_film(clean)
    exact.noise = read.noise
    truth = replace(data, film=exact).states(true).middle
    error = data.states(true).middle - truth
    covariance = data.true_covariance(true, np.arange(len(truth)), np.zeros(len(truth)), truth)
    sigma = np.sqrt(np.diagonal(covariance, axis1=1, axis2=2))
    z = error / sigma
    assert np.abs(z.mean(axis=0)).max() < 4 / np.sqrt(len(z))
    assert z.std(axis=0) == pytest.approx(np.ones(6), abs=0.25)


def test_errors_that_wander_after_a_contact_do_not_average_out():
    """As where dust hides a part of the outline: states after contacts are as uncertain as they are wrong; the flights
    before them, and films whose noise is white, stay as sure as they are."""
    experiment = film(world(), 12, seed=5, noise_m=2e-5, noise_rad=2e-3)
    clean = load_film(experiment)
    data = FilmData.of(clean, setup_world(experiment))
    assert not data.slow.any()
    wandering, rng = load_film(experiment), np.random.default_rng(2)
    first = data.flights.follows < 0
    for release, end in zip(data.flights.release[first], data.flights.last[first], strict=True):
        later = np.flatnonzero(wandering.release == release)
        later = later[later >= end]
        wandering.pose[later] += np.cumsum(rng.normal(size=(len(later), 3)) * [1e-5, 1e-5, 1e-3], axis=0)
    found = FilmData.of(wandering, setup_world(experiment))
    assert not found.slow[found.flights.follows < 0].any() and (found.slow[found.flights.follows >= 0] > 3.0).all()
    (said,) = slow_error_remarks(found)
    assert "off by about 0.0" in said and not slow_error_remarks(data)
    true = setup_world(experiment)
    exact = replace(found, film=load_film(film(world(), 12, seed=5, noise_m=0.0, noise_rad=0.0)))
    exact.film.noise = found.film.noise
    error = (found.states(true).middle - exact.states(true).middle)[:, VX:]
    every = np.arange(len(error))
    variance = np.diagonal(found.state_covariance(every, np.zeros(len(error))), axis1=1, axis2=2)[:, VX:]
    pulls = error / np.sqrt(variance)
    for own in (found.flights.follows < 0, found.flights.follows >= 0):
        assert np.sqrt(np.mean(pulls[own] ** 2, axis=0)) == pytest.approx(1.0, abs=0.45)


def test_a_slide_on_a_ground_that_lies_higher_than_stated_is_no_flight():
    """Raised by a third of a block's size, the film has about the flights that it has where it lies."""
    experiment = film(world(), 8, seed=3, fps=240.0, duration_s=0.8)
    raised = replace(experiment, trajectories=experiment.trajectories.assign(y_m=experiment.trajectories.y_m + 0.007))
    setup = setup_world(experiment)
    count = [len(FilmData.of(load_film(e), setup).flights) for e in (experiment, raised)]
    assert 0.8 * count[0] <= count[1] <= 1.2 * count[0]


def test_flight_of_the_parabola_is_reversible():
    setup = world()
    state = np.array([[0.1, 0.2, 0.3, 1.0, -2.0, 30.0]])
    there = move_freely(setup, np.zeros(1, int), state, np.array([0.05]))
    assert move_freely(setup, np.zeros(1, int), there, np.array([-0.05])) == pytest.approx(state, abs=1e-12)
    assert there[0, 1] == pytest.approx(0.2 - 2.0 * 0.05 - 0.5 * 9.81 * 0.05**2, abs=1e-12)


@pytest.mark.parametrize(
    ("name", "value"), [("magnus_lift", 0.03), ("magnus_lift", -0.03), ("air_drag", 1.0), ("flight_damping", 2.0)]
)
def test_a_flight_through_strong_air_is_fitted_exactly(name, value):
    """A lift of this size turns the path by 100° in 0.5 s: the slope along one axis depends on the speed along both."""
    true = catalogue()[name].apply(world(), [value])
    t = np.arange(250) / 500.0
    begin = np.array([[0.0, 2.0, 0.0, 1.0, 2.0, 120.0]])
    flown = move_freely(true, np.zeros(len(t), int), np.repeat(begin, len(t), axis=0), t)
    read = load_film(film(world(), 2))
    path = replace(read, t_s=t, pose=flown[:, :3])
    flights = Flights.of(path, *np.array([[0], [len(t)], [-1]]))
    states = fit_states(true, path, flights)
    middle = move_freely(true, np.zeros(1, int), begin, flights.middle)
    assert np.abs(states.residuals).max() < 0.01  # of the noise of a frame
    assert states.middle == pytest.approx(middle, rel=1e-4)


def test_true_world_leaves_only_noise():
    true = world()
    experiment = film(true, 12, seed=5, soil=0.0)
    _, data = data_of(experiment)
    residuals = data.residuals(true)
    assert len(data.impacts) > 30
    assert (residuals.flights[..., :2] ** 2).mean() == pytest.approx(1.0, abs=0.2)
    base = np.array([1.1e4, 7.0 / 1.1, 3e3, np.tan(np.deg2rad(32.0)), 0.03])
    model = Model(true, base)
    slope = jacobian_by_differences(model, Point(np.zeros(5), residuals), data, np.full(5, 0.05))
    chi2 = chi_square(residuals.impacts, residual_covariance(slope, np.array([*np.full(5, 1e-4), START_SCATTER]))) / 6
    assert np.median(chi2) == pytest.approx(0.9, abs=0.35)


@pytest.mark.parametrize("edge", [0.05, -0.05])
def test_no_lens_makes_the_noise_look_smaller(edge):
    """Taken back through a lens noise shrinks as lengths do: degrees 4 to 6 of flights are noise in any lens."""
    experiment = film(world(), 12, seed=5, fps=2000.0)
    read = load_film(experiment)
    setup = setup_world(experiment)
    data = FilmData.of(read, setup)
    seen = catalogue()["lens_distortion"].apply(setup, [edge, 1.0, 0.0])
    plain, through = (data.residuals(w).flights[:, :2, 2:] for w in (setup, seen))
    long_enough = plain != 0.0  # a short flight has fewer degrees
    assert long_enough.sum() > 50
    assert (through[long_enough] ** 2).mean() == pytest.approx((plain[long_enough] ** 2).mean(), rel=0.07)


def test_a_step_that_leaps_is_shortened():
    """With slopes a tenth of what they are, the Newton step without a fold is ten times too long."""
    experiment = film(world(), 12, seed=5)
    setup, data = data_of(experiment)
    found = fit(Model(setup, base_law_start(experiment)), data)
    flat = replace(found, jacobian=replace(found.jacobian, impacts=0.1 * found.jacobian.impacts))
    lost = cross_validate(found, data).score.sum() - cross_validate(flat, data).score.sum()
    assert abs(lost) < 30.0  # 138 if it is taken whole


def test_a_film_whose_frames_are_all_lost_is_refused():
    experiment = film(world(), 2)
    experiment.trajectories["y_m"] = np.nan
    with pytest.raises(InputError, match="every frame of the film is lost"):
        load_film(experiment)
