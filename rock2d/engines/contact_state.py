"""Contact state: the memory of each contact of a block, and the search for the feature that it meets.

A polygon has a contact for each corner and VERTEX_CONTACTS for ground corners under its faces; a circle or ellipse has
SMOOTH_CONTACTS. A contact follows its feature from facet to facet, so it keeps its memory at joints.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from rock2d.compiled import copy, kernel, njit
from rock2d.engines.ellipse import half_of_ellipse
from rock2d.engines.geometry import (
    CONVEX,
    CORNER_FACET,
    CORNER_VERTEX,
    LENGTH,
    NORMAL_X,
    NORMAL_Y,
    PATCH,
    POINT_X,
    POINT_Y,
    SMOOTH_FACET,
    SMOOTH_VERTEX,
    TANGENT_X,
    TANGENT_Y,
    VERTEX_FACE,
    along_and_above,
    beyond_corner,
    corner_place,
    depth_rate,
    load_feature,
    near_depth,
    place_feature,
    polygon_depth,
    pose_of,
    repeats_corner,
    under_face,
)
from rock2d.scene.blocks import Block

# memory of a contact: integers, then reals; ACTING is the force of a contact with effects
ACTIVE, KIND, INDEX, PART, ZONE, KEY = range(6)
DEPTH, RATE, PEAK, DISPLACEMENT, ROTATION, OFFSET, ACTING = range(7)
N_INTS, N_REALS = KEY + 1, ACTING + 1
# saved contact of a suspended release: its integers, its reals, and the largest kinetic energy of the release at the
# beginning of a contact
SAVED_ENERGY = N_INTS + N_REALS
N_SAVED = SAVED_ENERGY + 1
VERTEX_CONTACTS = 8  # convex ground corners under one polygon at a time
SMOOTH_CONTACTS = 6  # patches and corners under one circle or ellipse at a time
NOWHERE = -1.0e300  # depth of a contact that has no feature
SAME_FOOT = 1e-9  # relative difference of depths below which they belong to the same point of an ellipse


class Contacts(NamedTuple):
    """The memory of all contacts of a block, or the features that a search found for them."""

    ints: np.ndarray  # (contacts, N_INTS): ACTIVE, KIND, INDEX, PART, ZONE, KEY
    reals: np.ndarray  # (contacts, N_REALS): DEPTH, RATE, PEAK, DISPLACEMENT, ROTATION, OFFSET, ACTING


def contact_count(block: Block) -> int:
    """Number of contacts that a block needs."""
    return SMOOTH_CONTACTS if block.smooth else len(block.corners_m) + VERTEX_CONTACTS


@njit
def new_contacts(count):
    """Empty memory of `count` contacts."""
    contacts = Contacts(np.zeros((count, N_INTS), np.int64), np.zeros((count, N_REALS)))
    clear(contacts)
    return contacts


@kernel
def clear(contacts):
    """Empty the memory of all contacts."""
    ints, reals = contacts.ints, contacts.reals
    for j in range(ints.shape[0]):  # slice assignments take seconds to compile
        for k in range(N_INTS):
            ints[j, k] = 0
        for k in range(N_REALS):
            reals[j, k] = 0.0
        ints[j, KEY], reals[j, DEPTH] = -1, NOWHERE


@kernel
def save_contacts(memory, energy, saved):
    """Write the memory of all contacts, and the largest kinetic energy (J), into `saved` (contacts, N_SAVED)."""
    for j in range(memory.ints.shape[0]):
        for k in range(N_INTS):
            saved[j, k] = memory.ints[j, k]
        copy(memory.reals[j], saved[j, N_INTS:SAVED_ENERGY])
        saved[j, SAVED_ENERGY] = energy


@kernel
def restore_contacts(saved, memory):
    """Read the memory of all contacts from `saved`; returns (active contacts, largest kinetic energy in J)."""
    active = 0
    for j in range(memory.ints.shape[0]):
        for k in range(N_INTS):
            memory.ints[j, k] = int(saved[j, k])
        copy(saved[j, N_INTS:SAVED_ENERGY], memory.reals[j])
        active += memory.ints[j, ACTIVE]
    return active, saved[0, SAVED_ENERGY]


@kernel
def find_features(q, reach, near, world, memory, found):
    """Fill `found` with each contact's nearest feature and depth at state q; contacts keep the feature they follow.

    near : (first, one past the last) index of the facets that are searched
    reach : features of vertices and smooth profiles farther above the ground (in m) are ignored (depth NOWHERE)
    """
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

    loaded : LoadedContacts, of which `active` are in use; their rows follow the memory
    """
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
                if (
                    not ints[k, ACTIVE]
                    and found_r[k, DEPTH] != NOWHERE
                    and abs(found_i[k, KEY] - ints[j, KEY]) == 1
                ):
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
    depth, nx, ny, _, _ = place_feature(
        SMOOTH_VERTEX, load_feature(SMOOTH_VERTEX, v, half, block, facets), pose
    )
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
    profile, in the same half of it. Beyond the longer axis of an ellipse the contact ends.
    """
    block, facets, ints = world.block, world.ground.facets, memory.ints
    x, y, _, _ = pose
    vertex, half = ints[j, INDEX], ints[j, PART]
    if ints[j, KIND] == SMOOTH_FACET:
        feature = load_feature(SMOOTH_FACET, vertex, 0, block, facets)
        _, _, _, rx, ry = place_feature(SMOOTH_FACET, feature, pose)
        along = (x + rx - feature[0]) * facets[vertex, TANGENT_X] + (y + ry - feature[1]) * facets[
            vertex, TANGENT_Y
        ]
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
