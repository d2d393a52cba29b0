"""An impact of more than one strike: later corners, or the same one again, meet another place of the soil.

The soil varies from place to place, so each strike has a draw of its own. The derivatives of an impact by the soil are
therefore divided into those of the first strike and of the later ones. They act on the same residuals independently."""

from dataclasses import replace

import numpy as np

from rock2d.arrays import Array
from rock2d.diagnosis.data import Data, FilmData
from rock2d.diagnosis.model import BASE_WIDTH, Model, with_changed_law
from rock2d.engines.batch import run_world
from rock2d.kinematics.turned_ground import approach_s, lifted
from rock2d.records.columns import I_TIME, I_TIME_AFTER, INSTANT_STATE
from rock2d.scene.world import World

SOIL_STEP = 0.02  # for differences, in the logarithms of the soil's parameters


def by_later_strikes(model: Model, p: Array, data: Data) -> Array:
    """(n, d, 5) derivatives at p of the residuals of impacts by the soil that all strikes but the first meet.

    0 in an impact table: each of its rows is one strike."""
    world, shift = model.acting(p, data.impact_order)
    size, count = len(BASE_WIDTH), len(data.impact_release)
    if not (isinstance(data, FilmData) and count):
        return np.zeros((count, data.outcome_noise().shape[-1], size))
    world = replace(world, slope_rad=np.zeros(1))
    states = data.states(world)
    starts, instants_s = data.starts(world, states, shift), data.instants_s(world)
    possible = np.isfinite(starts).all(axis=1)
    starts, instants_s = np.where(possible[:, None], starts, 0.0), np.where(possible[:, None], instants_s, 0.0)
    changes = np.zeros((count, *instants_s.shape[1:], 3, size))
    strikes = run_world(
        world, starts, data.impact_block, time_limit_s=instants_s[:, -1], impact_limit=2, impact_room=2,
        step_fraction=data.step_fraction,
    ).impacts  # fmt: skip
    # when the block is clear of the first indentation, or at the second strike
    clear_s = strikes[:, 0, I_TIME_AFTER] + approach_s(world, data.impact_block)
    split_s = np.minimum(clear_s, strikes[:, 1, I_TIME])
    own = np.flatnonzero(possible & np.isfinite(split_s))
    if len(own):
        part, block, step_fraction = _of_impacts(world, own), data.impact_block[own], data.step_fraction
        ends = run_world(part, starts[own], block, time_limit_s=split_s[own], step_fraction=step_fraction).ends
        left, since_s = lifted(part, block, ends[:, INSTANT_STATE]), instants_s[own] - split_s[own, None]

        def poses(change: Array) -> Array:
            changed = with_changed_law(part, np.tile(change, (len(own), 1)))
            return run_world(
                changed, left, block, time_limit_s=since_s[:, -1] + 1e-9, times_s=since_s, step_fraction=step_fraction
            ).samples

        same = poses(np.zeros(size))
        for k, step in enumerate(SOIL_STEP * np.eye(size)):
            changes[own, ..., k] = (poses(step) - same) / SOIL_STEP
    columns = [data.outcomes(world, states, changes[..., k]) for k in range(size)]
    return np.nan_to_num(np.stack(columns, axis=-1))


def _of_impacts(world: World, own: Array) -> World:
    """The world of some of the impacts."""
    return world if len(world.contact) == 1 else replace(world, contact=world.contact[own])
