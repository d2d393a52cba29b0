"""Figures of residuals: simulated minus measured."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from rock2d.errors import InputError
from rock2d.graphics.figure_style import (
    LINESTYLES,
    SMALL_PT,
    TEXT_PT,
    blank_figure,
    finish,
    handle,
)
from rock2d.graphics.palette import INK, block_colours

Array = np.ndarray


def residuals_figure(residuals: pd.DataFrame, title: str = "") -> Figure:
    """Simulated minus measured, a column for each channel: median and 10-90 % band against the time since the start
    of the release, and the distribution at the end of the releases.

    `residuals` has the columns release, block, t_s, dx_m, dy_m, dtheta_rad. Raises InputError if no row is complete.
    """
    channels = ["dx_m", "dy_m", "dtheta_rad"]
    rows = residuals.dropna(subset=[*channels, "t_s"])
    if rows.empty:
        raise InputError("no residuals to draw: nothing measured has a simulated counterpart")
    group = rows.groupby(["block", "release"], sort=False)["t_s"]
    step = float(np.median(group.diff().dropna())) if (group.size() > 1).any() else 1e-3
    since = rows["t_s"] - group.transform("min")
    rows = rows.assign(since_s=(since / step).round() * step)
    millimetres = float(rows[["dx_m", "dy_m"]].abs().quantile(0.9).max()) < 0.5
    factors = {"dx_m": 1e3, "dy_m": 1e3, "dtheta_rad": 1.0} if millimetres else dict.fromkeys(channels, 1.0)
    unit = "mm" if millimetres else "m"
    labels = {"dx_m": f"x ({unit})", "dy_m": f"y ({unit})", "dtheta_rad": "orientation (rad)"}

    figure = blank_figure(8.4, 5.2)
    axes = figure.subplots(2, 3)
    names = list(dict.fromkeys(rows["block"]))
    colours = block_colours(names)
    for column, channel in enumerate(channels):
        over, end = axes[:, column]
        finals = {}
        for i, name in enumerate(names):
            own = rows[rows["block"] == name]
            values = own[channel] * factors[channel]
            finals[name] = values.groupby(own["release"]).last().to_numpy(float)
            quantiles = values.groupby(own["since_s"]).quantile([0.1, 0.5, 0.9]).unstack()
            count = values.groupby(own["since_s"]).size()
            quantiles = quantiles[count >= min(5, count.max())]  # a few long releases give no band
            t, colour = quantiles.index.to_numpy(float), colours[name]
            over.fill_between(t, quantiles[0.1], quantiles[0.9], color=colour, alpha=0.22, lw=0)
            style = LINESTYLES[i % len(LINESTYLES)]
            over.plot(t, quantiles[0.5], color=colour, ls=style, lw=1.5, label=name.replace("_", " "))
            over.set_xlim(0, max(t.max(), over.get_xlim()[1] if i else 0.0))
        over.axhline(0, color="#555555", lw=0.7)
        over.grid(color="#e4e4e4", lw=0.6)
        over.set_title("Δ " + labels[channel], fontsize=TEXT_PT)
        over.set_xlabel("time since the start (s)")
        _histogram(end, finals, colours)
        end.set_xlabel(f"Δ {labels[channel]} at the end")
    axes[0, 0].set_ylabel("simulated − measured")
    axes[1, 0].set_ylabel("releases")
    grey = colours[names[0]] if len(names) == 1 else "#777777"
    handles = [
        handle(n.replace("_", " "), color=colours[n], ls=LINESTYLES[i % len(LINESTYLES)], lw=1.6)
        for i, n in enumerate(names)
        if len(names) > 1
    ]
    handles += [handle("median", color=grey, lw=1.5)] if len(names) == 1 else []
    handles.append(handle("10-90 % of releases", color=grey, alpha=0.3, lw=7))
    figure.legend(
        handles=handles, loc="outside lower center", ncols=5, frameon=False, fontsize=SMALL_PT + 0.5
    )
    finish(figure, title)
    return figure


def _histogram(axis: Any, values: Mapping[str, Array], colours: Mapping[str, str]) -> None:
    """Counts in common bins over the middle 98 %, as outlines if there are several blocks; a note gives the number
    beyond the bins."""
    every = np.concatenate(list(values.values()))
    low, high = np.quantile(every, [0.01, 0.99]) if len(every) >= 50 else (every.min(), every.max())
    if high - low < 1e-12 * max(1.0, abs(high)):
        low, high = low - 0.5e-3, high + 0.5e-3
    bins = np.linspace(low, high, int(np.clip(2 * np.sqrt(len(every)), 6, 40)) + 1)
    for i, (name, own) in enumerate(values.items()):
        if len(values) == 1:
            axis.hist(own, bins, color=colours[name], alpha=0.75, edgecolor="white", lw=0.4)
        else:
            style = LINESTYLES[i % len(LINESTYLES)]
            axis.hist(own, bins, color=colours[name], histtype="step", ls=style, lw=1.4)
    axis.axvline(0, color="#555555", lw=0.7)
    beyond = int(((every < low) | (every > high)).sum())
    notes = [f"{beyond} beyond the bins"] if beyond else []
    if len(values) == 1:
        axis.axvline(np.median(every), color=INK, lw=1.1, ls=(0, (4, 2)))
        notes.insert(0, f"median {np.median(every):.3g}")
    axis.set_title(", ".join(notes), loc="right", fontsize=SMALL_PT, pad=2)
