"""A ground that is steeper where a block strikes: what it must do to the motion, and the scatter that it causes."""

from dataclasses import dataclass, field, fields, replace

import numpy as np
import pytest

from rock2d.arrays import Array
from rock2d.diagnosis.data import FilmData, Residuals
from rock2d.diagnosis.fitting import fit
from rock2d.diagnosis.model import from_scale
from rock2d.effects import catalogue
from rock2d.engines.batch import run_world
from rock2d.kinematics.turned_ground import TurnedRun, run_on_turned_ground, touched_points, turned
from rock2d.laws.contact import contact_table
from rock2d.records.columns import BEFORE, INSTANT_STATE, LINEAR_VELOCITY, OMEGA, POSE
from rock2d.scene.cross_section import CrossSection
from rock2d.scene.world import World
from tests.kinematics.synthetic_films import LAW, base_fit, film
from tests.kinematics.synthetic_films import world as laboratory
from tests.laboratory import BLOCKS, FLOOR

NAMES = ["sphere", "cube", "parallelepiped"]
# Fast blocks, for which gravity does not matter, and slow ones that strike once: nine releases.
FAST = [[0.0, 0.02, 0.3, 8.0, -5.0, 30.0], [0.1, 0.025, 1.1, 9.0, -6.0, -80.0], [0.2, 0.03, -0.4, 5.0, -4.0, 60.0]]
SLOW = [[0.0, 0.02, 0.3, 1.0, -1.0, 30.0], [0.0, 0.022, 2.9, 1.0, -1.0, -40.0], [0.0, 0.026, 1.1, 0.4, -1.0, -14.0]]
STARTS, BLOCK = np.array([*FAST, *SLOW]), np.tile(np.arange(3), 2)
LIMITS_S = np.repeat([0.012, 0.025], 3)


def on(ground: CrossSection, slope_rad: float = 0.0) -> World:
    table = contact_table(LAW, ground.zone_names)[None]
    return World({name: BLOCKS[name] for name in NAMES}, ground, table, slope_rad=np.array([slope_rad]))


def first_touches() -> np.ndarray:
    """Poses of the blocks when they first touch the level floor."""
    run = run_world(on(FLOOR), STARTS, BLOCK, time_limit_s=LIMITS_S, impact_limit=1, impact_room=1)
    return run.impacts[:, 0, BEFORE][:, POSE]


def test_the_touched_point_is_that_of_the_block():
    """Below the centre of the sphere; below the lowest corner of the others."""
    touching = first_touches()
    touched = touched_points(on(FLOOR), BLOCK, touching)
    for k, (x, _, theta) in enumerate(touching):
        corners = np.pad(BLOCKS[NAMES[BLOCK[k]]].corners_m, ((0, 0), (0, 1)))
        lowest = min(turned(corners, np.zeros(2), theta).tolist(), key=lambda corner: corner[1], default=[0.0])
        assert touched[k, 0] == pytest.approx(x + lowest[0], abs=2e-6)


@pytest.mark.parametrize("slope_rad", [-0.12, 0.08])
def test_a_turned_ground_is_an_inclined_plane_through_the_touched_point(slope_rad):
    """As long as the block strikes once. The plane is a cross-section of its own for each block.
    Velocities change by up to 1 m/s with the slope."""
    times_s = np.linspace(0.2, 1.0, 5) * LIMITS_S[:, None]
    run = run_on_turned_ground(on(FLOOR, slope_rad), BLOCK, STARTS, LIMITS_S, times_s)
    touched = touched_points(on(FLOOR), BLOCK, first_touches())
    for k in range(len(BLOCK)):
        x, rise = touched[k, 0], np.tan(slope_rad)
        plane = CrossSection([[-5.0, rise * (-5.0 - x)], [5.0, rise * (5.0 - x)]], ["floor"])
        alone = run_world(
            on(plane), STARTS[[k]], BLOCK[[k]], time_limit_s=LIMITS_S[[k]], times_s=times_s[[k]], impact_room=4
        )
        assert alone.impact_count[0] == np.isfinite(run.impacts_s[k]).sum() == 1
        end = alone.ends[0, INSTANT_STATE]
        assert run.ends[k, LINEAR_VELOCITY] == pytest.approx(end[LINEAR_VELOCITY], rel=0.002, abs=0.015)
        assert run.ends[k, OMEGA] == pytest.approx(end[OMEGA], rel=0.01, abs=1.5)
        assert run.samples[k, :, :2] == pytest.approx(alone.samples[0, :, :2], abs=2e-4)


def test_a_level_turned_ground_is_the_stated_one():
    """Cubes of which many strike with a second corner soon after the first."""
    rng = np.random.default_rng(1)
    lowest, highest = [0.0, 0.02, 0.0, -1.0, -2.0, -60.0], [0.0, 0.02, 1.5, 3.0, -0.3, 60.0]
    starts = rng.uniform(lowest, highest, (60, 6))
    block, limit = np.ones(60, int), np.full(60, 0.06)
    flat = run_world(on(FLOOR), starts, block, time_limit_s=limit, times_s=limit[:, None], impact_room=8)
    run = run_on_turned_ground(on(FLOOR, 1e-9), block, starts, limit, limit[:, None])
    assert (flat.impact_count > 1).sum() > 10
    error = np.abs(run.samples - flat.samples)[:, 0, :2].max(axis=1)
    assert np.quantile(error, 0.9) < 1e-5
    assert error.max() < 2e-3  # a second corner strikes before the first is clear of its indentation


def test_the_next_strike_finds_the_stated_ground():
    """A ball that bounces twice: with the state after the first bounce, the second is that of the level floor."""
    start, block = np.array([[0.0, 0.02, 0.0, 1.0, -2.0, 0.0]]), BLOCK[:1]

    def run(limit_s: float) -> TurnedRun:
        return run_on_turned_ground(on(FLOOR, 0.1), block, start, np.full(1, limit_s), np.full((1, 1), limit_s))

    whole = run(0.3)
    second_s = np.sort(whole.impacts_s[np.isfinite(whole.impacts_s)])[1]
    before_it = run(second_s - 1e-3)
    level = run_world(on(FLOOR), before_it.ends, block, time_limit_s=0.3 - second_s + 1e-3)
    assert np.isfinite(before_it.impacts_s).sum() == 1
    assert whole.ends[0] == pytest.approx(level.ends[0, INSTANT_STATE], abs=1e-4)


@dataclass
class RoughFilm(FilmData):
    """A film whose impacts ended differently by `change` (n, 6)."""

    change: Array = field(default_factory=lambda: np.zeros((0, 6)))

    def residuals(self, world: World, shift: Array | None = None) -> Residuals:
        found = super().residuals(world, shift)
        return replace(found, impacts=found.impacts - self.change)


@pytest.mark.parametrize("sd_rad", [0.01, 0.06])
def test_a_rough_ground_is_found_as_rough_as_it_is(sd_rad):
    """Impacts of spheres and cubes on slopes that were drawn."""
    data, base = base_fit(film(laboratory(), 24, seed=3, soil=0.0))
    slopes = sd_rad * np.random.default_rng(0).normal(size=len(data.impacts))
    world = base.model.world(base.p, data.impact_order)
    change = data.residuals(replace(world, slope_rad=slopes)).impacts - base.residuals.impacts
    known = {each.name: getattr(data, each.name) for each in fields(data) if each.init}
    model = replace(base.model, effects=[catalogue()["surface_roughness"]])
    found = fit(model, RoughFilm(**known, change=np.nan_to_num(change)))
    assert from_scale(model.parameters[0][0], found.scatter[5]) == pytest.approx(np.std(slopes), rel=0.25)
