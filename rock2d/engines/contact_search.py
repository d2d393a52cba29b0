"""The search for the feature that each contact of a block meets, and the guard: the distance that the block can move
before its contacts can change. Compiled.

A contact follows its feature from facet to facet, so it keeps its memory at joints."""

import numpy as np

from rock2d.compiled import copy, kernel
from rock2d.engines.contact_state import ACTIVE, DEPTH, INDEX, KEY, KIND, NOWHERE, PART, RATE
from rock2d.engines.geometry import (
    CONVEX,
    CORNER_FACET,
    CORNER_VERTEX,
    FACE_OFFSET,
    FACE_X,
    FACE_Y,
    LENGTH,
    NORMAL_X,
    NORMAL_Y,
    PATCH,
    POINT_X,
    POINT_Y,
    RUN_FIRST,
    RUN_LAST,
    SMOOTH_FACET,
    SMOOTH_VERTEX,
    TANGENT_X,
    TANGENT_Y,
    VERTEX_FACE,
    along_and_above,
    beyond_corner,
    corner_place,
    depth_rate,
    facet_range,
    half_of_ellipse,
    is_ball,
    load_feature,
    near_depth,
    place_feature,
    polygon_depth,
    pose_of,
    profile_bend,
    repeats_corner,
    under_face,
)
from rock2d.records.columns import OMEGA, THETA, VX, VY, X, Y

SAME_FOOT = 1e-9  # relative difference of depths below which they belong to the same point of an ellipse
GUARD = 3  # column of an anchor (x, y, theta, guard in m): the pose whose guard is known
# lever, in block radii, by which rotation counts as motion: vertices near the block are so far away
TURN_ARM = 1.5
VIEW_RADII = 2.0  # radii to each side within which the ground is searched
BALL_VIEW_RADII = 10.0  # the same for a ball, which hops far between two contacts
VIEW_FACETS = 16  # largest number of facets beyond the block that are searched


@kernel
def find_features(q, reach, near, world, memory, found):
    """Fill `found` with each contact's nearest feature and depth at state q; contacts keep the feature they follow.

    near : (first, one past the last) index of the facets that are searched
    reach : features of vertices and smooth profiles farther above the ground (in m) are ignored (depth NOWHERE)"""
    pose = pose_of(q)
    f0, f1 = near
    block, ground, ints, found_i, found_r = world.block, world.ground, memory.ints, found.ints, found.reals
    for j in range(ints.shape[0]):
        found_r[j, DEPTH] = NOWHERE
        if ints[j, ACTIVE]:
            copy(ints[j], found_i[j])
    facets, sides = ground.facets, block.sides
    n = sides.shape[0]
    if n > 0:
        for i in range(n):
            px, py = corner_place(i, pose, sides)
            depth, kind, index = near_depth(px, py, ground, f0, f1, reach + block.rounding)
            if block.rounding > 0.0:
                outside = depth < 0.0
                depth += block.rounding
                if repeats_corner(sides, i) or (
                    outside and kind == CORNER_VERTEX and facets[index, CONVEX] > 0.0
                    and beyond_corner(i, facets[index, POINT_X], facets[index, POINT_Y], pose, sides)[0] < 0.0
                ):  # fmt: skip
                    depth = NOWHERE  # another corner's circle, or the vertex lies under a face
            _set(found, i, (kind, index, i), depth, i)
        for v in range(max(f0, 1), f1):
            if facets[v, CONVEX] > 0.0:
                px, py = facets[v, POINT_X], facets[v, POINT_Y]
                depth, face = polygon_depth(px, py, pose, sides)
                if depth > -reach:
                    rounded = depth < block.rounding and block.rounding > 0.0
                    if rounded and not under_face(face, px, py, pose, sides):
                        continue  # under a rounded corner
                    j = _contact_for(memory, found, n, v)
                    if j >= 0:
                        _set(found, j, (VERTEX_FACE, v, face), depth, v)
    else:
        _smooth_features(pose, reach, near, world, memory, found)
    for j in range(ints.shape[0]):
        depth = found_r[j, DEPTH]
        if depth == NOWHERE:
            continue
        kind = found_i[j, KIND]
        feature = load_feature(kind, found_i[j, INDEX], found_i[j, PART], block, facets)
        _, nx, ny, rx, ry = place_feature(kind, feature, pose)
        if kind == CORNER_VERTEX and depth < 0.0 and block.rounding == 0.0:
            nx, ny = -nx, -ny  # outside, the nearest vertex lies the other way
        found_r[j, RATE] = depth_rate(q, nx, ny, rx, ry)


