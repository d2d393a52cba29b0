"""The figure of a cross-section."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from rock2d.graphics.canvas import fitted_view, motion_limits
from rock2d.graphics.figure_style import blank_figure, finish
from rock2d.graphics.palette import SIMULATED_COLOUR
from rock2d.graphics.trajectories import draw_cross_section
from rock2d.scene.cross_section import CrossSection

WIDE_IN, AXIS_IN = 7.5, 6.85


def cross_section_figure(
    cross_section: CrossSection, title: str = "", release_m: tuple[float, float] | None = None
) -> Figure:
    """The cross-section with its zones and measure lines, drawn to scale.

    `release_m`: the stations (m) between which blocks start; this part is marked.
    """
    points = cross_section.points_m
    limits = motion_limits(cross_section, points[:, 0], points[:, 1], 0.0)
    high_in = float(
        np.clip(AXIS_IN * (limits[3] - limits[2]) / (limits[1] - limits[0]) * 1.1 + 0.45, 1.6, 6.0)
    )
    figure = blank_figure(WIDE_IN, high_in + 0.6)
    axis = figure.subplots()
    view = fitted_view(limits, 1500, round(1500 * high_in / AXIS_IN))
    draw_cross_section(axis, cross_section, view, points, AXIS_IN)
    if release_m is not None:
        x = np.linspace(*release_m, 50)
        axis.plot(
            x, cross_section.height_m(x), color=SIMULATED_COLOUR, linewidth=3.0, label="start of blocks"
        )
        axis.legend(loc="upper right", frameon=False)
    axis.set_xlabel("x (m)")
    axis.set_ylabel("y (m)")
    finish(figure, title)
    return figure
