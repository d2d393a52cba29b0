"""Indicators: what the modules of this folder define as `INDICATOR`, or as `INDICATORS`.

An indicator is a table that is computed from the tracks of a run. `rock2d run` writes it, and `RunResult.to_pandas`
returns it."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

from rock2d.registry import registered

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

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


def indicators() -> Mapping[str, Indicator]:
    """Every indicator by its name, in the order of the names. Raises ValueError if two share a name."""
    return registered(__name__, "INDICATOR")
