"""Rectangles."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from rock2d.scene.shapes.shape import NO_AXES, Profile, Shape, Size, length_and_height, polygon_moments, positive


def rectangle(a: float, b: float) -> Profile:
    """The profile of a rectangle with half length a and half height b."""
    corners = np.array([[-a, -b], [a, -b], [a, b], [-a, b]])
    return Profile(NO_AXES, corners, {"uniform": polygon_moments(corners)[1]})


def _profile(name: str, sizes: Mapping[str, Any]) -> Profile:
    a = 0.5 * positive(name, "length_m", sizes.get("length_m"))
    b = 0.5 * positive(name, "height_m", sizes.get("height_m"))
    return rectangle(a, b)


SHAPE = Shape(
    "rectangle",
    "A rectangular profile.",
    (Size("length_m", "Length along the body's own x in m"), Size("height_m", "Length along the body's own y in m")),
    ("uniform",),
    _profile,
    lambda semi_axes_m, corners_m: length_and_height(corners_m),
)
