"""Figure 1: the set-up with its measure lines, and the spread of its assumed parts."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from rock2d.graphics.figure_style import blank_figure, finish
from rock2d.graphics.trajectories import draw_cross_section
from rock2d.reproduction.hypotheses import hypothesis_cross_section
from rock2d.reproduction.results import Results
from rock2d_figures.style import setup_view, with_short_lines

OTHER_HYPOTHESES = 60  # drawn in grey
FIGURE_WIDTH_IN = 7.2


def figure(results: Results) -> Figure:
    """The likeliest hypothesis of the deterministic model, and other hypotheses as grey lines."""
    values = results.values("deterministic")
    sample = results.samples["deterministic"]
    ground = with_short_lines(hypothesis_cross_section(values, sample.best))
    view, shape = setup_view(ground, 1500)
    drawn = blank_figure(FIGURE_WIDTH_IN, FIGURE_WIDTH_IN * shape + 0.5)
    axis = drawn.subplots()
    draw_cross_section(axis, ground, view, np.empty((0, 2)), FIGURE_WIDTH_IN - 0.6)
    for i in np.linspace(0, len(sample.u) - 1, OTHER_HYPOTHESES).astype(int):
        other = hypothesis_cross_section(values, int(i))
        axis.plot(*other.points_m.T, color="#555555", lw=0.35, alpha=0.35, zorder=1.9)
    axis.set_xlabel("x (cm)")
    axis.set_ylabel("y (cm)")
    finish(drawn)
    return drawn
