"""First crossings of the measure lines: one row for each block that passes a line.

A measure line's *foot* is the end nearer to the ground. A block passes a line when its centroid first crosses it, in
either direction. The crossing is exact: it lies on the parabola, not between samples.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from types import MappingProxyType
from typing import TYPE_CHECKING

import numpy as np

from rock2d.records.track import Track
from rock2d.runs.indicators.indicator import Indicator
from rock2d.scene.blocks import Block
from rock2d.scene.cross_section import CrossSection

if TYPE_CHECKING:
    import pandas as pd

Array = np.ndarray

CROSSING_VALUES = (
    "t_s", "x_m", "y_m", "theta_rad", "vx_m_s", "vy_m_s", "speed_m_s", "omega_rad_s", "incidence_angle_deg",
    "passing_height_m", "translational_J", "rotational_J", "kinetic_J",
)  # fmt: skip
CROSSING_COLUMNS = ("block", "release", "line", *CROSSING_VALUES)


def crossings_table(
    tracks: Iterable[Track],
    cross_section: CrossSection,
    blocks: Mapping[str, Block],
    own_blocks: Mapping[int, Block] = MappingProxyType({}),
) -> pd.DataFrame:
    """State of every block at its first crossing of every measure line; CROSSING_COLUMNS, one row a passing.

    - incidence_angle_deg: between the velocity and the line's normal, in [-90, 90]; positive when the block
      heads toward the line's foot, that is the ground. At an upright line: the angle below the horizontal.
    - passing_height_m: distance along the line from its foot to the crossing of the centroid.
    - energies are those of the release's own block, if it has one in `own_blocks` (release -> block)
    - kinetic_J = translational_J + rotational_J = ½ m v² + ½ I ω², with the block's own moment of inertia.

    Raises KeyError if a track's block is not in `blocks`.
    """
    import pandas as pd

    rows = []
    for track in tracks:
        for name, ends in cross_section.measure_lines.items():
            found = track.crossings(ends)[:1]
            if len(found):
                block = own_blocks.get(track.release, blocks[track.block])
                masses = np.array([block.mass_kg, block.inertia_kg_m2])
                values = crossing_values(found, ends, cross_section, masses)[0]
                rows.append((track.block, track.release, name, *map(float, values)))
    return pd.DataFrame(rows, columns=list(CROSSING_COLUMNS))


def crossing_values(found: Array, line: Array, cross_section: CrossSection, masses: Array) -> Array:
    """(n, 13) values of CROSSING_COLUMNS from t_s on, of crossings `found` (n, 7: t and state) of one line; `masses`
    (n, 2) or (2,) are the mass in kg and the moment of inertia in kg m² of the blocks."""
    return values_at(found, *foot_and_up(line, cross_section), masses).T


def foot_and_up(line: Array, cross_section: CrossSection) -> tuple[Array, Array]:
    """(2,) foot of a measure line (2, 2), and (2,) the direction from it to the head, of length 1."""
    foot, head = cross_section.foot_and_head(line)
    return foot, (head - foot) / np.hypot(*(head - foot))


def values_at(found: Array, foot: Array, up: Array, masses: Array) -> Array:
    """(13, n) values, see `crossing_values`; `foot`, `up`: (2,), or (2, n) where crossings are of several lines."""
    x, y, vx, vy, omega = found[:, 1], found[:, 2], found[:, 4], found[:, 5], found[:, 6]
    speed, rising = np.hypot(vx, vy), vx * up[0] + vy * up[1]
    across = np.abs(vy * up[0] - vx * up[1])
    mass, inertia = np.asarray(masses, float).T
    moving, spinning = 0.5 * mass * speed**2, 0.5 * inertia * omega**2
    incidence = np.degrees(np.arctan2(-rising, across))
    height = (x - foot[0]) * up[0] + (y - foot[1]) * up[1]
    return np.stack([*found[:, :6].T, speed, omega, incidence, height, moving, spinning, moving + spinning])


INDICATOR = Indicator(
    "crossings",
    CROSSING_COLUMNS,
    lambda run: crossings_table(run.tracks, run.cross_section, run.blocks, run.own_blocks),
)
