"""Figures 1 to 3 of the paper: the set-up, the sphere at line 2, and the trajectories."""

import numpy as np
from matplotlib.figure import Figure

from rock2d.arrays import Array
from rock2d.graphics.canvas import Limits
from rock2d.graphics.figure_style import TEXT_PT, blank_figure, finish, handle
from rock2d.graphics.trajectories import draw_cross_section, positions_of
from rock2d.records.columns import INSTANT_OMEGA, INSTANT_VX, INSTANT_VY
from rock2d.reproduction import published
from rock2d.reproduction.hypotheses import hypothesis_cross_section
from rock2d.reproduction.outcomes import Outcome
from rock2d.reproduction.results import Results
from rock2d.runs.results import RunResult
from rock2d.scene.cross_section import CrossSection
from rock2d_figures.style import STYLES, finish_with_legend

WIDE_IN = 7.2
AXIS_IN = WIDE_IN - 0.6  # width of the axes of Figure 1
PANEL_IN = 3.45  # width of a panel of Figure 3
MARGIN_LEFT_M, MARGIN_RIGHT_M, MARGIN_BELOW_M = 0.12, 0.12, 0.02  # margins around ditch and embankment
SHOWN_LINE_LENGTH_M = 0.11  # longest drawn part of a measure line, so that its name stays in the picture
OTHER_HYPOTHESES = 60  # drawn in grey in Figure 1
FEWEST_CROSSINGS = 20  # crossings that a hypothesis must have for its distribution to be drawn
SHARES = np.linspace(0.01, 0.99, 99)


def figure_1(results: Results) -> Figure:
    """The set-up with its measure lines: the likeliest hypothesis of the deterministic model, and other hypotheses as
    grey lines."""
    values = results.values("deterministic")
    sample = results.samples["deterministic"]
    ground = _with_short_lines(hypothesis_cross_section(values, sample.best))
    limits, shape = _setup_limits(ground)
    figure = blank_figure(WIDE_IN, WIDE_IN * shape + 0.5)
    axis = figure.subplots()
    unit = draw_cross_section(axis, ground, limits, (AXIS_IN, AXIS_IN * shape), np.empty((0, 2)))
    for i in np.linspace(0, len(sample.u) - 1, OTHER_HYPOTHESES).astype(int):
        other = hypothesis_cross_section(values, int(i))
        axis.plot(*other.points_m.T, color="#555555", lw=0.35, alpha=0.35, zorder=1.9)
    axis.set(xlabel=f"x ({unit})", ylabel=f"y ({unit})")
    return finish(figure)


def figure_2(results: Results) -> Figure:
    """Cumulative distributions of velocity, incidence angle, spin and energy of the sphere at line 2: median over the
    hypotheses of each model, and the band that holds 90 % of them."""
    sphere = published.SETUP_BLOCKS["sphere"]
    figure = blank_figure(WIDE_IN, 5.0)
    axes = figure.subplots(2, 2, sharey=True).ravel()
    for name, (outcome, *_) in results.outcomes.items():
        colour, line, _ = STYLES[name]
        values = _at_line_2(outcome, sphere.mass_kg, sphere.inertia_kg_m2)
        for axis, letter, (label, own) in zip(axes, "abcd", values.items(), strict=True):
            enough = own[np.isfinite(own).sum(axis=1) >= FEWEST_CROSSINGS]
            if not len(enough):
                continue
            levels = np.nanquantile(enough, SHARES, axis=1)
            low, middle, high = np.quantile(levels, [0.05, 0.5, 0.95], axis=1)
            axis.fill_betweenx(100 * SHARES, low, high, color=colour, alpha=0.18, lw=0)
            axis.plot(middle, 100 * SHARES, color=colour, ls=line, lw=1.6)
            axis.set(xlabel=f"({letter}) {label}", ylim=(0, 100))
            axis.grid(color="#e4e4e4", lw=0.6)
    for axis in axes[::2]:
        axis.set_ylabel("releases that passed (%)")
    handles = [handle(name, color=STYLES[name][0], ls=STYLES[name][1], lw=1.6) for name in results.outcomes]
    handles.append(handle("90 % of the hypotheses", color="#777777", alpha=0.3, lw=7))
    return finish_with_legend(figure, handles, 3)


def figure_3(runs: dict[str, RunResult]) -> Figure:
    """Trajectories from the found set-up: one row for each block, one column for each model; `runs`: model -> run of
    the scenario."""
    grounds = {model: _with_short_lines(run.cross_section) for model, run in runs.items()}
    shown = {model: _setup_limits(ground) for model, ground in grounds.items()}
    high_in = PANEL_IN * max(shape for _, shape in shown.values())
    blocks = list(next(iter(runs.values())).blocks)
    figure = blank_figure(len(runs) * PANEL_IN, len(blocks) * (high_in + 0.35) + 0.3)
    axes = figure.subplots(len(blocks), len(runs), squeeze=False)
    for column, (model, run) in enumerate(runs.items()):
        limits, shape = shown[model]
        for row, block in enumerate(blocks):
            axis, size_in = axes[row, column], (PANEL_IN, PANEL_IN * shape)
            unit = draw_cross_section(axis, grounds[model], limits, size_in, np.empty((0, 2)), 1100)
            for track in run.tracks:
                if track.block == block:
                    axis.plot(*positions_of(track).T, color=STYLES[model][0], lw=0.7, alpha=0.6, zorder=3)
            axis.set_title(f"{block}, {model}", loc="left", fontsize=TEXT_PT)
            if row == len(blocks) - 1:
                axis.set_xlabel(f"x ({unit})")
            if column == 0:
                axis.set_ylabel(f"y ({unit})")
    return finish(figure)


def _at_line_2(outcome: Outcome, mass_kg: float, inertia_kg_m2: float) -> dict[str, Array]:
    """label -> (k, n) values at line 2, NaN if not passed; incidence: the velocity's angle above the horizontal."""
    vx, vy, omega = (outcome.at_line_2[..., column] for column in (INSTANT_VX, INSTANT_VY, INSTANT_OMEGA))
    return {
        "velocity (m/s)": np.hypot(vx, vy),
        "incidence angle (°)": np.degrees(np.arctan2(vy, vx)),
        "spin (rad/s)": np.abs(omega),
        "kinetic energy (mJ)": 1e3 * 0.5 * (mass_kg * (vx**2 + vy**2) + inertia_kg_m2 * omega**2),
    }


def _setup_limits(cross_section: CrossSection) -> tuple[Limits, float]:
    """The part of a set-up that figures show, and its height over its width."""
    rise = cross_section.embankment
    assert rise is not None
    right = float(cross_section.points_m[rise.crest_end, 0]) + MARGIN_RIGHT_M
    limits = (-MARGIN_LEFT_M, right, -MARGIN_BELOW_M, 2.4 * rise.height_m)
    return limits, (limits[3] - limits[2]) / (limits[1] - limits[0])


def _with_short_lines(cross_section: CrossSection) -> CrossSection:
    """The cross-section with its measure lines cut at SHOWN_LINE_LENGTH_M from their first end."""
    lines = {}
    for name, (foot, head) in cross_section.measure_lines.items():
        away = head - foot
        lines[name] = np.stack([foot, foot + away * min(1.0, SHOWN_LINE_LENGTH_M / np.hypot(*away))])
    return CrossSection(cross_section.points_m, cross_section.zones, lines)
