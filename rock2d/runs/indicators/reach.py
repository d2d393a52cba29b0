"""Angles of reach and energy line angles of blocks.

The *angle of reach* (Fahrböschung, travel angle) is the slope of the line from the start of a block to its end. The
*energy line angle* is the slope of the line from the energy head at the start, height plus (kinetic energy) / (m g), to
the end. They are equal for a block that starts at rest. For a block that slides with constant friction, the energy line
angle is the friction angle on any ground.

Sources: A. Heim, Bergsturz und Menschenleben, Zürich 1932; M. Jaboyedoff and V. Labiouse, Technical note: Preliminary
estimation of rockfall runout zones, Nat. Hazards Earth Syst. Sci. 11 (2011) 819-828."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from rock2d.arrays import Array
from rock2d.runs.indicators.passing import left_source
from rock2d.runs.simulation import Indicator, Simulation
from rock2d.statistics import percentile_estimate

if TYPE_CHECKING:
    import pandas as pd

REACH_COLUMNS = (
    "block", "angle", "left_source", "not_stopped", "least_deg", "exceeded_by_95_deg", "low95_deg", "high95_deg",
)  # fmt: skip
REACH, ENERGY_LINE = "reach", "energy_line"
REACH_PERCENTILE = 5.0  # angles that 95 % of the blocks exceed


def angle_of_reach_deg(start_m: Array, end_m: Array) -> Array:
    """Slope (n,) in degrees, positive downwards, of the lines from `start_m` to `end_m`, (n, 2) x and y each."""
    run, fall = np.abs(end_m[:, 0] - start_m[:, 0]), start_m[:, 1] - end_m[:, 1]
    return np.rad2deg(np.arctan2(fall, run))


def energy_head_m(states: Array, inertia_over_mass_m2: Array, gravity_m_s2: float) -> Array:
    """Height in m plus kinetic energy over weight of states (n, 6: x, y, theta, vx, vy, omega); infinite without
    gravity."""
    twice = states[:, 3] ** 2 + states[:, 4] ** 2 + inertia_over_mass_m2 * states[:, 5] ** 2
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(states[:, 1] + twice / (2.0 * gravity_m_s2))


def reach_table(run: Simulation) -> pd.DataFrame:
    """Angle of reach and energy line angle of the releases that left their source; REACH_COLUMNS.

    - not_stopped: releases that left the cross-section or were cut short; because they would run farther, the angles
      are then upper bounds
    - least_deg: smallest angle
    - exceeded_by_95_deg: angle that 95 % of the blocks exceed, with its 95 % interval"""
    import pandas as pd

    rows = []
    for name in dict.fromkeys(track.block for track in run.tracks):
        tracks = [track for track in run.tracks if track.block == name]
        bodies = [run.block_of(track) for track in tracks]
        start, end = (np.array([track.knots[i, 1:7] for track in tracks]) for i in (0, -1))
        left_section = np.array([track.stop == "exit" for track in tracks])
        left = left_source(start[:, 0], end[:, 0], left_section, np.array([body.size_m for body in bodies]))
        ratio = np.array([body.inertia_kg_m2 / body.mass_kg for body in bodies])
        head = np.column_stack([start[:, 0], energy_head_m(start, ratio, tracks[0].gravity_m_s2)])
        stopped = np.array([track.stop == "rest" for track in tracks])
        for angle, origin in ((REACH, start[:, :2]), (ENERGY_LINE, head)):
            found = np.sort(angle_of_reach_deg(origin, end[:, :2])[left])
            estimate = percentile_estimate(found, len(found), REACH_PERCENTILE)
            least = float(found[0]) if len(found) else np.nan
            rows.append((name, angle, int(left.sum()), int((left & ~stopped).sum()), least, *estimate))
    return pd.DataFrame(rows, columns=list(REACH_COLUMNS))


INDICATOR = Indicator("reach", REACH_COLUMNS, reach_table)
