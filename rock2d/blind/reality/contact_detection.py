"""The polyline of the ground, and where a block touches it, compiled. The end facets have no end.

A polygon has a contact for each corner and one for each ridge of the ground; a circle has one for each patch of it.
A `group` of corners (those into which one corner was cut) shares one contact. With a rounding, the corners of the
polygon are those of the inset polygon and carry circles of that radius."""

from typing import NamedTuple

import numba
import numpy as np

from rock2d.blind.reality.compiled_records import THETA, Body, ContactRows, Ground, X, Y
from rock2d.blind.reality.data_model import Array

# columns of a contact: depth in m, unit vector out of the ground, point of contact in m, facet
DEPTH, NX, NY, PX, PY, FACET = range(6)
N_FOUND = FACET + 1
NO_CONTACT = -1e9  # depth where nothing is near
HOLLOW_TURN_RAD = 0.2  # a sharper hollow divides the ground into patches, each of which may touch a circle
RIDGE_TURN_RAD = 0.05  # a sharper ridge may touch the face of a polygon


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
            depth, nx, ny, facet = nearest_on_ground(px, py, points)
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
def _circle_contacts(x: float, y: float, radius: float, ground: Ground, found: Array) -> tuple[ContactRows, float]:
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
    return ContactRows(0 * p0, p0, p1), gap  # 0 with the type of the others


@numba.njit
def facet_at(x: float, points: Array) -> int:
    """The facet above or below x."""
    low, high = 0, points.shape[0] - 1
    while high - low > 1:
        middle = (low + high) // 2
        if points[middle, 0] <= x:
            low = middle
        else:
            high = middle
    return low


@numba.njit
def nearest_on_facet(x: float, y: float, f: int, points: Array) -> tuple[float, float, float, float]:
    """Nearest point of facet f in m, its squared distance, and where it lies on the facet's line (0 to 1 within)."""
    ax, ay = points[f, 0], points[f, 1]
    bx, by = points[f + 1, 0] - ax, points[f + 1, 1] - ay
    share = ((x - ax) * bx + (y - ay) * by) / (bx * bx + by * by)
    at = share
    if f > 0:
        at = max(at, 0.0)
    if f < points.shape[0] - 2:
        at = min(at, 1.0)
    qx, qy = ax + at * bx, ay + at * by
    return qx, qy, (x - qx) ** 2 + (y - qy) ** 2, share


@numba.njit
def is_below(x: float, y: float, f: int, points: Array) -> bool:
    """Whether a point above or below facet f is in the solid."""
    ax, ay = points[f, 0], points[f, 1]
    bx, by = points[f + 1, 0] - ax, points[f + 1, 1] - ay
    return bx * (y - ay) - by * (x - ax) < 0.0


@numba.njit
def outward_normal(x: float, y: float, qx: float, qy: float, f: int, sunk: bool, points: Array) -> tuple[float, float]:
    """Unit vector out of the solid at the nearest point (qx, qy) of (x, y)."""
    dx, dy = x - qx, y - qy
    if sunk:
        dx, dy = -dx, -dy
    length = np.sqrt(dx * dx + dy * dy)
    bx, by = points[f + 1, 0] - points[f, 0], points[f + 1, 1] - points[f, 1]
    if length < 1e-9 * (abs(bx) + abs(by)):
        dx, dy = -by, bx
        length = np.sqrt(dx * dx + dy * dy)
    return dx / length, dy / length


@numba.njit
def nearest_on_ground(x: float, y: float, points: Array) -> tuple[float, float, float, int]:
    """Depth of a point in m (negative: height above the surface), outward unit vector, nearest facet."""
    home = facet_at(x, points)
    qx, qy, best, _ = nearest_on_facet(x, y, home, points)
    at = home
    f = home - 1
    while f >= 0 and (x <= points[f + 1, 0] or (x - points[f + 1, 0]) ** 2 < best):
        px, py, square, _ = nearest_on_facet(x, y, f, points)
        if square < best:
            qx, qy, best, at = px, py, square, f
        f -= 1
    f = home + 1
    while f < points.shape[0] - 1 and (x >= points[f, 0] or (points[f, 0] - x) ** 2 < best):
        px, py, square, _ = nearest_on_facet(x, y, f, points)
        if square < best:
            qx, qy, best, at = px, py, square, f
        f += 1
    sunk = is_below(x, y, home, points)
    nx, ny = outward_normal(x, y, qx, qy, at, sunk, points)
    depth = np.sqrt(best)
    return (depth if sunk else -depth), nx, ny, at


def ground_turns(points: Array) -> Array:
    """(n,) turn of the ground at each point in rad, positive in hollows, 0 at the ends."""
    step = np.diff(points, axis=0)
    direction = np.arctan2(step[:, 1], step[:, 0])
    return np.concatenate([[0.0], np.diff(direction), [0.0]])


def ground_patches(points: Array) -> Array:
    """(n - 1,) patch of each facet: runs of facets without a sharp hollow."""
    return np.concatenate([[0], np.cumsum(ground_turns(points)[1:-1] > HOLLOW_TURN_RAD)]).astype(np.int64)
