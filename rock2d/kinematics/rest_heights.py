"""Heights of blocks at rest. A block above the stated ground indicates a wrong size, scale, origin or ground.

Only heights above the ground are judged: the depth of a block in its indentation is a property of the soil.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rock2d.engines.geometry import block_arrays, ground_arrays
from rock2d.errors import counted
from rock2d.kinematics.flights import Film, clearances
from rock2d.records.columns import POSITION
from rock2d.scene.world import World

Array = np.ndarray

REST_FRAMES = 10  # number of last frames of a release in which a block at rest does not move
STILL_SDS = 8.0  # largest range of their positions, in standard deviations of the noise
FEWEST_RESTS = 5  # fewest releases of a block for a remark
# least mean height for a remark, in its standard errors and in block radii
CLEAR_HEIGHT, LEAST_HEIGHT_RADII = 4.0, 0.005
FARTHEST_RADII = 2.0  # largest distance from the ground of a block that lies on it, in radii


@dataclass(frozen=True)
class RestHeight:
    """Height of the lowest point of a block at rest above the stated ground: mean over `rests` releases in m, its
    standard error (None for a single release), and the height over the radius of the block."""

    block: str
    rests: int
    height_m: float
    error_m: float | None
    height_radii: float

    @property
    def clear(self) -> bool:
        """Whether the height is significantly above the ground."""
        above = self.height_radii > LEAST_HEIGHT_RADII
        return above and self.error_m is not None and self.height_m > CLEAR_HEIGHT * self.error_m


def rest_heights(film: Film, world: World) -> list[RestHeight]:
    """Height at rest of each block that comes to rest on the ground of a world, or near it."""
    found = []
    for b, (name, block) in enumerate(world.blocks.items()):
        heights = _rest_heights_m(film, world, b)
        heights = heights[np.abs(heights) < FARTHEST_RADII * block.radius_m]
        if n := len(heights):
            error = float(heights.std(ddof=1) / np.sqrt(n)) if n > 1 else None
            height = float(heights.mean())
            found.append(RestHeight(name, n, height, error, height / block.radius_m))
    return found


def rest_remarks(film: Film, world: World) -> list[str]:
    """A remark on each block that comes to rest above the ground of a world."""
    remarks = []
    for b, (name, block) in enumerate(world.blocks.items()):
        heights = _rest_heights_m(film, world, b)
        if len(heights) < FEWEST_RESTS:
            continue
        height = float(heights.mean())
        error = float(heights.std(ddof=1) / np.sqrt(len(heights)))
        if height > max(CLEAR_HEIGHT * error, LEAST_HEIGHT_RADII * block.radius_m):
            remarks.append(
                f"at rest, block {name} lies {1e3 * height:.2g} ± {1e3 * error:.1g} mm above the ground (mean of "
                f"{counted(len(heights), 'release')}): are its sizes, the scale, the origin and the ground right?"
            )
    return remarks


def _rest_heights_m(film: Film, world: World, block: int) -> Array:
    """(n,) height above the ground of the lowest point of a block, of the releases that end at rest."""
    ground, own = ground_arrays(world.cross_section), block_arrays(list(world.blocks.values())[block])
    ends = np.searchsorted(film.release, np.arange(len(film.release_names)), side="right")
    poses = []
    smooth = list(world.blocks.values())[block].smooth  # the height of a polygon depends on its angle
    for release in np.flatnonzero((film.release_block == block) & (film.angle_known | smooth)):
        pose = film.pose[max(ends[release] - REST_FRAMES, 0) : ends[release]]
        if np.ptp(pose[:, POSITION], axis=0).max() < STILL_SDS * film.noise[:2].max():
            poses.append(pose.mean(axis=0))
    return clearances(own, ground, world.view.true(np.array(poses).reshape(-1, 3)))
