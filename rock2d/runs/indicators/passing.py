"""Passing frequencies: the share of the releases of a block that cross a measure line."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from rock2d.records.columns import UNRESOLVED_STOPS
from rock2d.records.track import Track
from rock2d.runs.indicators.indicator import Indicator
from rock2d.scene.cross_section import CrossSection
from rock2d.statistics import wilson_interval

if TYPE_CHECKING:
    import pandas as pd

PASSING_COLUMNS = ("block", "line", "releases", "passed", "unresolved", "frequency", "low95", "high95")


def passing_table(tracks: Sequence[Track], cross_section: CrossSection) -> pd.DataFrame:
    """Passing frequency of every block at every measure line; PASSING_COLUMNS.

    unresolved: releases that were cut short, or sank into the ground, before they crossed the line. The 95 % interval
    covers both of what they could have done: from the lower bound of Wilson's (1927) score interval if none of them
    had crossed, to its upper bound if all had.
    """
    import pandas as pd

    rows = []
    for block in dict.fromkeys(track.block for track in tracks):
        own = [track for track in tracks if track.block == block]
        for line, ends in cross_section.measure_lines.items():
            failed = [track for track in own if len(track.crossings(ends)) == 0]
            unresolved = sum(track.stop in UNRESOLVED_STOPS for track in failed)
            rows.append(passing_row(block, line, len(own), len(own) - len(failed), unresolved))
    return pd.DataFrame(rows, columns=list(PASSING_COLUMNS))


def passing_row(
    block: str, line: str, releases: int, passed: int, unresolved: int
) -> tuple[str, str, int, int, int, float, float, float]:
    """One row of PASSING_COLUMNS."""
    low, _ = wilson_interval(passed, releases)
    _, high = wilson_interval(passed + unresolved, releases)
    return block, line, releases, passed, unresolved, passed / releases, low, high


INDICATOR = Indicator("passing", PASSING_COLUMNS, lambda run: passing_table(run.tracks, run.cross_section))
