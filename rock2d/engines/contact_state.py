"""Contact contacts: the memory of each contact point of a block, and the search for the feature it meets.

A polygon has a contact for each corner and VERTEX_SLOTS for ground corners under its faces; a circle or ellipse has
SMOOTH_SLOTS. A contact follows its feature from facet to facet, so memory is carried over joints.
"""

from __future__ import annotations

import numpy as np

from rock2d.compiled import copy, kernel
from rock2d.engines.geometry import (
    CONVEX,
    CORNER_FACET,
    CORNER_VERTEX,
    CORNER_X,
    CORNER_Y,
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
    beyond_corner,
    load_feature,
    near_depth,
    place_feature,
    polygon_depth,
    repeats,
    under_face,
)
from rock2d.scene.blocks import Block

# memory of a contact: integers, then reals; ACTING is the force of a contact with effects, which the rest does not tell
ACTIVE, KIND, INDEX, PART, ZONE, KEY = range(6)
DEPTH, RATE, DEPTH_MAX, STRETCH, ROTATION, OFFSET, ACTING = range(7)
N_INTS, N_REALS = 6, 7
VERTEX_CONTACTS = 8  # convex ground corners under one polygon at a time
SMOOTH_CONTACTS = 6  # patches and corners under one circle or ellipse at a time
NOWHERE = -1.0e300  # depth of a contact that has no feature


def contact_count(block: Block) -> int:
    """Number of contact contacts that a block needs."""
    return SMOOTH_CONTACTS if block.smooth else len(block.corners_m) + VERTEX_CONTACTS


def new_contacts(block: Block) -> tuple[np.ndarray, np.ndarray]:
    """Empty memory: (contacts, N_INTS) integers and (contacts, N_REALS) reals."""
    n = contact_count(block)
    ints, reals = np.zeros((n, N_INTS), np.int64), np.zeros((n, N_REALS))
    clear(ints, reals)
    return ints, reals


@kernel
def clear(ints, reals):
    """Empty the memory of all contacts."""
    ints[:, :], reals[:, :] = 0, 0.0
    ints[:, KEY] = -1
    reals[:, DEPTH] = NOWHERE


@kernel
def find_features(q, reach, f0, f1, ground, block, ints, found_i, found_r):
    """Fill `found_*` with each contact's nearest feature and depth at pose q; contacts keep the feature they follow.

    Only facets f0 to f1 - 1 are looked at; of vertices and smooth profiles, features farther above the ground
    than `reach` are left out (depth NOWHERE).
    """
    x, y, c, s = q[0], q[1], np.cos(q[2]), np.sin(q[2])
    for j in range(ints.shape[0]):
        found_r[j, DEPTH] = NOWHERE
        if ints[j, ACTIVE]:
            copy(ints[j], found_i[j])
    facets, sides = ground.facets, block.sides
    n = sides.shape[0]
    if n > 0:
        for i in range(n):
            px = x + c * sides[i, CORNER_X] - s * sides[i, CORNER_Y]
            py = y + s * sides[i, CORNER_X] + c * sides[i, CORNER_Y]
            depth, kind, index = near_depth(px, py, ground, f0, f1, reach + block.rounding)
            if block.rounding > 0.0:
                outside = depth < 0.0
                depth += block.rounding
                if repeats(sides, i) or (
                    outside and kind == CORNER_VERTEX and facets[index, CONVEX] > 0.0
                    and beyond_corner(i, facets[index, POINT_X], facets[index, POINT_Y], x, y, c, s, sides)[0] < 0.0
                ):  # fmt: skip
                    depth = NOWHERE  # another corner's circle, or the vertex lies under a face
            _set(found_i, found_r, i, kind, index, i, depth, i)
        for v in range(max(f0, 1), f1):
            if facets[v, CONVEX] > 0.0:
                px, py = facets[v, POINT_X], facets[v, POINT_Y]
                depth, face = polygon_depth(px, py, x, y, c, s, sides)
                if depth > -reach:
                    rounded = depth < block.rounding and block.rounding > 0.0
                    if rounded and not under_face(face, px, py, x, y, c, s, sides):
                        continue  # under a rounded corner
                    slot = _contact_for(ints, found_r, n, v)
                    if slot >= 0:
                        _set(found_i, found_r, slot, VERTEX_FACE, v, face, depth, v)
    else:
        _smooth_features(x, y, c, s, f0, f1, reach, facets, block, ints, found_i, found_r)
    for j in range(ints.shape[0]):
        depth = found_r[j, DEPTH]
        if depth == NOWHERE:
            continue
        kind = found_i[j, KIND]
        feature = load_feature(kind, found_i[j, INDEX], found_i[j, PART], block, facets)
        _, nx, ny, rx, ry = place_feature(kind, feature, x, y, c, s)
        if kind == CORNER_VERTEX and depth < 0.0 and block.rounding == 0.0:
            nx, ny = -nx, -ny  # outside, the nearest vertex lies the other way
        found_r[j, RATE] = -((q[3] - q[5] * ry) * nx + (q[4] + q[5] * rx) * ny)