@kernel
def hand_over(corners, memory, found, loaded, active):
    """Move the memory of a contact to the contact that continues it, where a ground corner has passed between the
    circle of a rounded corner (contact of a corner) and the flat part of a face (contact of a vertex).

    loaded : LoadedContacts, of which `active` are in use; their rows follow the memory"""
    ints, reals, found_i, found_r = memory.ints, memory.reals, found.ints, found.reals
    for j in range(ints.shape[0]):
        if not ints[j, ACTIVE] or found_r[j, DEPTH] != NOWHERE:
            continue
        if j < corners and found_i[j, KIND] != CORNER_VERTEX:
            continue
        vertex = found_i[j, INDEX] if j < corners else ints[j, INDEX]
        first, last = (corners, ints.shape[0]) if j < corners else (0, corners)
        for k in range(first, last):
            near = found_i[k, INDEX] == vertex
            near = near or (found_i[k, KIND] == CORNER_FACET and found_i[k, INDEX] == vertex - 1)
            if near and not ints[k, ACTIVE] and found_r[k, DEPTH] > 0.0:
                copy(ints[j], ints[k])
                copy(reals[j], reals[k])
                for a in range(active):
                    loaded.which[a] = k if loaded.which[a] == j else loaded.which[a]
                ints[j, ACTIVE], ints[j, KEY] = 0, -1
                reals[j, DEPTH] = NOWHERE
                break


@kernel
def changes_feature(j, memory, found):
    """Whether the feature found for contact j differs from its present one."""
    ints, found_i = memory.ints, found.ints
    same = ints[j, KIND] == found_i[j, KIND] and ints[j, INDEX] == found_i[j, INDEX]
    return not (same and ints[j, PART] == found_i[j, PART])


@kernel
def _set(found, j, feature, depth, key):
    ints = found.ints
    ints[j, KIND], ints[j, INDEX], ints[j, PART] = feature
    ints[j, KEY] = key
    found.reals[j, DEPTH] = depth


@kernel
def _contact_for(memory, found, start, key):
    """The contact that follows `key`, else a free one, else -1."""
    ints, found_r = memory.ints, found.reals
    free, stale = -1, -1
    for j in range(start, ints.shape[0]):
        empty = not ints[j, ACTIVE] and found_r[j, DEPTH] == NOWHERE
        if ints[j, KEY] == key and (ints[j, ACTIVE] or empty):
            return j
        if empty and ints[j, KEY] < 0:
            free = j
        elif empty:
            stale = j
    return free if free >= 0 else stale


@kernel
def _smooth_features(pose, reach, near, world, memory, found):
    """Deepest feature of each smooth patch (key 2p) and of each convex corner (key 2p + 1)."""
    x, y, _, _ = pose
    block, facets = world.block, world.ground.facets
    ints, found_i, found_r = memory.ints, found.ints, found.reals
    f0, f1 = near
    far = reach + block.radius
    for f in range(f0, f1):
        along, above = along_and_above(x, y, f, facets)
        if abs(above) > far or along < -far or along > facets[f, LENGTH] + far:
            continue
        tx, ty = facets[f, TANGENT_X], facets[f, TANGENT_Y]
        if above > 0.0:
            feature = load_feature(SMOOTH_FACET, f, 0, block, facets)
            depth, _, _, rx, ry = place_feature(SMOOTH_FACET, feature, pose)
            along = (x + rx - feature[0]) * tx + (y + ry - feature[1]) * ty
            if 0.0 <= along <= facets[f, LENGTH] and depth > -reach:
                _offer(memory, found, (SMOOTH_FACET, f, 0), depth, 2 * int(facets[f, PATCH]))
            if along <= facets[f, LENGTH]:
                continue
        # only the back of a facet that faces away is near; but if the vertex at its end is sharper than a right angle,
        # the block may lie before the next facet
        if f + 2 < facets.shape[0] and (above > 0.0 or _is_spike(f, x, y, facets)):
            _offer_vertex(f, pose, reach, world, memory, found)
    for j in range(ints.shape[0]):
        # the neighbouring contact continues an active contact whose feature is gone
        if ints[j, ACTIVE] and found_r[j, DEPTH] == NOWHERE:
            for k in range(ints.shape[0]):
                if not ints[k, ACTIVE] and found_r[k, DEPTH] != NOWHERE and abs(found_i[k, KEY] - ints[j, KEY]) == 1:
                    own = (found_i[k, KIND], found_i[k, INDEX], found_i[k, PART])
                    _set(found, j, own, found_r[k, DEPTH], found_i[k, KEY])
                    found_r[k, DEPTH] = NOWHERE
                    break
            if found_r[j, DEPTH] == NOWHERE:
                _keep_vertex(j, pose, world, memory, found)


