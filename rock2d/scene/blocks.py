"""Blocks: profile, mass and moment of inertia. `make_block` makes a block from its sizes.

A profile is either *smooth* (circle, ellipse: two semi-axes) or a convex *polygon* (corners). Body axes have their
origin at the centroid and their x axis along the length; angles are counter-clockwise positive."""

from collections.abc import Sequence
from dataclasses import dataclass, field, fields
from functools import cached_property
from typing import Any

import numpy as np

from rock2d.arrays import Array
from rock2d.scene.cross_section import CrossSection
from rock2d.scene.shapes import inertia_words, shapes
from rock2d.scene.shapes.shape import BlockError, polygon_moments

SIDES_OF_A_SMOOTH_PROFILE = 256


@dataclass(frozen=True, eq=False)
class Block:
    """A rigid block.

    Attributes
    ----------
    name : name of the block
    shape : name of a shape, see `rock2d.scene.shapes.shapes`
    mass_kg, inertia_kg_m2 : mass and moment of inertia about the centre of mass
    semi_axes_m : (a, b) of a smooth profile, (0, 0) for a polygon
    corners_m : (n, 2) corners of a polygon, counter-clockwise, centroid at the origin; (0, 2) if smooth
    rounding_m : radius of the rounded corners of a polygon; its faces keep their places
    centre_of_mass_m : (ex, ey) in body axes, from the centroid
    air : parameters of the laws of flight, columns `rock2d.effects.columns.AIR_NAMES`; () if no air acts

    Raises
    ------
    BlockError
        If mass or inertia are not positive, or if the rounding is too large."""

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
            raise BlockError(self.name, f"mass_kg must be positive, got {self.mass_kg}", "mass_kg")
        if not (self.inertia_kg_m2 > 0 and np.isfinite(self.inertia_kg_m2)):
            raise BlockError(self.name, f"inertia must be positive, got {self.inertia_kg_m2}", "inertia")
        if self.rounding_m and not 0 <= self.rounding_m <= self.largest_rounding_m * (1 + 1e-9):
            raise BlockError(
                self.name, f"corners can be rounded with up to {self.largest_rounding_m:g} m, got {self.rounding_m:g}"
            )

    @cached_property
    def _value(self) -> tuple[object, ...]:
        """All attributes, for comparison."""
        values = (getattr(self, each.name) for each in fields(self))
        return tuple(value.tobytes() if isinstance(value, np.ndarray) else value for value in values)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Block) and self._value == other._value

    def __hash__(self) -> int:
        return hash(self._value)

    @property
    def smooth(self) -> bool:
        """True for circle and ellipse."""
        return len(self.corners_m) == 0

    @property
    def radius_m(self) -> float:
        """Radius of the smallest circle about the centroid that contains the profile."""
        if self.smooth:
            return max(self.semi_axes_m)
        return float(np.hypot(*self.corners_m.T).max())

    @property
    def inradius_m(self) -> float:
        """Radius of the largest circle about the centroid inside the profile."""
        return min(self.semi_axes_m) if self.smooth else float(self.side_distances_m.min())

    @property
    def side_distances_m(self) -> Array:
        """(n,) distance of the centroid of a polygon from each side, in the order of the corners that they begin at."""
        x, y = self.corners_m.T
        next_x, next_y = np.roll(x, -1), np.roll(y, -1)
        return np.asarray((x * next_y - next_x * y) / np.hypot(next_x - x, next_y - y))

    @cached_property
    def reach_m(self) -> float:
        """Radius of a circle about the centre of mass that contains the profile."""
        ex, ey = self.centre_of_mass_m
        if self.smooth:
            return self.radius_m + float(np.hypot(ex, ey))
        return float(np.hypot(*(self.corners_m - np.array([ex, ey])).T).max())

    @property
    def largest_rounding_m(self) -> float:
        """Rounding radius in m at which the shortest face vanishes between its two corners; 0 if smooth."""
        if self.smooth:
            return 0.0
        edge = np.roll(self.corners_m, -1, axis=0) - self.corners_m
        length = np.hypot(*edge.T)
        before = np.roll(edge, 1, axis=0)
        cos_turn = (before * edge).sum(axis=1) / (length * np.roll(length, 1))
        shortening = np.sqrt((1 - cos_turn) / (1 + cos_turn))  # of both faces, per radius: tan(turn / 2)
        return float((length / (shortening + np.roll(shortening, -1))).min())

    @cached_property
    def area_m2(self) -> float:
        """Area of the profile."""
        if self.smooth:
            return float(np.pi * self.semi_axes_m[0] * self.semi_axes_m[1])
        return polygon_moments(self.corners_m)[0]

    @property
    def size_m(self) -> float:
        """Size of the block: diameter of the circle of equal area."""
        return 2.0 * float(np.sqrt(self.area_m2 / np.pi))

    def outline(self, points: int = 48) -> Array:
        """Closed outline in body axes, shape (points, 2) if smooth, else the corners."""
        if not self.smooth:
            return self.corners_m
        angle = np.linspace(0.0, 2 * np.pi, points, endpoint=False)
        return np.column_stack([self.semi_axes_m[0] * np.cos(angle), self.semi_axes_m[1] * np.sin(angle)])

    def height_above_lowest_point_m(self, theta_rad: Array) -> Array:
        """Height in m of the centroid above the lowest point of the block, at orientations `theta_rad` (any shape)."""
        theta = np.asarray(theta_rad, float)
        if self.smooth:
            a, b = self.semi_axes_m
            return np.hypot(a * np.sin(theta), b * np.cos(theta))
        x, y = self.corners_m.T
        return -(np.sin(theta)[..., None] * x + np.cos(theta)[..., None] * y).min(axis=-1)


