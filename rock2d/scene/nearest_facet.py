"""The facet of a cross-section that is nearest to a point, for many points at once."""

from __future__ import annotations

import numpy as np

from rock2d.compiled import njit


@njit
def nearest_facets(at, points):
    """(n,) index of the facet of the polyline `points` (m + 1, 2) that is nearest to each point `at` (n, 2)."""
    found = np.zeros(len(at), np.int64)
    for i in range(len(at)):
        x, y, best = at[i, 0], at[i, 1], np.inf
        for j in range(len(points) - 1):
            x0, x1 = points[j, 0], points[j + 1, 0]
            beside = max(min(x0, x1) - x, x - max(x0, x1))
            if beside > 1.000001 * best:  # farther than the best even with rounding
                continue
            ex, ey = x1 - x0, points[j + 1, 1] - points[j, 1]
            ax, ay = x - x0, y - points[j, 1]
            along = min(max((ax * ex + ay * ey) / (ex * ex + ey * ey), 0.0), 1.0)
            distance = np.hypot(ax - along * ex, ay - along * ey)
            if distance < best:
                best = distance
                found[i] = j
    return found
