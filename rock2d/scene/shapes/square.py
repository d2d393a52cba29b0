"""Squares: cubes seen from the side."""

from collections.abc import Mapping
from typing import Any

from rock2d.scene.shapes.rectangle import rectangle
from rock2d.scene.shapes.shape import Profile, Shape, Size, length_and_height, positive


def _profile(name: str, sizes: Mapping[str, Any]) -> Profile:
    half = 0.5 * positive(name, "side_m", sizes.get("side_m"))
    return rectangle(half, half)


SHAPE = Shape(
    "square",
    "A square profile.",
    (Size("side_m", "Side in m"),),
    ("uniform",),
    _profile,
    lambda semi_axes_m, corners_m: {"side_m": length_and_height(corners_m)["length_m"]},
)
