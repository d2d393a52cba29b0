"""Figures of the energies of a release."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from rock2d.graphics.figure_style import LINESTYLES, SMALL_PT, blank_figure, finish
from rock2d.graphics.palette import INK, block_colours
from rock2d.records.columns import INSTANT_OMEGA, INSTANT_VX, INSTANT_VY, INSTANT_Y, TIME
from rock2d.records.track import Track
from rock2d.scene.blocks import Block


def energy_figure(track: Track, block: Block, title: str = "") -> Figure:
    """Energies in J: translation, rotation, potential (zero at the lowest position) and their sum."""
    t = np.union1d(np.linspace(track.knots[0, TIME], track.end_s, 1500), track.knots[:, TIME])
    state = np.column_stack([t, track.states(t)])
    moving = 0.5 * block.mass_kg * (state[:, INSTANT_VX] ** 2 + state[:, INSTANT_VY] ** 2)
    spinning = 0.5 * block.inertia_kg_m2 * state[:, INSTANT_OMEGA] ** 2
    height = block.mass_kg * track.gravity_m_s2 * (state[:, INSTANT_Y] - state[:, INSTANT_Y].min())
    figure = blank_figure(6.0, 3.4)
    axis = figure.subplots()
    colours = block_colours(["translation", "rotation", "potential"])
    for (name, values), style in zip(
        {"translation": moving, "rotation": spinning, "potential": height}.items(), LINESTYLES, strict=False
    ):
        axis.plot(t, values, color=colours[name], ls=style, lw=1.4, label=name)
    axis.plot(t, moving + spinning + height, color=INK, lw=1.8, label="sum")
    axis.set_xlim(t[0], t[-1])
    axis.set_ylim(0)
    axis.grid(color="#e4e4e4", lw=0.6)
    axis.set_xlabel("time (s)")
    axis.set_ylabel("energy (J)")
    axis.legend(frameon=False, fontsize=SMALL_PT + 0.5, ncols=4, loc="lower left", bbox_to_anchor=(0, 1))
    finish(figure, title)
    return figure
