"""Passing frequencies: shares of the released and of the arriving blocks that pass a measure line; percentiles of those
that passed.

A block *leaves its source* if the horizontal distance from its start to its end is more than LEAVING_SIZES of its
sizes. It *arrives* if it passes the arrival line or a line behind it. Each embankment has its own arrival line: at the
line `crest_2`, the arriving blocks are those that came to `arrival_2`. Without an embankment, the first measure line is
the arrival line. The share of the arriving blocks does not depend on the number of blocks that stay at a flat start."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from rock2d.arrays import Array
from rock2d.records.columns import UNRESOLVED_STOPS
from rock2d.runs.simulation import Indicator, Simulation
from rock2d.scene.cross_section import CrossSection
from rock2d.scene.earthworks import ARRIVAL_LINE, is_line
from rock2d.statistics import percentile_estimate, wilson_interval

if TYPE_CHECKING:
    import pandas as pd

PASSING_COLUMNS = (
    "block", "line", "releases", "left_source", "arrived", "passed", "unresolved", "frequency", "low95", "high95",
    "per_arriving", "per_arriving_low95", "per_arriving_high95",
)  # fmt: skip
LEAVING_SIZES = 5.0
PERCENTILE_COLUMNS = ("block", "line", "quantity", "percentile", "passed", "value", "low95", "high95")
LINE_QUANTITIES = ("kinetic_J", "passing_height_m", "speed_m_s")
LINE_PERCENTILES = (95.0, 99.0)


class PassingCounts(NamedTuple):
    """Counts of releases of a block at each of its lines, (lines,) each.

    Attributes
    ----------
    passed, unresolved : of all releases; unresolved ones were cut short or buried before they passed
    arrived, may_arrive : releases that came to the arrival line of this line, and those that were cut short or buried
        before it"""

    passed: Array
    unresolved: Array
    arrived: Array
    may_arrive: Array


def arrivals(cross_section: CrossSection) -> Array:
    """(lines, lines) bool: whether a block that passes line j has arrived with respect to line i."""
    names = list(cross_section.measure_lines)
    x = np.array([cross_section.foot_and_head(ends)[0][0] for ends in cross_section.measure_lines.values()])
    is_arrival = np.array([is_line(name, ARRIVAL_LINE) for name in names], bool)
    candidates = x[is_arrival] if is_arrival.any() else x[:0] if not len(x) else np.array([x.min()])
    first = [candidates[candidates <= at].max(initial=-np.inf) for at in x]
    first_x = np.where(np.isfinite(first), first, x)  # for a line before all arrival lines: the line itself
    return x[None, :] >= first_x[:, None]


def count_passing(passed: Array, cut: Array, arrive: Array) -> PassingCounts:
    """Counts of releases. `passed` (n, lines) bool: whether they passed; `cut` (n,) bool: whether they were cut short
    or buried; `arrive`: see `arrivals`."""
    arrived = (passed.astype(np.int64) @ arrive.T.astype(np.int64)) > 0
    unresolved = ~passed & cut[:, None]
    may_arrive = ~arrived & cut[:, None]
    return PassingCounts(*(each.sum(axis=0) for each in (passed, unresolved, arrived, may_arrive)))


def left_source(start_x_m: Array, end_x_m: Array, left_section: Array, size_m: Array) -> Array:
    """(n,) bool: whether releases left their source; `left_section`: whether they left the cross-section."""
    return np.asarray(left_section | (np.abs(end_x_m - start_x_m) > LEAVING_SIZES * size_m))


def passing_rows(
    block: str, lines: Sequence[str], releases: int, left: float, counts: PassingCounts
) -> list[tuple[Any, ...]]:
    """Rows of PASSING_COLUMNS; `left`, the number that left their source, is NaN if ends were not simulated."""
    rows: list[tuple[Any, ...]] = []
    for line, passed, unresolved, arrived, may_arrive in zip(lines, *(each.tolist() for each in counts), strict=True):
        share = passing_share(passed, unresolved, releases)
        rows.append(
            (block, line, releases, left, arrived, passed, unresolved, *share,
             *passing_share(passed, unresolved, arrived, may_arrive))
        )  # fmt: skip
    return rows


def passing_share(passed: int, unresolved: int, of: int, further: int = 0) -> tuple[float, float, float]:
    """(share, lower, upper end of its 95 % interval); the interval covers that no or all unresolved releases pass.

    `further`: unresolved releases that are not counted in `of`, but may belong to it."""
    if of == 0:
        return (np.nan,) * 3
    most = of + further
    return passed / of, wilson_interval(passed, most)[0], wilson_interval(passed + unresolved, most)[1]


def passing_table(run: Simulation) -> pd.DataFrame:
    """Passing frequency of every block at every measure line; PASSING_COLUMNS.

    - left_source, arrived: see the module
    - unresolved: releases that were cut short, or sank into the ground, before they crossed the line
    - frequency: share of the released blocks; per_arriving: share of the blocks that arrived, NaN if none did

    The 95 % intervals go from the lower bound of the score interval of Wilson (1927) if no unresolved release had
    crossed, to its upper bound if all had crossed."""
    import pandas as pd

    rows, arrive, lines = [], arrivals(run.cross_section), list(run.cross_section.measure_lines)
    crossings = run.to_pandas("crossings")
    crossed = set(zip(crossings["release"], crossings["line"], strict=True))
    for block in dict.fromkeys(track.block for track in run.tracks):
        tracks = [track for track in run.tracks if track.block == block]
        passed = np.array([[(track.release, line) in crossed for line in lines] for track in tracks], bool)
        cut, left_section = (
            np.array([track.stop in stops for track in tracks]) for stops in (UNRESOLVED_STOPS, ("exit",))
        )
        start, end = (np.array([track.knots[i, 1] for track in tracks]) for i in (0, -1))
        size = np.array([run.block_of(track).size_m for track in tracks])
        left = int(left_source(start, end, left_section, size).sum())
        counts = count_passing(passed.reshape(len(tracks), len(lines)), cut, arrive)
        rows += passing_rows(block, lines, len(tracks), left, counts)
    return pd.DataFrame(rows, columns=list(PASSING_COLUMNS))


def percentile_table(crossings: pd.DataFrame) -> pd.DataFrame:
    """Percentiles over the blocks that passed, from `crossings_table`; PERCENTILE_COLUMNS.

    Percentiles and intervals are those of `statistics.percentile_estimate`: NaN if too few blocks passed."""
    import pandas as pd

    rows = []
    for (block, line), group in crossings.groupby(["block", "line"], sort=False):
        for quantity in LINE_QUANTITIES:
            ranked = np.sort(group[quantity].to_numpy(float))
            for percentile in LINE_PERCENTILES:
                estimate = percentile_estimate(ranked, len(ranked), percentile)
                rows.append((block, line, quantity, percentile, len(ranked), *estimate))
    return pd.DataFrame(rows, columns=list(PERCENTILE_COLUMNS))


INDICATORS = (
    Indicator("passing", PASSING_COLUMNS, passing_table),
    Indicator("percentiles", PERCENTILE_COLUMNS, lambda run: percentile_table(run.to_pandas("crossings"))),
)
