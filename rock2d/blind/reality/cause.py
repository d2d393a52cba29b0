"""What `known/` and `outside/` need to describe a cause that a blind trial can hide."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from rock2d.blind.reality.data_model import Array, World, mean_size_m

Rng = np.random.Generator
Values = Mapping[str, float]

IMPACT_SPEED = 4.0  # typical speed of an impact over √(gravity × size)


@dataclass(frozen=True)
class Scale:
    """The units in which sizes of causes are given, in SI.

    Attributes
    ----------
    size, mass : means over the blocks
    spring : √(k_l / mass) of the soil in rad/s
    low, high : corners (x, y) of the box of embankment and ditch, or of the ground's middle third"""

    size: float
    mass: float
    gravity: float
    spring: float
    low: Array
    high: Array
    n_blocks: int

    @property
    def speed(self) -> float:
        """√(gravity × size) in m/s."""
        return float(np.sqrt(self.gravity * self.size))


def scale_of(world: World) -> Scale:
    """The scale of a world."""
    setup = world.setup
    points = np.asarray(setup.points_m, float)
    ranges = [r for r in (setup.ditch, setup.embankment) if r is not None]
    if ranges:
        seen = points[min(a for a, _ in ranges) : max(b for _, b in ranges) + 1]
        low, high = seen.min(axis=0), seen.max(axis=0)
    else:
        low, high = points.min(axis=0), points.max(axis=0)
        third = (high[0] - low[0]) / 3.0
        low[0], high[0] = low[0] + third, high[0] - third
    mass = float(np.mean([block.mass_kg for block in world.blocks]))
    spring = float(np.sqrt(world.law.k_l / mass))
    return Scale(mean_size_m(world.blocks), mass, world.gravity_m_s2, spring, low, high, len(world.blocks))


Sizes = Callable[[int, float, Rng, Scale], dict[str, float]]


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
        correct"""

    sizes: Sizes
    forms: int = 1
    columns: Mapping[str, int] = field(default_factory=dict)
    switches: tuple[int, ...] = ()
    recorded: Callable[[Array, View, Values], Array] | None = None


def random_sign(rng: Rng) -> float:
    """-1 or 1."""
    return 1.0 if rng.random() < 0.5 else -1.0
