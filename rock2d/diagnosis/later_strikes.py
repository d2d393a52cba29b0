"""Impacts of more than one strike: later corners, or the same one again, meet another place of the soil.

The soil varies from place to place. So the first strike of an impact has one draw of the soil, and all later ones
together have another. A strike lasts from the first contact until nothing touches: corners that press at the same time
are one strike."""

from dataclasses import replace

import numpy as np

from rock2d.arrays import Array
from rock2d.diagnosis.data import Data, FilmData
from rock2d.diagnosis.model import BASE_WIDTH, Model
from rock2d.engines.batch import run_world
from rock2d.kinematics.turned_ground import lifted, run_on_turned_ground
from rock2d.records.columns import BEFORE, I_TIME
from rock2d.scene.world import World


def by_later_strikes(model: Model, p: Array, data: Data, steps: Array) -> Array:
    """(n, d, 5) derivatives at p of the residuals of impacts by the soil of all strikes but the first, by differences
    with `steps` (5,) of the parameters of the law.

    0 in an impact table: each of its rows is one strike."""
    size, count = len(BASE_WIDTH), len(data.impact_release)
    if not (isinstance(data, FilmData) and count):
        return np.zeros((count, data.outcome_noise().shape[-1], size))
    world, shift = model.acting(p, data.impact_order)
    known = data.observed(world)
    starts: Array = known.starts + shift
    instants_s = known.instants_s
    possible = np.isfinite(starts).all(axis=1)
    starts, instants_s = np.where(possible[:, None], starts, 0.0), np.where(possible[:, None], instants_s, 0.0)
    second_s, left = _second_strikes(world, data, starts, instants_s)
    own = np.flatnonzero(possible & np.isfinite(second_s))
    changes = np.zeros((*instants_s.shape, 3, size))
    if len(own):
        worlds = [world] + [
            model.acting(p + step, data.impact_order)[0] for step in steps[:, None] * np.eye(size, len(p))
        ]
        rows = [np.broadcast_to(each.contact, (count, *each.contact.shape[1:]))[own] for each in worlds]
        level = replace(world, contact=np.concatenate(rows), slope_rad=np.zeros(1))
        block, since_s = (np.concatenate([part] * len(worlds)) for part in (
            data.impact_block[own], np.maximum(instants_s - second_s[:, None], 0.0)[own],
        ))  # fmt: skip
        start = lifted(level, block, np.tile(left[own], (len(worlds), 1)))
        poses = run_world(
            level, start, block, time_limit_s=since_s[:, -1] + 1e-9, times_s=since_s, step_fraction=data.step_fraction
        ).samples
        same, *changed = np.split(poses, len(worlds))
        for k, (pose, step) in enumerate(zip(changed, steps, strict=True)):
            changes[own, ..., k] = (pose - same) / step
    return np.nan_to_num(np.stack([data.outcomes(world, changes[..., k]) for k in range(size)], axis=-1))


def _second_strikes(world: World, data: FilmData, starts: Array, instants_s: Array) -> tuple[Array, Array]:
    """True times after `starts` of the second strikes (n,), NaN where there is none, and the states then (n, 6)."""
    block, limits_s = data.impact_block, instants_s[:, -1]
    if world.slope_rad.any():
        steps = data.step_fraction
        struck = run_on_turned_ground(world, block, starts, limits_s, instants_s, steps).impacts_s
        second_s = np.sort(struck, axis=1)[:, 1]  # NaN last
        until_s = np.where(np.isfinite(second_s), second_s, 0.0)
        return second_s, run_on_turned_ground(world, block, starts, until_s, instants_s[:, :0], steps).ends
    second = run_world(
        world, starts, block, time_limit_s=limits_s, impact_limit=2, impact_room=2, step_fraction=data.step_fraction
    ).impacts[:, 1]
    return second[:, I_TIME], second[:, BEFORE]
