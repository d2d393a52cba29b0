"""Blocks, set-up, soil law, camera, and hidden causes."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[Any]


@dataclass(frozen=True)
class Block:
    """A circle (`vertices_m` None) or a convex polygon.

    radius_m : the circle's radius, or the distance of the farthest corner from the centroid
    vertices_m : (k, 2) corners counter-clockwise about the centroid
    inertia_kg_m2 : about the centroid"""

    name: str
    radius_m: float
    vertices_m: Array | None
    mass_kg: float
    inertia_kg_m2: float

    @property
    def size_m(self) -> float:
        """Diameter of a circle, side of the square of equal area of a polygon."""
        if self.vertices_m is None:
            return 2.0 * self.radius_m
        x, y = np.asarray(self.vertices_m, float).T
        return float(np.sqrt(0.5 * abs(np.sum(x * np.roll(y, -1) - y * np.roll(x, -1)))))

    @property
    def half_width_m(self) -> float:
        """Least distance of a face from the centroid."""
        if self.vertices_m is None:
            return self.radius_m
        corners = np.asarray(self.vertices_m, float)
        along = np.roll(corners, -1, axis=0) - corners
        across = corners[:, 0] * along[:, 1] - corners[:, 1] * along[:, 0]
        return float(np.min(across / np.hypot(*along.T)))


@dataclass(frozen=True)
class Setup:
    """The cross-section: a polyline from left to right (x strictly increasing), solid below.

    zones : name of the soil of each facet
    face, embankment, ditch : ranges [a, b) of facets; None where there is none"""

    points_m: Array
    zones: tuple[str, ...]
    face: tuple[int, int] | None = None
    embankment: tuple[int, int] | None = None
    ditch: tuple[int, int] | None = None

    def __post_init__(self) -> None:
        points = np.asarray(self.points_m, float)
        if not (np.diff(points[:, 0]) > 0.0).all():
            raise ValueError("x of a set-up's points must rise strictly")
        if len(self.zones) != len(points) - 1:
            raise ValueError(f"{len(points) - 1} facets need as many zones, got {len(self.zones)}")


@dataclass(frozen=True)
class Law:
    """Soil: stiffnesses in N/m, friction coefficient, rolling stiffness in N m/rad.

    indentation : the rolling spring acts until the block is clear of the surface, not only while the ground presses"""

    k_l: float
    k_ul: float
    k_t: float
    mu: float
    k_r: float
    indentation: bool = False


@dataclass(frozen=True)
class Hidden:
    """A hidden cause: its name, its form, and its values in SI."""

    name: str
    form: int
    values: dict[str, float]


@dataclass(frozen=True)
class World:
    """Set-up, soil, blocks and gravity."""

    setup: Setup
    law: Law
    blocks: Sequence[Block]
    gravity_m_s2: float


@dataclass(frozen=True)
class Releases:
    """n releases.

    Attributes
    ----------
    block_ids : (n,) index of the block
    states : (n, 6) x, y, theta, vx, vy, omega of the centroid at the first instant, in SI
    order : (n,) number of earlier releases of the same block"""

    block_ids: Array
    states: Array
    order: Array


@dataclass(frozen=True)
class Camera:
    """Noise and view of a camera.

    Attributes
    ----------
    position_noise_m, angle_noise_rad : standard deviations of the noise of a frame
    noise_correlation : of the noise from frame to frame
    lost : share of the frames that are lost (NaN)
    centre_m, extent_m : centre of the picture, and the length by which distortions scale"""

    position_noise_m: float
    angle_noise_rad: float
    noise_correlation: float
    lost: float
    centre_m: Array
    extent_m: float


def mean_size_m(blocks: Sequence[Block]) -> float:
    """Mean size of the blocks in m: the length that scales a set-up."""
    return float(np.mean([block.size_m for block in blocks]))
