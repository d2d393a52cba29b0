"""Known causes in a real record: the camera's exactly, those of the motion as a film with the cause would show them."""

import numpy as np
import pytest

from rock2d.blind.injection import injected
from rock2d.diagnosis.data import FilmData
from rock2d.diagnosis.fitting import fit
from rock2d.diagnosis.known_causes import effects_of_size, largest_size, size_parameter, values_of_size, with_cause
from rock2d.diagnosis.model import Model, from_scale
from rock2d.effects import catalogue
from rock2d.effects.changes import aim_and_width
from rock2d.kinematics.flights import load_film
from rock2d.laws.contact import K_L, K_R, K_T, K_UL, MU
from tests.kinematics.synthetic_films import film, world

POSE = ["x_m", "y_m", "theta_rad"]
ROW = world().contact[0, 0]
MODEL = Model(world(), np.array([ROW[K_L], ROW[K_UL] / ROW[K_L], ROW[K_T], ROW[MU], ROW[K_R]]))
SIZED = effects_of_size("")
NOISE_FREE = {"noise_m": 0.0, "noise_rad": 0.0, "soil": 0.0}


def put_in(experiment, name, model=MODEL, p=None, **values):
    return injected(experiment, model, MODEL.start() if p is None else p, catalogue()[name], values)


def beside(own, record, end="_old"):
    """The frames of the first piece of each release beside those of another film."""
    table = own.experiment.trajectories
    first = table.groupby("release")["t_s"].transform("min") == 0.0
    table = table[first].assign(release=np.cumsum(table[first]["t_s"] == 0.0) - 1)
    names = np.unique(record.trajectories["release"])
    return table.assign(release=names[table["release"]]).merge(
        record.trajectories, on=["release", "t_s"], suffixes=("", end)
    )


@pytest.fixture(scope="module")
def record():
    return film(world(), 6, seed=1, **NOISE_FREE)


@pytest.mark.parametrize("name", SIZED)
def test_a_cause_of_size_0_gives_the_record_back(record, name):
    values = values_of_size(catalogue()[name], 0.0, world())
    own = put_in(record, name, **values)
    assert (own.releases, own.cut) == (12, 0)
    assert (own.pieces > 12) != catalogue()[name].camera
    np.testing.assert_allclose(own.experiment.trajectories[POSE], record.trajectories[POSE], atol=1e-12)


@pytest.mark.parametrize("name", [name for name in SIZED if not catalogue()[name].camera])
def test_a_cause_of_the_motion_changes_what_follows_it_and_no_piece_is_lost(record, name):
    own = put_in(
        record,
        name,
        **values_of_size(catalogue()[name], 0.1 * largest_size(size_parameter(catalogue()[name], world())), world()),
    )
    both = beside(own, record)
    moved = np.hypot(both.x_m - both.x_m_old, both.y_m - both.y_m_old)
    assert own.experiment.trajectories["release"].nunique() == own.pieces
    assert moved[both.t_s == 0.0].max() == 0.0 < moved.max() < 0.1


def test_a_strong_cause_still_shows_in_the_impacts(record):
    """An impact that comes earlier or later does not take those after it away: of some four impacts a release, one, a
    quarter, would be left."""
    own = put_in(record, "rounded_edges", radius=0.4).experiment
    impacts = [len(FilmData.of(load_film(film), world()).impacts.release) for film in (own, record)]
    assert impacts[0] > 0.5 * impacts[1]


def test_a_wrong_scale_is_the_scaled_record(record):
    own = put_in(record, "scale_error", scale=1.04).experiment.trajectories
    (x, y), _ = aim_and_width(record.cross_section)
    np.testing.assert_allclose(own["x_m"], x + 1.04 * (record.trajectories["x_m"] - x), atol=1e-12)
    np.testing.assert_allclose(own["y_m"], y + 1.04 * (record.trajectories["y_m"] - y), atol=1e-12)
    np.testing.assert_allclose(own["theta_rad"], record.trajectories["theta_rad"], atol=1e-12)


def test_a_wrong_frame_rate_keeps_the_frames(record):
    own = put_in(record, "frame_rate_error", time_scale=1.03).experiment
    assert own.fps == pytest.approx(1.03 * record.fps)
    np.testing.assert_allclose(own.trajectories["t_s"], record.trajectories["t_s"] / 1.03)
    np.testing.assert_allclose(own.trajectories[POSE], record.trajectories[POSE], atol=1e-12)


def test_what_the_record_has_adds_up_with_the_cause():
    for name, own, more, both in (("air_drag", 0.1, 0.2, 0.3), ("scale_error", 1.02, 1.03, 1.02 * 1.03)):
        effect = catalogue()[name]
        key = effect.parameters[0].name
        model, _, p = with_cause(MODEL, MODEL.start(), effect, {key: own})
        model, before, after = with_cause(model, p, effect, {key: more})
        assert len(model.effects) == 1
        assert [model.values(q)[0][0] for q in (before, after)] == pytest.approx([own, both])


@pytest.mark.parametrize(
    ("name", "values"),
    [
        ("air_drag", {"drag_per_mass_1_m": 0.05}),
        ("rounded_edges", {"radius": 0.1}),
        ("inertia_error", {"factor": 1.05}),
        ("out_of_plane", {"angle_rad": 0.1}),
    ],
)
def test_a_cause_of_the_motion_is_as_a_film_with_it(record, name, values):
    """Until the films part, the changed record is a hundred times nearer to the film than the record is."""
    effect = catalogue()[name]
    full = [values.get(q.name, q.neutral) for q in effect.parameters]
    with_it = film(effect.apply(world(), full), 6, seed=1, **NOISE_FREE)
    both = beside(put_in(record, name, **values), record).merge(
        with_it.trajectories, on=["release", "t_s"], suffixes=("", "_film")
    )
    old, new = (np.hypot(both.x_m_film - both["x_m" + end], both.y_m_film - both["y_m" + end]) for end in ("_old", ""))
    moved = old > 1e-5
    assert moved.mean() > 0.1 and np.median(new[moved] / old[moved]) < 0.01


def test_a_fit_finds_the_cause_that_was_put_in():
    """In a film with noise, and with a soil that varies."""
    noisy = film(world(), 16, seed=3)
    for name, value in (("air_drag", 0.2), ("scale_error", 1.03), ("mass_eccentricity", 0.02)):
        effect = catalogue()[name]
        own = put_in(noisy, name, **{effect.parameters[0].name: value})
        found = fit(Model(world(), MODEL.base, [effect]), FilmData.of(load_film(own.experiment), world()))
        at, parameter = len(MODEL.start()), found.model.parameters[0][0]
        sd = np.sqrt(found.p_covariance[at, at])
        expected = with_cause(MODEL, MODEL.start(), effect, {parameter.name: value})[2][at]
        assert abs(found.p[at] - expected) < 3.0 * sd < 1.5 * abs(expected), from_scale(parameter, found.p[at])


def test_roughness_turns_impacts_and_depends_on_the_seed_alone(record):
    effect, values = catalogue()["surface_roughness"], {"sd_rad": 0.05}
    films = [injected(record, MODEL, MODEL.start(), effect, values, seed).experiment.trajectories for seed in (1, 1, 2)]
    assert films[0].equals(films[1]) and not films[0].equals(films[2])
    both = beside(injected(record, MODEL, MODEL.start(), effect, values, 1), record)
    moved = np.hypot(both.x_m - both.x_m_old, both.y_m - both.y_m_old)
    assert moved[both.t_s < 0.02].max() < 1e-12 < 1e-3 < moved.max()  # before the first impact, and after it
