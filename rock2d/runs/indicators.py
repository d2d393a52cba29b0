"""What a designer reads off an ensemble of tracks: measure lines, passing frequencies, percentiles, stops.

Pure functions from tracks to tidy tables, whichever engine or camera the tracks came from. A measure line's
*foot* is the end nearer to the surface. A block passes a line when its centroid first crosses it, in either
direction; the parabola is met exactly, not between samples.
"""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from rock2d.records.track import Track
from rock2d.scene.blocks import Block
from rock2d.scene.cross_section import CrossSection
from rock2d.scene.nearest_facet import nearest_facets

if TYPE_CHECKING:
    import pandas as pd

Array = np.ndarray

CROSSING_COLUMNS = [
    "block", "release", "line", "t_s", "x_m", "y_m", "theta_rad", "vx_m_s", "vy_m_s", "speed_m_s",
    "omega_rad_s", "incidence_angle_deg", "passing_height_m", "translational_J", "rotational_J", "kinetic_J",
]  # fmt: skip
PASSING_COLUMNS = ["block", "line", "releases", "passed", "frequency", "low95", "high95"]
PERCENTILE_COLUMNS = ["block", "line", "quantity", "percentile", "passed", "value", "low95", "high95"]
STOP_COLUMNS = ["block", "release", "stop", "t_s", "x_m", "y_m", "zone", "runout_m"]
QUANTITIES = ("kinetic_J", "passing_height_m")  # of which percentiles are taken at measure lines
PERCENTILES = (95.0, 99.0)


def crossings_table(
    tracks: Iterable[Track], cross_section: CrossSection, blocks: Mapping[str, Block]
) -> pd.DataFrame:
    """State of every block at its first crossing of every measure line; CROSSING_COLUMNS, one row a passing.

    - incidence_angle_deg: between the velocity and the line's normal, in [-90, 90]; positive when the block
      heads toward the line's foot, that is the ground. At an upright line: the angle below the horizontal.
    - passing_height_m: distance along the line from its foot to the crossing of the centroid.
    - kinetic_J = translational_J + rotational_J = ½ m v² + ½ I ω², with the block's own moment of inertia.

    Raises KeyError if a track's block is not in `blocks`.
    """
    import pandas as pd

    rows = []
    for track in tracks:
        for name, ends in cross_section.measure_lines.items():
            found = track.crossings(ends)[:1]
            if len(found):
                values = crossing_values(found, ends, cross_section, blocks[track.block])[0]
                rows.append((track.block, track.release, name, *map(float, values)))
    return pd.DataFrame(rows, columns=CROSSING_COLUMNS)


def crossing_values(found: Array, line: Array, cross_section: CrossSection, block: Block) -> Array:
    """(n, 13) values of CROSSING_COLUMNS from t_s on, of crossings `found` (n, 7: t and state) of one line."""
    foot, up = _foot_and_direction(line, cross_section)
    x, y, vx, vy, omega = found[:, 1], found[:, 2], found[:, 4], found[:, 5], found[:, 6]
    speed, rising = np.hypot(vx, vy), vx * up[0] + vy * up[1]
    across = np.abs(vy * up[0] - vx * up[1])
    moving, spinning = 0.5 * block.mass_kg * speed**2, 0.5 * block.inertia_kg_m2 * omega**2
    incidence = np.degrees(np.arctan2(-rising, across))
    height = (x - foot[0]) * up[0] + (y - foot[1]) * up[1]
    return np.column_stack(
        [found[:, :6], speed, omega, incidence, height, moving, spinning, moving + spinning]
    )


def passing_table(tracks: Sequence[Track], cross_section: CrossSection) -> pd.DataFrame:
    """Passing frequency of every block at every measure line; PASSING_COLUMNS.

    The 95 % interval is Wilson's (1927) score interval.
    """
    import pandas as pd

    rows = []
    for block in dict.fromkeys(track.block for track in tracks):
        own = [track for track in tracks if track.block == block]
        for line, ends in cross_section.measure_lines.items():
            passed = sum(len(track.crossings(ends)) > 0 for track in own)
            rows.append(passing_row(block, line, len(own), passed))
    return pd.DataFrame(rows, columns=PASSING_COLUMNS)


def passing_row(
    block: str, line: str, releases: int, passed: int
) -> tuple[str, str, int, int, float, float, float]:
    """One row of PASSING_COLUMNS."""
    return (block, line, releases, passed, passed / releases, *wilson_interval(passed, releases))


def percentile_table(
    crossings: pd.DataFrame,
    quantities: Sequence[str] = QUANTITIES,
    percentiles: Sequence[float] = PERCENTILES,
) -> pd.DataFrame:
    """Percentiles over the blocks that passed, from `crossings_table`; PERCENTILE_COLUMNS.

    The intervals are those of `percentile_interval`: a bound that so few passings cannot give is NaN.
    """
    import pandas as pd

    rows = []
    for (block, line), group in crossings.groupby(["block", "line"], sort=False):
        for quantity in quantities:
            ranked = dict(enumerate(np.sort(group[quantity].to_numpy(float)).tolist()))
            for percentile in percentiles:
                estimate = percentile_estimate(ranked, len(ranked), percentile)
                rows.append((block, line, quantity, percentile, len(ranked), *estimate))
    return pd.DataFrame(rows, columns=PERCENTILE_COLUMNS)


