"""Figure 2: cumulative distributions of velocity, incidence angle, spin and energy of the sphere at line 2."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from rock2d.graphics.figure_style import SMALL_PT, blank_figure, finish, handle
from rock2d.reproduction import published
from rock2d.reproduction.outcomes import Outcome
from rock2d.reproduction.results import Results
from rock2d_figures.style import STYLES

Array = np.ndarray

FEWEST_CROSSINGS = 20  # crossings that a hypothesis must have for its distribution to be drawn
SHARES = np.linspace(0.01, 0.99, 99)


def quantities(outcome: Outcome, mass_kg: float, inertia_kg_m2: float) -> dict[str, Array]:
    """label -> (k, n) values at line 2, NaN if not passed; incidence: the velocity's angle above the horizontal."""
    vx, vy, omega = outcome.at_line_2[..., 4], outcome.at_line_2[..., 5], outcome.at_line_2[..., 6]
    return {
        "velocity (m/s)": np.hypot(vx, vy),
        "incidence angle (°)": np.degrees(np.arctan2(vy, vx)),
        "spin (rad/s)": np.abs(omega),
        "kinetic energy (mJ)": 1e3 * 0.5 * (mass_kg * (vx**2 + vy**2) + inertia_kg_m2 * omega**2),
    }


def figure(results: Results) -> Figure:
    """Median over the hypotheses of each model, and the band that holds 90 % of them."""
    sphere = published.SETUP_BLOCKS["sphere"]
    drawn = blank_figure(7.2, 5.0)
    axes = drawn.subplots(2, 2, sharey=True).ravel()
    for name, (outcome, *_) in results.outcomes.items():
        colour, line, _ = STYLES[name]
        values = quantities(outcome, sphere.mass_kg, sphere.inertia_kg_m2)
        for axis, letter, (label, own) in zip(axes, "abcd", values.items(), strict=True):
            enough = own[np.isfinite(own).sum(axis=1) >= FEWEST_CROSSINGS]
            if not len(enough):
                continue
            levels = np.nanquantile(enough, SHARES, axis=1)
            low, middle, high = np.quantile(levels, [0.05, 0.5, 0.95], axis=1)
            axis.fill_betweenx(100 * SHARES, low, high, color=colour, alpha=0.18, lw=0)
            axis.plot(middle, 100 * SHARES, color=colour, ls=line, lw=1.6)
            axis.set_xlabel(f"({letter}) {label}")
            axis.set_ylim(0, 100)
            axis.grid(color="#e4e4e4", lw=0.6)
    for axis in axes[::2]:
        axis.set_ylabel("releases that passed (%)")
    handles = [handle(name, color=STYLES[name][0], ls=STYLES[name][1], lw=1.6) for name in results.outcomes]
    handles.append(handle("90 % of the hypotheses", color="#777777", alpha=0.3, lw=7))
    drawn.legend(handles=handles, loc="outside lower center", ncols=3, frameon=False, fontsize=SMALL_PT + 0.5)
    finish(drawn)
    return drawn
