"""Causes that a blind trial can hide. Every cause is one file in `known/` or `outside/`."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from importlib import import_module
from pathlib import Path
from typing import NamedTuple

import numpy as np

from rock2d.blind.reality.data_model import Array
from rock2d.blind.reality.scale import Scale

Rng = np.random.Generator
Values = Mapping[str, float]
Sizes = Callable[[int, float, Rng, Scale], dict[str, float]]

IMPACT_SPEED = 4.0  # typical speed of an impact over √(gravity × size)
LAST_IN_DRAW_ORDER = 1000


class View(NamedTuple):
    """View of a camera: instants (frames,), centre (2,) of the picture, length by which distortions scale, and seed."""

    times_s: Array
    centre_m: Array
    extent_m: float
    seed: int


@dataclass(frozen=True)
class Cause:
    """A cause that a blind trial can hide.

    Attributes
    ----------
    sizes : (form, share, rng, scale) -> values in SI of a form; share 1 is the largest plausible size
    forms : number of physically different forms
    columns : column of `parameters` in which the compiled motion finds each value
    switches : columns of `parameters` that are 1 while the cause acts
    recorded : (poses, view, values) -> poses (releases, frames, 3) that the camera records; None if the recording is
        correct
    draw_order : position among the causes when a seed assigns them to cases; equal positions are sorted by name
    """

    sizes: Sizes
    forms: int = 1
    columns: Mapping[str, int] = field(default_factory=dict)
    switches: tuple[int, ...] = ()
    recorded: Callable[[Array, View, Values], Array] | None = None
    draw_order: int = LAST_IN_DRAW_ORDER


def causes_in(package: str, folder: Path) -> dict[str, Cause]:
    """The causes of a package, name of the file -> cause, in draw order."""
    names = {path.stem for path in folder.glob("*.py")} - {"__init__"}
    found: dict[str, Cause] = {name: import_module(f"{package}.{name}").CAUSE for name in names}
    return dict(sorted(found.items(), key=lambda item: (item[1].draw_order, item[0])))


def random_sign(rng: Rng) -> float:
    """-1 or 1."""
    return 1.0 if rng.random() < 0.5 else -1.0
