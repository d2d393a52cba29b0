"""The first event within a trial step: of the law, or where a contact begins, ends or changes its feature, compiled."""

import numpy as np

from rock2d.compiled import kernel
from rock2d.effects.columns import ANY_EFFECT_ACTS, FIRST_EFFECT_COLUMN
from rock2d.effects.forces import normal
from rock2d.engines.contact_search import changes_feature
from rock2d.engines.contact_state import (
    ACTIVE,
    DEPTH,
    INDEX,
    KEY,
    KIND,
    LEAST_EVENT,
    NOWHERE,
    OFFSET,
    PART,
    PEAK,
    RATE,
    ZONE,
)
from rock2d.engines.geometry import (
    CORNER_VERTEX,
    CORNER_X,
    CORNER_Y,
    POINT_X,
    POINT_Y,
    SMOOTH_FACET,
    SMOOTH_VERTEX,
    TANGENT_X,
    TANGENT_Y,
    beyond_corner,
    contact_point,
    depth_rate,
    pose_of,
)
from rock2d.laws.contact import K_L, K_UL, normal_force, residual_indentation
from rock2d.records.columns import OMEGA, THETA, VX, VY, X, Y

# repetitions of a step to land on an event: near a vertex a cubic approximates the motion badly
MOST_LANDINGS = 8
LEAST_GAP = 1e-12  # gap between two features as a share of the radius: larger than rounding
LANDED = 0.99  # share of a step: a later event is the one on which the step has landed


@kernel(forceinline=True)
def lands(event_s, h, landings):
    """Whether a step of h (s), repeated `landings` times so far, is repeated to land on the event at `event_s`."""
    return event_s < h and landings < MOST_LANDINGS and (landings == 0 or event_s <= LANDED * h)


@kernel(forceinline=True)
def later(t, dt):
    """t + dt in s, but always later than t: a step to an event just before a time limit can be shorter than the
    resolution of t, and would be repeated for ever."""
    return max(t + dt, np.nextafter(t, np.inf))


@kernel
def hermite_root(g0, r0, g1, r1, h):
    """Time in (0, h) just after the sign change of the cubic through (g0, rate r0) and (g1, rate r1)."""
    a1, a2, a3 = h * r0, 3.0 * (g1 - g0) - h * (2.0 * r0 + r1), 2.0 * (g0 - g1) + h * (r0 + r1)
    low, high = 0.0, 1.0
    s = g0 / (g0 - g1)
    for _ in range(60):
        value = g0 + s * (a1 + s * (a2 + s * a3))
        if (value > 0.0) == (g1 > 0.0):
            high = s
        else:
            low = s
        rate = a1 + s * (2.0 * a2 + 3.0 * a3 * s)
        ahead = s - value / rate if rate != 0.0 else -1.0
        if not low <= ahead <= high:
            ahead = 0.5 * (low + high)
        if abs(ahead - s) < 1e-14:
            break
        s = ahead
    return min(1.0, ahead + 1e-14) * h


@kernel
def turning_time(g0, r0, g1, r1, h):
    """Time in (0, h) of the extremum of the cubic through (g0, rate r0) and (g1, rate r1 of the other sign)."""
    a1, a2, a3 = h * r0, 3.0 * (g1 - g0) - h * (2.0 * r0 + r1), 2.0 * (g0 - g1) + h * (r0 + r1)
    # the rate a1 + 2 a2 s + 3 a3 s² has one zero in (0, 1), because r0 > 0 > r1; this form avoids cancellation
    root = np.sqrt(max(a2 * a2 - 3.0 * a1 * a3, 0.0))
    s = a1 / (root - a2) if a2 < 0.0 else (-a2 - root) / (3.0 * a3)
    return h * s if 0.0 < s < 1.0 else h * r0 / (r0 - r1)


@kernel
def law_event(d0, r0, d1, r1, peak, bottom, h):
    """Time in (0, h] at which a contact reaches its deepest point, its former peak, or the bottom of its
    indentation; h if it does not. For an unpressed contact also the top of a hop, so that its way down is not missed.

    d, r : penetration in m and its rate before and after the step; peak : peak penetration; bottom : residual
    indentation"""
    if d0 >= peak and r0 > 0.0 and r1 < 0.0:
        return turning_time(d0, r0, d1, r1, h)
    if (d0 > bottom) != (d1 > bottom):
        return hermite_root(d0 - bottom, r0, d1 - bottom, r1, h)
    if d0 < peak < d1:
        return hermite_root(d0 - peak, r0, d1 - peak, r1, h)
    if d0 <= bottom and r0 < 0.0 < r1:
        return h * r0 / (r0 - r1)
    return h