def stops_table(tracks: Iterable[Track], cross_section: CrossSection) -> pd.DataFrame:
    """Where and how every release ended; STOP_COLUMNS.

    zone: of the facet nearest to the centroid, None if the block left the cross-section.
    runout_m: horizontal distance from the track's start to its end, positive toward the embankment.
    """
    import pandas as pd

    rows = []
    for track in tracks:
        t, x, y = map(float, track.knots[-1, :3])
        nearest = int(nearest_facets(track.knots[-1:, 1:3], cross_section.points_m)[0])
        zone = None if track.stop == "exit" else cross_section.zones[nearest]
        runout = x - float(track.knots[0, 1])
        rows.append((track.block, track.release, track.stop, t, x, y, zone, runout))
    return pd.DataFrame(rows, columns=STOP_COLUMNS)


def wilson_interval(passed: int, releases: int, confidence: float = 0.95) -> tuple[float, float]:
    """Wilson's score interval of a frequency. Raises ValueError unless 0 <= passed <= releases > 0."""
    from scipy import stats

    interval = stats.binomtest(passed, releases).proportion_ci(confidence, method="wilson")
    return float(interval.low), float(interval.high)


def percentile_interval(values: Array, percentile: float, confidence: float = 0.95) -> tuple[float, float]:
    """Distribution-free interval of a percentile, from order statistics; NaN where no such value exists.

    Of n values the number below the p-quantile is Binomial(n, p); the bounds are the sorted values X(l), X(u)
    (from 1) with the largest l and smallest u for which P(B < l) and P(B >= u) are each at most half of
    1 - confidence. At 95 % confidence there is no upper bound below 72 values for the 95th and below 368 for
    the 99th percentile.
    """
    low, high = _interval_ranks(len(values), percentile, confidence)
    ranked = np.sort(np.asarray(values, float))
    return (
        float(ranked[low]) if low >= 0 else float("nan"),
        float(ranked[high]) if high < len(ranked) else float("nan"),
    )


def percentile_ranks(n: int, percentile: float) -> list[int]:
    """Ranks (from 0, of n > 0 values) of the sorted values that `percentile_estimate` looks at."""
    below, _ = _percentile_rank(n, percentile)
    ranks = {below, min(below + 1, n - 1), *_interval_ranks(n, percentile)}
    return sorted(rank for rank in ranks if 0 <= rank < n)


def percentile_estimate(ranked: Mapping[int, float], n: int, percentile: float) -> tuple[float, float, float]:
    """(percentile, low, high): linear between the two nearest of n sorted values, with the 95 % interval of
    `percentile_interval`. `ranked` gives the value of each of `percentile_ranks`."""
    below, weight = _percentile_rank(n, percentile)
    a, b = ranked[below], ranked[min(below + 1, n - 1)]
    low, high = _interval_ranks(n, percentile)
    nan = float("nan")
    value = a + (b - a) * weight if weight < 0.5 else b - (b - a) * (1.0 - weight)  # as numpy rounds it
    return value, ranked[low] if low >= 0 else nan, ranked[high] if high < n else nan


def _percentile_rank(n: int, percentile: float) -> tuple[int, float]:
    """Rank (from 0) below which, and how far above which, the percentile lies among n sorted values."""
    at = (n - 1) * (percentile / 100.0)
    return int(at), at - int(at)


def _interval_ranks(n: int, percentile: float, confidence: float = 0.95) -> tuple[int, int]:
    """Ranks (from 0) of the bounds of `percentile_interval`; -1 and n where there is none."""
    from scipy import stats

    def below(k: int) -> float:
        return float(stats.binom.cdf(k, n, percentile / 100.0))  # P(B <= k)

    tail = 0.5 * (1.0 - confidence)
    lower = bisect_right(range(n), tail, key=below)  # how many l have P(B < l) <= tail
    upper = bisect_left(range(n), 1.0 - tail, key=below) + 1  # smallest u with P(B < u) >= 1 - tail
    return lower - 1, upper - 1


def _distances(cross_section: CrossSection, x: float, y: float) -> Array:
    """(n,) distances from a point to the facets, in m."""
    start, edge = cross_section.points_m[:-1], np.diff(cross_section.points_m, axis=0)
    away = np.array([x, y]) - start
    along = np.clip((away * edge).sum(axis=1) / (edge * edge).sum(axis=1), 0.0, 1.0)
    return np.hypot(*(away - along[:, None] * edge).T)


def _foot_and_direction(line: Array, cross_section: CrossSection) -> tuple[Array, Array]:
    """The line's end nearer to the surface (the first, if equal) and the unit vector away from it."""
    near = [_distances(cross_section, x, y).min() for x, y in line]
    foot, head = (line[0], line[1]) if near[0] <= near[1] else (line[1], line[0])
    return foot, (head - foot) / np.hypot(*(head - foot))
