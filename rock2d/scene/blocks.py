"""Block profiles: size, mass, moment of inertia, corners.

A profile is either *smooth* (circle, ellipse: two semi-axes) or a convex *polygon* (corners). Body axes are
centred on the centroid, with the length along the body's own x; the angle is counter-clockwise positive.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

Array = np.ndarray


@dataclass(frozen=True)
class Block:
    """A rigid block.

    Attributes
    ----------
    shape : "circle" | "square" | "rectangle" | "ellipse" | "polygon"
    mass_kg, inertia_kg_m2 : mass and moment of inertia about the centre of mass
    semi_axes_m : (a, b) of a smooth profile, (0, 0) for a polygon
    corners_m : (n, 2) corners of a polygon, counter-clockwise, centroid at the origin; (0, 2) if smooth
    rounding_m : radius with which the corners of a polygon are rounded; its faces stay where they are
    centre_of_mass_m : (ex, ey) in body axes, from the centroid
    air : what air does to it, the columns of `rock2d.effects.columns.AIR_NAMES`; () for nothing
    """

    name: str
    shape: str
    mass_kg: float
    inertia_kg_m2: float
    semi_axes_m: tuple[float, float] = (0.0, 0.0)
    corners_m: Array = field(default_factory=lambda: np.empty((0, 2)))
    rounding_m: float = 0.0
    centre_of_mass_m: tuple[float, float] = (0.0, 0.0)
    air: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        if not (self.mass_kg > 0 and np.isfinite(self.mass_kg)):
            raise ValueError(f"block {self.name}: mass_kg must be positive, got {self.mass_kg}")
        if not (self.inertia_kg_m2 > 0 and np.isfinite(self.inertia_kg_m2)):
            raise ValueError(f"block {self.name}: inertia must be positive, got {self.inertia_kg_m2}")
        if self.rounding_m and not 0 <= self.rounding_m <= self.largest_rounding_m * (1 + 1e-9):
            raise ValueError(
                f"block {self.name}: corners can be rounded with up to {self.largest_rounding_m:g} m, "
                f"got {self.rounding_m:g}"
            )

    @property
    def smooth(self) -> bool:
        """True for circle and ellipse."""
        return len(self.corners_m) == 0

    @property
    def radius_m(self) -> float:
        """Radius of the smallest circle about the centroid that holds the profile."""
        if self.smooth:
            return max(self.semi_axes_m)
        return float(np.hypot(*self.corners_m.T).max())

    @property
    def reach_m(self) -> float:
        """Radius of a circle about the centre of mass that holds the profile."""
        ex, ey = self.centre_of_mass_m
        if self.smooth:
            return self.radius_m + float(np.hypot(ex, ey))
        return float(np.hypot(*(self.corners_m - np.array([ex, ey])).T).max())

    @property
    def largest_rounding_m(self) -> float:
        """Radius of rounded corners at which the first face vanishes between two of them; 0 if smooth."""
        if self.smooth:
            return 0.0
        edge = np.roll(self.corners_m, -1, axis=0) - self.corners_m
        length = np.hypot(*edge.T)
        before = np.roll(edge, 1, axis=0)
        cos_turn = (before * edge).sum(axis=1) / (length * np.roll(length, 1))
        taken = np.sqrt((1 - cos_turn) / (1 + cos_turn))  # tan(turn / 2): what a corner takes of each face
        return float((length / (taken + np.roll(taken, -1))).min())

    @property
    def area_m2(self) -> float:
        """Area of the profile."""
        if self.smooth:
            return float(np.pi * self.semi_axes_m[0] * self.semi_axes_m[1])
        return _polygon_moments(self.corners_m)[0]

    @property
    def size_m(self) -> float:
        """Diameter of the circle of equal area: the block's one-number size."""
        return 2.0 * float(np.sqrt(self.area_m2 / np.pi))

    def outline(self, points: int = 48) -> Array:
        """Closed outline in body axes, shape (points, 2) if smooth, else the corners."""
        if not self.smooth:
            return self.corners_m
        angle = np.linspace(0.0, 2 * np.pi, points, endpoint=False)
        return np.column_stack([self.semi_axes_m[0] * np.cos(angle), self.semi_axes_m[1] * np.sin(angle)])

    def lowest_reach(self, theta_rad: Array) -> Array:
        """Height of the centroid above the block's lowest point at orientations `theta_rad`, in m."""
        theta = np.asarray(theta_rad, float)
        if self.smooth:
            a, b = self.semi_axes_m
            return np.hypot(a * np.sin(theta), b * np.cos(theta))
        x, y = self.corners_m.T
        return -(np.sin(theta)[..., None] * x + np.cos(theta)[..., None] * y).min(axis=-1)


def poses_at(poses: Array, point_m: Sequence[float] | Array) -> Array:
    """Poses (..., 3: x, y, theta) of another point of the body, at `point_m` (2,) or (..., 2) in its axes from the one
    whose poses are given. `Block.centre_of_mass_m` leads from the centroid to the centre of mass, its negative back."""
    out = np.array(poses, float)
    rx, ry = _turned(point_m, out[..., 2])
    out[..., 0] += rx
    out[..., 1] += ry
    return out


