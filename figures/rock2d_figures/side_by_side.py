"""Table 2 side by side as a plot: where do the models of this project lie in the intervals of the paper's?"""

from __future__ import annotations

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from rock2d.graphics.figure_style import SMALL_PT, blank_figure, finish, handle
from rock2d.reproduction import published
from rock2d_figures.style import STYLES, spelled

SHIFT = {"experiment": -0.24, "deterministic": 0.0, "probabilistic": 0.24}
BAR_PT, RING_PT, RING_COLOUR = 7.0, 10.0, "#c0392b"


def figure(table: pd.DataFrame) -> Figure:
    """One panel for each block; `table` as `rock2d.reproduction.paper_setup` gives it.

    Bars: exact 95 % intervals of the 50 published releases. Open markers: published; filled: this project's models, in
    a ring where they lie outside the bar.
    """
    drawn = blank_figure(7.2, 3.2)
    axes = drawn.subplots(1, len(published.BLOCKS), sharey=True)
    for axis, block in zip(axes, published.BLOCKS, strict=True):
        own = table[table["block"] == block]
        x = np.arange(len(own))
        for name, shift in SHIFT.items():
            colour, _, marker = STYLES[name]
            paper = name if name == "experiment" else f"paper_{name}"
            at = x + shift
            axis.vlines(
                at, own[f"{paper}_low95"], own[f"{paper}_high95"], color=colour, lw=BAR_PT, alpha=0.25
            )
            axis.plot(at, own[paper], marker, mfc="white", mec=colour, ms=5, mew=1.1, zorder=3)
            if name != "experiment":
                axis.plot(at, own[name], marker, color=colour, ms=3.6, zorder=4)
                off = ~own[f"{name}_agrees"].to_numpy(bool)
                axis.plot(
                    at[off], own[name][off], "o", mfc="none", mec=RING_COLOUR, ms=RING_PT, mew=1.1, zorder=5
                )
        axis.set_title(block, fontsize=SMALL_PT + 1.5, loc="left")
        axis.set_xticks(x, [spelled(line) for line in own["line"]])
        axis.set_ylim(-5, 105)
        axis.grid(axis="y", color="#e4e4e4", lw=0.6)
    axes[0].set_ylabel("passing frequency (%)")
    handles = [handle("experiment", mec=STYLES["experiment"][0], marker="o", mfc="white", ls="none", ms=5)]
    for name in published.COLUMNS:
        colour, _, marker = STYLES[name]
        handles.append(handle(f"paper, {name}", mec=colour, marker=marker, mfc="white", ls="none", ms=5))
        handles.append(handle(f"rock2d, {name}", color=colour, marker=marker, ls="none", ms=3.6))
    handles.append(
        handle("outside the paper's 95 %", mec=RING_COLOUR, marker="o", mfc="none", ls="none", ms=RING_PT - 2)
    )
    drawn.legend(handles=handles, loc="outside lower center", ncols=3, frameon=False, fontsize=SMALL_PT + 0.5)
    finish(drawn)
    return drawn
