"""Figures of block motion along a slope: envelopes, stops, and distributions at the measure lines."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from rock2d.graphics.figure_style import SMALL_PT, blank_figure, finish, handle
from rock2d.graphics.palette import block_colours
from rock2d.graphics.trajectories import AXIS_IN, WIDE_IN, draw_cross_section
from rock2d.scene.blocks import Block
from rock2d.scene.cross_section import CrossSection
from rock2d.wording import energy_unit, spoken

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

PANEL_IN = 1.5
PERCENTILE_STYLES: dict[float, Any] = {50.0: (0, (1.5, 1.2)), 95.0: "-", 99.0: (0, (5, 1.6))}
STOP_BINS, LINE_BINS = 60, 30


def envelopes_figure(cross_section: CrossSection, envelopes: pd.DataFrame) -> Figure:
    """Percentiles of height above the ground, speed and energy along the slope, below the cross-section: a colour for
    each block, a line for each percentile, and a band for the 95 % interval of the 95th percentile.

    `envelopes` is the table of `indicators.envelopes`."""
    names = list(envelopes["block"].unique())
    energies = envelopes.loc[envelopes["quantity"] == "kinetic_J", "value"]
    scale, unit = energy_unit(energies.max() if len(names) else 0.0)
    panels = (
        ("height_m", 1.0, "height (m)"), ("speed_m_s", 1.0, "speed (m/s)"), ("kinetic_J", scale, f"energy ({unit})"),
    )  # fmt: skip
    figure, axes = _below_section(cross_section, len(panels))
    colours = block_colours(names)
    for axis, (quantity, factor, label) in zip(axes, panels, strict=True):
        of_quantity = envelopes[envelopes["quantity"] == quantity]
        for name, percentile in itertools.product(names, PERCENTILE_STYLES):
            own = of_quantity[(of_quantity["block"] == name) & (of_quantity["percentile"] == percentile)]
            style = PERCENTILE_STYLES[percentile]
            axis.plot(own["x_m"], factor * own["value"], color=colours[name], lw=1.1, ls=style)
            if percentile == 95.0:
                low, high = factor * own["low95"], factor * own["high95"]
                axis.fill_between(own["x_m"], low, high, color=colours[name], alpha=0.18, lw=0)
        axis.set_ylabel(label)
        axis.set_ylim(bottom=0)
        axis.grid(lw=0.4, color="#dddddd")
    handles = [handle(spoken(name), color=colours[name]) for name in names]
    handles += [handle(f"{p:g} %", color="#555555", ls=style) for p, style in PERCENTILE_STYLES.items()]
    figure.legend(handles=handles, loc="outside lower right", ncols=6, frameon=False, fontsize=SMALL_PT)
    return finish(figure, "Envelopes: exceeded by 50, 5 and 1 % of the blocks that come past")


def stops_figure(cross_section: CrossSection, stops: pd.DataFrame) -> Figure:
    """Histogram of the stops of each block, below the cross-section; `stops` is the table of the indicator."""
    names = list(stops["block"].unique())
    figure, (axis,) = _below_section(cross_section, 1)
    x_m = cross_section.points_m[:, 0]
    colours = block_colours(names)
    inside = [stops[(stops["block"] == name) & (stops["stop"] != "exit")]["x_m"] for name in names]
    bins = np.linspace(x_m.min(), x_m.max(), STOP_BINS + 1)
    axis.hist(inside, bins, stacked=True, color=[colours[n] for n in names])
    axis.set_ylabel("releases")
    for i, name in enumerate(names):
        own = stops[stops["block"] == name]["stop"].value_counts()
        text = f"{spoken(name)}: " + ", ".join(f"{n} {stop}" for stop, n in own.items())
        axis.text(0.01, 0.95 - 0.13 * i, text, transform=axis.transAxes, fontsize=SMALL_PT, va="top",
                  color=colours[name])  # fmt: skip
    return finish(figure, "Where releases end")


def distributions_figure(crossings: pd.DataFrame, lines: Sequence[str], blocks: Mapping[str, Block]) -> Figure:
    """Histograms of energy, passing height and speed of the blocks that pass each line, a row for each line."""
    scale, unit = energy_unit(crossings["kinetic_J"].max() if len(crossings) else 0.0)
    panels = (
        ("kinetic_J", scale, f"energy ({unit})"), ("passing_height_m", 1.0, "passing height (m)"),
        ("speed_m_s", 1.0, "speed (m/s)"),
    )  # fmt: skip
    figure = blank_figure(WIDE_IN, 0.8 + PANEL_IN * len(lines))
    axes = figure.subplots(len(lines), len(panels), squeeze=False, sharex="col")
    colours = block_colours(blocks)
    for row, line in zip(axes, lines, strict=True):
        for axis, (quantity, factor, label) in zip(row, panels, strict=True):
            values = factor * crossings[quantity]
            edges = np.histogram_bin_edges(values, LINE_BINS) if len(crossings) else LINE_BINS
            for name in blocks:
                own = crossings[(crossings["line"] == line) & (crossings["block"] == name)]
                axis.hist(factor * own[quantity], edges, histtype="step", color=colours[name], lw=1.2)
            if line == lines[-1]:
                axis.set_xlabel(label)
        row[0].set_ylabel(f"{line}\nreleases")
    handles = [handle(spoken(name), color=colours[name]) for name in blocks]
    figure.legend(handles=handles, loc="outside lower right", ncols=6, frameon=False, fontsize=SMALL_PT)
    return finish(figure, "Blocks that pass the measure lines")


def _below_section(cross_section: CrossSection, panels: int) -> tuple[Figure, list[Any]]:
    """A figure with the cross-section on top, and the axes below it, which share its x axis."""
    points = cross_section.points_m
    limits = (points[:, 0].min(), points[:, 0].max(), points[:, 1].min(), points[:, 1].max())
    high_in = float(np.clip(AXIS_IN * (limits[3] - limits[2]) / (limits[1] - limits[0]) + 0.3, 0.9, 3.6))
    figure = blank_figure(WIDE_IN, high_in + panels * PANEL_IN + 0.9)
    top, *axes = figure.subplots(1 + panels, 1, sharex=True, height_ratios=[high_in, *[PANEL_IN] * panels])
    unit = draw_cross_section(top, cross_section, limits, (AXIS_IN, high_in), points)
    low = limits[2] - 0.18 * (limits[3] - limits[2]) - 0.01
    top.set(xlim=limits[:2], ylim=(low, limits[3] * 1.02), aspect="auto", ylabel=f"y ({unit})")
    axes[-1].set_xlabel(f"x ({unit})")
    return figure, axes
