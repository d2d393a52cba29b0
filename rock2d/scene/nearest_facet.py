"""The facet of a cross-section that is nearest to a point, for many points at once."""

import numpy as np

from rock2d.compiled import njit


def nearest_facets(at: np.ndarray, points: np.ndarray) -> np.ndarray:
    """(n,) index of the facet of the polyline `points` (m + 1, 2) that is nearest to each point `at` (n, 2)."""
    found: np.ndarray = _nearest(np.require(at, float, ("C", "W")), points)  # so that it is compiled once
    return found


@njit
def _nearest(at, points):
    found = np.zeros(len(at), np.int64)
    for i in range(len(at)):
        x, y, best, most = at[i, 0], at[i, 1], np.inf, np.inf
        for j in range(len(points) - 1):
            if _beside(x, points, j) <= 0.0:  # the nearest facet is not farther than a facet above or below
                most = _distance(x, y, points, j)
                break
        for j in range(len(points) - 1):
            if _beside(x, points, j) > 1.000001 * min(best, most):  # farther even with rounding
                continue
            distance = _distance(x, y, points, j)
            if distance < best:
                best = distance
                found[i] = j
    return found


@njit
def _beside(x, points, j):
    """Distance in m of x from the x range of facet j; negative inside."""
    x0, x1 = points[j, 0], points[j + 1, 0]
    return max(min(x0, x1) - x, x - max(x0, x1))


@njit
def _distance(x, y, points, j):
    ex, ey = points[j + 1, 0] - points[j, 0], points[j + 1, 1] - points[j, 1]
    ax, ay = x - points[j, 0], y - points[j, 1]
    along = min(max((ax * ex + ay * ey) / (ex * ex + ey * ey), 0.0), 1.0)
    return np.hypot(ax - along * ex, ay - along * ey)
