"""Predictions with learnt changes: what they add to the motion is what moves a block, and what lies still stays."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from rock2d.diagnosis.predict import predict
from rock2d.diagnosis.quantities import Curve
from rock2d.engines.geometry import block_arrays, ground_arrays
from rock2d.kinematics.flights import clearances
from tests.diagnosed_files import with_learnt
from tests.diagnosis.test_impact_table_data import impacts, plain_world
from tests.diagnosis.test_predict import known
from tests.kinematics.synthetic_films import SOIL, film, world
from tests.programs import refusal

POSES = ["x_m", "y_m", "theta_rad"]
# lever -> coefficients of a constant change far above any that is learnt: m/s², m, m/s, rad
STRONG = {
    "flight": [[4.0], [-5.0], [200.0]],
    "outcome": [[1e-3], [-3e-3], [0.2], [0.2], [-0.3], [10.0]],
    "frame": [[0.1], [-0.1], [5.0], [0.1]],
    "slope": [[0.1]],
}


@pytest.fixture(scope="module")
def other():
    return film(world(), 4, seed=21, fps=500.0, duration_s=1.6)


def learnt(*changes: tuple[str, list[list[float]]]) -> dict:
    """The law of the synthetic films with constant changes: lever and coefficients."""
    given = ({"lever": lever, "depends_on": "nothing", "curves": [], "coefficients": c} for lever, c in changes)
    return {**known(), "model": with_learnt(SOIL, *given)}


def depth_m(table: pd.DataFrame, scene) -> np.ndarray:
    """(rows,) how deep the blocks of a prediction lie in the ground."""
    depth = np.empty(len(table))
    for name, block in scene.blocks.items():
        own = (table.block == name).to_numpy()
        poses = table.loc[own, POSES].to_numpy()
        depth[own] = -clearances(block_arrays(block), ground_arrays(scene.cross_section), poses)
    return depth


def test_a_learnt_acceleration_bends_the_next_flight_as_gravity_does(other):
    """y'' = -(g + a) between the impacts, to the rounding of differences."""
    pull = 0.6
    base = predict(other, known(), base_only=True)
    pulled = predict(other, learnt(("flight", [[0.0], [-pull], [0.0]])))
    step = 1.0 / other.fps
    bends = []
    for (_, own), (_, plain) in zip(
        pulled.groupby(["release", "segment"]), base.groupby(["release", "segment"]), strict=True
    ):
        second, before = (np.diff(t.y_m, 2) / step**2 for t in (own, plain))
        # frames of the next flight: the first ones are aloft, too
        flies = np.abs(before + other.gravity_m_s2) < 1e-6
        flies &= np.cumsum(~flies) > 0
        bends += list(second[flies] + other.gravity_m_s2)
    assert len(bends) > 200
    assert np.median(bends) == pytest.approx(-pull, abs=1e-6)


@pytest.mark.parametrize("lever", STRONG)
def test_a_change_of_size_zero_shows_in_no_film(other, lever):
    """What is left is the truncation of a contact that begins in another step: below the noise of the camera."""
    nothing = learnt((lever, [[0.0] for _ in STRONG[lever]]))
    base = predict(other, nothing, base_only=True)
    miss = np.abs(predict(other, nothing)[POSES] - base[POSES]).max()
    assert (miss < [other.position_noise_m, other.position_noise_m, other.angle_noise_rad]).all()


def test_what_a_table_taught_is_used_for_a_film_and_a_film_says_what_a_table_cannot_use(other):
    table = learnt(("outcome", STRONG["outcome"][3:]))  # the rates alone
    film_ = learnt(("outcome", [[0.0], [0.0], [0.0], *STRONG["outcome"][3:]]))
    pd.testing.assert_frame_equal(predict(other, table), predict(other, film_))
    for lever in ("flight", "slope", "outcome"):
        said = f"learnt a change of a film .{lever} of nothing"
        measured = impacts(plain_world(), 30, seed=4, noise=0.01)
        assert refusal(predict, measured, learnt((lever, STRONG[lever])), said=said).code == "wrong_kind"


def test_blocks_come_to_rest_on_the_learnt_profile(other):
    """It lies 1 mm higher than the stated ground. Blocks filmed below it start in an indentation."""
    rise_m, x_m = 1e-3, other.cross_section.points_m[[0, -1], 0]
    curve = Curve("x_m", "spline", tuple(np.linspace(*x_m, 6).tolist()))
    at = np.linspace(*x_m, 60)
    level = np.linalg.lstsq(curve.features(at), np.full(len(at), rise_m), rcond=None)[0]
    change = {"lever": "profile", "depends_on": "place", "coefficients": [level.tolist()],
              "curves": [{"quantity": "x_m", "kind": "spline", "numbers": list(curve.numbers)}]}  # fmt: skip
    learnt_profile = {**known(), "model": with_learnt(SOIL, change)}
    last = predict(other, known()).t_s.max()
    higher, stated = (
        table[table.t_s == last].y_m.to_numpy() for table in (predict(other, own) for own in (learnt_profile, known()))
    )
    assert np.median(higher - stated) == pytest.approx(rise_m, rel=0.1)


@pytest.mark.parametrize("lever", STRONG)
def test_what_lies_still_stays_and_nothing_is_pushed_through_the_ground(other, lever):
    """However strong a change is: at the end of the film blocks rest, and none lies deeper than impacts press it."""
    scene, content = world(), learnt((lever, STRONG[lever]))
    base, changed = predict(other, content, base_only=True), predict(other, content)
    assert not np.allclose(base[POSES], changed[POSES])
    deepest = depth_m(base, scene).max()
    assert depth_m(changed, scene).max() < 1.5 * deepest
    radius = min(block.radius_m for block in scene.blocks.values())
    for _, own in changed.groupby("release"):
        last = own[own.t_s > own.t_s.max() - 0.05]
        assert np.hypot(np.ptp(last.x_m), np.ptp(last.y_m)) < 0.1 * radius
        assert np.ptp(last.theta_rad) < 0.1


def test_a_change_of_a_block_goes_to_the_block_of_its_name(other):
    """Another experiment may list its blocks in another order, or only some of them."""
    first, second = other.blocks

    def pulled(numbers, names=None):
        curve = {"quantity": "block", "kind": "kinds", "numbers": numbers, "names": names, "measured": None}
        change = {
            "lever": "flight", "depends_on": "block", "curves": [curve],
            "coefficients": [[0.0, 0.0], [-0.6, 0.0], [0.0, 0.0]],
        }  # fmt: skip
        return predict(other, {**known(), "model": with_learnt(SOIL, change)})

    pd.testing.assert_frame_equal(pulled([0.0, 1.0], [second, first]), pulled([1.0, 0.0]))
    assert not pulled([0.0, 1.0], [first, second]).equals(pulled([0.0, 1.0], [second, first]))
    pd.testing.assert_frame_equal(pulled([0.0, 1.0], ["absent", first]), pulled([1.0, 7.0], ["absent", "gone"]))


def test_what_happened_after_an_impact_is_not_used_to_predict_it():
    """A frame that moves with the velocity changes the predicted velocity, not the measured one."""
    measured = impacts(plain_world(), 30, seed=4, noise=0.01)
    curves = [
        {"quantity": name, "kind": "line", "numbers": [1.0], "measured": [-9.0, 9.0]} for name in ("vx_m_s", "vy_m_s")
    ]
    moving = {
        "lever": "frame", "depends_on": "velocity", "curves": curves,
        "coefficients": [[0.1, 0.0], [0.0, 0.1], [0.0, 0.0], [0.0, 0.0]],
    }  # fmt: skip
    content = {**known(), "model": with_learnt(SOIL, moving)}
    other = replace(measured, impacts=measured.impacts.assign(vx_after_m_s=0.3, vy_after_m_s=0.2))
    pd.testing.assert_frame_equal(predict(measured, content), predict(other, content))
