"""Shapes of blocks: what the modules of this folder define as `SHAPE`, or as `SHAPES`.

The sizes of a shape become keys of files and arguments of `make_block`."""

from collections.abc import Mapping

from rock2d.registry import registered
from rock2d.scene.shapes.shape import Shape


def shapes() -> Mapping[str, Shape]:
    """Every shape by its name, in the order of the names. Raises ValueError if two share a name."""
    return registered(__name__, "SHAPE")


def inertia_words() -> tuple[str, ...]:
    """All names of mass distributions of all shapes, sorted."""
    return tuple(sorted({word for shape in shapes().values() for word in shape.inertias}))
