"""The guard: the distance that a block can move before its contacts can change, compiled."""

from __future__ import annotations

import numpy as np

from rock2d.compiled import kernel
from rock2d.engines.contact_state import ACTIVE, INDEX, KIND
from rock2d.engines.geometry import (
    CONVEX,
    CORNER_FACET,
    FACE_OFFSET,
    FACE_X,
    FACE_Y,
    LENGTH,
    POINT_X,
    POINT_Y,
    RUN_FIRST,
    RUN_LAST,
    SMOOTH_FACET,
    TANGENT_X,
    TANGENT_Y,
    along_and_above,
    corner_place,
    facet_range,
    is_ball,
    load_feature,
    near_depth,
    place_feature,
    pose_of,
    profile_bend,
)
from rock2d.records.columns import OMEGA, THETA, VX, VY, X, Y

GUARD = 3  # column of an anchor (x, y, theta, guard in m): the pose whose guard is known
TURN_ARM = (
    1.5  # lever, in block radii, by which rotation counts as motion: vertices near the block are so far away
)
VIEW_RADII = 2.0  # radii to each side within which the ground is searched
BALL_VIEW_RADII = 10.0  # the same for a ball, which hops far between two contacts
VIEW_FACETS = 16  # largest number of facets beyond the block that are searched


@kernel
def set_anchor(anchor, q, h, world, memory):
    """Write pose q and its guard into `anchor`; a guard too small for a step of h (s) becomes 0.

    Returns whether the centroid lies below the surface. Within the guard it stays above.
    """
    block, ground = world.block, world.ground
    ball = is_ball(block)
    most = (BALL_VIEW_RADII if ball else VIEW_RADII) - 1.0
    allowance = min(most, max(0.1, VIEW_FACETS * ground.facet_m / block.radius)) * block.radius
    half = max(VIEW_RADII * block.radius, block.radius + allowance)
    near = facet_range(ground, q[X] - half, q[X] + half)
    anchor[X], anchor[Y], anchor[THETA] = q[X], q[Y], q[THETA]
    depth, _, _ = near_depth(q[X], q[Y], ground, near[0], near[1], block.radius)
    anchor[GUARD] = guard_distance(q, allowance, near, world, memory)
    pace = abs(q[VX]) + abs(q[VY])
    if not ball:  # `fast_contact_steps` checks the depth of a ball
        anchor[GUARD] = min(anchor[GUARD], max(-depth, 0.0))
        pace += TURN_ARM * block.radius * abs(q[OMEGA])
    if anchor[GUARD] < h * pace:
        anchor[GUARD] = 0.0
    return depth > 0.0


@kernel
def guard_distance(q, allowance, near, world, memory):
    """Distance in m that any point of the block may move from pose q before a contact begins or changes its feature; 0
    if it is not known.

    near : (first, one past the last) index of the facets that are searched
    allowance : width in m of these facets beyond the block, the largest guard. A contact that moves within a run of
        facets does not change: `fast_contact_steps` follows it.
    """
    pose = pose_of(q)
    x, y, c, s = pose
    block, ground, ints = world.block, world.ground, memory.ints
    f0, f1 = near
    facets, sides = ground.facets, block.sides
    n, guard = sides.shape[0], allowance
    if n == 0:
        return _smooth_guard(q, guard, near, world, memory)
    for i in range(n):
        px, py = corner_place(i, pose, sides)
        if not ints[i, ACTIVE]:
            depth, _, _ = near_depth(px, py, ground, f0, f1, guard + block.rounding)
            guard = min(guard, -depth - block.rounding)
        elif ints[i, KIND] != CORNER_FACET:
            return 0.0
        else:
            own = ints[i, INDEX]
            _, above = along_and_above(px, py, own, facets)
            guard = min(guard, _within_run(px, py, own, facets))
            width = guard + 2.0 * abs(above)
            g0, g1 = facet_range(ground, px - width, px + width)
            other = np.inf  # squared distance to the nearest facet of another run
            for f in range(max(f0, g0), min(f1, g1)):
                if facets[own, RUN_FIRST] <= f <= facets[own, RUN_LAST]:
                    continue
                along, away = along_and_above(px, py, f, facets)
                beyond = max(-along, along - facets[f, LENGTH], 0.0)
                other = min(other, away * away + beyond * beyond)
            guard = min(guard, 0.5 * (np.sqrt(other) - abs(above)))
        if guard <= 0.0:
            return 0.0
    for v in range(max(f0, 1), f1):
        if facets[v, CONVEX] <= 0.0:
            continue
        dx, dy = facets[v, POINT_X] - x, facets[v, POINT_Y] - y
        bx, by = c * dx + s * dy, -s * dx + c * dy
        nearest, second = np.inf, np.inf  # depth below the faces
        for k in range(n):
            d = sides[k, FACE_OFFSET] - sides[k, FACE_X] * bx - sides[k, FACE_Y] * by
            if d < nearest:
                nearest, second = d, nearest
            elif d < second:
                second = d
        if nearest > 0.0 and block.rounding > 0.0:
            return 0.0  # a face's flat part may end there
        guard = min(guard, 0.5 * (second - nearest) if nearest > 0.0 else -nearest)
    return max(guard, 0.0)


