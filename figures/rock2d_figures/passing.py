"""Table 2 as a plot: passing frequencies with intervals, experiment against this project's and the paper's models."""

from __future__ import annotations

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from rock2d.graphics.figure_style import SMALL_PT, blank_figure, finish, handle
from rock2d_figures.style import STYLES, spelled

MARKER_SHIFT = {"experiment": -0.3, "deterministic": -0.1, "probabilistic": 0.1}
PAPER_MARKER_SHIFT = {"deterministic": -0.1, "probabilistic": 0.1}


def figure(table: pd.DataFrame) -> Figure:
    """One panel for each block; `table` as `summary.passing_table` gives it.

    Filled: this project's mean and 95 % interval over hypotheses, the experiment's exact interval. Open: the paper's
    models.
    """
    blocks = list(dict.fromkeys(table["block"]))
    drawn = blank_figure(7.2, 3.2)
    axes = np.atleast_1d(drawn.subplots(1, len(blocks), sharey=True))
    for axis, block in zip(axes, blocks, strict=True):
        own = table[table["block"] == block]
        x = np.arange(len(own))
        for name, shift in MARKER_SHIFT.items():
            colour, _, marker = STYLES[name]
            bounds = [own[f"{name}_{end}95"].to_numpy(float) for end in ("low", "high")]
            axis.vlines(x + shift, *bounds, color=colour, lw=1.1, zorder=3)
            for bound in bounds:
                axis.plot(x + shift, bound, "_", color=colour, ms=5, mew=1.1, zorder=3)
            axis.plot(x + shift, own[name], marker, color=colour, ms=5, zorder=4)
        for name, shift in PAPER_MARKER_SHIFT.items():
            colour, _, marker = STYLES[name]
            axis.plot(
                x + shift + 0.2,
                own[f"paper_{name}"],
                marker,
                mfc="white",
                mec=colour,
                ms=5,
                mew=1.1,
                zorder=3,
            )
        axis.set_title(block, fontsize=SMALL_PT + 1.5, loc="left")
        axis.set_xticks(x, [spelled(line) for line in own["line"]])
        axis.set_ylim(-4, 104)
        axis.grid(axis="y", color="#e4e4e4", lw=0.6)
    axes[0].set_ylabel("passing frequency (%)")
    handles = [
        handle(name, color=STYLES[name][0], marker=STYLES[name][2], ls="-", ms=5, lw=1.1)
        for name in MARKER_SHIFT
    ]
    handles += [
        handle(f"paper, {name}", mec=STYLES[name][0], marker=STYLES[name][2], mfc="white", ls="none", ms=5)
        for name in PAPER_MARKER_SHIFT
    ]
    drawn.legend(handles=handles, loc="outside lower center", ncols=5, frameon=False, fontsize=SMALL_PT + 0.5)
    finish(drawn)
    return drawn
