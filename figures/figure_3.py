"""Figure 3: trajectories of the three blocks with both models, from the calibrated scenario."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from figures.style import STYLES, TEXT_PT, with_short_lines
from rock2d import drawing
from rock2d.plots import blank_figure, draw_cross_section, finish
from rock2d.run import RunResult

SHOWN = 25  # releases of each block
BACK_M = 0.10  # of the slope that is shown


def figure(runs: dict[str, RunResult]) -> Figure:
    """A row a block, a column a model; `runs`: model -> its run of the calibrated scenario."""
    first = next(iter(runs.values()))
    ground = with_short_lines(first.terrain)
    rise = ground.embankment
    assert rise is not None
    top = 2.4 * rise.height_m
    limits = (-BACK_M, float(ground.points_m[rise.crest_end, 0]) + 0.1, -0.02, top)
    shape = (limits[3] - limits[2]) / (limits[1] - limits[0])
    wide_in = 3.45
    drawn = blank_figure(2 * wide_in, len(first.blocks) * (wide_in * shape + 0.35) + 0.3)
    axes = drawn.subplots(len(first.blocks), len(runs), squeeze=False, sharex=True, sharey=True)
    view = drawing.fitted_view(limits, 1100, round(1100 * shape))
    for column, (model, run) in enumerate(runs.items()):
        colour = STYLES[model][0]
        for row, block in enumerate(run.blocks):
            axis = axes[row, column]
            draw_cross_section(axis, ground, view, np.empty((0, 2)), wide_in)
            for track in [t for t in run.tracks if t.block == block][:SHOWN]:
                t = np.union1d(np.linspace(track.knots[0, 0], track.end_s, 500), track.knots[:, 0])
                way = track.states(t)[:, :2]
                axis.plot(*way.T, color=colour, lw=0.7, alpha=0.6, zorder=3)
            axis.set_title(f"{block}, {model}", loc="left", fontsize=TEXT_PT)
            if row == len(run.blocks) - 1:
                axis.set_xlabel("x (cm)")
            if column == 0:
                axis.set_ylabel("y (cm)")
    finish(drawn)
    return drawn
