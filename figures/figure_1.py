"""Figure 1: the bench with its measure lines, and what of it is assumed."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from figures.style import with_short_lines
from rock2d import drawing
from rock2d.plots import blank_figure, draw_cross_section, finish
from rock2d.reproduction.hypotheses import terrain
from rock2d.reproduction.results import Results
from rock2d.reproduction.stages import FULL_SPACE, PROBABILISTIC_SPACE

OTHERS = 60  # other hypotheses that are drawn


def figure(results: Results) -> Figure:
    """The hypothesis that the other figures show, and in grey lines others that explain the sphere as well."""
    known, values = results.known, PROBABILISTIC_SPACE.values(results.rebound.u)
    ground = with_short_lines(terrain(values, results.shown, known.height_m, known.crest_m))
    top = 2.4 * known.height_m
    limits = (-0.14, float(ground.points_m[4, 0]) + 0.16, -0.02, top)
    wide_in = 7.2
    high_in = wide_in * (limits[3] - limits[2]) / (limits[1] - limits[0]) + 0.5
    drawn = blank_figure(wide_in, high_in)
    axis = drawn.subplots()
    view = drawing.fitted_view(limits, 1500, round(1500 * (limits[3] - limits[2]) / (limits[1] - limits[0])))
    draw_cross_section(axis, ground, view, np.empty((0, 2)), wide_in - 0.6)
    others = FULL_SPACE.values(results.calibrated.u)
    for i in np.linspace(0, len(results.calibrated.u) - 1, OTHERS).astype(int):
        other = terrain(others, int(i), known.height_m, known.crest_m)
        axis.plot(*other.points_m.T, color="#555555", lw=0.35, alpha=0.35, zorder=1.9)
    axis.set_xlabel("x (cm)")
    axis.set_ylabel("y (cm)")
    finish(drawn)
    return drawn
