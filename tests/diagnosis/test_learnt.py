"""Learnt changes: what has no name is found, closes the gap on releases that it never saw, and enters predictions."""

from dataclasses import replace

import numpy as np
import pytest

from rock2d.diagnosis.cross_validation import FOLDS, cross_validate, folds
from rock2d.diagnosis.data import FilmData
from rock2d.diagnosis.diagnosis_content import base_values
from rock2d.diagnosis.fitting import Fit
from rock2d.diagnosis.flight_response import flight_paths, flight_response, integral
from rock2d.diagnosis.learnt import Learnt, best_predicting, learn, residuals_on
from rock2d.diagnosis.levers import FLIGHT, LAW, PROFILE, SLOPE, Levers
from rock2d.diagnosis.predict import predict
from rock2d.diagnosis.quantities import CONSTANT, FLIGHT_DEPENDENCES, Basis, Curve, bases, read_basis
from rock2d.effects import catalogue
from rock2d.files.experiment import Experiment
from rock2d.kinematics.states import move_freely
from rock2d.laws.contact import K_UL
from rock2d.scene.rough_ground import raised
from rock2d.scene.world import World
from tests.diagnosed_files import with_learnt
from tests.kinematics.synthetic_films import BLOCKS, base_fit, data_of, film, series_order, world

RELEASES = 24
HARDENED = 2.5  # factor on k_ul in the second half of the series: a step, which no effect of the catalogue is


def hardening(releases: int) -> World:
    """A soil that suddenly hardens in the middle of the series."""
    order = series_order(releases)
    true = world(order)
    rows = np.repeat(true.contact, len(order), axis=0)
    rows[order >= releases / 2, :, K_UL] *= HARDENED
    return replace(true, contact=rows)


def fitted(experiment: Experiment) -> tuple[FilmData, Fit, Learnt]:
    data, base = base_fit(experiment)
    return data, base, learn(Learnt.of(base, data), data)


@pytest.fixture(scope="module")
def hardened() -> tuple[FilmData, Fit, Learnt]:
    return fitted(film(hardening(RELEASES), RELEASES, seed=7))


def test_what_predicts_held_out_releases_better_is_used_where_something_was_learnt(hardened):
    data, base, learnt = hardened
    without = Learnt.of(base, data)
    assert best_predicting(data, without, learnt) is learnt
    assert best_predicting(data, without, replace(learnt, changes=[])) is without
    assert best_predicting(data, learnt, without) is learnt
    same = replace(learnt)
    assert best_predicting(data, learnt, same) is learnt  # equal, but no better


def test_a_soil_that_hardens_in_one_step_is_learnt_as_a_law_that_depends_on_the_series(hardened):
    _, _, learnt = hardened
    change = learnt.changes[0]
    assert change.name == "law of series"
    curve = change.basis.curves[0]
    ends = curve.features(np.array([curve.numbers[0], curve.numbers[-1]])) @ change.coefficients.T
    # logarithm of k_ul: of k_l and of the ratio
    stiffening = ends[1, 0] + ends[1, 1] - ends[0, 0] - ends[0, 1]
    assert stiffening == pytest.approx(np.log(HARDENED), abs=0.35)


def test_learning_ends_where_more_changes_cannot_gain_what_is_asked():
    """A soil that hardens, and a drag: two changes. The stronger one alone is learnt if both together gain too little
    anyway; both if a second one may decide."""
    true = catalogue()["air_drag"].apply(hardening(RELEASES), [0.3])
    data, base, both = fitted(film(true, RELEASES, seed=7))
    assert {c.lever for c in both.changes} == {LAW, FLIGHT}
    start = Learnt.of(base, data)
    gain = sum(c.total for c in both.changes)
    one, again = (learn(start, data, least_total=total) for total in (100.0 * gain, gain))
    assert [c.name for c in one.changes] == [c.name for c in both.changes[:1]]
    assert [c.name for c in again.changes] == [c.name for c in both.changes]


def test_what_was_learnt_gains_on_releases_that_were_held_out(hardened):
    data, base, learnt = hardened
    gain = learnt.held_out.score - cross_validate(base, data).score
    assert gain.sum() > 3.0 * gain.std() * np.sqrt(len(gain))