@kernel
def force_limit_event(law, row, first, ends, memory, h, whole):
    """Time in (0, h] at which the force of a pressed contact with effects reaches or leaves its lower limit 0; h if it
    does not, or if the step has landed there. `row`, `first` as in `forces.ground_forces`.

    law : row of CONTACT_LAW_COLUMNS; ends : (penetration in m, its rate in m/s) before and after the step
    memory : (peak penetration, bottom of the indentation) in m"""
    ((d0, r0), (d1, r1)), (peak, bottom) = ends, memory
    if d0 < bottom or d1 < bottom:
        return h
    force0 = normal_force(d0, peak, law[K_L], law[K_UL])
    force1 = normal_force(d1, peak, law[K_L], law[K_UL])
    whole0 = force0 + normal(row, first, d0, r0, peak, bottom, force0)
    whole1 = force1 + normal(row, first, d1, r1, max(peak, d1), bottom, force1)
    if (whole0 > 0.0) == (whole1 > 0.0):
        return h
    t = h * whole0 / (whole0 - whole1)
    return t if t > LEAST_EVENT * whole else h


@kernel
def _depth_and_rate(j, q, world, memory):
    """Depth in m of contact j at its own feature, and its rate in m/s."""
    ints = memory.ints
    depth, nx, ny, rx, ry = contact_point(
        ints[j, KIND], ints[j, INDEX], ints[j, PART], pose_of(q), world.block, world.ground
    )
    return depth, depth_rate(q, nx, ny, rx, ry)


@kernel
def _gap_to_found(j, q, world, memory, found):
    """A distance in m that changes sign when contact j passes from its feature to the one found for it, and its rate.

    Between two facets or faces: the difference of the depths. Between a facet and its vertex: the distance of the foot
    of the contact point from the end of the facet, because there the depths touch without crossing."""
    block, ground, ints, found_i = world.block, world.ground, memory.ints, found.ints
    pose = pose_of(q)
    _, _, c, s = pose
    d0, nx, ny, rx, ry = contact_point(ints[j, KIND], ints[j, INDEX], ints[j, PART], pose, block, ground)
    vx, vy = q[VX] - q[OMEGA] * ry, q[VY] + q[OMEGA] * rx
    if ints[j, KIND] != found_i[j, KIND]:
        facet, vertex = ints[j, INDEX], found_i[j, INDEX]
        if ints[j, KIND] in (CORNER_VERTEX, SMOOTH_VERTEX):
            facet, vertex = vertex, facet
        if ints[j, KIND] == SMOOTH_VERTEX:
            _, _, _, rx, ry = contact_point(np.int64(SMOOTH_FACET), facet, np.int64(0), pose, block, ground)
        elif ints[j, KIND] <= CORNER_VERTEX:  # the centre of a rounded corner, above the foot
            rx, ry = rx + block.rounding * nx, ry + block.rounding * ny
            vx, vy = q[VX] - q[OMEGA] * ry, q[VY] + q[OMEGA] * rx
        facets = ground.facets
        tx, ty = facets[facet, TANGENT_X], facets[facet, TANGENT_Y]
        dx, dy = q[X] + rx - facets[vertex, POINT_X], q[Y] + ry - facets[vertex, POINT_Y]
        if ints[j, KIND] >= SMOOTH_FACET:
            # the foot moves with the centre of the profile, not with the material
            vx = q[VX] - q[OMEGA] * (s * block.centre_x + c * block.centre_y)
            vy = q[VY] + q[OMEGA] * (c * block.centre_x - s * block.centre_y)
        return dx * tx + dy * ty, vx * tx + vy * ty
    r0 = vx * nx + vy * ny
    d1, nx, ny, rx, ry = contact_point(found_i[j, KIND], found_i[j, INDEX], found_i[j, PART], pose, block, ground)
    return d0 - d1, -depth_rate(q, nx, ny, rx, ry) - r0


@kernel
def _corner_event(j, q0, q1, h, world, memory, found):
    """Time in (0, h] just after a ground corner passes between a rounded corner of the block (contact of a corner) and
    the flat part of a face next to it (contact of a vertex), see `contact_state.hand_over`."""
    block, ground, ints, found_i = world.block, world.ground, memory.ints, found.ints
    n = block.sides.shape[0]
    corner, vertex = j, found_i[j, INDEX]
    if j >= n:
        vertex, corner = ints[j, INDEX], ints[j, PART]
        if not _nearer_start(corner, vertex, q1, ground, block):
            corner = corner + 1 if corner + 1 < n else 0
    elif found_i[j, KIND] != CORNER_VERTEX:
        return h
    g0, s0 = _beyond(corner, vertex, q0, ground, block)
    g1, s1 = _beyond(corner, vertex, q1, ground, block)
    if (g0 > 0.0) == (g1 > 0.0):
        return h
    t = hermite_root(g0, s0, g1, s1, h) + 1e-5 * h
    return t if 1e-3 * h < t < h else h


