"""The centre of mass is not the centroid that is tracked."""

from collections.abc import Sequence
from dataclasses import replace

from rock2d.effects.changes import with_blocks
from rock2d.effects.effect import Effect, Parameter
from rock2d.effects.fitted_effect import FittedEffect
from rock2d.scene.blocks import Block
from rock2d.scene.world import World

# least inertia as a share of the stated one, which matters for blocks much smaller than others
SMALLEST_INERTIA = 0.1


def apply(world: World, values: Sequence[float]) -> World:
    """r_c = (along, across) × L in the axes of each block: the centre of mass relative to the centroid, L the blocks'
    mean size.

    The stated moment of inertia is about the centroid; a density gradient does not change it. About the centre of mass
    it is smaller by m r_c² (Steiner)."""
    size = world.fitted_size_m
    offset = (values[0] * size, values[1] * size)

    def displaced(block: Block) -> Block:
        stated = block.inertia_kg_m2
        inertia = stated - block.mass_kg * (offset[0] ** 2 + offset[1] ** 2)
        return replace(block, centre_of_mass_m=offset, inertia_kg_m2=max(inertia, SMALLEST_INERTIA * stated))

    return with_blocks(world, displaced)


def remedy(fitted: FittedEffect) -> str:
    """Balance the blocks to find the centre of mass."""
    along, across = (fitted.number(key, 1e3 * fitted.setup.mean_size_m) for key in ("along", "across"))
    return (
        f"Balance the blocks on an edge: the centre of mass should lie {along} mm along the block's own x and "
        f"{across} mm along its own y from the centroid. No key of experiment.yaml states it. Make the blocks of one "
        "material, or track the centre of mass instead of the centroid."
    )


EFFECT = Effect(
    name="mass_eccentricity",
    summary="the centre of mass is not the centroid that is tracked: flights wobble, impacts turn the block",
    source="rigid-body mechanics about the centre of mass, `rock2d.engines.geometry`; Steiner's theorem",
    phase="all",
    origin="block",
    parameters=(
        Parameter("along", "1", 0.0, -0.15, 0.15, "offset along the block's own x over the blocks' mean size"),
        Parameter("across", "1", 0.0, -0.15, 0.15, "offset along the block's own y over the blocks' mean size"),
    ),
    apply=apply,
    remedy=remedy,
)
