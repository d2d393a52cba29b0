"""Passing frequencies: of the blocks that are released, leave their source and arrive, how many pass a measure line.

A block *leaves its source* if it ends more than LEAVING_SIZES of its sizes, horizontally, from where it starts. It
*arrives* if it passes the arrival line or a line beyond; before an embankment the arrival line is its own, elsewhere it
is the first measure line. Of several embankments each has its own: at the line `crest_2` those blocks arrived that came
to `arrival_2`. So a slow start on flat ground, where most blocks stay, changes the share of the released blocks and not
that of the arriving ones.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from rock2d.records.columns import UNRESOLVED_STOPS
from rock2d.runs.indicators.indicator import Indicator, Simulated
from rock2d.scene.cross_section import CrossSection
from rock2d.scene.earthworks import ARRIVAL_LINE, is_line
from rock2d.statistics import wilson_interval

if TYPE_CHECKING:
    import pandas as pd

Array = np.ndarray

PASSING_COLUMNS = (
    "block", "line", "releases", "left_source", "arrived", "passed", "unresolved", "frequency", "low95", "high95",
    "per_arriving", "per_arriving_low95", "per_arriving_high95",
)  # fmt: skip
LEAVING_SIZES = 5.0


class PassingCounts(NamedTuple):
    """Counts of releases of a block at each of its lines, (lines,) each.

    Attributes
    ----------
    passed, unresolved : of all releases; unresolved were cut short or buried before they passed
    arrived, arrived_unresolved : that came to the arrival line of this line, and those of them that are unresolved
    """

    passed: Array
    unresolved: Array
    arrived: Array
    arrived_unresolved: Array


def arrivals(cross_section: CrossSection) -> Array:
    """(lines, lines) bool: a block that passes line j arrives at line i."""
    names = list(cross_section.measure_lines)
    x = np.array([cross_section.foot_and_head(ends)[0][0] for ends in cross_section.measure_lines.values()])
    own = np.array([is_line(name, ARRIVAL_LINE) for name in names], bool)
    candidates = x[own] if own.any() else x[:0] if not len(x) else np.array([x.min()])
    first = [candidates[candidates <= at].max(initial=-np.inf) for at in x]
    first_x = np.where(np.isfinite(first), first, x)  # of a line before all arrival lines: the line itself
    return x[None, :] >= first_x[:, None]


def count_passing(passed: Array, cut: Array, arrive: Array) -> PassingCounts:
    """Counts of releases: `passed` (n, lines) bool, which passed; `cut` (n,) bool, which were cut short or buried;
    `arrive` as `arrivals` gives it."""
    arrived = (passed.astype(np.int64) @ arrive.T.astype(np.int64)) > 0
    unresolved = ~passed & cut[:, None]
    return PassingCounts(*(own.sum(axis=0) for own in (passed, unresolved, arrived, arrived & unresolved)))


def left_source(start_x_m: Array, end_x_m: Array, left_section: Array, size_m: Array) -> Array:
    """(n,) bool, which releases left their source; `left_section`: they left the cross-section."""
    return np.asarray(left_section | (np.abs(end_x_m - start_x_m) > LEAVING_SIZES * size_m))


def passing_rows(
    block: str, lines: Sequence[str], releases: int, left: float, counts: PassingCounts
) -> list[tuple[Any, ...]]:
    """Rows of PASSING_COLUMNS; `left` is NaN where ends were not simulated."""
    rows: list[tuple[Any, ...]] = []
    for line, *own in zip(lines, *(each.tolist() for each in counts), strict=True):
        passed, unresolved, arrived, arrived_unresolved = own
        share = passing_share(passed, unresolved, releases)
        rows.append(
            (block, line, releases, left, arrived, passed, unresolved, *share,
             *passing_share(passed, arrived_unresolved, arrived))
        )  # fmt: skip
    return rows


def passing_share(passed: int, unresolved: int, of: int) -> tuple[float, float, float]:
    """Share with its 95 % interval, from the bound if no unresolved release had passed to that if all had."""
    if of == 0:
        return (np.nan,) * 3
    return passed / of, wilson_interval(passed, of)[0], wilson_interval(passed + unresolved, of)[1]


def passing_table(run: Simulated) -> pd.DataFrame:
    """Passing frequency of every block at every measure line; PASSING_COLUMNS.

    - left_source, arrived: see the head of this module
    - unresolved: releases that were cut short, or sank into the ground, before they crossed the line
    - frequency: of the released blocks; per_arriving: of the blocks that arrived, NaN if none did

    The 95 % intervals cover both of what unresolved releases could have done: from the lower bound of Wilson's (1927)
    score interval if none of them had crossed, to its upper bound if all had.
    """
    import pandas as pd

    rows, arrive, lines = [], arrivals(run.cross_section), list(run.cross_section.measure_lines)
    crossings = run.to_pandas("crossings")
    crossed = set(zip(crossings["release"], crossings["line"], strict=True))
    for block in dict.fromkeys(track.block for track in run.tracks):
        own = [track for track in run.tracks if track.block == block]
        passed = np.array([[(track.release, line) in crossed for line in lines] for track in own], bool)
        cut, left_section = (
            np.array([track.stop in stops for track in own]) for stops in (UNRESOLVED_STOPS, ("exit",))
        )
        start, end = (np.array([track.knots[i, 1] for track in own]) for i in (0, -1))
        size = np.array([run.block_of(track).size_m for track in own])
        left = int(left_source(start, end, left_section, size).sum())
        counts = count_passing(passed.reshape(len(own), len(lines)), cut, arrive)
        rows += passing_rows(block, lines, len(own), left, counts)
    return pd.DataFrame(rows, columns=list(PASSING_COLUMNS))


INDICATOR = Indicator("passing", PASSING_COLUMNS, passing_table)
