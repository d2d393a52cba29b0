"""Faults of a film: sensor, lens, shutter, dust, shadow, soil, light, codec. Each has a size; 0 is off."""

from collections.abc import Iterator
from dataclasses import dataclass, fields
from typing import NamedTuple

import numpy as np

from rock2d.arrays import Array
from rock2d.errors import InputError
from rock2d.scene.blocks import Block
from rock2d.scene.cross_section import CrossSection
from rock2d_tracking.camera import PixelMap
from rock2d_tracking.synthetic import FAULT_LEVEL_NAMES

LAMP_HZ = 100.0  # a lamp on 50 Hz mains lights up twice a period
HEAP_GAP_RADII = 0.2  # gap below a block at which no soil is heaped up
HEAP_CORNERS = 83
FOOT_HEIGHT_RADII = 0.4  # above the lowest point of the block; a contact higher up is a wall
NOISE_SHIFT_PX = 128  # largest random shift of the noise pattern
DUST_GREY = 185.0
PUFF_GRAINS = 90
JUMP_INTERVAL_S = 0.006  # interval over which the change of the vertical velocity is measured
SMALLEST_JUMP_SHARE = 0.15  # share of a release's largest jump of the velocity; smaller ones raise no dust
EXPOSURE_STEP_PX = 0.5  # largest distance between two poses while the shutter is open
EXPOSURE_POSES = 32  # largest number of poses while the shutter is open
THINNEST_DUST = 0.004  # opacity below which dust is not drawn


@dataclass(frozen=True)
class Faults:
    """Sizes of the faults of a film; 0 is off. Raises InputError if one is out of its range.

    Attributes
    ----------
    noise_grey : 1 sigma of the sensor in the dark, in grey levels
    shot_noise : variance per grey level of light, in grey levels
    defocus_px : radius of the disc of a point out of focus
    shutter : open share of the frame interval; the time of the frame is its middle
    dust : opacity of the puff of the hardest impact
    shadow : share of light that the block takes from the soil directly below it
    low_contrast : relative reduction of the block's contrast with the background
    burial_radii : height of the soil heap in front of a block that touches the ground, in radii of the block
    dropped : share of missing frames
    flicker : relative amplitude of the light at `LAMP_HZ`
    compression : relative reduction of the codec's quality"""

    noise_grey: float = 0.0
    shot_noise: float = 0.0
    defocus_px: float = 0.0
    shutter: float = 0.0
    dust: float = 0.0
    shadow: float = 0.0
    low_contrast: float = 0.0
    burial_radii: float = 0.0
    dropped: float = 0.0
    flicker: float = 0.0
    compression: float = 0.0

    def __post_init__(self) -> None:
        most = {"noise_grey": 255.0, "shot_noise": 255.0, "defocus_px": 50.0, "burial_radii": 2.0}
        for each in fields(self):
            size, limit = getattr(self, each.name), most.get(each.name, 1.0)
            if not 0.0 <= size <= limit:
                raise InputError(f"fault {each.name}: expected 0 to {limit:g}, found {size!r}")

    @property
    def quality(self) -> int | None:
        """Quality for `write_film`: 1 to 100, or None (lossless) without compression."""
        return max(1, round(100 * (1.0 - self.compression))) if self.compression else None


CLEAN = Faults()
MODERATE = Faults(
    noise_grey=2.0, shot_noise=0.03, defocus_px=0.6, shutter=0.3, dust=0.35, shadow=0.35, low_contrast=0.25,
    burial_radii=0.2, dropped=0.01, flicker=0.02, compression=0.15,
)  # fmt: skip
SEVERE = Faults(
    noise_grey=5.0, shot_noise=0.12, defocus_px=1.6, shutter=0.8, dust=0.75, shadow=0.6, low_contrast=0.55,
    burial_radii=0.5, dropped=0.05, flicker=0.08, compression=0.5,
)  # fmt: skip
FAULT_LEVELS = dict(zip(FAULT_LEVEL_NAMES, (CLEAN, MODERATE, SEVERE), strict=True))


class Sensor:
    """Turns light into grey levels: flicker, noise, rounding."""

    def __init__(self, faults: Faults, size_px: tuple[int, int], rng: np.random.Generator) -> None:
        self.faults, self._rng = faults, rng
        self._phase_rad = rng.uniform(0.0, 2 * np.pi)
        self._noisy = faults.noise_grey > 0 or faults.shot_noise > 0
        width, height = size_px
        # one pattern, shifted in each frame: new normal numbers would take longer than all other steps
        shape = (height + NOISE_SHIFT_PX, width + NOISE_SHIFT_PX) if self._noisy else (0, 0)
        self._pattern = rng.standard_normal(shape, np.float32)

    def expose(self, light: Array, t_s: float) -> Array:
        """(height, width) uint8 from `light`, float32 in grey levels, which is overwritten; `t_s`: its time."""
        import cv2

        if self.faults.flicker:
            light *= 1.0 + self.faults.flicker * np.sin(2 * np.pi * LAMP_HZ * t_s + self._phase_rad)
        if not self._noisy:
            return np.asarray(cv2.convertScaleAbs(light))
        height, width = light.shape
        row, column = self._rng.integers(0, NOISE_SHIFT_PX, 2, endpoint=True)
        sigma: Array = np.sqrt(light * np.float32(self.faults.shot_noise) + np.float32(self.faults.noise_grey**2))
        sigma *= self._pattern[row : row + height, column : column + width]
        return np.asarray(cv2.add(light, sigma, dtype=cv2.CV_8U))


