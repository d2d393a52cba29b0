"""What a reproduction finds out: arrivals that explain the paper's own simulations, against the statements of its text,
and the posteriors of set-up and laws within their prior ranges."""

from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from rock2d.arrays import Array
from rock2d.graphics.figure_style import SMALL_PT, blank_figure, handle
from rock2d.records.columns import OMEGA, VX, VY
from rock2d.reproduction import published
from rock2d.reproduction.arrival_results import ArrivalResults
from rock2d.reproduction.hypotheses import incident_distributions
from rock2d.reproduction.outcomes import FACING_ID, Outcome
from rock2d_figures.style import STYLES, finish_with_legend

STATEMENT_COLOUR = "#cfcfcf"
N = published.RELEASES
# block -> lowest and highest share in % of first impacts on the facing that the text allows
STATED_ON_FACING = {
    "sphere": (0.0, 100.0 * (1 - published.SPHERE_IN_DITCH / N)),
    "cube": tuple(100.0 * count / N for count in published.CUBE_ON_FACING),
    "parallelepiped": (100.0 * published.PARALLELEPIPED_ON_FACING / N, 100.0),
}


def arrivals_figure(results: ArrivalResults) -> Figure:
    """One panel for each quantity, one row for each block: median and 95 % interval over hypotheses. Grey: what the
    text says, and the speed of the drop."""
    drawn = blank_figure(7.2, 2.3)
    axes = drawn.subplots(1, 4, sharey=True)
    values, drop_m_s = results.values, float(np.sqrt(2.0 * published.GRAVITY_M_S2 * published.DROP_M))
    for row, (block, outcome) in enumerate(zip(published.BLOCKS, results.predicted, strict=True)):
        mean = incident_distributions(values, published.SETUP_BLOCKS[block]).mean
        on_facing = outcome.first_zone == FACING_ID
        _statement(axes[0], row, *STATED_ON_FACING[block])
        _interval(axes[0], row, 100.0 * on_facing.mean(axis=1))
        if block == "parallelepiped":
            _statement(axes[1], row, 0.0, published.OFF_NORMAL_DEG)
        _interval(axes[1], row, _mean_angle(outcome, on_facing))
        axes[2].axvline(drop_m_s, color=STATEMENT_COLOUR, lw=2, zorder=1)
        _interval(axes[2], row, np.hypot(mean[:, VX], mean[:, VY]))
        _interval(axes[3], row, np.abs(mean[:, OMEGA]))
    titles = (
        "first impacts\non facing (%)", "angle to the\nfacing's normal (°)",
        "speed off\nthe slope (m/s)", "spin (rad/s)",
    )  # fmt: skip
    for axis, title in zip(axes, titles, strict=True):
        axis.set_xlabel(title, fontsize=SMALL_PT)
        axis.grid(axis="x", color="#e4e4e4", lw=0.6)
        axis.set_axisbelow(True)
    axes[0].set_xlim(-5, 105)
    axes[0].set_yticks(range(len(published.BLOCKS)), published.BLOCKS)
    axes[0].set_ylim(len(published.BLOCKS) - 0.5, -0.5)
    colour = STYLES["deterministic"][0]
    handles = [
        handle("median, 95 % over hypotheses", color=colour, marker="D", ls="-", ms=4, lw=1.4),
        handle("the text; speed of the drop", color=STATEMENT_COLOUR, ls="-", lw=7),
    ]
    return finish_with_legend(drawn, handles, 2, SMALL_PT)


def _mean_angle(outcome: Outcome, on_facing: Array) -> Array:
    """Mean angle off the facing's normal of the hypotheses that have first impacts there."""
    some = on_facing.any(axis=1)
    angles = np.where(on_facing, outcome.off_normal_deg, 0.0)[some].sum(axis=1)
    return np.asarray(angles / on_facing[some].sum(axis=1))


def _statement(axis: Axes, row: int, low: float, high: float) -> None:
    axis.fill_betweenx([row - 0.32, row + 0.32], low - 0.8, high + 0.8, color=STATEMENT_COLOUR, lw=0)


def _interval(axis: Axes, row: int, values: Array) -> None:
    if not len(values):
        return
    colour = STYLES["deterministic"][0]
    low, middle, high = np.percentile(values, [2.5, 50.0, 97.5])
    axis.plot([low, high], [row, row], color=colour, lw=1.4, zorder=3)
    axis.plot(middle, row, "D", color=colour, ms=4, zorder=4)


def identified_figure(table: pd.DataFrame) -> Figure:
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
