"""Corners of polygons are rounded."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from rock2d.blocks import Block
from rock2d.effects.changes import with_blocks
from rock2d.effects.effect import Effect, Parameter
from rock2d.world import World


def apply(world: World, values: Sequence[float]) -> World:
    """One radius for all blocks, as one cutter gives; at most what the narrowest block can have."""
    radius = values[0] * min((inradius_m(b) for b in world.blocks.values() if not b.smooth), default=0.0)
    return with_blocks(world, lambda block: block if block.smooth else replace(block, rounding_m=radius))


def inradius_m(block: Block) -> float:
    """Distance of a polygon's nearest face from its centroid."""
    edge = np.roll(block.corners_m, -1, axis=0) - block.corners_m
    normals = np.column_stack([edge[:, 1], -edge[:, 0]]) / np.hypot(*edge.T)[:, None]
    return float((normals * block.corners_m).sum(axis=1).min())


EFFECT = Effect(
    name="rounded_edges",
    summary="corners of square, rectangle and polygon are rounded; mass and inertia stay",
    source="geometry: circles that touch both faces, `rock2d.geometry`",
    phase="impact",
    parameters=(Parameter("radius", "1", 0.0, 0.0, 0.95, "radius over half the width of the narrowest block"),),
    apply=apply,
)
