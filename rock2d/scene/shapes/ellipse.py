"""Ellipses."""

from collections.abc import Mapping
from typing import Any

from rock2d.scene.shapes.shape import NO_CORNERS, Profile, Shape, Size, positive


def _profile(name: str, sizes: Mapping[str, Any]) -> Profile:
    a = 0.5 * positive(name, "length_m", sizes.get("length_m"))
    b = 0.5 * positive(name, "height_m", sizes.get("height_m"))
    return Profile((a, b), NO_CORNERS, {"uniform": 0.25 * (a**2 + b**2)})


SHAPE = Shape(
    "ellipse",
    "An elliptic profile.",
    (Size("length_m", "Axis along the body's own x in m"), Size("height_m", "Axis along the body's own y in m")),
    ("uniform",),
    _profile,
    lambda semi_axes_m, corners_m: {"length_m": 2.0 * float(semi_axes_m[0]), "height_m": 2.0 * float(semi_axes_m[1])},
)
