"""Figures of learnt changes: each lever as a curve over what it depends on."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from rock2d.diagnosis.levers import FLIGHT, FRAME, LAW, OUTCOME, PROFILE, SLOPE, STATE
from rock2d.diagnosis.quantities import BLOCK, CONSTANT, KINDS, PLACE_M, ZONE, Curve
from rock2d.graphics.figure_style import LINESTYLES, SMALL_PT, blank_figure, finish
from rock2d.graphics.palette import BLOCK_COLOURS
from rock2d.records.columns import X, Y

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from rock2d.diagnosis.diagnose import Diagnosis
    from rock2d.diagnosis.learnt import Change

Array = np.ndarray

# lever -> its components: name, unit, and a typical size, because angles and lengths differ by orders of magnitude
COMPONENTS = {
    LAW: (
        ("k_l", "factor", 1.0), ("k_ul / k_l", "factor", 1.0), ("k_t", "factor", 1.0), ("tan φ", "factor", 1.0),
        ("k_r", "factor", 1.0),
    ),
    STATE: (
        ("x", "m", 0.001), ("y", "m", 0.001), ("θ", "rad", 0.05), ("v_x", "m/s", 0.1), ("v_y", "m/s", 0.1),
        ("ω", "rad/s", 5.0),
    ),
    OUTCOME: (  # a table of impacts has only the last three
        ("tangential", "m", 0.001), ("normal", "m", 0.001), ("θ", "rad", 0.05), ("tangential", "m/s", 0.1),
        ("normal", "m/s", 0.1), ("ω", "rad/s", 5.0),
    ),
    SLOPE: (("slope of the ground", "rad", 1.0),),
    PROFILE: (("height of the ground above the stated one", "m", 1.0),),
    FRAME: (("v_x", "m/s", 0.1), ("v_y", "m/s", 0.1), ("ω", "rad/s", 5.0), ("θ", "rad", 0.05)),
    FLIGHT: (("along x", "m/s²", 1.0), ("along y", "m/s²", 1.0), ("angular", "rad/s²", 100.0)),
}  # fmt: skip
LEVER_WORDS = {
    LAW: "parameters of the law", STATE: "measured state before the impact", OUTCOME: "outcome of the impact",
    FLIGHT: "acceleration in flight", SLOPE: "slope of the ground", PROFILE: "profile of the ground",
    FRAME: "motion of the camera or the ground",
}  # fmt: skip
UNITS = {"m": "m", "rad": "rad", "m_s": "m/s", "rad_s": "rad/s", "m2_s2": "m²/s²", "m_s2": "m/s²", "s": "s"}
POINTS = 200  # points of a curve
LEAST_SWING = 0.2  # share of the largest change, in typical sizes; components that change less are left out
MOST_DRAWN = 3  # drawn components of a lever
WIDE_IN, HIGH_IN = 4.6, 2.6


def described(change: Change) -> str:
    """A change in words."""
    depends = (
        "the same everywhere" if change.basis.name == CONSTANT else f"depending on the {change.basis.name}"
    )
    return f"{LEVER_WORDS[change.lever]}, {depends}"


def learnt_figure(result: Diagnosis, change: Change) -> Figure:
    """One panel for each quantity that the change depends on."""
    panels = max(len(change.basis.curves), 1)
    figure = blank_figure(WIDE_IN * min(panels, 2), HIGH_IN * -(-panels // 2))
    axes = figure.subplots(-(-panels // 2), min(panels, 2), squeeze=False).ravel()
    first = 0
    for axis, curve in zip(axes, change.basis.curves, strict=False):
        width = curve.features(np.array([0.0, 1.0])).shape[1]
        _draw_curves(axis, result, change.lever, curve, change.coefficients[:, first : first + width])
        first += width
    finish(figure)
    return figure


def _draw_curves(axis: Axes, result: Diagnosis, lever: str, curve: Curve, coefficients: Array) -> None:
    """Draw the components of a lever that change most, over one quantity."""
    at = _points(curve)
    values = curve.features(at) @ coefficients.T
    numbers = COMPONENTS[lever][-len(coefficients) :]
    values = np.exp(values - values.mean(axis=0)) if lever == LAW else values
    swing = np.ptp(values, axis=0) / [typical for _, _, typical in numbers]
    drawn = [k for k in np.argsort(-swing)[:MOST_DRAWN] if swing[k] >= LEAST_SWING * swing.max()]
    for i, k in enumerate(drawn):
        name, unit, _ = numbers[k]
        style: dict[str, Any] = {"color": BLOCK_COLOURS[i % len(BLOCK_COLOURS)], "label": f"{name} ({unit})"}
        if curve.kind == KINDS:
            axis.plot(np.arange(len(at)), values[:, k], linestyle="none", marker="os^"[i], **style)
        else:
            axis.plot(at, values[:, k], linestyle=LINESTYLES[i], **style)
    if curve.kind == KINDS:
        axis.set_xticks(np.arange(len(at)), _kind_labels(result, curve))
    elif curve.quantity == PLACE_M:
        points = result.experiment.cross_section.points_m
        ground = axis.twinx()
        ground.plot(points[:, X], points[:, Y], color="#bbbbbb", linewidth=1.0, zorder=0)
        ground.set_yticks([])
        axis.set_xlim(at[0], at[-1])
    axis.axhline(1.0 if lever == LAW else 0.0, color="#999999", linewidth=0.8)
    axis.set_xlabel(_with_unit(curve.quantity))
    axis.legend(fontsize=SMALL_PT, frameon=False)


def _with_unit(quantity: str) -> str:
    """A quantity with its unit in brackets."""
    for end in sorted(UNITS, key=len, reverse=True):
        if quantity.endswith(f"_{end}"):
            return f"{quantity[: -len(end) - 1].replace('_', ' ')} ({UNITS[end]})"
    return quantity


def _points(curve: Curve) -> Array:
    """Values of a quantity at which its curve is drawn."""
    if curve.kind == KINDS:
        return np.array(curve.numbers)
    if curve.kind == "spline":
        return np.linspace(curve.numbers[0], curve.numbers[-1], POINTS)
    if curve.kind == "line":
        return np.linspace(-2.0, 2.0, POINTS) * curve.numbers[0]
    if curve.kind == "waves":
        return np.linspace(0.0, 2.0 * np.pi / curve.numbers[0], POINTS)
    return np.linspace(-np.pi, np.pi, POINTS)


def _kind_labels(result: Diagnosis, curve: Curve) -> list[str]:
    """Labels of blocks, zones or other kinds."""
    if curve.quantity == BLOCK:
        names = list(result.experiment.blocks)
        return [names[int(k)] for k in curve.numbers]
    if curve.quantity == ZONE:
        zones = result.experiment.cross_section.zone_names
        return [zones[int(k)] for k in curve.numbers]
    return [f"{k:g}" for k in curve.numbers]