def poses_at(poses: Array, point_m: Sequence[float] | Array) -> Array:
    """Poses (..., 3: x, y, theta) of another point of the body. `point_m` (2,) or (..., 2) is its position in body axes
    relative to the point whose poses are given. `Block.centre_of_mass_m` leads from the centroid to the centre of mass,
    its negative from the centre of mass to the centroid."""
    out = np.array(poses, float)
    rx, ry = _rotated(point_m, out[..., 2])
    out[..., 0] += rx
    out[..., 1] += ry
    return out


def states_at(states: Array, point_m: Sequence[float] | Array) -> Array:
    """States (n, 6: x, y, theta, vx, vy, omega) of another point of the body; see `poses_at`."""
    out = np.array(np.atleast_2d(states), float)
    rx, ry = _rotated(point_m, out[:, 2])
    out[:, 0] += rx
    out[:, 1] += ry
    out[:, 3] -= out[:, 5] * ry
    out[:, 4] += out[:, 5] * rx
    return out


def _rotated(point_m: Sequence[float] | Array, theta: Array) -> tuple[Array, Array]:
    """Components in the axes of the ground of vectors (..., 2) in body axes."""
    ex, ey = np.moveaxis(np.asarray(point_m, float), -1, 0)
    c, s = np.cos(theta), np.sin(theta)
    return c * ex - s * ey, s * ex + c * ey


