"""Where a block touches the ground, compiled.

A polygon has a contact for each corner and one for each ridge of the ground; a circle has one for each patch of it.
A `group` of corners (those into which one corner was cut) shares one contact. With a rounding, the corners of the
polygon are those of the inset polygon and carry circles of that radius.
"""

from __future__ import annotations

from typing import NamedTuple

import numba
import numpy as np

from rock2d.blind.reality.compiled_records import THETA, Body, ContactRows, Ground, X, Y
from rock2d.blind.reality.data_model import Array
from rock2d.blind.reality.ground import facet_at, nearest_on_facet, nearest_on_ground, outward_normal

# columns of a contact: depth in m, unit vector out of the ground, point of contact in m, facet
DEPTH, NX, NY, PX, PY, FACET = range(6)
N_FOUND = FACET + 1
NO_CONTACT = -1e9  # depth where nothing is near


class Pose(NamedTuple):
    """Position of the centre of mass in m, cosine and sine of the angle."""

    x: float
    y: float
    cos: float
    sin: float


@numba.njit
def find_contacts(state: Array, body: Body, ground: Ground, found: Array) -> tuple[ContactRows, float]:
    """Fill `found`; returns the rows that were looked at, and the least clearance in m (negative in contact)."""
    x, y = state[X], state[Y]
    c, s = np.cos(state[THETA]), np.sin(state[THETA])
    corners, rounding, group, points = body.corners, body.rounding, body.group, ground.points
    if group == 0:
        cx, cy = x + c * corners[0, 0] - s * corners[0, 1], y + s * corners[0, 0] + c * corners[0, 1]
        return _circle_contacts(cx, cy, rounding, ground, found)
    n = corners.shape[0] // group
    gap = 1e9
    for i in range(n):
        found[i, DEPTH] = NO_CONTACT
        for k in range(i * group, (i + 1) * group):
            px = x + c * corners[k, 0] - s * corners[k, 1]
            py = y + s * corners[k, 0] + c * corners[k, 1]
            depth, nx, ny, _, _, facet = nearest_on_ground(px, py, points)
            if depth + rounding > found[i, DEPTH]:
                found[i, DEPTH], found[i, NX], found[i, NY] = depth + rounding, nx, ny
                found[i, PX], found[i, PY], found[i, FACET] = px - rounding * nx, py - rounding * ny, facet
        gap = min(gap, -found[i, DEPTH])
    first = max(1, facet_at(x - 1.5 * body.reach, points))
    last = min(points.shape[0] - 1, facet_at(x + 1.5 * body.reach, points) + 1)
    pose = Pose(x, y, c, s)
    for v in range(first, last):
        if ground.ridges[v] == 0.0:
            continue
        clearance = _ridge_contact(v, n + v, pose, body, points, found)
        gap = min(gap, clearance)
    return ContactRows(n, n + first, n + max(first, last)), gap


@numba.njit
def _ridge_contact(v: int, row: int, pose: Pose, body: Body, points: Array, found: Array) -> float:
    """The contact (in `row`) of ridge v with the nearest face; returns a lower bound of its clearance in m."""
    c, s, corners, rounding = pose.cos, pose.sin, body.corners, body.rounding
    n = corners.shape[0]
    dx, dy = points[v, 0] - pose.x, points[v, 1] - pose.y
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
        found[row, DEPTH] = NO_CONTACT  # the circle of a corner meets it
    found[row, NX], found[row, NY] = -(c * mx - s * my), -(s * mx + c * my)
    found[row, PX], found[row, PY], found[row, FACET] = points[v, 0], points[v, 1], v - 1
    return high - rounding if found[row, DEPTH] != NO_CONTACT else max(high - rounding, 0.0) + 1e-3 * rounding


@numba.njit
def _circle_contacts(
    x: float, y: float, radius: float, ground: Ground, found: Array
) -> tuple[ContactRows, float]:
    points, patch = ground.points, ground.patch
    first, last = facet_at(x - 1.5 * radius, points), facet_at(x + 1.5 * radius, points) + 1
    p0, p1 = patch[first], patch[last - 1] + 1
    sunk = nearest_on_ground(x, y, points)[0] > 0.0
    for p in range(p0, p1):
        found[p, DEPTH] = NO_CONTACT
    gap = 1e9
    facets = points.shape[0] - 1
    for f in range(first, last):
        qx, qy, square, share = nearest_on_facet(x, y, f, points)
        clearance = np.sqrt(square)
        clearance = (-clearance if sunk else clearance) - radius
        gap = min(gap, clearance)
        p = patch[f]
        beyond = share < 0.0 and f > 0 and patch[f - 1] != p
        beyond = beyond or (share > 1.0 and f + 1 < facets and patch[f + 1] != p)
        if beyond or -clearance < found[p, DEPTH]:
            continue
        nx, ny = outward_normal(x, y, qx, qy, f, sunk, points)
        found[p, DEPTH], found[p, NX], found[p, NY] = -clearance, nx, ny
        found[p, PX], found[p, PY], found[p, FACET] = x - radius * nx, y - radius * ny, f
    return ContactRows(0 * p0, p0, p1), gap
