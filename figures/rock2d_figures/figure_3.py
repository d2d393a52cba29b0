"""Figure 3: trajectories of the three blocks with both models, from the found set-up."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from rock2d.graphics.figure_style import TEXT_PT, blank_figure, finish
from rock2d.graphics.trajectories import draw_cross_section, positions_of
from rock2d.runs.results import RunResult
from rock2d_figures.style import STYLES, setup_view, with_short_lines

PANEL_WIDTH_IN = 3.45


def figure(runs: dict[str, RunResult]) -> Figure:
    """One row for each block, one column for each model; `runs`: model -> run of the scenario."""
    grounds = {model: with_short_lines(run.cross_section) for model, run in runs.items()}
    views = {model: setup_view(ground, 1100) for model, ground in grounds.items()}
    high_in = PANEL_WIDTH_IN * max(shape for _, shape in views.values())
    blocks = list(next(iter(runs.values())).blocks)
    drawn = blank_figure(len(runs) * PANEL_WIDTH_IN, len(blocks) * (high_in + 0.35) + 0.3)
    axes = drawn.subplots(len(blocks), len(runs), squeeze=False)
    for column, (model, run) in enumerate(runs.items()):
        for row, block in enumerate(blocks):
            axis = axes[row, column]
            draw_cross_section(axis, grounds[model], views[model][0], np.empty((0, 2)), PANEL_WIDTH_IN)
            for track in run.tracks:
                if track.block == block:
                    axis.plot(*positions_of(track).T, color=STYLES[model][0], lw=0.7, alpha=0.6, zorder=3)
            axis.set_title(f"{block}, {model}", loc="left", fontsize=TEXT_PT)
            if row == len(blocks) - 1:
                axis.set_xlabel("x (cm)")
            if column == 0:
                axis.set_ylabel("y (cm)")
    finish(drawn)
    return drawn