def make_block(name: str, shape: str, mass_kg: float, inertia: str | float = "uniform", **sizes: Any) -> Block:
    """Make a block from the sizes of its shape.

    Parameters
    ----------
    name : str
    shape : {"circle", "ellipse", "polygon", "rectangle", "square"} or another name of `rock2d.scene.shapes`
    mass_kg : float
    inertia : {"uniform", "solid_sphere"} or float
        Moment of inertia about the centroid: "uniform" is that of a solid prism of the profile, "solid_sphere" is
        2/5 m r² (circles only), a number is the moment in kg m².
    **sizes
        circle: `diameter_m`; square: `side_m`; rectangle and ellipse: `length_m`, `height_m`; polygon:
        `vertices_m`, a list of [x, y].

    Returns
    -------
    Block

    Raises
    ------
    BlockError
        A ValueError, which names the wrong `key`: if the shape is unknown, a size is missing, unknown or not positive,
        a polygon is not convex, or the mass is not positive.

    Examples
    --------
    >>> cube = make_block("cube", "square", 0.0233, side_m=0.019)
    >>> round(cube.inertia_kg_m2 * 1e6, 3)
    1.402"""
    if shape not in shapes():
        raise BlockError(name, f"unknown shape {shape!r}", "shape")
    made_from = shapes()[shape]
    keys = [size.key for size in made_from.sizes]
    for key in sizes:
        if key not in keys:
            raise BlockError(name, f"unknown size {key} of a {shape}, expected {', '.join(keys)}", key)
    profile = made_from.profile(name, sizes)
    if isinstance(inertia, (int, float)):
        per_mass = float(inertia) / mass_kg
    elif inertia in profile.inertia_per_mass_m2:
        per_mass = profile.inertia_per_mass_m2[inertia]
    elif inertia in inertia_words():
        able = [other.name for other in shapes().values() if inertia in other.inertias]
        raise BlockError(name, f"inertia {inertia} needs shape {' or '.join(able)}, got {shape}", "inertia")
    else:
        words = ", ".join(inertia_words())
        raise BlockError(name, f"inertia must be {words} or a number, got {inertia!r}", "inertia")
    return Block(name, shape, float(mass_kg), float(per_mass * mass_kg), profile.semi_axes_m, profile.corners_m)


def touching_height_m(block: Block, cross_section: CrossSection, x_m: Array, theta_rad: Array) -> Array:
    """(n,) height in m of the centroid at which the block touches the ground if it is lowered at x_m (n,) with
    orientations theta_rad (n,).

    A smooth profile is replaced by a polygon around it, which is 1e-4 of its size larger. Raises ValueError if the
    whole width of a block is outside the cross-section."""
    outline = block.outline(SIDES_OF_A_SMOOTH_PROFILE)
    if block.smooth:
        outline = outline / np.cos(np.pi / SIDES_OF_A_SMOOTH_PROFILE)
    x, theta = np.atleast_1d(np.asarray(x_m, float)), np.atleast_1d(np.asarray(theta_rad, float))
    c, s = np.cos(theta)[:, None], np.sin(theta)[:, None]
    ahead, up = c * outline[:, 0] - s * outline[:, 1], s * outline[:, 0] + c * outline[:, 1]
    below_corners = cross_section.height_m(x[:, None] + ahead) - up
    heights = np.nanmax(np.where(np.isnan(below_corners), -np.inf, below_corners), axis=1)
    back, front = ahead.min(axis=1), ahead.max(axis=1)
    vertices = cross_section.points_m
    near = (vertices[:, 0] > (x + back).min()) & (vertices[:, 0] < (x + front).max())
    for vertex_x, vertex_y in vertices[near]:
        under = vertex_x - x
        for i in np.flatnonzero((under > back) & (under < front)):
            heights[i] = max(heights[i], vertex_y - _underside(ahead[i], up[i], under[i]))
    if not np.isfinite(heights).all():
        raise ValueError("a block is outside the cross-section")
    return heights


def _underside(ahead: Array, up: Array, at: float) -> float:
    """Height of the lower side of a convex polygon at a distance ahead of its centroid."""
    other_ahead, other_up = np.roll(ahead, -1), np.roll(up, -1)
    crosses = (np.minimum(ahead, other_ahead) <= at) & (at <= np.maximum(ahead, other_ahead))
    a, b, p, q = ahead[crosses], other_ahead[crosses], up[crosses], other_up[crosses]
    width = np.where(a == b, 1.0, b - a)
    return float(np.where(a == b, np.minimum(p, q), p + (at - a) / width * (q - p)).min())
