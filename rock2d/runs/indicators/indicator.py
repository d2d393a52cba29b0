"""An indicator: a named table that is computed from the tracks of a run."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    import pandas as pd

    from rock2d.runs.simulation import Simulation


class Indicator(NamedTuple):
    """A table of a run.

    Attributes
    ----------
    name : name of the table and of its CSV file
    columns : names of the columns with units; a table may have further columns after them
    table : computes the table
    applies : whether these releases have such a table"""

    name: str
    columns: tuple[str, ...]
    table: Callable[[Simulation], pd.DataFrame]
    applies: Callable[[Simulation], bool] = lambda run: True
