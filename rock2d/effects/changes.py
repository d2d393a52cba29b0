"""Changes of a world that effects use; every function returns a changed copy."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from rock2d.arrays import Array
from rock2d.effects.effect import Parameter
from rock2d.scene.blocks import Block
from rock2d.scene.cross_section import CrossSection, ditch_facets, embankment_facets
from rock2d.scene.world import World

# Points on which what a camera changes depends. They are rarely measured, so they are parameters of the effects.
AIM_PARAMETERS = (
    Parameter("centre_right", "1", 0.0, -1.0, 1.0, "camera's axis right of the set-up's middle, over its width"),
    Parameter("centre_up", "1", 0.0, -1.0, 1.0, "camera's axis above the set-up's middle, over its width"),
)
KEPT_PARAMETERS = (
    Parameter("centre_right", "1", 0.0, -1.0, 1.0, "point that stays, right of the set-up's middle, over its width"),
    Parameter("centre_up", "1", 0.0, -1.0, 1.0, "point that stays, above the set-up's middle, over its width"),
)
POINT_PARAMETERS = AIM_PARAMETERS + KEPT_PARAMETERS


def aim_and_width(cross_section: CrossSection) -> tuple[tuple[float, float], float]:
    """Default aim (x, y) of a camera and width of its subject, in m: middle and width of the bounding box of embankment
    and ditch, or of the whole cross-section if there is no embankment."""
    subject = embankment_facets(cross_section) | ditch_facets(cross_section)
    facets = np.flatnonzero(subject) if subject.any() else np.arange(len(subject))
    points = cross_section.points_m[np.union1d(facets, facets + 1)]
    low, high = points.min(axis=0), points.max(axis=0)
    middle = 0.5 * (low + high)
    return (float(middle[0]), float(middle[1])), float(high[0] - low[0])


def with_view(world: World, **changes: Any) -> World:
    """The world seen by another camera; `changes`: fields of `World.view`."""
    return replace(world, view=replace(world.view, **changes))


def moved_point(world: World, known: tuple[float, float] | None, shift: Sequence[float]) -> tuple[float, float]:
    """A `known` point of the camera, by default the middle of `aim_and_width`, moved by `shift` (right, up) × the
    width."""
    middle, width = aim_and_width(world.cross_section)
    x, y = middle if known is None else known
    return x + width * shift[0], y + width * shift[1]


def with_blocks(world: World, change: Callable[[Block], Block]) -> World:
    """The world with every block changed."""
    return replace(world, blocks={name: change(block) for name, block in world.blocks.items()})


def with_air(world: World, name: str, per_kg: float) -> World:
    """The world with the column `name` of every block's `air` set to `per_kg` × the block's mass."""
    from rock2d.effects.columns import N_AIR, air_column

    def change(block: Block) -> Block:
        air = list(block.air or np.zeros(N_AIR))
        air[air_column(name)] = float(per_kg * block.mass_kg)
        return replace(block, air=tuple(air))

    return with_blocks(world, change)


def with_column(world: World, name: str, value: float | Array, zones: Array | None = None) -> World:
    """The world with an effect's contact column set to `value` (a number, or one for each zone) in `zones` (a mask)."""
    from rock2d.effects.columns import column, widened

    contact = widened(world.contact)
    selected = np.ones(contact.shape[1], bool) if zones is None else zones
    contact[:, selected, column(name)] = np.broadcast_to(value, contact.shape[:2])[:, selected]
    return replace(world, contact=contact)


def with_scaled_columns(
    world: World, columns: Sequence[int], factor: float | Array, zones: Array | None = None
) -> World:
    """The world with columns of the contact law multiplied by `factor` (a number, or one for each release) in `zones`
    (a mask)."""
    factor = np.atleast_1d(np.asarray(factor, float))
    contact = np.repeat(world.contact, len(factor), axis=0) if len(world.contact) == 1 else world.contact.copy()
    selected = np.ones(contact.shape[1], bool) if zones is None else zones
    for column in columns:
        contact[:, selected, column] *= factor[:, None]
    return replace(world, contact=contact)
