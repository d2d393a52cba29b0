"""Check of the stated shapes: with the true outline, the penetration of a block does not depend on its angle.

The depth at the lowest point of each impact is fitted with harmonics of the angle between block and ground. The second
and the fourth harmonic distinguish circles, squares and elongated blocks.
"""

from __future__ import annotations

import numpy as np

from rock2d.engines.geometry import block_arrays, ground_arrays
from rock2d.kinematics.film_segments import FilmSegments
from rock2d.kinematics.flights import CONTACT_MARGIN_FRAMES, clearances
from rock2d.records.columns import POSITION, THETA
from rock2d.scene.nearest_facet import nearest_facets
from rock2d.scene.world import World

Array = np.ndarray

HARMONICS = (1, 2, 3, 4)
TELLING_HARMONICS = (1, 3)  # indices of the second and the fourth harmonic
FEWEST_IMPACTS = 20  # fewest impacts of a block
MOST_FRAMES = 40  # most frames of an impact; longer contacts are rolling or sliding
# least amplitude in block radii (half of that of a square stated as its circumscribed circle), and in standard errors
LARGEST_AMPLITUDE_RADII, CLEAR_AMPLITUDE = 0.06, 6.0
LARGEST_CONDITION = 1.0e3
LARGEST_DEVIATION = 6.0  # distance of a depth from the median, in median deviations


def shape_remarks(data: FilmSegments, world: World) -> list[str]:
    """A remark on each block whose penetration depends on its angle, as with a wrong shape."""
    depth, angle, block = _lowest_points(data, world)
    remarks = []
    for b, name in enumerate(data.film.block_names):
        rows = block == b
        if rows.sum() >= FEWEST_IMPACTS and _depends(depth[rows], angle[rows]):
            remarks.append(
                f"the depth to which block {name} sinks into the ground depends on its angle: are its shape "
                f"({world.blocks[name].shape}) and sizes right?"
            )
    return remarks


def _lowest_points(data: FilmSegments, world: World) -> tuple[Array, Array, Array]:
    """For each impact: height of the block above the ground at its lowest, in radii, angle between block and ground,
    and index of the block."""
    flights, film, blocks = data.flights, data.film, list(world.blocks.values())
    arrays = [block_arrays(b) for b in blocks]
    ground = ground_arrays(world.cross_section)
    rows = []
    for before, after in zip(data.impacts.before, data.impacts.after, strict=True):
        first = flights.last[before] - CONTACT_MARGIN_FRAMES
        last = flights.first[after] + CONTACT_MARGIN_FRAMES
        if last - first > MOST_FRAMES or not film.angle_known[flights.release[before]]:
            continue
        block = int(flights.block[before])
        pose = world.view.true(film.pose[first:last])
        gap = clearances(arrays[block], ground, pose)
        low = int(np.argmin(gap))
        facet = nearest_facets(pose[low : low + 1, POSITION], world.cross_section.points_m)[0]
        tangent = world.cross_section.tangents[facet]
        turn = pose[low, THETA] - np.arctan2(tangent[1], tangent[0])
        rows.append((gap[low] / blocks[block].radius_m, turn, block))
    columns = np.array(rows, float).reshape(-1, 3).T
    return columns[0], columns[1], columns[2]


def _depends(depth: Array, angle: Array) -> bool:
    """Whether the second or fourth harmonic of the depth is large and significant."""
    off = np.abs(depth - np.median(depth))
    use = off <= LARGEST_DEVIATION * np.median(off)
    waves = [wave(n * angle[use]) for n in HARMONICS for wave in (np.cos, np.sin)]
    design = np.column_stack([np.ones(use.sum()), *waves])
    freedom = len(design) - design.shape[1]
    if freedom < 1 or np.linalg.cond(design) > LARGEST_CONDITION:  # the angles vary too little
        return False
    fitted = np.linalg.lstsq(design, depth[use], rcond=None)[0]
    variance = ((depth[use] - design @ fitted) ** 2).sum() / freedom
    error = np.sqrt(variance * np.diag(np.linalg.inv(design.T @ design)))[1:].reshape(-1, 2).max(axis=1)
    amplitude = np.hypot(*fitted[1:].reshape(-1, 2).T)
    clear = (amplitude > LARGEST_AMPLITUDE_RADII) & (amplitude > CLEAR_AMPLITUDE * error)
    return bool(clear[list(TELLING_HARMONICS)].any())
