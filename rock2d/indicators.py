"""What a designer reads off an ensemble of tracks: measure lines, passing frequencies, percentiles, stops.

Pure functions from tracks to tidy tables, whichever engine or camera the tracks came from. A measure line's
*foot* is the end nearer to the surface. A block passes a line when its centroid first crosses it, in either
direction; the parabola is met exactly, not between samples.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

import numpy as np
import pandas as pd
from scipy import stats

from rock2d.blocks import Block
from rock2d.terrain import Terrain
from rock2d.track import Track

Array = np.ndarray

CROSSING_COLUMNS = [
    "block", "release", "line", "t_s", "x_m", "y_m", "theta_rad", "vx_m_s", "vy_m_s", "speed_m_s",
    "omega_rad_s", "incidence_angle_deg", "passing_height_m", "translational_J", "rotational_J", "kinetic_J",
]  # fmt: skip
PASSING_COLUMNS = ["block", "line", "releases", "passed", "frequency", "low95", "high95"]
PERCENTILE_COLUMNS = ["block", "line", "quantity", "percentile", "passed", "value", "low95", "high95"]
STOP_COLUMNS = ["block", "release", "stop", "t_s", "x_m", "y_m", "zone", "runout_m"]


def crossings_table(tracks: Iterable[Track], terrain: Terrain, blocks: Mapping[str, Block]) -> pd.DataFrame:
    """State of every block at its first crossing of every measure line; CROSSING_COLUMNS, one row a passing.

    - incidence_angle_deg: between the velocity and the line's normal, in [-90, 90]; positive when the block
      heads toward the line's foot, that is the ground. At an upright line: the angle below the horizontal.
    - passing_height_m: distance along the line from its foot to the crossing of the centroid.
    - kinetic_J = translational_J + rotational_J = ½ m v² + ½ I ω², with the block's own moment of inertia.

    Raises KeyError if a track's block is not in `blocks`.
    """
    rows = []
    for track in tracks:
        block = blocks[track.block]
        for name, ends in terrain.measure_lines.items():
            found = track.crossings(ends)
            if len(found) == 0:
                continue
            t, x, y, theta, vx, vy, omega = map(float, found[0])
            foot, up = _foot_and_direction(ends, terrain)
            speed, rising = np.hypot(vx, vy), vx * up[0] + vy * up[1]
            across = abs(vy * up[0] - vx * up[1])
            moving, spinning = 0.5 * block.mass_kg * speed**2, 0.5 * block.inertia_kg_m2 * omega**2
            rows.append(
                (
                    *(track.block, track.release, name, t, x, y, theta, vx, vy, float(speed), omega),
                    float(np.degrees(np.arctan2(-rising, across))),
                    float((x - foot[0]) * up[0] + (y - foot[1]) * up[1]),
                    *(float(moving), float(spinning), float(moving + spinning)),
                )
            )
    return pd.DataFrame(rows, columns=CROSSING_COLUMNS)


def passing_table(tracks: Sequence[Track], terrain: Terrain) -> pd.DataFrame:
    """Passing frequency of every block at every measure line; PASSING_COLUMNS.

    The 95 % interval is Wilson's (1927) score interval.
    """
    rows = []
    for block in dict.fromkeys(track.block for track in tracks):
        own = [track for track in tracks if track.block == block]
        for line, ends in terrain.measure_lines.items():
            passed = sum(len(track.crossings(ends)) > 0 for track in own)
            rows.append(
                (block, line, len(own), passed, passed / len(own), *wilson_interval(passed, len(own)))
            )
    return pd.DataFrame(rows, columns=PASSING_COLUMNS)


def percentile_table(
    crossings: pd.DataFrame,
    quantities: Sequence[str] = ("kinetic_J", "passing_height_m"),
    percentiles: Sequence[float] = (95.0, 99.0),
) -> pd.DataFrame:
    """Percentiles over the blocks that passed, from `crossings_table`; PERCENTILE_COLUMNS.

    The intervals are those of `percentile_interval`: a bound that so few passings cannot give is NaN.
    """
    rows = []
    for (block, line), group in crossings.groupby(["block", "line"], sort=False):
        for quantity in quantities:
            values = group[quantity].to_numpy(float)
            for percentile in percentiles:
                value = float(np.percentile(values, percentile))
                low, high = percentile_interval(values, percentile)
                rows.append((block, line, quantity, percentile, len(values), value, low, high))
    return pd.DataFrame(rows, columns=PERCENTILE_COLUMNS)


def stops_table(tracks: Iterable[Track], terrain: Terrain) -> pd.DataFrame:
    """Where and how every release ended; STOP_COLUMNS.

    zone: of the facet nearest to the centroid, None if the block left the cross-section.
    runout_m: horizontal distance from the track's start to its end, positive toward the embankment.
    """
    rows = []
    for track in tracks:
        t, x, y = map(float, track.knots[-1, :3])
        zone = None if track.stop == "exit" else terrain.zones[int(np.argmin(_distances(terrain, x, y)))]
        runout = x - float(track.knots[0, 1])
        rows.append((track.block, track.release, track.stop, t, x, y, zone, runout))
    return pd.DataFrame(rows, columns=STOP_COLUMNS)


def wilson_interval(passed: int, releases: int, confidence: float = 0.95) -> tuple[float, float]:
    """Wilson's score interval of a frequency. Raises ValueError unless 0 <= passed <= releases > 0."""
    interval = stats.binomtest(passed, releases).proportion_ci(confidence, method="wilson")
    return float(interval.low), float(interval.high)


def percentile_interval(values: Array, percentile: float, confidence: float = 0.95) -> tuple[float, float]:
    """Distribution-free interval of a percentile, from order statistics.

    Of n values the number below the p-quantile is Binomial(n, p); the bounds are the sorted values X(l), X(u)
    (from 1) with the largest l and smallest u for which P(B < l) and P(B >= u) are each at most half of
    1 - confidence. NaN where no such value exists: for the upper bound at 95 % confidence, below 72 values
    for the 95th and below 368 for the 99th percentile.
    """
    ranked, n, p = np.sort(np.asarray(values, float)), len(values), percentile / 100.0
    tail = 0.5 * (1.0 - confidence)
    below = stats.binom.cdf(np.arange(n), n, p)  # P(B <= k) for k = 0 .. n - 1
    lower = int(np.searchsorted(below, tail, side="right"))  # how many l have P(B < l) <= tail
    upper = int(np.searchsorted(below, 1.0 - tail, side="left")) + 1  # smallest u with P(B < u) >= 1 - tail
    return (
        float(ranked[lower - 1]) if lower >= 1 else float("nan"),
        float(ranked[upper - 1]) if upper <= n else float("nan"),
    )


def _distances(terrain: Terrain, x: float, y: float) -> Array:
    """(n,) distances from a point to the facets, in m."""
    start, edge = terrain.points_m[:-1], np.diff(terrain.points_m, axis=0)
    away = np.array([x, y]) - start
    along = np.clip((away * edge).sum(axis=1) / (edge * edge).sum(axis=1), 0.0, 1.0)
    return np.hypot(*(away - along[:, None] * edge).T)


def _foot_and_direction(line: Array, terrain: Terrain) -> tuple[Array, Array]:
    """The line's end nearer to the surface (the first, if equal) and the unit vector away from it."""
    near = [_distances(terrain, x, y).min() for x, y in line]
    foot, head = (line[0], line[1]) if near[0] <= near[1] else (line[1], line[0])
    return foot, (head - foot) / np.hypot(*(head - foot))
