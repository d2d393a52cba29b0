"""Impacts on a ground whose slope differs from that of its facet where a block first strikes.

The ground is turned about the point that is touched first, until the block has left it again: each strike finds another
slope on a rough ground. A turned ground is equivalent to the stated one with the motion turned the other way. Gravity
is turned with it, which is corrected afterwards."""

from typing import NamedTuple

import numpy as np

from rock2d.arrays import Array
from rock2d.engines.batch import BATCH_STEP_FRACTION, BatchResult, run_world
from rock2d.kinematics.flights import block_clearances
from rock2d.kinematics.states import move_freely
from rock2d.laws.contact import K_L, K_UL
from rock2d.records.columns import (
    BEFORE,
    I_TIME,
    I_TIME_AFTER,
    INSTANT_STATE,
    LINEAR_VELOCITY,
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


class TurnedRun(NamedTuple):
    """Motion of n releases: poses (n, k, 3) at given instants, states (n, 6) at the end, instants (n, i) of impacts;
    displacements (n,) in m of recoiling ground, by which only the poses are moved."""

    samples: Array
    ends: Array
    impacts_s: Array
    ground_shift_m: Array


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
    touch = run_world(world, starts, block, time_limit_s=limits_s, impact_limit=1, impact_room=1).impacts[:, 0]
    strikes = np.isfinite(touch[:, I_TIME])
    slope, touch_s = np.where(strikes, world.slope_rad, 0.0), np.where(strikes, touch[:, I_TIME], 0.0)
    touching = np.where(strikes[:, None], touch[:, BEFORE], starts)
    pivot = touched_points(world, block, touching[:, POSE])
    near = lifted(world, block, move_freely(world, block, turned(touching, pivot, -slope), -touch_s))

    def run(
        states: Array, until_s: Array, instants_s: Array, impact_limit: int = 0, room: int = impact_room
    ) -> BatchResult:
        return run_world(
            world, states, block, time_limit_s=until_s, times_s=instants_s, step_fraction=step_fraction,
            impact_limit=impact_limit, impact_room=room,
        )  # fmt: skip

    # until the block is clear of its indentation, and has not struck again; mostly the expected instant is late enough
    approach, contact = approach_s(world, block), _expected_contact_s(world, block)
    back_s = np.minimum(touch_s + contact + approach, limits_s)
    first = run(near, back_s, times_s)
    samples, ends, impacts_s = first.samples, first.ends[:, INSTANT_STATE], first.impacts[..., I_TIME]
    left_s, shift_m = first.impacts[:, 0, I_TIME_AFTER], first.ground_shift_m
    again = (first.impact_count > 1) | ((back_s < limits_s) & ~(left_s + 0.5 * approach <= back_s))
    if again.any():
        later = run(near, np.where(again, limits_s, 0.0), times_s[:, :0], impact_limit=2, room=2).impacts
        left_s = np.where(again, later[:, 0, I_TIME_AFTER], left_s)
        back_s = np.where(again, np.fmin(np.fmin(left_s + approach, later[:, 1, I_TIME]), limits_s), back_s)
        other = run(near, np.where(again, back_s, 0.0), times_s)
        samples = np.where(again[:, None, None], other.samples, samples)
        ends = np.where(again[:, None], other.ends[:, INSTANT_STATE], ends)
        impacts_s = np.where(again[:, None], other.impacts[..., I_TIME], impacts_s)
        shift_m = np.where(again, other.ground_shift_m, shift_m)
    # the time of contact counts as flight, but not that for which a block lies on the ground
    flies_s = np.where(np.isnan(impacts_s[:, 0]), touch_s, np.fmax(np.fmin(left_s, back_s) - contact, touch_s))
    flight = _Flights(world.gravity_m_s2, slope, touch_s, flies_s)
    onward = run(
        lifted(world, block, flight.with_true_gravity(turned(ends, pivot, slope), back_s)), limits_s - back_s,
        np.maximum(times_s - back_s[:, None], 0.0),
    )  # fmt: skip
    samples = flight.with_true_gravity(turned(samples, pivot[:, None], slope[:, None]), times_s)
    onward.samples[..., X] += shift_m[:, None]
    return TurnedRun(
        np.where((times_s > back_s[:, None])[..., None], onward.samples, samples),
        onward.ends[:, INSTANT_STATE],
        np.hstack([impacts_s, back_s[:, None] + onward.impacts[..., I_TIME]]),
        shift_m + onward.ground_shift_m,
    )


class _Flights(NamedTuple):
    """Parts of a simulated motion in which the block flies: before `touch_s` and after `flies_s` (n,). The motion was
    turned back by `slope` (n,), and its gravity with it."""

    gravity_m_s2: float
    slope: Array
    touch_s: Array
    flies_s: Array

    def with_true_gravity(self, states: Array, times_s: Array) -> Array:
        """States or poses (n, ..., 3 or 6) at `times_s` (n, ...) as under the true gravity."""
        shape = (-1,) + (1,) * (times_s.ndim - 1)
        slope, touch_s, flies_s = (own.reshape(shape) for own in (self.slope, self.touch_s, self.flies_s))
        flown_s = np.minimum(times_s - touch_s, 0.0) + np.maximum(times_s - flies_s, 0.0)
        change = self.gravity_m_s2 * np.stack([-np.sin(slope), np.cos(slope) - 1.0], axis=-1)
        out = states.copy()
        out[..., POSITION] += 0.5 * change * flown_s[..., None] ** 2
        if states.shape[-1] == N_STATE:
            out[..., LINEAR_VELOCITY] += change * flown_s[..., None]
        return out


def _expected_contact_s(world: World, block: Array) -> Array:
    """(n,) duration of an impact on linear springs in which the whole block is pressed."""
    mass = np.array([b.mass_kg for b in world.blocks.values()])[block]
    k_l, k_ul = world.contact[..., [K_L, K_UL]].min(axis=1).T
    return np.asarray(np.pi / 2.0 * (np.sqrt(mass / k_l) + np.sqrt(mass / k_ul)))


def approach_s(world: World, block: Array) -> Array:
    """(n,) time before and after an impact, in s, for which blocks fly on a turned ground; see APPROACH."""
    return APPROACH * np.sqrt(world.radii_m[block] / max(world.gravity_m_s2, 1e-3))


def touched_points(world: World, block: Array, touching: Array) -> Array:
    """(n, 2) points on the normals through the points where blocks in the poses `touching` (n, 3) touch the ground. To
    first order, a turn about any point of a normal moves a facet equally."""
    # a turn about the centre raises a point of the block by its distance from the centre along the ground
    ahead, radius = _change(world, block, touching, THETA, np.full(len(block), TURN_STEP_RAD)), world.radii_m[block]
    along = _normals(world, block, touching)[:, [Y, X]] * [1.0, -1.0]
    return np.asarray(touching[:, POSITION] + np.clip(ahead, -radius, radius)[:, None] * along)


def lifted(world: World, block: Array, states: Array) -> Array:
    """The states (n, 6), with blocks that are inside the ground moved out of it along its normal."""
    depth, out = -block_clearances(world, block, states[:, POSE]), states.copy()
    if (inside := depth > 0.0).any():
        out[inside, POSITION] += depth[inside, None] * _normals(world, block[inside], states[inside, POSE])
    return out


def _normals(world: World, block: Array, poses: Array) -> Array:
    """(n, 2) directions in which blocks in `poses` (n, 3) move away from the ground."""
    step = SHIFT_STEP_RADII * world.radii_m[block]
    away = np.column_stack([_change(world, block, poses, column, step) for column in (X, Y)])
    return np.asarray(away / np.maximum(np.linalg.norm(away, axis=1, keepdims=True), 1e-9))


def _change(world: World, block: Array, poses: Array, column: int, step: Array) -> Array:
    """(n,) change of the clearance with a column of `poses`, by steps (n,)."""
    moved = poses + np.multiply.outer(step, np.arange(N_POSE) == column)
    return (block_clearances(world, block, moved) - block_clearances(world, block, poses)) / step


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
