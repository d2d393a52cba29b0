"""Area, second moment and centroid of polygons."""

from __future__ import annotations

import numpy as np

Array = np.ndarray


def polygon_moments(corners: Array) -> tuple[float, float]:
    """Area and polar second moment per area about the origin (counter-clockwise corners)."""
    x, y = corners.T
    x2, y2 = np.roll(x, -1), np.roll(y, -1)
    cross = x * y2 - x2 * y
    area = 0.5 * cross.sum()
    polar = (cross * (x * x + x * x2 + x2 * x2 + y * y + y * y2 + y2 * y2)).sum() / 12.0
    return float(area), float(polar / area) if area else 0.0
