"""Percentiles of kinetic energy, passing height and speed at the measure lines."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from rock2d.runs.indicators.indicator import Indicator
from rock2d.statistics import percentile_estimate

if TYPE_CHECKING:
    import pandas as pd

PERCENTILE_COLUMNS = ("block", "line", "quantity", "percentile", "passed", "value", "low95", "high95")
LINE_QUANTITIES = ("kinetic_J", "passing_height_m", "speed_m_s")
PERCENTILES = (95.0, 99.0)


def percentile_table(crossings: pd.DataFrame) -> pd.DataFrame:
    """Percentiles over the blocks that passed, from `crossings_table`; PERCENTILE_COLUMNS.

    Percentiles and intervals are those of `statistics.percentile_estimate`: NaN if too few blocks passed."""
    import pandas as pd

    rows = []
    for (block, line), group in crossings.groupby(["block", "line"], sort=False):
        for quantity in LINE_QUANTITIES:
            ranked = np.sort(group[quantity].to_numpy(float))
            for percentile in PERCENTILES:
                estimate = percentile_estimate(ranked, len(ranked), percentile)
                rows.append((block, line, quantity, percentile, len(ranked), *estimate))
    return pd.DataFrame(rows, columns=list(PERCENTILE_COLUMNS))


INDICATOR = Indicator("percentiles", PERCENTILE_COLUMNS, lambda run: percentile_table(run.to_pandas("crossings")))
