"""Shapes of blocks: their sizes and keys, geometry and moments of inertia."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from rock2d.arrays import Array

NO_CORNERS = np.empty((0, 2))
NO_AXES = (0.0, 0.0)


class BlockError(ValueError):
    """Sizes, mass or inertia that do not form a block.

    Attributes
    ----------
    key : the key that is wrong, for example "diameter_m", or None
    reason : the message without the name of the block"""

    def __init__(self, block: str, reason: str, key: str | None = None) -> None:
        super().__init__(f"block {block}: {reason}")
        self.block, self.reason, self.key = block, reason, key

    def __reduce__(self) -> tuple[type[BlockError], tuple[str, str, str | None]]:
        return type(self), (self.block, self.reason, self.key)


class Size(NamedTuple):
    """One size of a shape. `key` is its key in files and in `make_block`; `points` is True for a list of [x, y]."""

    key: str
    meaning: str
    points: bool = False


class Profile(NamedTuple):
    """The geometry of a block about its centroid.

    Attributes
    ----------
    semi_axes_m : (a, b) of a smooth profile, (0, 0) for a polygon
    corners_m : (n, 2) corners, counter-clockwise; (0, 2) if smooth
    inertia_per_mass_m2 : name of a mass distribution -> moment of inertia over mass"""

    semi_axes_m: tuple[float, float]
    corners_m: Array
    inertia_per_mass_m2: Mapping[str, float]


class Shape(NamedTuple):
    """A shape of blocks.

    Attributes
    ----------
    summary : one line
    sizes : its sizes
    inertias : names of its mass distributions
    profile : (name of the block, sizes by key) -> its geometry; raises BlockError
    sizes_of : (semi_axes_m, corners_m) of a block -> its sizes by key"""

    name: str
    summary: str
    sizes: tuple[Size, ...]
    inertias: tuple[str, ...]
    profile: Callable[[str, Mapping[str, Any]], Profile]
    sizes_of: Callable[[tuple[float, float], Array], dict[str, Any]]


def positive(name: str, key: str, sizes: Mapping[str, Any]) -> float:
    """The size `key` as a float; raises BlockError if it is missing or not positive."""
    value = sizes.get(key)
    if value is None or not value > 0:
        raise BlockError(name, f"{key} must be a positive number, got {value}", key)
    return float(value)


def length_and_height(corners_m: Array) -> dict[str, float]:
    """Length and height of the rectangle with these corners."""
    length, height = (2.0 * float(half) for half in corners_m.max(axis=0))
    return {"length_m": length, "height_m": height}


def polygon_moments(corners: Array) -> tuple[float, float]:
    """(area in m², polar second moment over area in m², about the origin) of counter-clockwise corners (n, 2)."""
    x, y = corners.T
    x2, y2 = np.roll(x, -1), np.roll(y, -1)
    cross = x * y2 - x2 * y
    area = 0.5 * cross.sum()
    polar = (cross * (x * x + x * x2 + x2 * x2 + y * y + y * y2 + y2 * y2)).sum() / 12.0
    return float(area), float(polar / area) if area else 0.0


def _circle(name: str, sizes: Mapping[str, Any]) -> Profile:
    radius = 0.5 * positive(name, "diameter_m", sizes)
    inertia_per_mass_m2 = {"uniform": 0.5 * radius**2, "solid_sphere": 0.4 * radius**2}
    return Profile((radius, radius), NO_CORNERS, inertia_per_mass_m2)


def _ellipse(name: str, sizes: Mapping[str, Any]) -> Profile:
    a = 0.5 * positive(name, "length_m", sizes)
    b = 0.5 * positive(name, "height_m", sizes)
    return Profile((a, b), NO_CORNERS, {"uniform": 0.25 * (a**2 + b**2)})


def _rectangular(a: float, b: float) -> Profile:
    """The profile of a rectangle with half length a and half height b."""
    corners = np.array([[-a, -b], [a, -b], [a, b], [-a, b]])
    return Profile(NO_AXES, corners, {"uniform": polygon_moments(corners)[1]})


def _rectangle(name: str, sizes: Mapping[str, Any]) -> Profile:
    return _rectangular(0.5 * positive(name, "length_m", sizes), 0.5 * positive(name, "height_m", sizes))


def _square(name: str, sizes: Mapping[str, Any]) -> Profile:
    half = 0.5 * positive(name, "side_m", sizes)
    return _rectangular(half, half)


def _polygon(name: str, sizes: Mapping[str, Any]) -> Profile:
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


SHAPES = (
    Shape(
        "circle",
        "A ball or disc.",
        (Size("diameter_m", "Diameter in m"),),
        ("uniform", "solid_sphere"),
        _circle,
        lambda semi_axes_m, corners_m: {"diameter_m": 2.0 * float(semi_axes_m[0])},
    ),
    Shape(
        "ellipse",
        "An elliptic profile.",
        (Size("length_m", "Axis along the body's own x in m"), Size("height_m", "Axis along the body's own y in m")),
        ("uniform",),
        _ellipse,
        lambda semi_axes_m, corners_m: {
            "length_m": 2.0 * float(semi_axes_m[0]),
            "height_m": 2.0 * float(semi_axes_m[1]),
        },
    ),
    Shape(
        "rectangle",
        "A rectangular profile.",
        (
            Size("length_m", "Length along the body's own x in m"),
            Size("height_m", "Length along the body's own y in m"),
        ),
        ("uniform",),
        _rectangle,
        lambda semi_axes_m, corners_m: length_and_height(corners_m),
    ),
    Shape(
        "square",
        "A square profile.",
        (Size("side_m", "Side in m"),),
        ("uniform",),
        _square,
        lambda semi_axes_m, corners_m: {"side_m": length_and_height(corners_m)["length_m"]},
    ),
    Shape(
        "polygon",
        "A convex polygon.",
        (Size("vertices_m", "Corners [[x, y], ...] in m, convex, in order around", points=True),),
        ("uniform",),
        _polygon,
        lambda semi_axes_m, corners_m: {"vertices_m": [[float(x), float(y)] for x, y in corners_m]},
    ),
)
