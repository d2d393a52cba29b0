"""When a block in contact has come to rest, compiled; one rule for every engine."""

from __future__ import annotations

import numpy as np

from rock2d.compiled import njit
from rock2d.contact import K_R, K_UL, MU, normal_force
from rock2d.engines.slots import ACTIVE, DEPTH, DEPTH_MAX, INDEX, KIND, OFFSET, PART, ROTATION, ZONE
from rock2d.engines.stepper import stored_energy
from rock2d.geometry import SMOOTH_FACET, contact_point

# At rest: for two windows of REST_WINDOW √(radius/g) in contact, the second within a box of REST_BOX radii, its net
# motion below REST_DRIFT radii and at most 5 % and REST_GROWTH radii more than the first's. The law has no damping
# below its thresholds: a resting block keeps an elastic tremor that lifts the friction limit off and on, so that it
# creeps without gaining speed. What slides above the friction angle, or tips, gains speed.
REST_WINDOW, REST_BOX, REST_DRIFT, REST_GROWTH = 2.0, 0.6, 0.4, 0.01
# what is watched: begin, x and y there, bounds x_min, x_max, y_min, y_max, net motion of the window before
W_TIME, W_X, W_Y, W_LOW_X, W_HIGH_X, W_LOW_Y, W_HIGH_Y, W_BEFORE = range(8)


@njit
def forget_rest(watch):
    """The block is not in contact: begin to watch anew."""
    watch[W_TIME] = -1.0
    watch[W_BEFORE] = np.inf


@njit
def watch_rest(watch, t, q, radius, gravity):
    """Note the state at time t of a block in contact; True if it has come to rest (see REST_WINDOW)."""
    x, y = q[0], q[1]
    if watch[W_TIME] < 0.0:
        watch[W_TIME], watch[W_X], watch[W_Y] = t, x, y
        watch[W_LOW_X], watch[W_HIGH_X], watch[W_LOW_Y], watch[W_HIGH_Y] = x, x, y, y
    watch[W_LOW_X], watch[W_HIGH_X] = min(watch[W_LOW_X], x), max(watch[W_HIGH_X], x)
    watch[W_LOW_Y], watch[W_HIGH_Y] = min(watch[W_LOW_Y], y), max(watch[W_HIGH_Y], y)
    if t - watch[W_TIME] < REST_WINDOW * np.sqrt(radius / max(gravity, 1e-9)):
        return False
    net = np.sqrt((x - watch[W_X]) ** 2 + (y - watch[W_Y]) ** 2)
    box = max(watch[W_HIGH_X] - watch[W_LOW_X], watch[W_HIGH_Y] - watch[W_LOW_Y])
    steady = net < min(REST_DRIFT * radius, 1.05 * watch[W_BEFORE] + REST_GROWTH * radius)
    at_rest = steady and watch[W_BEFORE] < np.inf and box < REST_BOX * radius
    watch[W_TIME], watch[W_BEFORE] = -1.0, net
    return at_rest


CAPTURED_DRIFT = 0.2  # radii that a captured block can still go


@njit
def captured(q, gravity, terrain, block, params, ints, reals):
    """True if the energy that is left cannot carry the block farther than CAPTURED_DRIFT radii.

    That is so if friction holds it at every contact against the slope and stops it within that way, and it cannot
    roll away: it stands on contacts left and right of its centroid and has not half the energy to tip over the
    nearer, or it is a ball that cannot leave its crater and whose rolling spring turns it back.
    """
    energy = 0.5 * (block.mass * (q[3] * q[3] + q[4] * q[4]) + block.inertia * q[5] * q[5])
    energy += stored_energy(ints, reals, params)
    weight, radius = block.mass * gravity, block.radius
    if energy > weight * radius:
        return False
    c, s = np.cos(q[2]), np.sin(q[2])
    left, right, hold, count, last = 0.0, 0.0, np.inf, 0, 0
    for j in range(ints.shape[0]):
        if ints[j, ACTIVE]:
            _, nx, ny, rx, _ = contact_point(
                ints[j, KIND], ints[j, INDEX], ints[j, PART], q[0], q[1], c, s, block, terrain
            )
            left, right = max(left, -rx), max(right, rx)
            hold = min(hold, params[ints[j, ZONE], MU] * ny - abs(nx))
            count, last = count + 1, j
    if count == 0 or hold <= 0.0 or energy > CAPTURED_DRIFT * radius * weight * hold:
        return False
    support = min(left, right)
    if count > 1:
        return energy < 0.25 * weight * support * support / radius
    j = last
    p = params[ints[j, ZONE]]
    if ints[j, KIND] != SMOOTH_FACET or block.semi_a != block.semi_b or p[K_R] <= 0.0:
        return False
    depth, nx, ny, _, _ = contact_point(SMOOTH_FACET, ints[j, INDEX], 0, q[0], q[1], c, s, block, terrain)
    force = normal_force(reals[j, DEPTH] - reals[j, OFFSET], reals[j, DEPTH_MAX], p[0], p[K_UL])
    v_n = q[3] * nx + q[4] * ny
    if 0.5 * (block.mass * v_n * v_n + force * force / p[K_UL]) >= weight * ny * depth:
        return False
    pull = weight * abs(nx) * radius
    swing = np.sqrt(pull * pull + 2.0 * p[K_R] * (energy + pull * abs(reals[j, ROTATION]))) / p[K_R]
    return swing < CAPTURED_DRIFT
