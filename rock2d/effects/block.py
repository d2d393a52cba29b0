"""Effects of the block: centre of mass, moment of inertia and corners differ from the stated ones."""

from collections.abc import Sequence
from dataclasses import replace

from rock2d.effects.changes import with_blocks
from rock2d.effects.effect import Effect, Parameter
from rock2d.effects.fitted_effect import FittedEffect
from rock2d.scene.blocks import Block
from rock2d.scene.world import World

# least inertia as a share of the stated one, which matters for blocks much smaller than others
SMALLEST_INERTIA = 0.1


def with_mass_eccentricity(world: World, values: Sequence[float]) -> World:
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


def mass_eccentricity_remedy(fitted: FittedEffect) -> str:
    """Balance the blocks to find the centre of mass."""
    along, across = (fitted.number(key, 1e3 * fitted.setup.mean_size_m) for key in ("along", "across"))
    return (
        f"Balance the blocks on an edge: the centre of mass should lie {along} mm along the block's own x and "
        f"{across} mm along its own y from the centroid. No key of experiment.yaml states it. Make the blocks of one "
        "material, or track the centre of mass instead of the centroid."
    )


MASS_ECCENTRICITY = Effect(
    name="mass_eccentricity",
    summary="the centre of mass is not the centroid that is tracked: flights wobble, impacts turn the block",
    source="rigid-body mechanics about the centre of mass, `rock2d.engines.geometry`; Steiner's theorem",
    phase="all",
    origin="block",
    parameters=(
        Parameter("along", "1", 0.0, -0.15, 0.15, "offset along the block's own x over the blocks' mean size"),
        Parameter("across", "1", 0.0, -0.15, 0.15, "offset along the block's own y over the blocks' mean size"),
    ),
    apply=with_mass_eccentricity,
    remedy=mass_eccentricity_remedy,
)


def with_inertia_error(world: World, values: Sequence[float]) -> World:
    """I true = factor × I stated, for every block."""
    factor = float(values[0])
    return with_blocks(world, lambda block: replace(block, inertia_kg_m2=factor * block.inertia_kg_m2))


def inertia_error_remedy(fitted: FittedEffect) -> str:
    """State the fitted moment of inertia."""
    inertias = {name: block.inertia_kg_m2 for name, block in fitted.setup.blocks.items()}
    stated = ", ".join(f"{name} `inertia: {fitted.values['factor'] * v:.4g}`" for name, v in inertias.items())
    return (
        f"The moment of inertia is {fitted.number('factor')} times the stated one. Set in experiment.yaml: {stated} "
        "(kg m²), and diagnose again. Measure it, for example as a pendulum: are the blocks hollow, cored or of two "
        "materials?"
    )


INERTIA_ERROR = Effect(
    name="inertia_error",
    summary="the moment of inertia differs from the stated block's: hollow, cored, or not of one material",
    source="definition; a thin shell has 5/3 of a solid ball's, a square frame 2 of a solid square's",
    phase="impact",
    origin="block",
    parameters=(Parameter("factor", "1", 1.0, 0.5, 2.0, "true over stated moment of inertia"),),
    apply=with_inertia_error,
    remedy=inertia_error_remedy,
)


def with_rounded_edges(world: World, values: Sequence[float]) -> World:
    """Every corner becomes a circle of radius `radius` × the largest that fits into every block
    (`Block.largest_rounding_m`)."""
    most = min((b.largest_rounding_m for b in world.blocks.values() if not b.smooth), default=0.0)
    radius = values[0] * most
    return with_blocks(world, lambda block: block if block.smooth else replace(block, rounding_m=radius))


def rounded_edges_remedy(fitted: FittedEffect) -> str:
    """Measure the corners, and state rounded outlines."""
    sizes = [b.largest_rounding_m for b in fitted.setup.blocks.values() if not b.smooth]
    radius = fitted.number("radius", 1e3 * min(sizes, default=0.0))
    return (
        f"Measure the corners with a radius gauge: {radius} mm are expected. Then state blocks as `shape: polygon` "
        "with `vertices_m` along the rounded outline, four or more to a corner, and diagnose again."
    )


ROUNDED_EDGES = Effect(
    name="rounded_edges",
    summary="corners of square, rectangle and polygon are rounded; mass and inertia stay",
    source="geometry: circles that touch both faces, `rock2d.engines.geometry`",
    phase="impact",
    origin="block",
    parameters=(Parameter("radius", "1", 0.0, 0.0, 0.95, "radius over the largest that fits into every block"),),
    apply=with_rounded_edges,
    remedy=rounded_edges_remedy,
)


EFFECTS = (MASS_ECCENTRICITY, INERTIA_ERROR, ROUNDED_EDGES)
