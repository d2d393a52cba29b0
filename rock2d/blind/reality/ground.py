"""The polyline of the ground, compiled: nearest points and the side of a point. The end facets have no end."""

from __future__ import annotations

import numba
import numpy as np

from rock2d.blind.reality.data_model import Array

HOLLOW_TURN_RAD = 0.2  # a sharper hollow divides the ground into patches, each of which may touch a circle
RIDGE_TURN_RAD = 0.05  # a sharper ridge may touch the face of a polygon


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
def outward_normal(
    x: float, y: float, qx: float, qy: float, f: int, sunk: bool, points: Array
) -> tuple[float, float]:
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
def nearest_on_ground(x: float, y: float, points: Array) -> tuple[float, float, float, float, float, int]:
    """Depth of a point in m (negative: height above the surface), outward unit vector, nearest point, facet."""
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
    return (depth if sunk else -depth), nx, ny, qx, qy, at


def ground_turns(points: Array) -> Array:
    """(n,) turn of the ground at each point in rad, positive in hollows, 0 at the ends."""
    step = np.diff(points, axis=0)
    direction = np.arctan2(step[:, 1], step[:, 0])
    return np.concatenate([[0.0], np.diff(direction), [0.0]])


def ground_patches(points: Array) -> Array:
    """(n - 1,) patch of each facet: runs of facets without a sharp hollow."""
    return np.concatenate([[0], np.cumsum(ground_turns(points)[1:-1] > HOLLOW_TURN_RAD)]).astype(np.int64)
