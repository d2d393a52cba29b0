"""Identified quantities: posteriors of set-up and laws within their prior ranges."""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from rock2d.graphics.figure_style import SMALL_PT, blank_figure, handle
from rock2d_figures.style import STYLES, finish_with_legend


def figure(table: pd.DataFrame) -> Figure:
    """`table` as `summary.identified_table` gives it, with the columns `model` and `paper`; all as shares of the
    prior's range (logarithmic where the prior is)."""
    drawn = blank_figure(7.2, 0.19 * len(table) + 1.2)
    axis = drawn.subplots()
    for y, row in enumerate(table.to_dict("records")):
        low, middle, high = (_share(row[key], row) for key in ("low95", "median", "high95"))
        colour = STYLES[row["model"]][0]
        axis.plot([0, 1], [y, y], color="#dddddd", lw=4, solid_capstyle="butt", zorder=1)
        axis.plot([low, high], [y, y], color=colour, lw=2, solid_capstyle="butt", zorder=2)
        axis.plot(middle, y, "o", color=colour, ms=4, zorder=3)
        if np.isfinite(row["paper"]):
            axis.plot(_share(row["paper"], row), y, "x", color="black", ms=5, mew=1.3, zorder=4)
        axis.text(1.02, y, f"{row['sd_over_prior_sd']:.2f}", va="center", fontsize=SMALL_PT)
    axis.set_yticks(range(len(table)), list(table["quantity"]), fontsize=SMALL_PT)
    axis.set_ylim(len(table) - 0.4, -0.6)
    axis.set_xlim(-0.02, 1.1)
    axis.set_xticks([0, 0.5, 1], ["lower bound", "prior range", "upper bound"])
    axis.set_title("sd / prior sd", fontsize=SMALL_PT, loc="right")
    handles = [
        handle(f"{name}: median, 95 %", color=STYLES[name][0], marker="o", ms=4, lw=2)
        for name in dict.fromkeys(table["model"])
    ]
    handles.append(handle("paper", color="black", marker="x", ls="none", ms=5, mew=1.3))
    return finish_with_legend(drawn, handles, 4)


def _share(value: float, row: dict[Any, Any]) -> float:
    low, high = row["prior_low"], row["prior_high"]
    if row["prior_log"] is True:
        return float(np.log(max(value, low) / low) / np.log(high / low))
    return (value - low) / (high - low)
