"""A shape of blocks: its sizes and their keys, its geometry and its moments of inertia."""

from __future__ import annotations

from collections.abc import Callable, Mapping
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


def positive(name: str, key: str, value: Any) -> float:
    """`value` as a float; raises BlockError if it is missing or not positive."""
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
