"""The units in which sizes of causes are given: length, mass, gravity, stiffness and extent of a world."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rock2d.blind.reality.data_model import Array, World, mean_mass_kg, mean_size_m, soil_of


@dataclass(frozen=True)
class Scale:
    """Sizes of a world in SI.

    Attributes
    ----------
    size, mass : means over the blocks
    spring : √(k_l / mass) of the first zone's soil in rad/s
    low, high : corners (x, y) of the box of embankment and ditch, or of the ground's middle third
    """

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
    mass = mean_mass_kg(world.blocks)
    spring = float(np.sqrt(soil_of(world.law, setup.zones[0]).k_l / mass))
    return Scale(mean_size_m(world.blocks), mass, world.gravity_m_s2, spring, low, high, len(world.blocks))
