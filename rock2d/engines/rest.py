"""Detection of rest in the engines of the contact law, compiled."""

import numpy as np

from rock2d.compiled import kernel
from rock2d.engines.contact_state import (
    ACTIVE,
    DEPTH,
    INDEX,
    KIND,
    OFFSET,
    PART,
    PEAK,
    ROTATION,
    ZONE,
    kinetic_energy,
    stored_energy,
)
from rock2d.engines.geometry import SMOOTH_FACET, contact_point, is_ball, pose_of
from rock2d.laws.contact import K_L, K_R, K_UL, MU, normal_force
from rock2d.records.columns import VX, VY, X, Y

# A block is at rest after two windows of REST_WINDOW √(radius/g) in contact if it stays within a box of REST_BOX radii
# in the second one, with a net motion below REST_DRIFT radii that exceeds that of the first by at most 5 % and
# REST_GROWTH radii. The law has no damping below its thresholds: a resting block keeps an elastic tremor that lowers
# the friction limit again and again, so that it creeps without gaining speed. A block that slides above the friction
# angle, or tips, gains speed. A ball that oscillates on its rolling spring stays in its box, but has more energy than
# REST_ENERGY m g radius.
REST_WINDOW, REST_BOX, REST_DRIFT, REST_GROWTH, REST_ENERGY = 2.0, 0.6, 0.4, 0.01, 0.25
HOLDING_SHARE = 0.7  # share of the friction that must hold a captured block; the rest stops it
# largest energy of a captured block, in weight × radius: with more, tremor may lift it off its contacts and move it on
CAPTURE_ENERGY = 0.02
LARGEST_FRICTION = 100.0  # friction coefficient used for friction without limit
# columns of an observation: start time of the window, x and y there, bounds x_min, x_max, y_min, y_max, largest kinetic
# energy, net motion of the window before
W_TIME, W_X, W_Y, W_LOW_X, W_HIGH_X, W_LOW_Y, W_HIGH_Y, W_KINETIC, W_BEFORE = range(9)
N_WATCH = W_BEFORE + 1


@kernel
def forget_rest(watch):
    """The block is not in contact: restart the observation."""
    watch[W_TIME] = -1.0
    watch[W_BEFORE] = np.inf


@kernel
def watch_rest(watch, t, q, body):
    """Update the observation with the state at time t of a block in contact; True if it is at rest (see
    REST_WINDOW)."""
    x, y, radius, gravity = q[X], q[Y], body.block.radius, body.gravity
    if watch[W_TIME] < 0.0:
        watch[W_TIME], watch[W_X], watch[W_Y] = t, x, y
        watch[W_LOW_X], watch[W_HIGH_X], watch[W_LOW_Y], watch[W_HIGH_Y] = x, x, y, y
        watch[W_KINETIC] = 0.0
    watch[W_KINETIC] = max(watch[W_KINETIC], kinetic_energy(q, body.block))
    watch[W_LOW_X], watch[W_HIGH_X] = min(watch[W_LOW_X], x), max(watch[W_HIGH_X], x)
    watch[W_LOW_Y], watch[W_HIGH_Y] = min(watch[W_LOW_Y], y), max(watch[W_HIGH_Y], y)
    if t - watch[W_TIME] < REST_WINDOW * np.sqrt(radius / max(gravity, 1e-9)):
        return False
    net = np.sqrt((x - watch[W_X]) ** 2 + (y - watch[W_Y]) ** 2)
    box = max(watch[W_HIGH_X] - watch[W_LOW_X], watch[W_HIGH_Y] - watch[W_LOW_Y])
    steady = net < min(REST_DRIFT * radius, 1.05 * watch[W_BEFORE] + REST_GROWTH * radius)
    at_rest = steady and watch[W_BEFORE] < np.inf and box < REST_BOX * radius
    at_rest = at_rest and watch[W_KINETIC] < REST_ENERGY * body.block.mass * gravity * radius
    watch[W_TIME], watch[W_BEFORE] = -1.0, net
    return at_rest