@kernel(forceinline=True)
def _within_run(px, py, own, facets):
    """Distance in m that a point may move along the ground before it leaves the run of facet `own`."""
    first, last = int(facets[own, RUN_FIRST]), int(facets[own, RUN_LAST])
    behind, _ = along_and_above(px, py, first, facets)
    dx, dy = px - facets[last, POINT_X], py - facets[last, POINT_Y]
    ahead = facets[last, LENGTH] - dx * facets[last, TANGENT_X] - dy * facets[last, TANGENT_Y]
    return min(behind, ahead)


@kernel
def _smooth_guard(q, guard, near, world, memory):
    """`guard_distance` of a smooth profile. The contact point of a ball lies below its centre; that of another profile
    moves along the ground by at most `profile_bend` times the angle when the block turns."""
    pose = pose_of(q)
    block, facets, ints = world.block, world.ground.facets, memory.ints
    f0, f1 = near
    ball = is_ball(block)
    for j in range(ints.shape[0]):
        if ints[j, ACTIVE]:
            if ints[j, KIND] != SMOOTH_FACET:
                return 0.0
            px, py, _ = _lowest(ints[j, INDEX], pose, block, facets)
            guard = min(guard, _within_run(px, py, ints[j, INDEX], facets))
    f = f0
    while f < f1 and guard > 0.0:
        owned = False  # whether f lies in the run of a contact, which is checked above
        for j in range(ints.shape[0]):
            if ints[j, ACTIVE] and facets[f, RUN_FIRST] <= ints[j, INDEX] <= facets[f, RUN_LAST]:
                owned = True
        if owned:
            f = int(facets[f, RUN_LAST]) + 1
            continue
        px, py, height = _lowest(f, pose, block, facets)
        along, _ = along_and_above(px, py, f, facets)
        guard = min(guard, max(height, -along, along - facets[f, LENGTH]))
        f += 1
    for v in range(max(f0, 1), f1):
        if facets[v, CONVEX] > 0.0 or not ball:
            owned = False  # whether v lies in the run of a contact, or at its end
            for j in range(ints.shape[0]):
                if ints[j, ACTIVE]:
                    own = ints[j, INDEX]
                    owned = owned or facets[own, RUN_FIRST] <= v <= facets[own, RUN_LAST] + 1
            if not owned:
                guard = min(guard, _outside(v, pose, block, facets))
    if not ball:
        guard *= min(1.0, TURN_ARM * block.radius / profile_bend(block))
    return max(guard, 0.0)


@kernel(forceinline=True)
def _lowest(f, pose, block, facets):
    """(x, y) in m of the point of a smooth profile nearest to the line of facet f, and its height above the line. For a
    ball, x and y of the centre, which lies above that point."""
    x, y, _, _ = pose
    if is_ball(block):
        return x, y, along_and_above(x, y, f, facets)[1] - block.radius
    depth, _, _, rx, ry = place_feature(SMOOTH_FACET, load_feature(SMOOTH_FACET, f, 0, block, facets), pose)
    return x + rx, y + ry, -depth


@kernel(forceinline=True)
def _outside(v, pose, block, facets):
    """Lower bound of the distance in m of vertex v from a smooth profile; negative if it lies inside."""
    x, y, c, s = pose
    dx, dy = facets[v, POINT_X] - x, facets[v, POINT_Y] - y
    if is_ball(block):
        return np.sqrt(dx * dx + dy * dy) - block.radius
    px, py = c * dx + s * dy - block.centre_x, -s * dx + c * dy - block.centre_y
    stretched = np.sqrt((px / block.semi_a) ** 2 + (py / block.semi_b) ** 2)
    return min(block.semi_a, block.semi_b) * (stretched - 1.0)
