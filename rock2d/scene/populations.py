"""Blocks of a population: a profile of a family, made from its size and its density."""

from __future__ import annotations

import numpy as np

from rock2d.scene.blocks import Block, make_block

FAMILIES = ("circle", "square", "rectangle", "ellipse")
WITH_ASPECT = ("rectangle", "ellipse")


def block_of_size(name: str, shape: str, size_m: float, aspect: float, density_kg_m3: float) -> Block:
    """A block of a family.

    Parameters
    ----------
    shape : one of FAMILIES
    size_m : diameter of the circle of equal area; the block has the volume of a ball of this diameter
    aspect : length over height, of a rectangle or an ellipse

    Raises BlockError if a size makes no sense.
    """
    mass_kg = density_kg_m3 * np.pi / 6 * size_m**3
    if shape == "circle":
        return make_block(name, shape, mass_kg, "solid_sphere", diameter_m=size_m)
    if shape == "square":
        return make_block(name, shape, mass_kg, side_m=size_m * np.sqrt(np.pi) / 2)
    height_m = size_m / np.sqrt(aspect) * (np.sqrt(np.pi) / 2 if shape == "rectangle" else 1.0)
    return make_block(name, shape, mass_kg, length_m=aspect * height_m, height_m=height_m)
