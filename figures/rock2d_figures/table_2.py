"""Table 2, passing frequencies of experiment and models: as plots and as text."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from rock2d.graphics.figure_style import SMALL_PT, blank_figure, handle
from rock2d.reproduction import published
from rock2d.wording import spoken
from rock2d_figures.style import STYLES, finish_with_legend

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

SHIFT = {"experiment": -0.3, "deterministic": -0.1, "probabilistic": 0.1}
WIDE_SHIFT = {"experiment": -0.24, "deterministic": 0.0, "probabilistic": 0.24}
PAPER_SHIFT = 0.2  # of the paper's models from this project's
BAR_PT, RING_PT = 7.0, 10.0
RING: dict[str, Any] = {"mfc": "none", "mec": "#c0392b"}
OPEN: dict[str, Any] = {"mfc": "white", "ms": 5, "mew": 1.1, "zorder": 3}


def passing_figure(table: pd.DataFrame) -> Figure:
    """Experiment against this project's and the paper's models; `table` as `summary.passing_table` gives it.

    Filled: this project's mean and 95 % interval over hypotheses, the experiment's exact interval. Open: the paper's
    models."""
    figure = blank_figure(7.2, 3.2)
    for axis, own, x in _panels(figure, table, 4):
        for name, shift in SHIFT.items():
            colour, _, marker = STYLES[name]
            low, high = (own[f"{name}_{end}95"].to_numpy(float) for end in ("low", "high"))
            axis.vlines(x + shift, low, high, color=colour, lw=1.1, zorder=3)
            for bound in (low, high):
                axis.plot(x + shift, bound, "_", color=colour, ms=5, mew=1.1, zorder=3)
            axis.plot(x + shift, own[name], marker, color=colour, ms=5, zorder=4)
            if name != "experiment":
                axis.plot(x + shift + PAPER_SHIFT, own[f"paper_{name}"], marker, mec=colour, **OPEN)
    handles = [handle(name, color=STYLES[name][0], marker=STYLES[name][2], ls="-", ms=5, lw=1.1) for name in SHIFT]
    handles += [_open_handle(f"paper, {name}", name) for name in published.COLUMNS]
    return finish_with_legend(figure, handles, 5)


def side_by_side_figure(table: pd.DataFrame) -> Figure:
    """This project's models in the intervals of the paper's; `table` as `rock2d.reproduction.paper_setup` gives it.

    Bars: exact 95 % intervals of the 50 published releases. Open markers: published; filled: this project's models, in
    a ring where they lie outside the bar."""
    figure = blank_figure(7.2, 3.2)
    for axis, own, x in _panels(figure, table, 5):
        for name, shift in WIDE_SHIFT.items():
            colour, _, marker = STYLES[name]
            paper = name if name == "experiment" else f"paper_{name}"
            at = x + shift
            axis.vlines(at, own[f"{paper}_low95"], own[f"{paper}_high95"], color=colour, lw=BAR_PT, alpha=0.25)
            axis.plot(at, own[paper], marker, mec=colour, **OPEN)
            if name != "experiment":
                axis.plot(at, own[name], marker, color=colour, ms=3.6, zorder=4)
                off = ~own[f"{name}_agrees"].to_numpy(bool)
                axis.plot(at[off], own[name][off], "o", ms=RING_PT, mew=1.1, zorder=5, **RING)
    handles = [_open_handle("experiment", "experiment")]
    for name in published.COLUMNS:
        colour, _, marker = STYLES[name]
        handles.append(_open_handle(f"paper, {name}", name))
        handles.append(handle(f"rock2d, {name}", color=colour, marker=marker, ls="none", ms=3.6))
    handles.append(handle("outside the paper's 95 %", marker="o", ls="none", ms=RING_PT - 2, **RING))
    return finish_with_legend(figure, handles, 3)


def _panels(figure: Figure, table: pd.DataFrame, room: float) -> Iterator[tuple[Axes, pd.DataFrame, np.ndarray]]:
    """The axes of each block, its rows, and the place of each line; `room`: below 0 and above 100 %."""
    blocks = list(dict.fromkeys(table["block"]))
    axes = np.atleast_1d(figure.subplots(1, len(blocks), sharey=True))
    axes[0].set_ylabel("passing frequency (%)")
    for axis, block in zip(axes, blocks, strict=True):
        own = table[table["block"] == block]
        x = np.arange(len(own))
        yield axis, own, x
        axis.set_title(block, fontsize=SMALL_PT + 1.5, loc="left")
        axis.set_xticks(x, [spoken(line) for line in own["line"]])
        axis.set_ylim(-room, 100 + room)
        axis.grid(axis="y", color="#e4e4e4", lw=0.6)


def _open_handle(label: str, name: str) -> Any:
    return handle(label, mec=STYLES[name][0], marker=STYLES[name][2], mfc="white", ls="none", ms=5)


def markdown_rows(table: pd.DataFrame) -> tuple[list[str], list[list[str]]]:
    """Head and cells of `table` as `summary.passing_table` gives it: % [95 % interval], p of exact tests."""
    head = ["block", "line", "experiment"]
    for name in (*published.COLUMNS, *(f"paper, {name}" for name in published.COLUMNS)):
        head += [name, "p"]
    rows = []
    for row in table.to_dict("records"):
        cells = [row["block"], spoken(row["line"]), interval_text(row, "experiment")]
        for name in published.COLUMNS:
            cells += [interval_text(row, name), _p(row[f"{name}_p"])]
        for name in published.COLUMNS:
            cells += [f"{row[f'paper_{name}']:.0f}", _p(row[f"paper_{name}_p"])]
        rows.append(cells)
    return head, rows


def interval_text(row: Mapping[Any, Any], name: str) -> str:
    """A frequency in % of a row of a table, with its 95 % interval: `name`, `name`_low95 and `name`_high95."""
    return f"{row[name]:.0f} [{row[f'{name}_low95']:.0f}, {row[f'{name}_high95']:.0f}]"


def _p(p: float) -> str:
    return f"**{p:.3f}**" if p < 0.05 else f"{p:.3f}"