@kernel
def captured(q, world, memory):
    """Whether the remaining energy is at most CAPTURE_ENERGY and cannot move the block farther than REST_DRIFT radii.
    The endless creep of a trembling block does not count.

    Either the block stands on contacts to the left and right of its centroid, which hold it with HOLDING_SHARE of the
    friction (the rest stops it within that distance), and has less than half the energy to tip over the nearer one. Or
    it is a ball that friction holds, that cannot leave its indentation, and that its rolling spring turns back."""
    block, ground, law, ints, reals = world.block, world.ground, world.law, memory.ints, memory.reals
    energy = kinetic_energy(q, block) + stored_energy(memory, law)
    weight, radius = block.mass * world.gravity, block.radius
    if energy > CAPTURE_ENERGY * weight * radius:
        return False
    pose = pose_of(q)
    left, right, count, last = -1, -1, 0, -1  # outermost contacts, number of contacts, last contact
    left_x, right_x = 0.0, 0.0
    for j in range(ints.shape[0]):
        if ints[j, ACTIVE]:
            _, _, _, rx, _ = contact_point(ints[j, KIND], ints[j, INDEX], ints[j, PART], pose, block, ground)
            if rx < left_x:
                left, left_x = j, rx
            if rx > right_x:
                right, right_x = j, rx
            count, last = count + 1, j
    if left >= 0 and right >= 0:
        support = min(-left_x, right_x)
        if energy > 0.25 * weight * support * support / radius:
            return False
        low1, high1, y1, mu1 = _force_slopes(left, pose, world, ints)
        low2, high2, y2, mu2 = _force_slopes(right, pose, world, ints)
        if energy > REST_DRIFT * radius * weight * (1.0 - HOLDING_SHARE) * min(mu1, mu2):
            return False
        return _stands((left_x, y1, low1, high1), (right_x, y2, low2, high2))
    j = last
    if count != 1 or ints[j, KIND] != SMOOTH_FACET or not is_ball(block):
        return False
    p = law[ints[j, ZONE]]
    depth, nx, ny, _, _ = contact_point(ints[j, KIND], ints[j, INDEX], ints[j, PART], pose, block, ground)
    if p[K_R] <= 0.0 or ny <= 0.0 or energy > REST_DRIFT * radius * weight * (p[MU] * ny - abs(nx)):
        return False
    force = normal_force(reals[j, DEPTH] - reals[j, OFFSET], reals[j, PEAK], p[K_L], p[K_UL])
    v_n = q[VX] * nx + q[VY] * ny
    if 0.5 * (block.mass * v_n * v_n + force * force / p[K_UL]) >= weight * ny * depth:
        return False
    pull = weight * abs(nx) * radius
    swing = np.sqrt(pull * pull + 2.0 * p[K_R] * (energy + pull * abs(reals[j, ROTATION]))) / p[K_R]
    return swing < REST_DRIFT


@kernel
def _force_slopes(j, pose, world, ints):
    """(least and greatest ratio of horizontal to upward force, height of contact j above the centroid in m, friction
    coefficient), within HOLDING_SHARE of the friction cone. The range is empty if the cone does not point upward."""
    _, nx, ny, _, ry = contact_point(ints[j, KIND], ints[j, INDEX], ints[j, PART], pose, world.block, world.ground)
    mu = min(world.law[ints[j, ZONE], MU], LARGEST_FRICTION)
    most = HOLDING_SHARE * mu
    if ny - most * abs(nx) <= 0.0:
        return 1.0, -1.0, ry, mu
    return (nx - most * ny) / (ny + most * nx), (nx + most * ny) / (ny - most * nx), ry, mu


@kernel
def _stands(first, second):
    """Whether two contacts can hold a unit weight at the origin with forces within their ranges of slopes.

    first, second : (x, y, least slope, greatest slope), the first left and the second right of the origin

    The horizontal forces are H and -H, the upward forces f1 = a - b H and f2 = 1 - f1. There must be an H with
    low1 f1 <= H <= high1 f1, low2 f2 <= -H <= high2 f2, f1 >= 0 and f2 >= 0, which are all linear in H."""
    x1, y1, low1, high1 = first
    x2, y2, low2, high2 = second
    if low1 > high1 or low2 > high2:
        return False
    a, b = x2 / (x2 - x1), (y1 - y2) / (x2 - x1)
    least, most = -np.inf, np.inf
    for u, v in (  # u + v H >= 0
        (-low1 * a, 1.0 + low1 * b), (high1 * a, -1.0 - high1 * b), (-low2 * (1.0 - a), -1.0 - low2 * b),
        (high2 * (1.0 - a), 1.0 + high2 * b), (a, -b), (1.0 - a, b),
    ):  # fmt: skip
        if v > 0.0:
            least = max(least, -u / v)
        elif v < 0.0:
            most = min(most, -u / v)
        elif u < 0.0:
            return False
    return least <= most
