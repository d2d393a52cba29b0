"""Impacts on a ground whose slope differs from that of its facet where a block first strikes.

The ground is turned about the point that is touched first, until the block has left it again: each strike finds another
slope on a rough ground. A turned ground is equivalent to the stated one with the motion turned the other way."""

from typing import NamedTuple

import numpy as np

from rock2d.arrays import Array
from rock2d.engines.batch import BATCH_STEP_FRACTION, BatchResult, run_world
from rock2d.kinematics.flights import block_clearances
from rock2d.kinematics.states import move_freely
from rock2d.laws.contact import K_L, K_UL
from rock2d.records.columns import (
    I_TIME,
    I_TIME_AFTER,
    INSTANT_STATE,
    N_POSE,
    N_STATE,
    POSE,
    POSITION,
    THETA,
    VX,
    VY,
    X,
    Y,
)
from rock2d.scene.world import World

APPROACH = 0.3  # time before and after an impact with a turned ground, in √(radius / g)
TURN_STEP_RAD, SHIFT_STEP_RADII = 1e-4, 1e-4  # for derivatives of clearances
TOUCH_STEP, TOUCH_ITERATIONS = 1e-3, 3  # step for the derivative by time, in APPROACH; iterations for the touch
SLOWEST_M_S = 0.05  # speed of a slower block towards the ground


class TurnedRun(NamedTuple):
    """Motion of n releases: poses (n, k, 3) at given instants, states (n, 6) at the end, instants (n, i) of impacts."""

    samples: Array
    ends: Array
    impacts_s: Array


def run_on_turned_ground(
    world: World,
    block: Array,
    starts: Array,
    limits_s: Array,
    times_s: Array,
    step_fraction: float = BATCH_STEP_FRACTION,
    impact_room: int = 2,
) -> TurnedRun:
    """Run releases that soon strike a ground with the further slope `world.slope_rad`.

    `block` (n,): indices of the blocks; `starts` (n, 6): states shortly before the first impact; `limits_s` (n,): ends
    of the runs; `times_s` (n, k): instants of the samples; `impact_room`: largest number of impacts of either part."""
    slope = np.broadcast_to(world.slope_rad, len(block))
    pivot, touch_s = touches(world, block, starts, limits_s)
    near = turned(starts, pivot, -slope)

    def run(states: Array, until_s: Array, instants_s: Array, **more: int) -> BatchResult:
        more = {"impact_room": impact_room} | more
        return run_world(
            world, states, block, time_limit_s=until_s, times_s=instants_s, step_fraction=step_fraction, **more
        )

    # until the block is clear of its indentation, and has not struck again; mostly the expected instant serves
    back_s = np.minimum(touch_s + _contact_s(world, block) + approach_s(world, block), limits_s)
    first = run(near, back_s, times_s)
    samples, ends, impacts_s = first.samples, first.ends[:, INSTANT_STATE], first.impacts[..., I_TIME]
    again = (back_s < limits_s) & ~((first.impact_count == 1) & np.isfinite(first.impacts[:, 0, I_TIME_AFTER]))
    if again.any():
        strikes = run(near, np.where(again, limits_s, 0.0), times_s[:, :0], impact_limit=2, impact_room=2).impacts
        clear_s = np.fmin(strikes[:, 0, I_TIME_AFTER] + approach_s(world, block), strikes[:, 1, I_TIME])
        back_s = np.where(again, np.fmin(clear_s, limits_s), back_s)
        other = run(near, np.where(again, back_s, 0.0), times_s)
        samples = np.where(again[:, None, None], other.samples, samples)
        ends = np.where(again[:, None], other.ends[:, INSTANT_STATE], ends)
        impacts_s = np.where(again[:, None], other.impacts[..., I_TIME], impacts_s)
    onward = run(turned(ends, pivot, slope), limits_s - back_s, np.maximum(times_s - back_s[:, None], 0.0))
    late = (times_s > back_s[:, None])[..., None]
    return TurnedRun(
        np.where(late, onward.samples, turned(samples, pivot[:, None], slope[:, None])),
        onward.ends[:, INSTANT_STATE],
        np.hstack([impacts_s, back_s[:, None] + onward.impacts[..., I_TIME]]),
    )


def _contact_s(world: World, block: Array) -> Array:
    """(n,) longest duration of an impact on linear springs, half of a period, in which the whole block is pressed."""
    mass = np.array([b.mass_kg for b in world.blocks.values()])[block]
    softest = world.contact[..., [K_L, K_UL]].min(axis=(0, 1))
    return np.asarray(np.pi / 2.0 * (np.sqrt(mass / softest[0]) + np.sqrt(mass / softest[1])))


def approach_s(world: World, block: Array) -> Array:
    """(n,) APPROACH in s."""
    return APPROACH * np.sqrt(_radii(world, block) / world.gravity_m_s2)


def touches(world: World, block: Array, starts: Array, longest_s: Array) -> tuple[Array, Array]:
    """Where and when blocks from `starts` (n, 6) first touch the ground, within `longest_s` (n,): (n, 2) points on the
    normals through the touched points, (n,) times. A turn about any point of a normal moves a facet equally."""
    radius = _radii(world, block)
    wait_s, step_s = np.zeros(len(block)), TOUCH_STEP * approach_s(world, block)

    def clearance(pose: Array) -> Array:
        return block_clearances(world, block, pose)

    def moved(time_s: Array) -> Array:
        return move_freely(world, block, starts, time_s)[:, POSE]

    for _ in range(TOUCH_ITERATIONS):  # Newton's method
        gap = clearance(moved(wait_s))
        closing = np.maximum((gap - clearance(moved(wait_s + step_s))) / step_s, SLOWEST_M_S)
        wait_s = np.clip(wait_s + gap / closing, 0.0, longest_s)
    touching = moved(wait_s)

    def change(column: int, step: Array | float) -> Array:
        other = touching + np.multiply.outer(step, np.arange(N_POSE) == column)
        return (clearance(other) - clearance(touching)) / step

    shift = SHIFT_STEP_RADII * radius
    normal = np.column_stack([change(X, shift), change(Y, shift)])
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-9)
    # a turn about the centre raises a point of the block by its distance from the centre along the ground
    ahead = np.clip(change(THETA, TURN_STEP_RAD), -radius, radius)
    return touching[:, POSITION] + ahead[:, None] * normal[:, [Y, X]] * [1.0, -1.0], wait_s


def _radii(world: World, block: Array) -> Array:
    return np.array([b.radius_m for b in world.blocks.values()])[block]


def turned(states: Array, pivot: Array, angle: Array) -> Array:
    """States or poses (..., 3 or 6) turned about a pivot (..., 2)."""
    out = states.copy()
    c, s = np.cos(angle), np.sin(angle)
    dx, dy = states[..., X] - pivot[..., X], states[..., Y] - pivot[..., Y]
    out[..., X], out[..., Y] = pivot[..., X] + c * dx - s * dy, pivot[..., Y] + s * dx + c * dy
    out[..., THETA] += angle
    if states.shape[-1] == N_STATE:
        vx, vy = states[..., VX], states[..., VY]
        out[..., VX], out[..., VY] = c * vx - s * vy, s * vx + c * vy
    return out
