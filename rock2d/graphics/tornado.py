"""Tornado figure: the part of the variance of a result that each uncertain parameter causes."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from rock2d.graphics.figure_style import SMALL_PT, blank_figure, finish
from rock2d.graphics.palette import block_colours

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

LONGEST_LABEL = 44
BAR_HIGH_IN, PANEL_WIDE_IN = 0.3, 3.2


def told_apart(sensitivity: pd.DataFrame) -> pd.DataFrame:
    """The rows of `sensitivity` that a tornado figure can show: for a block and a line, the largest total index must be
    larger than every 95 % error."""
    panels = sensitivity.groupby(["block", "line"])
    return sensitivity[panels["total"].transform("max") > panels["total_error95"].transform("max")]


def tornado_figure(sensitivity: pd.DataFrame) -> Figure:
    """Bars of the total Sobol index of each parameter with its 95 % error: a row of panels for each line, a column for
    each block. An index that is not larger than its error has no bar.

    `sensitivity` is the table of `design.uncertainty.sensitivity_table`.
    """
    blocks, lines = sensitivity["block"].unique(), sensitivity["line"].unique()
    mean = sensitivity.groupby("parameter")["total"].mean().sort_values()
    names = list(mean.index)
    wide = 2.4 + PANEL_WIDE_IN * len(blocks)
    figure = blank_figure(wide, 0.9 + len(lines) * (0.7 + BAR_HIGH_IN * len(names)))
    axes = figure.subplots(len(lines), len(blocks), squeeze=False, sharex=True, sharey=True)
    colours = block_colours(blocks)
    for row, line in zip(axes, lines, strict=True):
        for axis, block in zip(row, blocks, strict=True):
            chosen = (sensitivity["line"] == line) & (sensitivity["block"] == block)
            own = sensitivity[chosen].set_index("parameter").reindex(names)
            at = np.arange(len(names))
            known = own["total"].where(own["total"] > own["total_error95"])
            axis.barh(at, known, color=colours[block], height=0.62)
            axis.errorbar(own["total"], at, xerr=own["total_error95"], fmt="none", ecolor="#333333", lw=1)
            axis.set_title(f"{block}, {line}", fontsize=SMALL_PT + 1, loc="left")
            if not chosen.any():
                axis.text(
                    0.5,
                    0.5,
                    "not known, or does not vary",
                    transform=axis.transAxes,
                    ha="center",
                    fontsize=SMALL_PT,
                )
            axis.set_yticks(at, [_shortened(name) for name in names])
    axes[0, 0].set_xlim(0.0, 1.05 * max(1.0, (sensitivity["total"] + sensitivity["total_error95"]).max()))
    for axis in axes[-1]:
        axis.set_xlabel("share of the variance (total)")
    finish(figure, "What the spread of the passing frequency comes from")
    return figure


def _shortened(name: str) -> str:
    """A short form of a key of the scenario file; for a law parameter, its name and where it applies."""
    parts = name.split(".")
    text = f"{parts[-1]} ({', '.join(parts[2:-1])})" if parts[0] == "model" else name
    return text if len(text) <= LONGEST_LABEL else "..." + text[3 - LONGEST_LABEL :]