def test_every_fold_is_predicted_by_coefficients_that_were_fitted_without_it(hardened):
    data, _, learnt = hardened
    moved = np.abs(learnt.held_out.residuals.impacts - learnt.fit.residuals.impacts).max(axis=1)
    assert all(moved[folds(data)[data.impact_release] == k].any() for k in range(FOLDS))
    for k, p in enumerate(learnt.held_out.parameters):
        own, held = learnt.fit.model.residuals(p, data), folds(data)[data.impact_release] == k
        assert own.impacts[held] == pytest.approx(learnt.held_out.residuals.impacts[held], nan_ok=True)


def test_derivatives_by_coefficients_are_those_of_the_residuals(hardened):
    data, _, learnt = hardened
    found, step = learnt.fit, 1e-3
    for k in range(found.model.named_size, found.model.size):
        ahead = found.model.residuals(found.p + step * (np.arange(found.model.size) == k), data)
        slope = (ahead.impacts - found.residuals.impacts) / step
        error = np.abs(found.jacobian.impacts[..., k] - slope)
        assert np.quantile(error, 0.9) < 0.05 * np.quantile(np.abs(slope), 0.9)


def test_a_prediction_uses_what_was_learnt(hardened):
    _, base, learnt = hardened
    other = film(hardening(RELEASES), RELEASES, seed=8)
    model = with_learnt(base_values(base), *(
        change.basis.content() | {"lever": change.lever, "coefficients": change.coefficients.tolist()}
        for change in learnt.changes
    ))  # fmt: skip
    model["learnt"]["base"] = base_values(learnt.fit)
    content = {"verdict": "unknown", "base": base_values(base), "series": dict.fromkeys(BLOCKS, RELEASES)}
    content["model"] = model
    errors = []
    for base_only in (True, False):
        found = predict(other, content, base_only=base_only).merge(
            other.trajectories, on=["release", "t_s"], suffixes=("", "_seen")
        )
        square = (found.x_m - found.x_m_seen) ** 2 + (found.y_m - found.y_m_seen) ** 2
        errors.append(np.sqrt(square.groupby([found.release, found.segment]).mean().median()))
    assert errors[1] < 0.7 * errors[0]


def test_what_was_learnt_gives_the_same_residuals_when_it_is_applied_to_its_own_data(hardened):
    data, _, learnt = hardened
    assert residuals_on(data, learnt).impacts == pytest.approx(learnt.fit.residuals.impacts, abs=1e-9)


def test_nothing_is_learnt_from_a_film_of_the_law_itself():
    _, base, learnt = fitted(film(world(series_order(16)), 16, seed=9))
    assert learnt.changes == [] and learnt.fit is base


def test_the_answer_to_a_change_of_the_law_is_the_derivative_of_the_residuals(hardened):
    data, base, _ = hardened
    levers = Levers(base, data)
    columns = levers.columns(levers.response(LAW, Basis(CONSTANT, ())))
    step = 1e-3
    ahead = base.model.residuals(base.p + step * np.eye(5)[1], data)
    slope = (ahead.impacts - base.residuals.impacts) / step
    error = np.abs(columns.impacts[..., 1] - slope)
    assert np.median(error) < 0.05 * np.median(np.abs(slope))


def test_a_uniform_acceleration_answers_as_another_gravity_does():
    experiment = film(world(), 6, seed=2)
    setup, data = data_of(experiment)
    paths = flight_paths(data, setup)
    response = flight_response(data, setup, paths, bases(FLIGHT_DEPENDENCES, paths.quantities)[CONSTANT])
    push = -0.3
    heavier = replace(setup, gravity_m_s2=setup.gravity_m_s2 - push)
    before, after = data.states(setup), data.states(heavier)
    noise = data.flight_noise(setup) * (data.film.noise / data.film.long_noise)
    expected = -push * response.residuals[..., 0] / noise[:, 1, None]
    found = after.residuals[:, 1] - before.residuals[:, 1]
    assert np.abs(found - expected).max() < 0.01 * np.abs(found).max()
    flights = np.arange(len(before.middle))
    dt = paths.t_s[paths.start[1:] - 1]
    place, rate = response.state_change(flights, dt)
    block = data.flights.block
    moved = move_freely(heavier, block, after.middle, dt) - move_freely(setup, block, before.middle, dt)
    assert moved[:, 1] == pytest.approx(push * place[:, 0], abs=1e-6)
    assert moved[:, 4] == pytest.approx(push * rate[:, 0], abs=1e-5)


