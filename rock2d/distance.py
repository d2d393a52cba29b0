"""How far a point is from the cross-section: a tree of boxes over the facets, compiled.

Flight needs only a lower bound of the distance to the ground; with the tree ten thousand facets cost little more
than ten.
"""

from __future__ import annotations

import numpy as np

from rock2d.compiled import njit
from rock2d.geometry import LENGTH, POINT_X, POINT_Y, TANGENT_X, TANGENT_Y

LEAF = 4  # facets in a leaf
NO_BOX = 1.0e300


def box_tree(points: np.ndarray) -> np.ndarray:
    """(2 m, 4) boxes x_min, y_min, x_max, y_max of a binary tree over the facets of `points` (n + 1, 2).

    Node i has the children 2 i and 2 i + 1, the root is 1, the leaves m to 2 m - 1 hold LEAF facets each.
    """
    n = len(points) - 1
    leaves = 1
    while leaves * LEAF < n:
        leaves *= 2
    boxes = np.empty((2 * leaves, 4))
    boxes[:, :2], boxes[:, 2:] = NO_BOX, -NO_BOX
    for leaf in range(-(-n // LEAF)):
        part = points[leaf * LEAF : min((leaf + 1) * LEAF, n) + 1]
        boxes[leaves + leaf] = [*part.min(axis=0), *part.max(axis=0)]
    for i in range(leaves - 1, 0, -1):
        boxes[i, :2] = np.minimum(boxes[2 * i, :2], boxes[2 * i + 1, :2])
        boxes[i, 2:] = np.maximum(boxes[2 * i, 2:], boxes[2 * i + 1, 2:])
    return boxes


@njit
def _box_distance2(boxes, i, px, py):
    if boxes[i, 0] > boxes[i, 2]:
        return NO_BOX
    dx = max(max(boxes[i, 0] - px, px - boxes[i, 2]), 0.0)
    dy = max(max(boxes[i, 1] - py, py - boxes[i, 3]), 0.0)
    return dx * dx + dy * dy


@njit
def distance_to_ground(px, py, facets, boxes):
    """Distance in m from a point to the nearest facet."""
    leaves = boxes.shape[0] // 2
    n = facets.shape[0] - 1
    stack = np.empty(64, np.int64)
    stack[0] = 1
    top, best = 1, NO_BOX
    while top > 0:
        top -= 1
        node = stack[top]
        if _box_distance2(boxes, node, px, py) >= best:
            continue
        if node >= leaves:
            start = (node - leaves) * LEAF
            for f in range(start, min(start + LEAF, n)):
                tx, ty = facets[f, TANGENT_X], facets[f, TANGENT_Y]
                dx, dy = px - facets[f, POINT_X], py - facets[f, POINT_Y]
                along = min(max(dx * tx + dy * ty, 0.0), facets[f, LENGTH])
                dx, dy = dx - along * tx, dy - along * ty
                best = min(best, dx * dx + dy * dy)
        else:
            # the nearer child is looked at first
            left, right = 2 * node, 2 * node + 1
            if _box_distance2(boxes, left, px, py) < _box_distance2(boxes, right, px, py):
                left, right = right, left
            stack[top], stack[top + 1] = left, right
            top += 2
    return np.sqrt(best)