@kernel(forceinline=True)
def _is_spike(f, x, y, facets):
    """Whether the ground turns by more than a right angle behind facet f, with (x, y) before the next facet."""
    v = f + 1
    if facets[f, TANGENT_X] * facets[v, TANGENT_X] + facets[f, TANGENT_Y] * facets[v, TANGENT_Y] >= 0.0:
        return False
    return along_and_above(x, y, v, facets)[1] > 0.0


@kernel
def _offer_vertex(f, pose, reach, world, memory, found):
    """Offer the vertex between facet f and the next to a smooth profile, if the ground is convex there and the foot
    lies between the facet's end and the next one's begin."""
    block, facets = world.block, world.ground.facets
    v = f + 1
    half = _half_at(v, pose, block, facets)
    depth, nx, ny, _, _ = place_feature(SMOOTH_VERTEX, load_feature(SMOOTH_VERTEX, v, half, block, facets), pose)
    turn_out = nx * facets[f, TANGENT_X] + ny * facets[f, TANGENT_Y]
    turn_in = nx * facets[v, TANGENT_X] + ny * facets[v, TANGENT_Y]
    up = nx * (facets[f, NORMAL_X] + facets[v, NORMAL_X]) + ny * (facets[f, NORMAL_Y] + facets[v, NORMAL_Y])
    if depth > -reach and turn_out >= 0.0 >= turn_in and up > 0.0:
        key = 2 * int(facets[f, PATCH]) + int(facets[v, CONVEX])
        _offer(memory, found, (SMOOTH_VERTEX, v, half), depth, key)


@kernel
def _keep_vertex(j, pose, world, memory, found):
    """Continue active contact j, whose feature is no longer found, at its vertex or at the end of its facet.

    Far inside the ground, the nearest features leave gaps. The contact continues as long as that vertex lies inside the
    profile, in the same half of it. Beyond the longer axis of an ellipse the contact ends."""
    block, facets, ints = world.block, world.ground.facets, memory.ints
    x, y, _, _ = pose
    vertex, half = ints[j, INDEX], ints[j, PART]
    if ints[j, KIND] == SMOOTH_FACET:
        feature = load_feature(SMOOTH_FACET, vertex, 0, block, facets)
        _, _, _, rx, ry = place_feature(SMOOTH_FACET, feature, pose)
        along = (x + rx - feature[0]) * facets[vertex, TANGENT_X] + (y + ry - feature[1]) * facets[vertex, TANGENT_Y]
        vertex += 1 if along > 0.0 else 0
        half = _half_at(vertex, pose, block, facets)
    if 0 < vertex < facets.shape[0] - 1:
        nearer = _half_at(vertex, pose, block, facets)
        depth = _vertex_depth(vertex, nearer, pose, block, facets)
        if half != nearer and _vertex_depth(vertex, half, pose, block, facets) > (1.0 + SAME_FOOT) * depth:
            return
        if depth > 0.0:
            _set(found, j, (SMOOTH_VERTEX, vertex, nearer), depth, ints[j, KEY])


@kernel
def _vertex_depth(v, half, pose, block, facets):
    """Depth in m of vertex v in a smooth profile, measured to one half of the profile."""
    return place_feature(SMOOTH_VERTEX, load_feature(SMOOTH_VERTEX, v, half, block, facets), pose)[0]


@kernel
def _half_at(v, pose, block, facets):
    """Half of an ellipse that is nearest to vertex v; 0 for a circle."""
    if block.semi_a == block.semi_b:
        return np.int64(0)
    x, y, c, s = pose
    dx, dy = facets[v, POINT_X] - x, facets[v, POINT_Y] - y
    px, py = c * dx + s * dy - block.centre_x, -s * dx + c * dy - block.centre_y
    return half_of_ellipse(px, py, block.semi_a, block.semi_b)


@kernel
def _offer(memory, found, feature, depth, key):
    """Give a feature to the contact of its key, unless that contact has a deeper one."""
    for j in range(found.ints.shape[0]):
        if found.reals[j, DEPTH] != NOWHERE and found.ints[j, KEY] == key:
            if depth > found.reals[j, DEPTH]:
                _set(found, j, feature, depth, key)
            return
    j = _contact_for(memory, found, 0, key)
    if j >= 0:
        _set(found, j, feature, depth, key)


@kernel
def set_anchor(anchor, q, h, world, memory):
    """Write pose q and its guard into `anchor`; a guard too small for a step of h (s) becomes 0.

    Returns whether the centroid lies below the surface. Within the guard it stays above."""
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
        facets does not change: `fast_contact_steps` follows it."""
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
