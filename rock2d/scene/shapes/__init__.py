"""Shapes of blocks: every module of this folder that defines `SHAPE`.

A shape is one file. A file added here is found: its sizes become keys of files and arguments of `make_block`.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from functools import cache
from importlib import import_module
from pathlib import Path
from types import MappingProxyType

from rock2d.scene.shapes.shape import Shape


@cache
def shapes() -> Mapping[str, Shape]:
    """Every shape by its name, in the order of the names. Raises ValueError if two share a name."""
    found: dict[str, Shape] = {}
    for path in sorted(Path(__file__).parent.glob("*.py")):
        if re.search(r"^SHAPE\b", path.read_text(encoding="utf-8"), re.MULTILINE):
            shape = import_module(f"{__name__}.{path.stem}").SHAPE
            if shape.name in found:
                raise ValueError(f"two shapes are named {shape.name}; one is in {path.name}")
            found[shape.name] = shape
    return MappingProxyType(dict(sorted(found.items())))


def inertia_words() -> tuple[str, ...]:
    """Every word for a distribution of mass that some shape knows, sorted."""
    return tuple(sorted({word for shape in shapes().values() for word in shape.inertias}))