def extended(rows: Array) -> Array:
    """Rows with a linearly extrapolated one at each end, for the exposure of the first and the last frame."""
    if len(rows) < 2:
        return rows
    return np.concatenate([2 * rows[:1] - rows[1:2], rows, 2 * rows[-1:] - rows[-2:-1]])


class BlockMotion(NamedTuple):
    """The motion of a block in a release.

    Attributes
    ----------
    t_s, poses_m : (n,) times and (n, 3) poses x, y in m and theta in rad, interpolated linearly
    noise_m : 1 sigma of the positions"""

    block: Block
    t_s: Array
    poses_m: Array
    noise_m: float


def exposure_poses(motion: BlockMotion, at_s: float, open_s: float, pixel_map: PixelMap) -> Array:
    """(n, 3) poses, evenly distributed over `open_s` about `at_s`, close enough together for a continuous smear."""

    def poses(at: Array) -> Array:
        return np.stack([np.interp(at, motion.t_s, column) for column in motion.poses_m.T], axis=1)

    dx, dy, turn = np.ptp(poses(at_s + np.array([-0.5, 0.5]) * open_s), axis=0)
    travel_px = (np.hypot(dx, dy) + motion.block.radius_m * turn) / pixel_map.metres_per_pixel
    count = int(np.clip(np.ceil(travel_px / EXPOSURE_STEP_PX), 1, EXPOSURE_POSES))
    return poses(at_s + open_s * ((np.arange(count) + 0.5) / count - 0.5))


def surface_m(cross_section: CrossSection, x_m: Array) -> Array:
    """Height of the ground at `x_m`; constant beyond the ends of the cross-section."""
    x = cross_section.points_m[:, 0]
    return cross_section.height_m(np.clip(x_m, x.min(), x.max()))


def heap_m(cross_section: CrossSection, block: Block, pose_m: Array, height_radii: float) -> Array | None:
    """(`HEAP_CORNERS`, 2) outline of the soil heaped in front of a block at `pose_m` (x, y, theta), in m.

    Full height if the block touches the ground; None if it is `HEAP_GAP_RADII` radii or more above it."""
    x, y, theta = pose_m
    radius = 0.5 * block.size_m
    c, s = np.cos(theta), np.sin(theta)
    rim = block.outline() @ np.array([[c, s], [-s, c]])
    rim = np.concatenate([rim + share * (np.roll(rim, -1, axis=0) - rim) for share in (0.0, 0.25, 0.5, 0.75)])
    foot = rim[rim[:, 1] < rim[:, 1].min() + FOOT_HEIGHT_RADII * radius]
    gap = (y + foot[:, 1] - surface_m(cross_section, x + foot[:, 0])).min()
    near = min(1.0 - gap / (HEAP_GAP_RADII * radius), 1.0)
    if near <= 0.0 or height_radii == 0.0:
        return None
    along = np.linspace(-2.0, 2.0, HEAP_CORNERS - 2)  # in radii
    fall = 0.5 + 0.5 * np.cos(np.pi * np.clip(np.abs(along) - 1.0, 0.0, 1.0))
    ground = surface_m(cross_section, x + radius * along)
    fall *= np.clip(1.5 - (y + rim[:, 1].min() - ground) / radius, 0.0, 1.0)  # none on a steep face
    top = np.column_stack([x + radius * along, ground + near * height_radii * radius * fall])
    return np.vstack([top, [[top[-1, 0], ground.min() - radius], [top[0, 0], ground.min() - radius]]])


@dataclass(frozen=True)
class Shadow:
    """A soft dark patch on the soil: its centre, its half widths (1 sigma) and the share of light that it takes."""

    middle_px: Array
    half_px: Array
    darkness: float

    @property
    def corners_px(self) -> Array:
        """(2, 2) opposite corners of what it darkens."""
        return self.middle_px + np.outer([-3.0, 3.0], self.half_px)

    def taken(self, window: tuple[slice, slice]) -> Array:
        """Share of light that it takes from a window (rows, columns) of the image."""
        v_px, u_px = np.ogrid[window]
        u, v = (u_px - self.middle_px[0]) / self.half_px[0], (v_px - self.middle_px[1]) / self.half_px[1]
        return np.asarray(self.darkness * np.exp(-0.5 * (u * u + v * v)))


