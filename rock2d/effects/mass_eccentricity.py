"""The centre of mass is not the centroid that is tracked."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from rock2d.effects.changes import with_blocks
from rock2d.effects.effect import Effect, Parameter
from rock2d.scene.world import World


def apply(world: World, values: Sequence[float]) -> World:
    """r_c = (along, across) × L in the axes of each block: the centre of mass beside the centroid, L the blocks' mean
    size."""
    size = world.mean_size_m
    offset = (values[0] * size, values[1] * size)
    return with_blocks(world, lambda block: replace(block, centre_of_mass_m=offset))


EFFECT = Effect(
    name="mass_eccentricity",
    summary="the centre of mass is not the centroid that is tracked: flights wobble, impacts turn the block",
    source="rigid-body mechanics about the centre of mass, `rock2d.engines.geometry`",
    phase="all",
    origin="block",
    parameters=(
        Parameter(
            "along", "1", 0.0, -0.15, 0.15, "offset along the block's own x over the blocks' mean size"
        ),
        Parameter(
            "across", "1", 0.0, -0.15, 0.15, "offset along the block's own y over the blocks' mean size"
        ),
    ),
    apply=apply,
)