@kernel
def _nearer_start(face, vertex, q, ground, block):
    """Whether a ground corner lies nearer to the first corner of a face than to its second."""
    sides, facets = block.sides, ground.facets
    end = face + 1 if face + 1 < sides.shape[0] else 0
    dx, dy = facets[vertex, POINT_X] - q[X], facets[vertex, POINT_Y] - q[Y]
    c, s = np.cos(q[THETA]), np.sin(q[THETA])
    bx, by = c * dx + s * dy, -s * dx + c * dy
    start_x, start_y = bx - sides[face, CORNER_X], by - sides[face, CORNER_Y]
    end_x, end_y = bx - sides[end, CORNER_X], by - sides[end, CORNER_Y]
    return start_x * start_x + start_y * start_y < end_x * end_x + end_y * end_y


@kernel
def _beyond(corner, vertex, q, ground, block):
    """`beyond_corner` of a ground corner, and its rate."""
    pose = pose_of(q)
    _, _, c, s = pose
    px, py = ground.facets[vertex, POINT_X], ground.facets[vertex, POINT_Y]
    past, tx, ty = beyond_corner(corner, px, py, pose, block.sides)
    vx, vy = q[VX] - q[OMEGA] * (py - q[Y]), q[VY] + q[OMEGA] * (px - q[X])  # velocity of the material there
    return past, -(vx * (c * tx - s * ty) + vy * (s * tx + c * ty))


@kernel
def _appearance(j, q0, q1, h, world, found):
    """Time in (0, h] to which a step is shortened if the contact of a smooth profile lies in the ground at its end, but
    has no feature at its start: the foot of a profile can move along the ground faster than the block. It is the time
    at which the depth of the new feature passes 0, or half the step if that is not known."""
    if world.block.sides.shape[0] > 0:
        return h
    d0, r0 = _depth_and_rate(j, q0, world, found)
    d1, r1 = _depth_and_rate(j, q1, world, found)
    return hermite_root(d0, r0, d1, r1, h) if d0 < 0.0 < d1 else 0.5 * h


@kernel
def first_event(h, whole, q0, q1, world, memory, found):
    """Time in (0, h] of the first event of the law within a trial step of h; h if there is none.

    whole : the step in s that was tried first; it determines how far behind an event a step lands"""
    ints, reals, found_i, found_r = memory.ints, memory.reals, found.ints, found.reals
    first = h
    for j in range(ints.shape[0]):
        d1, r1 = found_r[j, DEPTH], found_r[j, RATE]
        d0, r0 = reals[j, DEPTH], reals[j, RATE]
        if d1 == NOWHERE and ints[j, ACTIVE]:
            if world.block.rounding > 0.0:
                first = min(first, _corner_event(j, q0, q1, h, world, memory, found))
            d1, r1 = _depth_and_rate(j, q1, world, memory)  # slid off its feature, which acts until the end
        if d1 > 0.0 and not ints[j, ACTIVE] and (d0 == NOWHERE or ints[j, KEY] != found_i[j, KEY]):
            t = _appearance(j, q0, q1, h, world, found)
            first = t if LEAST_EVENT * whole < t < first else first
            continue
        if d0 == NOWHERE or d1 == NOWHERE:
            continue
        t = h
        if not ints[j, ACTIVE]:
            if d0 < 0.0 < d1:
                # rounding can leave a landing just above the ground: then a short step ends at the touch
                t = max(hermite_root(d0, r0, d1, r1, h), 2e-3 * whole)
        else:
            p = world.law[ints[j, ZONE]]
            # land a little behind the surface: there is no force on either side, and the error of the cubic is smaller
            clear = hermite_root(d0, r0, d1, r1, h) + 1e-3 * whole if d1 <= 0.0 < d0 else h
            d0, d1 = d0 - reals[j, OFFSET], d1 - reals[j, OFFSET]
            peak = reals[j, PEAK]
            bottom = residual_indentation(peak, p[K_L], p[K_UL])
            t = law_event(d0, r0, d1, r1, peak, bottom, h)
            t = min(t, clear)
            if p[ANY_EFFECT_ACTS] != 0.0:
                ends = (d0, r0), (d1, r1)
                limit = force_limit_event(p, p, FIRST_EFFECT_COLUMN, ends, (peak, bottom), h, whole)
                t = min(t, limit)
            if changes_feature(j, memory, found):
                # another feature has become the nearest: land just behind the change
                g0, s0 = _gap_to_found(j, q0, world, memory, found)
                g1, s1 = _gap_to_found(j, q1, world, memory, found)
                if (g0 > 0.0) != (g1 > 0.0):
                    # however soon, because the old feature must not act where another is nearest; but beyond rounding
                    behind = max(1e-5 * whole, LEAST_GAP * world.block.radius / max(abs(s0), abs(s1), 1e-300))
                    first = min(first, hermite_root(g0, s0, g1, s1, h) + behind)
        if LEAST_EVENT * whole < t < first:
            first = t
    return first
