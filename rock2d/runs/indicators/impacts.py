"""Impacts: the states before and after every impact."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rock2d.records.columns import IMPACT_COLUMNS
from rock2d.runs.indicators.indicator import Indicator

if TYPE_CHECKING:
    import pandas as pd

    from rock2d.runs.simulation import Simulation


def impacts_table(run: Simulation) -> pd.DataFrame:
    """Every impact of every track; IMPACT_COLUMNS."""
    import pandas as pd

    rows = [{"release": t.release, "block": t.block, **impact} for t in run.tracks for impact in t.impacts]
    return pd.DataFrame(rows, columns=list(IMPACT_COLUMNS))


INDICATOR = Indicator("impacts", IMPACT_COLUMNS, impacts_table)
