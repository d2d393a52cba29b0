"""Circles: balls and discs."""

from collections.abc import Mapping
from typing import Any

from rock2d.scene.shapes.shape import NO_CORNERS, Profile, Shape, Size, positive


def _profile(name: str, sizes: Mapping[str, Any]) -> Profile:
    radius = 0.5 * positive(name, "diameter_m", sizes.get("diameter_m"))
    inertia_per_mass_m2 = {"uniform": 0.5 * radius**2, "solid_sphere": 0.4 * radius**2}
    return Profile((radius, radius), NO_CORNERS, inertia_per_mass_m2)


SHAPE = Shape(
    "circle",
    "A ball or disc.",
    (Size("diameter_m", "Diameter in m"),),
    ("uniform", "solid_sphere"),
    _profile,
    lambda semi_axes_m, corners_m: {"diameter_m": 2.0 * float(semi_axes_m[0])},
)
