"""The world of a simulation: blocks, cross-section, soil and camera.

A world without effects is the model of the paper. Effects return changed copies (`rock2d.effects`); engines and the
diagnosis read them."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from rock2d.arrays import Array
from rock2d.scene.blocks import Block
from rock2d.scene.cross_section import CrossSection

# Newton's method for the inverse of the lens ends at a step this small, relative to the largest distance.
LENS_TOLERANCE, MOST_LENS_STEPS = 1e-9, 30
FOLD_SHARE = 1.0 - 1e-6  # share of the distance at which a lens folds the picture, and its derivative is 0
HORIZON = 0.1  # least scale of a slanting view; beyond it lies what such a camera hardly shows


@dataclass(frozen=True)
class View:
    """How the recording of the camera differs from the world; the default is a perfect camera.

    A point at u from the camera's axis, which meets the plane at `axis_m`, is changed in this order: divided by
    1 + `keystone_per_m` · u, because a slanting camera shows farther parts smaller, and enlarged so that areas at
    `middle_m` stay; rotated by `tilt_rad`, and scaled by `scale` along y and `scale` × `aspect` along x, about
    `fixed_m`; distorted by the factor 1 + `lens_per_m2` r² at a distance r from the axis in the picture; mirrored about
    the origin. The tilt, the rotation by which the slanting view turns a small body, and `theta_offset_rad` are added
    to angles. An instant t is recorded as t / `time_scale`."""

    tilt_rad: float = 0.0
    scale: float = 1.0
    time_scale: float = 1.0
    lens_per_m2: float = 0.0
    aim_m: tuple[float, float] | None = None  # point at which the camera aims; None: not stated
    kept_m: tuple[float, float] | None = None  # point by which the picture was placed; None: not stated
    theta_offset_rad: float = 0.0
    mirror: tuple[float, float, float] = (1.0, 1.0, 1.0)
    aspect: float = 1.0
    keystone_per_m: tuple[float, float] = (0.0, 0.0)
    middle_m: tuple[float, float] | None = None  # point at which the scale was measured; None: `axis_m`

    @property
    def scales(self) -> Array:
        """(2,) recorded lengths along x and y over true ones."""
        return np.array([self.scale * self.aspect, self.scale])

    @property
    def axis_m(self) -> tuple[float, float]:
        """Point (x, y) in m at which the axis of the camera meets the plane: `aim_m`, or the origin."""
        return (0.0, 0.0) if self.aim_m is None else self.aim_m

    @property
    def fixed_m(self) -> tuple[float, float]:
        """Point (x, y) in m that rotation and scales leave in its place: `kept_m`, or the origin."""
        return (0.0, 0.0) if self.kept_m is None else self.kept_m

    @property
    def slant_scale(self) -> float:
        """Factor of a slanting view by which areas at `middle_m` stay: there, the division changes the area of a small
        body by the factor (1 + k · u)^-3."""
        if self.middle_m is None:
            return 1.0
        return float(max(1.0 + np.dot(self.keystone_per_m, np.subtract(self.middle_m, self.axis_m)), HORIZON)) ** 1.5

    def record(self, pose: Array) -> Array:
        """Recorded poses of true poses (..., 3: x_m, y_m, theta_rad)."""
        slanted = self._slanted(np.asarray(pose, float), 1.0)
        x, y = np.moveaxis(self._turned(slanted[..., :2]), -1, 0)
        if self.lens_per_m2:
            cx, cy = self._turned(np.array(self.axis_m))
            dx, dy = x - cx, y - cy
            swell = 1.0 + self.lens_per_m2 * (dx * dx + dy * dy)
            x, y = cx + dx * swell, cy + dy * swell
        theta = slanted[..., 2] + self.tilt_rad + self.theta_offset_rad
        return np.stack([x, y, theta], axis=-1) * self.mirror

    def true(self, recorded: Array) -> Array:
        """True poses (..., 3) from recorded ones: the inverse of `record`. Points beyond a lens's fold lie at it."""
        x, y, theta = np.moveaxis(np.asarray(recorded, float) * self.mirror, -1, 0)
        if self.lens_per_m2:
            cx, cy = self._turned(np.array(self.axis_m))
            dx, dy = x - cx, y - cy
            far = np.hypot(dx, dy)
            # a lens that folds the picture cannot record a point beyond the fold
            fold = FOLD_SHARE * (-3.0 * self.lens_per_m2) ** -0.5 if self.lens_per_m2 < 0.0 else np.inf
            near = np.minimum(far, fold)
            for _ in range(MOST_LENS_STEPS):  # Newton on r (1 + k r²) = far
                swollen = near * (1 + self.lens_per_m2 * near**2) - far
                step = swollen / (1 + 3 * self.lens_per_m2 * near**2)
                near = np.minimum(near - step, fold)
                if np.abs(step).max(initial=0.0) <= LENS_TOLERANCE * far.max(initial=0.0):
                    break
            shrink = np.divide(near, far, out=np.ones_like(far), where=far > 0)
            x, y = cx + dx * shrink, cy + dy * shrink
        (fx, fy), (along_x, along_y) = self.fixed_m, self.scales
        c, s = np.cos(self.tilt_rad), np.sin(self.tilt_rad)
        dx, dy = (x - fx) / along_x, (y - fy) / along_y
        theta = theta - self.tilt_rad - self.theta_offset_rad
        return self._slanted(np.stack([fx + c * dx + s * dy, fy - s * dx + c * dy, theta], axis=-1), -1.0)

    def _turned(self, place: Array) -> Array:
        """Places (..., 2) rotated and scaled about `fixed_m`."""
        (fx, fy), (along_x, along_y) = self.fixed_m, self.scales
        c, s = np.cos(self.tilt_rad), np.sin(self.tilt_rad)
        dx, dy = place[..., 0] - fx, place[..., 1] - fy
        return np.stack([fx + along_x * (c * dx - s * dy), fy + along_y * (s * dx + c * dy)], axis=-1)

    def _slanted(self, pose: Array, way: float) -> Array:
        """Poses (..., 3) as a slanting camera shows them (`way` 1), or the poses that it shows so (-1)."""
        k = way * np.array(self.keystone_per_m)
        if not k.any():
            return pose
        # u' = a u / (1 + k · u) is the same as u = (u' / a) / (1 - k · u' / a)
        before, after = (1.0, self.slant_scale) if way > 0.0 else (self.slant_scale, 1.0)
        u = (pose[..., :2] - self.axis_m) / before
        along = np.maximum(u @ k, HORIZON - 1.0)
        # rotation in the derivative of u / (1 + k · u), the same for both ways with the sign of k
        turn = np.arctan2(u[..., 0] * k[1] - u[..., 1] * k[0], 2.0 + along)
        place = self.axis_m + after * u / (1.0 + along[..., None])
        return np.concatenate([place, (pose[..., 2] + turn)[..., None]], axis=-1)

    def true_per_recorded(self, pose: Array, direction: Array) -> Array:
        """(n,) true standard deviation along unit vectors `direction` ((n, 2) or (2,)), at true poses (n, 2 or more),
        of a noise whose recorded standard deviation is 1 in every direction."""
        c, s = np.cos(self.tilt_rad), np.sin(self.tilt_rad)
        turn = np.array([[c, s], [-s, c]])
        place, k = np.asarray(pose, float)[:, :2], np.array(self.keystone_per_m)
        if k.any():
            u = place - self.axis_m
            wide = 1.0 + (u @ k)[:, None]
            place = self.axis_m + self.slant_scale * u / wide
            direction = wide / self.slant_scale * (direction + k * (u * direction).sum(axis=1, keepdims=True))
        scaled = self._turned(place) - self._turned(np.array(self.axis_m))
        direction = direction @ turn / self.scales
        # without rotation and scales, the Jacobian of `record` is a I + b r rᵀ, so its inverse is symmetric
        swell = 1.0 + self.lens_per_m2 * (scaled**2).sum(axis=1, keepdims=True)
        b = 2.0 * self.lens_per_m2
        along = (scaled * direction).sum(axis=1, keepdims=True)
        out = direction - b * along / (swell + b * (scaled**2).sum(axis=1, keepdims=True)) * scaled
        return np.asarray(np.linalg.norm(out / swell, axis=1))


