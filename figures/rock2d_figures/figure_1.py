"""Figure 1: the set-up with its measure lines, and what of it is assumed."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from rock2d.graphics.figure_style import blank_figure, finish
from rock2d.graphics.trajectories import draw_cross_section
from rock2d.reproduction.hypotheses import cross_section
from rock2d.reproduction.results import Results
from rock2d_figures.style import setup_view, with_short_lines

OTHERS = 60  # other hypotheses that are drawn
WIDE_IN = 7.2


def figure(results: Results) -> Figure:
    """The likeliest hypothesis of the deterministic model, and in grey lines others as good."""
    known, values = results.known, results.values("deterministic")
    sample = results.samples["deterministic"]
    ground = with_short_lines(cross_section(values, sample.best, known.height_m, known.crest_m))
    view, shape = setup_view(ground, 1500)
    drawn = blank_figure(WIDE_IN, WIDE_IN * shape + 0.5)
    axis = drawn.subplots()
    draw_cross_section(axis, ground, view, np.empty((0, 2)), WIDE_IN - 0.6)
    for i in np.linspace(0, len(sample.u) - 1, OTHERS).astype(int):
        other = cross_section(values, int(i), known.height_m, known.crest_m)
        axis.plot(*other.points_m.T, color="#555555", lw=0.35, alpha=0.35, zorder=1.9)
    axis.set_xlabel("x (cm)")
    axis.set_ylabel("y (cm)")
    finish(drawn)
    return drawn