def test_an_angle_that_is_recorded_late_is_learnt_as_an_offset_in_proportion_to_the_spin():
    lag_frames = 6
    experiment = film(world(series_order(16)), 16, seed=11)
    table = experiment.trajectories
    late = table.groupby("release").theta_rad.shift(lag_frames).bfill()
    _, _, learnt = fitted(replace(experiment, trajectories=table.assign(theta_rad=late)))
    change = learnt.changes[0]
    assert change.name == "frame of spin"
    lag_s = change.coefficients[3, 0] / change.basis.curves[0].numbers[0]
    assert lag_s == pytest.approx(lag_frames / experiment.fps, rel=0.1)


def test_the_answer_to_a_slope_is_that_of_a_turned_ground(hardened):
    data, base, _ = hardened
    levers = Levers(base, data)
    columns = levers.columns(levers.response(SLOPE, Basis(CONSTANT, ())))
    turn = 0.01
    steeper = replace(levers.world, slope_rad=np.full(len(data.impacts), turn))
    change = data.residuals(steeper).impacts - base.residuals.impacts
    error = np.abs(columns.impacts[..., 0] * turn - change)
    assert np.median(error) < 0.1 * np.median(np.abs(change))


def test_the_answer_to_a_profile_is_that_of_a_raised_ground(hardened):
    """Hills of 0.1 mm, 1 m long: the place of a block of 2 cm is that of its centre, not of the contact."""
    data, base, _ = hardened
    levers = Levers(base, data)
    basis = next(own for own in levers.bases[PROFILE] if own.name == "place")
    response = levers.response(PROFILE, basis)
    x_m = levers.impact_quantities["x_m"]
    hill_m = 1e-4 * np.sin(2.0 * np.pi * x_m)
    coefficients = np.linalg.lstsq(basis.features({"x_m": x_m}), hill_m, rcond=None)[0]
    grid_m = basis.curves[0].grid()
    higher = raised(levers.world.cross_section, grid_m, basis.features({"x_m": grid_m}) @ coefficients)
    change = data.residuals(replace(levers.world, cross_section=higher)).minus(base.residuals)
    columns, c = levers.columns(response), coefficients / levers.units[PROFILE]
    error = np.abs(columns.impacts @ c - change.impacts)
    assert np.median(error) < 0.25 * np.median(np.abs(change.impacts))
    assert len(data.rests) > 10
    rests = change.flights[data.flown :]
    assert np.abs(columns.flights[data.flown :] @ c - rests).max() < 0.05 * np.abs(rests).max()


def test_a_constant_integrates_to_a_line():
    t = np.linspace(0.0, 2.0, 9)
    assert integral(t, np.ones((9, 1)), np.zeros(1, int))[:, 0] == pytest.approx(t)


def test_paths_one_after_the_other_are_integrated_each_alone():
    rng = np.random.default_rng(3)
    t, values = rng.uniform(size=30), rng.normal(size=(30, 2))
    begin = np.array([0, 1, 12, 20])
    alone = [
        integral(*part, np.zeros(1, int))
        for part in zip(np.split(t, begin[1:]), np.split(values, begin[1:]), strict=True)
    ]
    assert integral(t, values, begin) == pytest.approx(np.concatenate(alone), abs=1e-12)


def test_splines_sum_to_one_and_keep_their_last_value():
    curve = Curve("x_m", "spline", (0.0, 1.0, 3.0, 4.0))
    features = curve.features(np.linspace(-2.0, 6.0, 50))
    assert features[:, 1:].sum(axis=1) == pytest.approx(1.0)
    assert features[-1] == pytest.approx(curve.features(np.array([4.0]))[0])
    assert read_basis(Basis("place", (curve,)).content()) == Basis("place", (curve,))


def test_a_change_fades_where_nothing_was_measured():
    """1 within the measured range, half at a quarter of it beyond, nothing at half of it."""
    for curve in (Curve("x_m", "spline", (0.0, 1.0, 4.0)), Curve("x_m", "line", (2.0,), (0.0, 4.0))):
        at = np.array([-3.0, -2.0, -1.0, 0.0, 1.7, 4.0, 5.0, 6.0, 100.0])
        whole, faded = curve.features(at), Basis("place", (curve,)).features({"x_m": at})
        assert faded == pytest.approx(whole * np.array([0, 0, 0.5, 1, 1, 1, 0.5, 0, 0])[:, None])