@dataclass(frozen=True)
class World:
    """Blocks, cross-section, soil and camera of n releases (n = 1 if all are equal).

    Attributes
    ----------
    blocks : name -> block
    cross_section : the ground
    contact : (1 or n, zones, columns) rows of the contact law, see `rock2d.laws.contact` and `effects.columns`
    gravity_m_s2 : gravity
    view : the camera
    order : (1 or n,) number of releases of the same block that were filmed before
    slope_rad : (1 or n,) slope of the ground where a block strikes next minus the slope of the facet
    fitted_scale : mean size in m and mean mass in kg of the blocks to which effects were fitted; None: of `blocks`"""

    blocks: Mapping[str, Block]
    cross_section: CrossSection
    contact: Array
    gravity_m_s2: float = 9.81
    view: View = View()
    order: Array = field(default_factory=lambda: np.zeros(1))
    slope_rad: Array = field(default_factory=lambda: np.zeros(1))
    fitted_scale: tuple[float, float] | None = None

    @property
    def radii_m(self) -> Array:
        """(blocks,) radii of the blocks."""
        return np.array([block.radius_m for block in self.blocks.values()])

    @property
    def mean_size_m(self) -> float:
        """Mean size of the blocks in m, which scales lengths from the laboratory to the slope."""
        return float(np.mean([block.size_m for block in self.blocks.values()]))

    @property
    def fitted_size_m(self) -> float:
        """Mean size in m of the blocks to which effects were fitted: the unit of their lengths."""
        return self.mean_size_m if self.fitted_scale is None else self.fitted_scale[0]

    @property
    def fitted_mass_kg(self) -> float:
        """Mean mass in kg of the blocks to which effects were fitted: the unit of their masses."""
        if self.fitted_scale is not None:
            return self.fitted_scale[1]
        return float(np.mean([block.mass_kg for block in self.blocks.values()]))