@kernel
def hand_over(corners, ints, reals, found_i, found_r, stretch, rotation):
    """Where a ground corner has passed between the circle of a rounded corner (a corner's contact) and the flat part
    of a face (a vertex's contact), let the other contact go on with the contact's memory; stretch, rotation: its
    springs' new states."""
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
                stretch[k], rotation[k] = stretch[j], rotation[j]
                ints[j, ACTIVE], ints[j, KEY] = 0, -1
                reals[j, DEPTH] = NOWHERE
                break


@kernel
def _set(found_i, found_r, slot, kind, index, part, depth, key):
    found_i[slot, KIND], found_i[slot, INDEX], found_i[slot, PART] = kind, index, part
    found_i[slot, KEY] = key
    found_r[slot, DEPTH] = depth


@kernel
def _contact_for(ints, found_r, start, key):
    """The contact that follows `key`, else a free one, else -1."""
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
def _smooth_features(x, y, c, s, f0, f1, reach, facets, block, ints, found_i, found_r):
    """Deepest feature of each smooth patch (key 2p) and of each convex corner (key 2p + 1)."""
    far = reach + block.radius
    for f in range(f0, f1):
        dx, dy = x - facets[f, POINT_X], y - facets[f, POINT_Y]
        if dx * facets[f, NORMAL_X] + dy * facets[f, NORMAL_Y] > far:
            continue
        along = dx * facets[f, TANGENT_X] + dy * facets[f, TANGENT_Y]
        if along < -far or along > facets[f, LENGTH] + far:
            continue
        feature = load_feature(SMOOTH_FACET, f, 0, block, facets)
        depth, nx, ny, rx, ry = place_feature(SMOOTH_FACET, feature, x, y, c, s)
        tx, ty = facets[f, TANGENT_X], facets[f, TANGENT_Y]
        along = (x + rx - feature[0]) * tx + (y + ry - feature[1]) * ty
        if 0.0 <= along <= facets[f, LENGTH]:
            if -reach < depth < 2.0 * block.radius:
                _offer(ints, found_i, found_r, SMOOTH_FACET, f, depth, 2 * int(facets[f, PATCH]))
        elif along > facets[f, LENGTH] and f + 2 < facets.shape[0]:
            # between this facet's end and the next one's begin: the vertex, if the ground is convex there
            v = f + 1
            feature = load_feature(SMOOTH_VERTEX, v, 0, block, facets)
            depth, nx, ny, rx, ry = place_feature(SMOOTH_VERTEX, feature, x, y, c, s)
            turn_out = nx * tx + ny * ty
            turn_in = nx * facets[v, TANGENT_X] + ny * facets[v, TANGENT_Y]
            up = nx * (facets[f, NORMAL_X] + facets[v, NORMAL_X])
            up += ny * (facets[f, NORMAL_Y] + facets[v, NORMAL_Y])
            if depth > -reach and turn_out >= 0.0 >= turn_in and up > 0.0:
                key = 2 * int(facets[f, PATCH]) + int(facets[v, CONVEX])
                _offer(ints, found_i, found_r, SMOOTH_VERTEX, v, depth, key)
    for j in range(ints.shape[0]):
        # an active contact whose feature is gone has handed over to the neighbouring one
        if ints[j, ACTIVE] and found_r[j, DEPTH] == NOWHERE:
            for k in range(ints.shape[0]):
                if (
                    not ints[k, ACTIVE]
                    and found_r[k, DEPTH] != NOWHERE
                    and abs(found_i[k, KEY] - ints[j, KEY]) == 1
                ):
                    _set(
                        found_i, found_r, j, found_i[k, KIND], found_i[k, INDEX], 0, found_r[k, DEPTH],
                        found_i[k, KEY],
                    )  # fmt: skip
                    found_r[k, DEPTH] = NOWHERE
                    break


@kernel
def _offer(ints, found_i, found_r, kind, index, depth, key):
    """Give a feature to the contact of its key, keeping the deepest of that key."""
    for j in range(ints.shape[0]):
        if found_r[j, DEPTH] != NOWHERE and found_i[j, KEY] == key:
            if depth > found_r[j, DEPTH]:
                _set(found_i, found_r, j, kind, index, 0, depth, key)
            return
    slot = _contact_for(ints, found_r, 0, key)
    if slot >= 0:
        _set(found_i, found_r, slot, kind, index, 0, depth, key)
