"""Corners of polygons are rounded."""

from collections.abc import Sequence
from dataclasses import replace

from rock2d.effects.changes import with_blocks
from rock2d.effects.effect import Effect, Parameter
from rock2d.effects.fitted_effect import FittedEffect
from rock2d.scene.world import World


def apply(world: World, values: Sequence[float]) -> World:
    """Every corner becomes a circle of radius `radius` × the largest that fits into every block
    (`Block.largest_rounding_m`)."""
    most = min((b.largest_rounding_m for b in world.blocks.values() if not b.smooth), default=0.0)
    radius = values[0] * most
    return with_blocks(world, lambda block: block if block.smooth else replace(block, rounding_m=radius))


def remedy(fitted: FittedEffect) -> str:
    """Measure the corners, and state rounded outlines."""
    sizes = [b.largest_rounding_m for b in fitted.setup.blocks.values() if not b.smooth]
    radius = fitted.number("radius", 1e3 * min(sizes, default=0.0))
    return (
        f"Measure the corners with a radius gauge: {radius} mm are expected. Then state blocks as `shape: polygon` "
        "with `vertices_m` along the rounded outline, four or more to a corner, and diagnose again."
    )


EFFECT = Effect(
    name="rounded_edges",
    summary="corners of square, rectangle and polygon are rounded; mass and inertia stay",
    source="geometry: circles that touch both faces, `rock2d.engines.geometry`",
    phase="impact",
    origin="block",
    parameters=(Parameter("radius", "1", 0.0, 0.0, 0.95, "radius over the largest that fits into every block"),),
    apply=apply,
    remedy=remedy,
)
