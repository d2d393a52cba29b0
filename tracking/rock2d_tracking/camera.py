"""Pixels to metres and back: scale, direction of y, tilt, radial distortion.

Pixel coordinates (u, v) run to the right and downward from the centre of the image's first pixel. The world's x runs to
the right and y up, angles counter-clockwise."""

from dataclasses import dataclass

import numpy as np

from rock2d.arrays import Array

STRONGEST_BARREL = -4.0 / 27.0  # smallest k with which a lens shows something at ρ = 1; seen ρ has a maximum


@dataclass(frozen=True)
class PixelMap:
    """A camera perpendicular to the plane of motion.

    Attributes
    ----------
    metres_per_pixel : scale at the optical centre
    origin_px, origin_m : a point of the image, and the same point in the world
    up : -1 if the world's y axis points to the top of the image, +1 if to its bottom (a film upside down)
    tilt_rad : rotation of the image relative to the world: a horizontal line turns by this angle toward `up`
    k : radial distortion, seen = true (1 + k ρ²), where ρ is the true distance from `centre_px` over `half_px`"""

    metres_per_pixel: float
    origin_px: tuple[float, float]
    origin_m: tuple[float, float] = (0.0, 0.0)
    up: int = -1
    tilt_rad: float = 0.0
    k: float = 0.0
    centre_px: tuple[float, float] = (0.0, 0.0)
    half_px: float = 1.0

    @property
    def farthest_px(self) -> float:
        """Largest distance from `centre_px` at which the lens shows anything; a barrel folds what is farther out."""
        return self.half_px * 2.0 / (3.0 * np.sqrt(-3.0 * self.k)) if self.k < 0.0 else np.inf

    def to_world(self, seen: Array) -> Array:
        """Points (..., 2) of the image in m."""
        flat = self._undistorted(np.asarray(seen, float)) - self._undistorted(np.array(self.origin_px))
        level = np.stack([flat[..., 0], self.up * flat[..., 1]], axis=-1) * self.metres_per_pixel
        c, s = np.cos(self.tilt_rad), np.sin(self.tilt_rad)
        x, y = c * level[..., 0] + s * level[..., 1], -s * level[..., 0] + c * level[..., 1]
        return np.stack([x, y], axis=-1) + self.origin_m

    def to_pixel(self, world: Array) -> Array:
        """Points (..., 2) in m in the image; the inverse of `to_world`."""
        d = (np.asarray(world, float) - self.origin_m) / self.metres_per_pixel
        c, s = np.cos(self.tilt_rad), np.sin(self.tilt_rad)
        u, w = c * d[..., 0] - s * d[..., 1], s * d[..., 0] + c * d[..., 1]
        flat = np.stack([u, self.up * w], axis=-1) + self._undistorted(np.array(self.origin_px))
        return self._distorted(flat)

    def angle_to_world(self, seen_rad: Array) -> Array:
        """Angles in the image, from u toward v (clockwise on the screen), as angles of the world."""
        return np.asarray(self.up * np.asarray(seen_rad) - self.tilt_rad)

    def angle_to_pixel(self, world_rad: Array) -> Array:
        """The inverse of `angle_to_world`."""
        return np.asarray(self.up * (np.asarray(world_rad) + self.tilt_rad))

    def _distorted(self, flat: Array) -> Array:
        d = flat - self.centre_px
        square = (d**2).sum(axis=-1, keepdims=True) / self.half_px**2
        return np.asarray(d * (1.0 + self.k * square) + self.centre_px)

    def _undistorted(self, seen: Array) -> Array:
        """The inverse of `_distorted`: the root of k ρ³ + ρ = seen ρ, by angles that are tripled."""
        d = seen - self.centre_px
        if self.k == 0.0:
            return np.asarray(seen)
        radius, root = np.linalg.norm(d, axis=-1, keepdims=True) / self.half_px, np.sqrt(3.0 * abs(self.k))
        tripled = 1.5 * root * radius
        third = np.sinh(np.arcsinh(tripled) / 3) if self.k > 0.0 else np.sin(np.arcsin(np.minimum(tripled, 1.0)) / 3)
        factor = np.divide(2.0 * third / root, radius, out=np.ones_like(radius), where=radius > 0.0)
        return np.asarray(d * factor + self.centre_px)
