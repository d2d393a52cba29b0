"""Convex polygons."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from rock2d.arrays import Array
from rock2d.scene.shapes.shape import NO_AXES, BlockError, Profile, Shape, Size, polygon_moments


def _profile(name: str, sizes: Mapping[str, Any]) -> Profile:
    corners = _convex_corners(name, sizes.get("vertices_m"))
    return Profile(NO_AXES, corners, {"uniform": polygon_moments(corners)[1]})


def _convex_corners(name: str, vertices: Sequence[Sequence[float]] | None) -> Array:
    corners = np.asarray(vertices if vertices is not None else [], float)
    if corners.ndim != 2 or corners.shape[1] != 2 or len(corners) < 3:
        raise BlockError(name, "vertices_m must be at least three [x, y] points", "vertices_m")
    if polygon_moments(corners)[0] < 0:
        corners = corners[::-1]
    edge = np.roll(corners, -1, axis=0) - corners
    turn = edge[:, 0] * np.roll(edge[:, 1], -1) - edge[:, 1] * np.roll(edge[:, 0], -1)
    # all turns to the left, and one full turn in all: excludes stars
    angle = np.arctan2(turn, (edge * np.roll(edge, -1, axis=0)).sum(axis=1))
    if not (turn > 0).all() or abs(angle.sum() - 2 * np.pi) > 1e-6:
        raise BlockError(name, "vertices_m must be a strictly convex polygon", "vertices_m")
    x, y = corners.T
    x2, y2 = np.roll(x, -1), np.roll(y, -1)
    cross = x * y2 - x2 * y
    centroid = np.array([((x + x2) * cross).sum(), ((y + y2) * cross).sum()]) / (3.0 * cross.sum())
    return np.ascontiguousarray(corners - centroid)


SHAPE = Shape(
    "polygon",
    "A convex polygon.",
    (Size("vertices_m", "Corners [[x, y], ...] in m, convex, in order around", points=True),),
    ("uniform",),
    _profile,
    lambda semi_axes_m, corners_m: {"vertices_m": [[float(x), float(y)] for x, y in corners_m]},
)
