"""Impact prediction: every impact simulated from the measured flight before it.

The simulation starts from the state of the previous flight, a little above the ground. It is compared with the next
flight by the differences of pose and velocity at the beginning of that flight, along the ground and across it.
"""

from __future__ import annotations

import numpy as np

from rock2d.engines.batch import BATCH_STEP_FRACTION, run_world
from rock2d.kinematics.film_segments import POSE_SIZE, STATE_SIZE
from rock2d.kinematics.impacts import Impacts, ground_axes
from rock2d.kinematics.states import States, move_freely
from rock2d.records.columns import POSE, POSITION, THETA, VX, VY, X, Y
from rock2d.scene.world import World

Array = np.ndarray

COMPARED_INSTANTS = 5  # within `Impacts.window_s`


def simulate(
    world: World,
    impacts: Impacts,
    starts: Array,
    times_s: Array,
    step_fraction: float = BATCH_STEP_FRACTION,
) -> Array:
    """Poses (n, k, 3) of the centre of mass at true instants `times_s` (n, k) after `starts` (n, 6).

    NaN where a start is not finite, as after extrapolating a flight back with an impossible drag.
    """
    possible = np.isfinite(starts).all(axis=1)
    starts, times_s = np.where(possible[:, None], starts, 0.0), np.where(possible[:, None], times_s, 0.0)
    limits = times_s[:, -1] + 1e-9
    samples = run_world(
        world, starts, impacts.block, time_limit_s=limits, times_s=times_s, step_fraction=step_fraction
    ).samples
    samples[~possible] = np.nan
    return samples


def outcomes(
    world: World,
    impacts: Impacts,
    states: States,
    shift: Array | None = None,
    step_fraction: float = BATCH_STEP_FRACTION,
) -> Array:
    """(n, 6) simulated - measured at the beginning of the next flight: along the ground, across it (m), angle (rad),
    then their rates. `shift` (6,) or (n, 6) is added to the states before the impacts; `step_fraction`: see
    `run_batch`."""
    scale = world.view.time_scale
    starts = move_freely(world, impacts.block, states.middle[impacts.before], impacts.start_s * scale)
    if shift is not None:
        starts = starts + shift
    moments = np.linspace(0.0, 1.0, COMPARED_INSTANTS) * impacts.window_s[:, None]
    pivot = None
    if world.slope_rad.any():
        # a ground with this additional slope is equivalent to the stated ground with the motion turned the other way
        after = move_freely(world, impacts.block, states.middle[impacts.after], impacts.begin_s * scale)
        pivot = after[:, POSITION]
        starts = turned(starts, pivot, -world.slope_rad)
    simulated = simulate(world, impacts, starts, (impacts.wait_s[:, None] + moments) * scale, step_fraction)
    if pivot is not None:
        simulated = turned(simulated, pivot[:, None], world.slope_rad[:, None])
    measured = move_freely(
        world,
        np.repeat(impacts.block, COMPARED_INSTANTS),
        np.repeat(states.middle[impacts.after], COMPARED_INSTANTS, axis=0),
        ((impacts.begin_s[:, None] + moments) * scale).ravel(),
    )[:, POSE].reshape(len(impacts), COMPARED_INSTANTS, POSE_SIZE)
    difference = simulated - measured
    t = moments * scale
    centred = t - t.mean(axis=1, keepdims=True)
    rate = (centred[..., None] * difference).sum(axis=1) / (centred**2).sum(axis=1)[:, None]
    level = difference.mean(axis=1) - rate * t.mean(axis=1)[:, None]
    return np.column_stack([
        *ground_axes(impacts.tangent, level[:, POSITION]), level[:, THETA],
        *ground_axes(impacts.tangent, rate[:, POSITION]), rate[:, THETA],
    ])  # fmt: skip


def turned(states: Array, pivot: Array, angle: Array) -> Array:
    """States or poses (..., 3 or 6) turned about a pivot (..., 2)."""
    out = states.copy()
    c, s = np.cos(angle), np.sin(angle)
    dx, dy = states[..., X] - pivot[..., X], states[..., Y] - pivot[..., Y]
    out[..., X], out[..., Y] = pivot[..., X] + c * dx - s * dy, pivot[..., Y] + s * dx + c * dy
    out[..., THETA] += angle
    if states.shape[-1] == STATE_SIZE:
        vx, vy = states[..., VX], states[..., VY]
        out[..., VX], out[..., VY] = c * vx - s * vy, s * vx + c * vy
    return out