def states_at(states: Array, point_m: Sequence[float] | Array) -> Array:
    """States (n, 6: x, y, theta, vx, vy, omega) of another point of the body; see `poses_at`."""
    out = np.array(np.atleast_2d(states), float)
    rx, ry = _turned(point_m, out[:, 2])
    out[:, 0] += rx
    out[:, 1] += ry
    out[:, 3] -= out[:, 5] * ry
    out[:, 4] += out[:, 5] * rx
    return out


def _turned(point_m: Sequence[float] | Array, theta: Array) -> tuple[Array, Array]:
    """x and y of points in body axes, in the axes of the ground."""
    ex, ey = np.moveaxis(np.asarray(point_m, float), -1, 0)
    c, s = np.cos(theta), np.sin(theta)
    return c * ex - s * ey, s * ex + c * ey


def make_block(
    name: str,
    shape: str,
    mass_kg: float,
    inertia: str | float = "uniform",
    *,
    diameter_m: float | None = None,
    side_m: float | None = None,
    length_m: float | None = None,
    height_m: float | None = None,
    vertices_m: Sequence[Sequence[float]] | None = None,
) -> Block:
    """Build a block from the sizes that its shape needs.

    `inertia` is "uniform" (solid prism of the profile), "solid_sphere" (2/5 m r², circle only) or a number in
    kg m². Raises ValueError if a size is missing, not positive, or a polygon is not convex.
    """
    axes, corners = (0.0, 0.0), np.empty((0, 2))
    if shape == "circle":
        radius = 0.5 * _positive(name, "diameter_m", diameter_m)
        axes, per_mass = (radius, radius), 0.5 * radius**2
    elif shape == "ellipse":
        a = 0.5 * _positive(name, "length_m", length_m)
        b = 0.5 * _positive(name, "height_m", height_m)
        axes, per_mass = (a, b), 0.25 * (a**2 + b**2)
    elif shape in ("square", "rectangle", "polygon"):
        if shape == "square":
            a = b = 0.5 * _positive(name, "side_m", side_m)
        elif shape == "rectangle":
            a = 0.5 * _positive(name, "length_m", length_m)
            b = 0.5 * _positive(name, "height_m", height_m)
        if shape == "polygon":
            corners = _convex_corners(name, vertices_m)
        else:
            corners = np.array([[-a, -b], [a, -b], [a, b], [-a, b]])
        per_mass = _polygon_moments(corners)[1]
    else:
        raise ValueError(f"block {name}: unknown shape {shape!r}")
    if inertia == "solid_sphere":
        if shape != "circle":
            raise ValueError(f"block {name}: inertia solid_sphere needs shape circle, got {shape}")
        per_mass = 0.4 * axes[0] ** 2
    elif isinstance(inertia, (int, float)):
        per_mass = float(inertia) / mass_kg
    elif inertia != "uniform":
        raise ValueError(f"block {name}: inertia must be solid_sphere, uniform or a number, got {inertia!r}")
    return Block(name, shape, float(mass_kg), float(per_mass * mass_kg), axes, corners)


def _positive(name: str, key: str, value: float | None) -> float:
    if value is None or not value > 0:
        raise ValueError(f"block {name}: {key} must be a positive number, got {value}")
    return float(value)


def _polygon_moments(corners: Array) -> tuple[float, float]:
    """Area and polar second moment per area about the origin (counter-clockwise corners)."""
    x, y = corners.T
    x2, y2 = np.roll(x, -1), np.roll(y, -1)
    cross = x * y2 - x2 * y
    area = 0.5 * cross.sum()
    polar = (cross * (x * x + x * x2 + x2 * x2 + y * y + y * y2 + y2 * y2)).sum() / 12.0
    return float(area), float(polar / area) if area else 0.0


def _convex_corners(name: str, vertices: Sequence[Sequence[float]] | None) -> Array:
    corners = np.asarray(vertices if vertices is not None else [], float)
    if corners.ndim != 2 or corners.shape[1] != 2 or len(corners) < 3:
        raise ValueError(f"block {name}: vertices_m must be at least three [x, y] points")
    if _polygon_moments(corners)[0] < 0:
        corners = corners[::-1]
    edge = np.roll(corners, -1, axis=0) - corners
    turn = edge[:, 0] * np.roll(edge[:, 1], -1) - edge[:, 1] * np.roll(edge[:, 0], -1)
    # every turn to the left, and once around only: rules out stars
    angle = np.arctan2(turn, (edge * np.roll(edge, -1, axis=0)).sum(axis=1))
    if not (turn > 0).all() or abs(angle.sum() - 2 * np.pi) > 1e-6:
        raise ValueError(f"block {name}: vertices_m must be a strictly convex polygon")
    x, y = corners.T
    x2, y2 = np.roll(x, -1), np.roll(y, -1)
    cross = x * y2 - x2 * y
    centroid = np.array([((x + x2) * cross).sum(), ((y + y2) * cross).sum()]) / (3.0 * cross.sum())
    return np.ascontiguousarray(corners - centroid)
