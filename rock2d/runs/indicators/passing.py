"""Passing frequencies: the share of the releases of a block that cross a measure line."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from rock2d.records.track import Track
from rock2d.runs.indicators.indicator import Indicator
from rock2d.scene.cross_section import CrossSection
from rock2d.statistics import wilson_interval

if TYPE_CHECKING:
    import pandas as pd

PASSING_COLUMNS = ("block", "line", "releases", "passed", "frequency", "low95", "high95")


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
    return pd.DataFrame(rows, columns=list(PASSING_COLUMNS))


def passing_row(
    block: str, line: str, releases: int, passed: int
) -> tuple[str, str, int, int, float, float, float]:
    """One row of PASSING_COLUMNS."""
    return (block, line, releases, passed, passed / releases, *wilson_interval(passed, releases))


INDICATOR = Indicator("passing", PASSING_COLUMNS, lambda run: passing_table(run.tracks, run.cross_section))
