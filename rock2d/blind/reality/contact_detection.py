"""Where a block touches the ground, compiled.

A polygon has a contact for each corner and one for each ridge of the ground; a circle has one for each patch of it.
A `group` of corners, those into which one was cut, shares the contact of the one they were. With a rounding, the
polygon's corners are those of the inset polygon and carry circles of that radius.
Columns of a contact found: depth in m, unit vector out of the ground, point of contact in m, facet.
"""

from __future__ import annotations

import numba
import numpy as np

from rock2d.blind.reality.data_model import Array
from rock2d.blind.reality.ground import facet_at, foot, outward, sink

DEPTH, NX, NY, PX, PY, FACET = range(6)
NONE = -1e9  # depth of what is nowhere near


@numba.njit
def find(
    x: float, y: float, theta: float, corners: Array, rounding: float, group: int, reach: float, points: Array,
    ridges: Array, patch: Array, found: Array,
) -> tuple[int, int, float]:  # fmt: skip
    """Fill `found`; returns the range of those contacts beyond the corners that were looked at, and the least
    clearance in m (negative where something touches)."""
    c, s = np.cos(theta), np.sin(theta)
    if group == 0:
        cx, cy = x + c * corners[0, 0] - s * corners[0, 1], y + s * corners[0, 0] + c * corners[0, 1]
        return _circle(cx, cy, rounding, points, patch, found)
    n = corners.shape[0] // group
    gap = 1e9
    for i in range(n):
        found[i, DEPTH] = NONE
        for k in range(i * group, (i + 1) * group):
            px = x + c * corners[k, 0] - s * corners[k, 1]
            py = y + s * corners[k, 0] + c * corners[k, 1]
            depth, nx, ny, _, _, facet = sink(px, py, points)
            if depth + rounding > found[i, DEPTH]:
                found[i, DEPTH], found[i, NX], found[i, NY] = depth + rounding, nx, ny
                found[i, PX], found[i, PY], found[i, FACET] = px - rounding * nx, py - rounding * ny, facet
        gap = min(gap, -found[i, DEPTH])
    first = max(1, facet_at(x - 1.5 * reach, points))
    last = min(points.shape[0] - 1, facet_at(x + 1.5 * reach, points) + 1)
    for v in range(first, last):
        if ridges[v] == 0.0:
            continue
        clear = _ridge(v, n + v, x, y, c, s, corners, rounding, points, found)
        gap = min(gap, clear)
    return n + first, n + max(first, last), gap


@numba.njit
def _ridge(
    v: int,
    row: int,
    x: float,
    y: float,
    c: float,
    s: float,
    corners: Array,
    rounding: float,
    points: Array,
    found: Array,
) -> float:
    """The contact (in `row`) of ridge v with the nearest face; returns a lower bound of its clearance in m."""
    n = corners.shape[0]
    dx, dy = points[v, 0] - x, points[v, 1] - y
    bx, by = c * dx + s * dy, -s * dx + c * dy
    high, mx, my, within = -1e9, 0.0, 0.0, True
    for i in range(n):
        k = i + 1 if i + 1 < n else 0
        ex, ey = corners[k, 0] - corners[i, 0], corners[k, 1] - corners[i, 1]
        length = np.sqrt(ex * ex + ey * ey)
        ax, ay = ey / length, -ex / length
        h = (bx - corners[i, 0]) * ax + (by - corners[i, 1]) * ay
        if h > high:
            along = (bx - corners[i, 0]) * ex + (by - corners[i, 1]) * ey
            high, mx, my, within = h, ax, ay, 0.0 <= along <= length * length
    found[row, DEPTH] = rounding - high
    if high > 0.0 and not within:
        found[row, DEPTH] = NONE  # the circle of a corner meets it
    found[row, NX], found[row, NY] = -(c * mx - s * my), -(s * mx + c * my)
    found[row, PX], found[row, PY], found[row, FACET] = points[v, 0], points[v, 1], v - 1
    return high - rounding if found[row, DEPTH] != NONE else max(high - rounding, 0.0) + 1e-3 * rounding


@numba.njit
def _circle(
    x: float, y: float, radius: float, points: Array, patch: Array, found: Array
) -> tuple[int, int, float]:
    first, last = facet_at(x - 1.5 * radius, points), facet_at(x + 1.5 * radius, points) + 1
    p0, p1 = patch[first], patch[last - 1] + 1
    sunk = sink(x, y, points)[0] > 0.0
    for p in range(p0, p1):
        found[p, DEPTH] = NONE
    gap = 1e9
    facets = points.shape[0] - 1
    for f in range(first, last):
        qx, qy, square, share = foot(x, y, f, points)
        clear = np.sqrt(square)
        clear = (-clear if sunk else clear) - radius
        gap = min(gap, clear)
        p = patch[f]
        beyond = share < 0.0 and f > 0 and patch[f - 1] != p
        beyond = beyond or (share > 1.0 and f + 1 < facets and patch[f + 1] != p)
        if beyond or -clear < found[p, DEPTH]:
            continue
        nx, ny = outward(x, y, qx, qy, f, sunk, points)
        found[p, DEPTH], found[p, NX], found[p, NY] = -clear, nx, ny
        found[p, PX], found[p, PY], found[p, FACET] = x - radius * nx, y - radius * ny, f
    return p0, p1, gap
