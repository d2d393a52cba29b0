"""Intersection of parabolas with the cross-section: the next impact of a flying point, by a tree of boxes, compiled.

No point passes through the ground. The facet just left counts as touched exactly (its root is 2 v_n / (g n_y), without
comparing distances); every impact puts the point back onto its facet; and facets extend `Surface.reach_m` (1e-12 of the
coordinates, for rounding) beyond their ends and to their rear, so that a parabola through a joint meets one of its two
facets.

Parallel code uses numbers and whole arrays only: a view of a row changes a reference count, for which all threads would
wait."""

from typing import NamedTuple

import numpy as np

from rock2d.arrays import Array
from rock2d.compiled import njit
from rock2d.scene.cross_section import CrossSection

LEAF_FACETS = 4  # facets in a leaf of the tree
# columns of a facet: start, unit tangent, length
START_X, START_Y, ALONG_X, ALONG_Y, FACET_LENGTH = range(5)
# columns of a box: x range; slope m and greatest y - m x; x between which there are facets of this box only
BOX_LOW, BOX_HIGH, BOX_SLOPE, BOX_TOP, ONLY_FROM, ONLY_TO = range(6)


class Surface(NamedTuple):
    """A cross-section as compiled code reads it.

    facets : (n, 5) start x, y, unit tangent x, y, length; zones : (n,) zone ids
    boxes : (2 leaves - 1, 6) x_low, x_high, slope m and greatest y - m x: boxes along the ground, open downwards; then
        the x range in which all facets belong to this box. The children of box i are 2i+1 and 2i+2; the last `leaves`
        boxes hold LEAF_FACETS facets each
    x_low_m, x_high_m : ends of the cross-section; reach_m : see the module"""

    facets: Array
    zones: Array
    boxes: Array
    x_low_m: float
    x_high_m: float
    reach_m: float


_latest: tuple[CrossSection, Surface] | None = None


def make_surface(cross_section: CrossSection) -> Surface:
    """Prepare a cross-section for compiled code; the latest one is cached, because many releases use it in turn."""
    global _latest
    known = _latest
    if known is not None and known[0] is cross_section:
        return known[1]
    points = cross_section.points_m
    length = np.hypot(*np.diff(points, axis=0).T)
    facets = np.ascontiguousarray(np.column_stack([points[:-1], cross_section.tangents, length]))
    reach = 1e-12 * max(float(np.abs(points).max()), float(np.ptp(points, axis=0).max()))
    leaves = 1
    while leaves * LEAF_FACETS < len(facets):
        leaves *= 2
    left, right = float(points[:, 0].min()) - reach, float(points[:, 0].max()) + reach
    surface = Surface(facets, cross_section.zone_ids, _tree(points, leaves, reach), left, right, reach)
    _latest = cross_section, surface
    return surface


@njit
def _tree(points, leaves, reach):
    """The boxes of a Surface; those beyond the last facet are empty."""
    boxes = np.empty((2 * leaves - 1, ONLY_TO + 1))
    last = len(points) - 1
    before, after = points[:, 0].copy(), points[:, 0].copy()  # greatest x up to a point, least x from it on
    for j in range(last):
        before[j + 1] = max(before[j], before[j + 1])
        after[last - j - 1] = min(after[last - j], after[last - j - 1])
    held, first = leaves * LEAF_FACETS, 0  # facets a box holds, first box of the level
    while held >= LEAF_FACETS:
        for i in range(first, 2 * first + 1):
            start = (i - first) * held
            stop = min(start + held, last)
            box = boxes[i]
            box[BOX_LOW], box[BOX_HIGH], box[BOX_SLOPE], box[BOX_TOP] = np.inf, -np.inf, 0.0, -np.inf
            box[ONLY_FROM], box[ONLY_TO] = -np.inf, np.inf
            if start >= stop:
                continue
            across, rise = points[stop, 0] - points[start, 0], points[stop, 1] - points[start, 1]
            slope = rise / across if abs(rise) < 4.0 * across else 0.0
            for j in range(start, stop + 1):
                height = points[j, 1] - slope * points[j, 0]
                box[BOX_LOW], box[BOX_HIGH] = (min(box[BOX_LOW], points[j, 0]), max(box[BOX_HIGH], points[j, 0]))
                box[BOX_TOP] = max(box[BOX_TOP], height)
            margin = 2.0 * (1.0 + abs(slope)) * reach
            box[BOX_LOW], box[BOX_HIGH] = box[BOX_LOW] - margin, box[BOX_HIGH] + margin
            box[BOX_SLOPE], box[BOX_TOP] = slope, box[BOX_TOP] + margin
            if start > 0:
                box[ONLY_FROM] = before[start] + margin
            if stop < last:
                box[ONLY_TO] = after[stop] - margin
        held, first = held // 2, 2 * first + 1
    return boxes


@njit
def _facet(facets, j):
    return (facets[j, START_X], facets[j, START_Y], facets[j, ALONG_X], facets[j, ALONG_Y], facets[j, FACET_LENGTH])


