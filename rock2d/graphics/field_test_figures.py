"""Figures of a field test: measured and forecast stops, and the share of blocks that pass each distance."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.figure import Figure

from rock2d.arrays import Array
from rock2d.graphics.figure_style import SMALL_PT, blank_figure, finish, handle
from rock2d.graphics.palette import BLOCK_COLOURS, INK, MEASURED_COLOUR, ZONE_TONES, block_colours

if TYPE_CHECKING:
    import pandas as pd

    from rock2d.scene.cross_section import CrossSection

INTERVALS = ((0.05, 0.95, 1.5), (0.10, 0.90, 4.0), (0.25, 0.75, 8.0))  # from, to, width of the bar


def forecasts_figure(
    ground: CrossSection, measured: Mapping[str, Array], expected: Mapping[str, Mapping[str, Array]]
) -> Figure:
    """The mean section `ground`, and below it the stops of each block: `measured` distances (n,) in m, and the
    `expected` samples (any shape, m) by block and by forecast."""
    figure = blank_figure(8.0, 3.0 + 0.75 * len(measured))
    top, below = figure.subplots(2, 1, sharex=True, height_ratios=[2.0, 0.75 * len(measured) + 0.6])
    far = max(float(own.max()) for own in measured.values()) + 35.0
    x, y = ground.points_m.T
    shown = (x <= far) & (x >= -5.0)
    top.fill_between(x[shown], y[shown], y[shown].min() - 5.0, color=ZONE_TONES[0], lw=0)
    top.plot(x[shown], y[shown], color=INK, lw=1.2)
    top.set_ylabel("height in m")
    top.set_ylim(y[shown].min() - 5.0, None)
    colours = block_colours(measured)
    names = list(dict.fromkeys(name for own in expected.values() for name in own))
    offsets = np.linspace(-0.28, 0.28, max(len(names), 2))
    for row, (block, distances) in enumerate(measured.items()):
        top.plot(distances, np.interp(distances, x, y) + 1.5 + 2.0 * row, "v", color=colours[block], ms=4)
        below.plot(distances, np.full(len(distances), row), "|", color=MEASURED_COLOUR, ms=26, mew=1.1)
        for name, samples in expected.get(block, {}).items():
            at, colour = row + offsets[names.index(name)], BLOCK_COLOURS[names.index(name)]
            for low, high, width in INTERVALS:
                below.plot(np.quantile(samples, [low, high]), [at, at], color=colour, lw=width, alpha=0.45,
                           solid_capstyle="butt")  # fmt: skip
            below.plot(np.median(samples), at, "o", color="white", mec=colour, ms=4.5)
    below.set_yticks(range(len(measured)), [f"{block} ({len(own)})" for block, own in measured.items()])
    below.set_ylim(len(measured) - 0.45, -0.55)
    below.set_xlim(-5.0, far)
    below.set_xlabel("horizontal distance from the start in m")
    handles: list[Any] = [handle("measured stops", marker="|", ls="", color=MEASURED_COLOUR, ms=10)]
    handles += [handle(name, color=BLOCK_COLOURS[i], lw=5, alpha=0.6) for i, name in enumerate(names)]
    figure.legend(handles=handles, fontsize=SMALL_PT, loc="outside lower center", ncols=4, frameon=False)
    return finish(figure, "Stops, and forecasts (median, 50, 80 and 90 %)")


def passing_figure(table: pd.DataFrame, names: Mapping[str, str]) -> Figure:
    """The share of the releases of each block that pass a distance.

    `table` is that of `field_tests.forecasts.passing_table`; `names` gives the forecasts to draw and their labels."""
    shown = table[table["forecast"].isin(list(names))]
    blocks = list(dict.fromkeys(shown["block"]))
    figure = blank_figure(3.0 * len(blocks) + 0.8, 3.4)
    axes = np.atleast_1d(figure.subplots(1, len(blocks), sharey=True))
    for axis, block in zip(axes, blocks, strict=True):
        own = shown[shown["block"] == block]
        first = own[own["forecast"] == own["forecast"].iloc[0]]
        axis.fill_between(first["line_m"], 100 * first["low95"], 100 * first["high95"], color="#dddddd", lw=0)
        axis.plot(first["line_m"], 100 * first["measured"], color=MEASURED_COLOUR, lw=1.4, marker="o", ms=3)
        for i, name in enumerate(names):
            of = own[own["forecast"] == name]
            axis.plot(of["line_m"], 100 * of["forecast_frequency"], color=BLOCK_COLOURS[i], lw=1.4)
        axis.set_title(f"{block} ({first['releases'].iloc[0]})", fontsize=SMALL_PT + 1)
        axis.set_xlabel("distance in m")
        axis.grid(color="#e4e4e4", lw=0.6)
    axes[0].set_ylabel("passes the distance in %")
    handles: list[Any] = [handle("measured, 95 %", color=MEASURED_COLOUR, marker="o", ms=3)]
    handles += [handle(label, color=BLOCK_COLOURS[i]) for i, label in enumerate(names.values())]
    axes[0].legend(handles=handles, fontsize=SMALL_PT - 0.5, loc="lower left", frameon=False)
    return finish(figure)
