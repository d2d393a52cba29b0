"""First crossings of the measure lines: one row for each block that passes a line.

A measure line's *foot* is the end nearer to the ground. A block passes a line when its centroid first crosses it, in
either direction. The crossing is exact: it lies on the parabola, not between samples."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from rock2d.arrays import Array
from rock2d.compiled import njit
from rock2d.records.columns import INSTANT_OMEGA, INSTANT_VX, INSTANT_VY, INSTANT_X, INSTANT_Y, TIME
from rock2d.runs.simulation import Indicator, Simulation
from rock2d.scene.cross_section import CrossSection

if TYPE_CHECKING:
    import pandas as pd

CROSSING_VALUES = (
    "t_s", "x_m", "y_m", "theta_rad", "vx_m_s", "vy_m_s", "speed_m_s", "omega_rad_s", "incidence_angle_deg",
    "passing_height_m", "translational_J", "rotational_J", "kinetic_J",
)  # fmt: skip
CROSSING_COLUMNS = ("block", "release", "line", *CROSSING_VALUES)


def crossings_table(run: Simulation) -> pd.DataFrame:
    """State of every block at its first crossing of every measure line; CROSSING_COLUMNS, one row a crossing.

    - incidence_angle_deg: angle between the velocity and the normal of the line, in [-90, 90]; positive if the block
      moves towards the foot of the line, that is the ground. At a vertical line: the angle below the horizontal.
    - passing_height_m: distance along the line from its foot to the crossing of the centroid.
    - kinetic_J = translational_J + rotational_J = ½ m v² + ½ I ω², with mass and moment of inertia of the block of this
      release."""
    import pandas as pd

    rows, ground = [], run.cross_section
    for track in run.tracks:
        for name, ends in ground.measure_lines.items():
            found = track.crossings(ends)[:1]
            if len(found):
                block = run.block_of(track)
                masses = np.array([block.mass_kg, block.inertia_kg_m2])
                values = crossing_values(found, ends, ground, masses)[0]
                rows.append((track.block, track.release, name, *map(float, values)))
    return pd.DataFrame(rows, columns=list(CROSSING_COLUMNS))


def crossing_values(found: Array, line: Array, cross_section: CrossSection, masses: Array) -> Array:
    """(n, 13) values of CROSSING_COLUMNS from t_s on, of crossings `found` (n, 7: t and state) of one line; `masses`
    (n, 2) or (2,) are the mass in kg and the moment of inertia in kg m² of the blocks."""
    foot, up = foot_and_up(line, cross_section)
    each = np.broadcast_to(np.asarray(masses, float), (len(found), 2))
    return crossing_rows(found[:, None], foot[None], up[None], each)[2].T


def foot_and_up(line: Array, cross_section: CrossSection) -> tuple[Array, Array]:
    """Foot (2,) of a measure line (2, 2), and unit vector (2,) from the foot to the head."""
    foot, head = cross_section.foot_and_head(line)
    return foot, (head - foot) / np.hypot(*(head - foot))


def crossing_rows(found: Array, feet: Array, ups: Array, masses: Array) -> tuple[Array, Array, Array]:
    """Index of the release (k,), index of the line (k,) and values (13, k), see `crossing_values`, of all crossings in
    `found` (n, lines, 7: t and state, NaN if there is no crossing), ordered by release.

    `feet`, `ups` (lines, 2): see `foot_and_up`; `masses` (n, 2)."""
    # arrays of one layout, so that it is compiled once
    given = (np.require(own, float, ("C", "W")) for own in (found, feet, ups, masses))
    rows: tuple[Array, Array, Array] = _rows(*given)
    return rows


@njit(nogil=True)
def _rows(found, feet, ups, masses):
    n, lines = found.shape[:2]
    k = 0
    for i in range(n):
        for j in range(lines):
            k += np.isfinite(found[i, j, TIME])
    release, line, values = np.empty(k, np.int64), np.empty(k, np.int64), np.empty((13, k))
    k = 0
    for i in range(n):
        mass, inertia = masses[i]
        for j in range(lines):
            state = found[i, j]
            if not np.isfinite(state[TIME]):
                continue
            release[k], line[k] = i, j
            vx, vy, omega = state[INSTANT_VX], state[INSTANT_VY], state[INSTANT_OMEGA]
            up_x, up_y = ups[j, 0], ups[j, 1]
            speed, rising, across = np.hypot(vx, vy), vx * up_x + vy * up_y, abs(vy * up_x - vx * up_y)
            height = (state[INSTANT_X] - feet[j, 0]) * up_x + (state[INSTANT_Y] - feet[j, 1]) * up_y
            moving, spinning = 0.5 * mass * speed**2, 0.5 * inertia * omega**2
            for q in range(INSTANT_OMEGA):
                values[q, k] = state[q]
            values[6, k], values[7, k] = speed, omega
            values[8, k], values[9, k] = np.degrees(np.arctan2(-rising, across)), height
            values[10, k], values[11, k], values[12, k] = moving, spinning, moving + spinning
            k += 1
    return release, line, values


INDICATOR = Indicator("crossings", CROSSING_COLUMNS, crossings_table)
