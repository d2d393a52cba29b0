"""What the sphere and the words identify: the posterior of every unknown within its prior range."""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from figures.style import SMALL_PT, STYLES
from rock2d.plots import blank_figure, finish
from rock2d.reproduction import published

PAPERS = {
    **published.CONTACT,
    **published.REBOUND,
    "restitution": float(np.sqrt(published.CONTACT["k_l_N_m"] / published.CONTACT["k_ul_N_m"])),
}


def figure(table: pd.DataFrame) -> Figure:
    """`table` as `summary.identified_table` gives it, with the column `model`; bars: 95 %, dots: medians, crosses: the
    paper's values, all as shares of the prior's range (logarithmic where the prior is)."""
    drawn = blank_figure(7.2, 0.19 * len(table) + 0.9)
    axis = drawn.subplots()
    for y, row in enumerate(table.to_dict("records")):
        low, middle, high = (_share(row[key], row) for key in ("low95", "median", "high95"))
        colour = STYLES[row["model"]][0]
        axis.plot([0, 1], [y, y], color="#dddddd", lw=4, solid_capstyle="butt", zorder=1)
        axis.plot([low, high], [y, y], color=colour, lw=2, solid_capstyle="butt", zorder=2)
        axis.plot(middle, y, "o", color=colour, ms=4, zorder=3)
        if row["quantity"] in PAPERS:
            axis.plot(_share(PAPERS[row["quantity"]], row), y, "x", color="black", ms=5, mew=1.3, zorder=4)
        axis.text(1.02, y, f"{row['sd_over_prior_sd']:.2f}", va="center", fontsize=SMALL_PT)
    axis.set_yticks(range(len(table)), list(table["quantity"]), fontsize=SMALL_PT)
    axis.set_ylim(len(table) - 0.4, -0.6)
    axis.set_xlim(-0.02, 1.1)
    axis.set_xticks([0, 0.5, 1], ["lower bound", "prior range", "upper bound"])
    axis.set_title("sd / prior sd", fontsize=SMALL_PT, loc="right")
    finish(drawn)
    return drawn


def _share(value: float, row: dict[Any, Any]) -> float:
    low, high = row["prior_low"], row["prior_high"]
    if row["prior_log"] is True:
        return float(np.log(max(value, low) / low) / np.log(high / low))
    return (value - low) / (high - low)