def shadow(cross_section: CrossSection, block: Block, pose_m: Array, pixel_map: PixelMap, darkness: float) -> Shadow:
    """The shadow of a block at `pose_m` under a wide lamp overhead: wider and fainter, the higher it flies."""
    radius = 0.5 * block.size_m
    ground = float(surface_m(cross_section, pose_m[0]))
    height = max(0.0, (pose_m[1] - ground) / radius - 1.0)  # in radii
    half = radius / pixel_map.metres_per_pixel * (0.8 + 0.1 * height)
    middle = pixel_map.to_pixel(np.array([pose_m[0], ground]))
    return Shadow(middle, np.array([half, 0.45 * half]), darkness * np.exp(-height / 6.0))


def vertical_jumps(t_s: Array, y_m: Array, noise_m: float) -> Iterator[tuple[int, float]]:
    """Rows at which the vertical velocity jumps up, and the jumps in m/s; `noise_m` is that of the heights."""
    if len(t_s) < 3:
        return
    step = float(np.median(np.diff(t_s)))
    w = max(2, round(JUMP_INTERVAL_S / step))
    if len(t_s) <= 2 * w:
        return
    before = (y_m[w:-w] - y_m[: -2 * w]) / (t_s[w:-w] - t_s[: -2 * w])
    after = (y_m[2 * w :] - y_m[w:-w]) / (t_s[2 * w :] - t_s[w:-w])
    jump = after - before
    least = max(4.0 * np.sqrt(6.0) * noise_m / (w * step), SMALLEST_JUMP_SHARE * jump.max(), 0.0)
    for i in np.flatnonzero(jump > least).tolist():
        if jump[i] == jump[max(0, i - 2 * w) : i + 2 * w + 1].max():
            yield i + w, float(jump[i])


@dataclass(frozen=True)
class Puff:
    """Dust from one impact, slowed down by drag: its origin, velocities, size and opacity."""

    t_s: float
    from_px: Array
    velocity_px_s: Array
    radius_px: float
    opacity: float

    def draw(self, light: Array, t_s: float) -> None:
        """Draw the puff at `t_s` over `light`, (height, width) float32."""
        import cv2

        age = t_s - self.t_s
        if age <= 0.0:
            return
        opacity = self.opacity * (1.0 - np.exp(-age / 0.006)) * np.exp(-age / 0.15)
        if opacity < THINNEST_DUST:
            return
        sigma = self.radius_px * (0.15 + 0.7 * (1.0 - np.exp(-age / 0.08)))
        grains = self.from_px + self.velocity_px_s * 0.05 * (1.0 - np.exp(-age / 0.05))
        cell = max(1, int(sigma / 3.0))  # dust is smooth, so a coarse grid is sufficient
        low = np.floor(grains.min(axis=0) - 4 * sigma).astype(int)
        columns, rows = np.ceil((grains.max(axis=0) + 4 * sigma - low) / cell).astype(int).tolist()
        column, row = ((grains - low) / cell).astype(int).T
        grid = np.bincount(row * columns + column, minlength=rows * columns).reshape(rows, columns)
        cloud = cv2.GaussianBlur(grid.astype(np.float32), (0, 0), sigma / cell) * (self.radius_px / cell) ** 2
        veil = cv2.resize(cloud, (columns * cell, rows * cell), interpolation=cv2.INTER_LINEAR)
        u, v = low.tolist()
        under = light[max(v, 0) : max(v + rows * cell, 0), max(u, 0) : max(u + columns * cell, 0)]
        veil = veil[max(-v, 0) :, max(-u, 0) :][: under.shape[0], : under.shape[1]]
        veil = opacity * (1.0 - np.exp(-veil / 8.0))
        under += veil * (DUST_GREY - under)


def puffs(
    motion: BlockMotion, cross_section: CrossSection, pixel_map: PixelMap, dust: float, rng: np.random.Generator
) -> list[Puff]:
    """The puffs of dust that a moving block raises at its impacts; `dust` as in `Faults`."""
    block, t_s, poses_m, noise_m = motion
    found = list(vertical_jumps(t_s, poses_m[:, 1], noise_m))
    hardest, raised = max((jump for _, jump in found), default=1.0), []
    for row, jump in found:
        x = poses_m[row, 0]
        speed = (x - poses_m[max(0, row - 4), 0]) / max(t_s[row] - t_s[max(0, row - 4)], 1e-9)
        spread = rng.standard_normal((PUFF_GRAINS, 2)) * (0.35, 0.3) * jump
        velocity = np.column_stack([0.25 * speed + spread[:, 0], np.abs(spread[:, 1])])
        start = np.column_stack([x + rng.normal(0.0, 0.3 * block.size_m, PUFF_GRAINS), np.zeros(PUFF_GRAINS)])
        start[:, 1] = surface_m(cross_section, start[:, 0])
        at = pixel_map.to_pixel(start)
        moved = pixel_map.to_pixel(start + velocity * 1e-3)
        radius = 0.5 * block.size_m / pixel_map.metres_per_pixel
        raised.append(Puff(float(t_s[row]), at, (moved - at) / 1e-3, radius, dust * jump / hardest))
    return raised