@njit
def next_impact(surface, stack, flight, gravity, current, limit):
    """(time to the next impact, facet), or (limit, -1) if there is none within `limit`.

    `flight` is (x, y, vx, vy) at its start; `current` the facet on which the point sits, -1 if it starts in the air."""
    x, _, vx, _ = flight
    facets, boxes = surface.facets, surface.boxes
    first_leaf = len(boxes) // 2
    best, found = limit, -1
    best_v_n = 0.0
    per_vx = 1.0 / vx if abs(vx) > 1e-300 else 0.0
    first_child = 1 if vx >= 0.0 else 2  # the child that the flight reaches first
    # most flights are short: search the leaf where this one starts, then larger and larger parts around it
    searched = 0 if current < 0 else first_leaf + current // LEAF_FACETS
    box, top, met = searched, 0, True
    while True:
        # both children are checked without a branch, which the processor could not predict
        while met and box < first_leaf:
            near, far = 2 * box + first_child, 2 * box + 3 - first_child
            near_met = _meets(boxes, near, flight, per_vx, gravity, best)
            far_met = _meets(boxes, far, flight, per_vx, gravity, best)
            stack[top] = far
            top += near_met & far_met
            met = near_met | far_met
            box = near if near_met else far
        if met:
            start = (box - first_leaf) * LEAF_FACETS
            for j in range(start, min(start + LEAF_FACETS, len(facets))):
                tau, v_n = facet_impact(facets, j, flight, gravity, j == current, surface.reach_m)
                # if two facets are met at once, at a joint, the harder impact counts
                if 0.0 <= tau < best or (tau == best and (found < 0 or v_n < best_v_n)):
                    best, found = tau, j
                    best_v_n = v_n
            end = x + vx * best
            if (vx >= 0.0 and end < boxes[box, ONLY_TO]) or (vx < 0.0 and end > boxes[box, ONLY_FROM]):
                top = 0  # the waiting boxes lie beyond the end of the flight
        if top > 0:
            top -= 1
            box = stack[top]
            met = _meets(boxes, box, flight, per_vx, gravity, best)
            continue
        end = x + vx * best
        left, right = min(x, end), max(x, end)
        met = False
        while searched > 0 and not met and (boxes[searched, ONLY_FROM] >= left or boxes[searched, ONLY_TO] <= right):
            box = ((searched + 1) ^ 1) - 1  # the other child of its parent
            searched = (searched - 1) // 2
            met = _meets(boxes, box, flight, per_vx, gravity, best)
        if not met:
            return best, found


@njit
def _meets(boxes, i, flight, per_vx, gravity, limit):
    """Whether the flight may touch box `i` within `limit`; False only if it surely does not. `per_vx` is 1/vx, or 0 if
    vx is 0."""
    x, y, vx, vy = flight
    t0, t1 = 0.0, limit
    if per_vx == 0.0:
        if x < boxes[i, BOX_LOW] or x > boxes[i, BOX_HIGH]:
            return False
    else:
        a, b = (boxes[i, BOX_LOW] - x) * per_vx, (boxes[i, BOX_HIGH] - x) * per_vx
        t0, t1 = max(t0, min(a, b)), min(t1, max(a, b))
    # in sheared coordinates the flight is still a parabola
    y, vy = y - boxes[i, BOX_SLOPE] * x, vy - boxes[i, BOX_SLOPE] * vx
    y0, y1 = y + (vy - 0.5 * gravity * t0) * t0, y + (vy - 0.5 * gravity * t1) * t1
    return (t0 <= t1) & (min(y0, y1) <= boxes[i, BOX_TOP])


@njit
def facet_impact(facets, j, flight, gravity, touching, reach):
    """(time in s, v_n in m/s) at which the flight meets the front of facet `j`; (-1, 0) if it does not.

    The distance to its line is s = c + b τ - ½ a τ²; of the two roots the one with ds/dτ < 0."""
    x, y, vx, vy = flight
    x0, y0, tx, ty, length = _facet(facets, j)
    b = vy * tx - vx * ty
    a = gravity * tx
    if touching:
        c = 0.0
    else:
        c = (y - y0) * tx - (x - x0) * ty
        if -reach <= c < 0.0:
            c = 0.0
    square = b * b + 2.0 * a * c
    if square < 0.0:
        return -1.0, 0.0
    root = np.sqrt(square)
    if b < 0.0:
        tau = 2.0 * c / (root - b)
    elif a > 0.0:
        tau = (b + root) / a
    else:
        return -1.0, 0.0
    along = (x + vx * tau - x0) * tx + (y + (vy - 0.5 * gravity * tau) * tau - y0) * ty
    if tau < 0.0 or along < -reach or along > length + reach:
        return -1.0, 0.0
    return tau, -root


@njit
def lifted_to_surface(surface, stack, x, y):
    """`y`, or the height of the surface above (x, y) if that point lies in the ground.

    The point lies in the ground if, of the facets straight above it, one more has the ground below than above."""
    facets, boxes = surface.facets, surface.boxes
    first_leaf = len(boxes) // 2
    inside, height = 0, np.inf
    stack[0], top = 0, 1
    while top > 0:
        top -= 1
        i = stack[top]
        if x < boxes[i, BOX_LOW] or x > boxes[i, BOX_HIGH] or y - boxes[i, BOX_SLOPE] * x > boxes[i, BOX_TOP]:
            continue
        if i < first_leaf:
            stack[top], stack[top + 1] = 2 * i + 1, 2 * i + 2
            top += 2
            continue
        start = (i - first_leaf) * LEAF_FACETS
        for j in range(start, min(start + LEAF_FACETS, len(facets))):
            x0, y0, tx, ty, length = _facet(facets, j)
            x1 = x0 + length * tx
            if tx == 0.0 or not min(x0, x1) <= x < max(x0, x1):
                continue
            above = y0 + (x - x0) * ty / tx
            if above > y + surface.reach_m:
                inside += 1 if tx > 0.0 else -1
                if tx > 0.0:
                    height = min(height, above)
    return height if inside > 0 else y
