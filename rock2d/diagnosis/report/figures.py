"""Figures of a diagnosis: the cross-section with the residuals of all impacts, single impacts, and learnt changes as
curves; and their descriptions for readers who cannot see them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import zip_longest
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.figure import Figure

from rock2d.arrays import Array
from rock2d.diagnosis.levers import FLIGHT, FRAME, LAW, OUTCOME, PROFILE, SLOPE, STATE
from rock2d.diagnosis.quantities import CONSTANT, KINDS, LINE, PLACE_M, SPLINE, WAVES, Curve, kind_names
from rock2d.graphics.canvas import motion_limits
from rock2d.graphics.figure_style import LINESTYLES, SMALL_PT, TEXT_PT, blank_figure, finish, handle
from rock2d.graphics.overlays import draw_ground, draw_outline
from rock2d.graphics.palette import BLOCK_COLOURS, INK, MEASURED_COLOUR, SIMULATED_COLOUR, mixed
from rock2d.graphics.trajectories import draw_cross_section
from rock2d.records.columns import X, Y
from rock2d.scene.blocks import Block
from rock2d.scene.cross_section import CrossSection
from rock2d.wording import length, spoken, without_unit

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from rock2d.diagnosis.diagnose import Diagnosis
    from rock2d.diagnosis.learnt import Change

# colour and line of each model, distinguishable without colour
MODEL_STYLES: dict[str, tuple[str, Any]] = {
    "measured": (MEASURED_COLOUR, "-"),
    "base": (SIMULATED_COLOUR, (0, (5, 1.6))),
    "effect": (BLOCK_COLOURS[0], "-"),
}
# smallest residual in standard deviations, fill, area in pt²
MISS_CLASSES = ((0.0, "#f2f2f2", 9.0), (1.5, "#f5b041", 22.0), (2.5, "#8c2d04", 40.0))
MARKERS = {"circle": "o", "square": "s", "rectangle": "d", "ellipse": "h", "polygon": "^"}
OTHER_MARKER = "p"  # for all other shapes
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
POINTS = 200  # points of a curve
LEAST_SWING = 0.2  # share of the largest change, in typical sizes; components that change less are left out
MOST_DRAWN = 3  # drawn components of a lever
WIDE_IN, HIGH_IN = 4.6, 2.6


@dataclass
class Misses:
    """Place of each impact, and size of its residuals.

    Attributes
    ----------
    place_m : (n, 2) centroid at the touch
    block : (n,) index of the block
    sigma : (n,) root mean square of the residuals in standard deviations"""

    place_m: Array
    block: Array
    sigma: Array


def section_figure(
    cross_section: CrossSection,
    blocks: Mapping[str, Block],
    flights: Sequence[Array],
    misses: Misses,
    shares: Mapping[str, float],
    *,
    narrow: bool = False,
) -> Figure:
    """The cross-section with the measured flights (each (k, 2) m) and the size of the residuals of every impact. Zones
    are labelled with their share of the gap. `narrow`: for a phone, with the same size of text."""
    from matplotlib.collections import LineCollection

    ways = np.vstack([*flights, misses.place_m])
    radius = max(b.radius_m for b in blocks.values())
    limits = motion_limits(cross_section, ways[:, 0], ways[:, 1], radius)
    wide_in, axis_in, least_in = (3.7, 3.1, 1.6) if narrow else (6.6, 6.0, 2.0)
    high_in = axis_in * (limits[3] - limits[2]) / (limits[1] - limits[0]) * 1.18
    high_in = float(np.clip(high_in, least_in, 4.6))
    columns = 3 if narrow else max(3, len(blocks))
    figure = blank_figure(wide_in, high_in + 0.8 + 0.15 * -(-len(blocks) // columns))
    axis = figure.subplots()
    labels = {zone: f"{zone}  {100 * share:.0f} %" for zone, share in shares.items() if share >= 0.005}
    names = [labels.get(zone, zone) for zone in cross_section.zones]
    labelled = CrossSection(cross_section.points_m, names, cross_section.measure_lines)
    unit = draw_cross_section(axis, labelled, limits, (axis_in, high_in), ways, 1400)
    for text in axis.texts:
        if text.get_text().endswith("%"):
            text.set(weight="bold", color=INK)
    if flights:
        alpha = float(np.clip(60.0 / len(flights), 0.12, 0.5))
        style: dict[str, Any] = {"colors": "#5a6a78", "linewidths": 0.6, "zorder": 2.4, "rasterized": True}
        axis.add_collection(LineCollection(flights, alpha=alpha, **style))
    names_of = list(blocks)
    for k, (least, fill, area) in enumerate(MISS_CLASSES):
        most = MISS_CLASSES[k + 1][0] if k + 1 < len(MISS_CLASSES) else np.inf
        for b, name in enumerate(names_of):
            own = (misses.block == b) & (misses.sigma >= least) & (misses.sigma < most)
            x, y = misses.place_m[own].T
            axis.scatter(
                x, y, s=area, c=fill, marker=MARKERS.get(blocks[name].shape, OTHER_MARKER), linewidths=0.4,
                edgecolors=mixed(fill, "#000000", 0.45), zorder=3 + k,
            )  # fmt: skip
    _section_legend(figure, blocks, columns)
    axis.set(xlabel=f"x ({unit})", ylabel=f"y ({unit})")
    return finish(figure)


def section_alt(misses: Misses, flights: int, shares: Mapping[str, float]) -> str:
    """The cross-section in words: how many impacts have which residuals, and the zones with the largest shares of the
    gap."""
    bounds = [*(least for least, _, _ in MISS_CLASSES), np.inf]
    counts = np.histogram(misses.sigma, bounds)[0]
    words = [f"{n} from {low:g} to {high:g} σ" for n, low, high in zip(counts, bounds, bounds[1:], strict=False)]
    words[-1] = f"{counts[-1]} above {bounds[-2]:g} σ"
    drawn = f"{flights} measured flights and " if flights else ""
    said = f"The cross-section with {drawn}{len(misses.sigma)} impacts. Residuals of the base law: {', '.join(words)}."
    largest = sorted(shares.items(), key=lambda item: -item[1])[:3]
    parts = [f"{spoken(zone)} {100 * share:.0f} %" for zone, share in largest if share >= 0.005]
    return f"{said} Shares of the gap: {', '.join(parts)}." if parts else said


def _section_legend(figure: Figure, blocks: Mapping[str, Block], columns: int) -> None:
    low, high = (least for least, _, _ in MISS_CLASSES[1:])
    words = (f"residual < {low:g} σ", f"{low:g} to {high:g} σ", f"> {high:g} σ")
    dot = {"marker": "o", "ls": "none", "mew": 0.5}
    sizes = [
        handle(word, ms=np.sqrt(area), mfc=fill, mec=mixed(fill, "#000000", 0.45), **dot)
        for word, (_, fill, area) in zip(words, MISS_CLASSES, strict=True)
    ]
    style = {"ls": "none", "ms": 5, "mfc": "white", "mec": "#555555"}
    shapes = [
        handle(spoken(name), marker=MARKERS.get(block.shape, OTHER_MARKER), **style)
        for name, block in blocks.items()
        if len(blocks) > 1
    ]
    blank = handle("", ls="none")
    rows = [sizes, *(shapes[k : k + columns] for k in range(0, len(shapes), columns))]
    handles = [own for column in zip_longest(*rows, fillvalue=blank) for own in column]  # filled column by column
    columns = max(map(len, rows))
    figure.legend(handles=handles, loc="outside lower center", ncols=columns, frameon=False, fontsize=SMALL_PT)


@dataclass
class ShownImpact:
    """One impact: the measured frames around it and the predictions of the models from the same state.

    Attributes
    ----------
    title : two short lines
    measured : (k, 4) t_s, x_m, y_m, theta_rad of the frames
    models : model -> (m, 4) prediction"""

    title: str
    block: Block
    measured: Array
    models: dict[str, Array]

    def rows(self, labels: Mapping[str, str]) -> list[tuple[Any, ...]]:
        """(name of the film or of the model, t_s, x_m, y_m, theta_rad), one row for each frame and each prediction."""
        series = {"measured": self.measured, **self.models}
        return [(labels[name], *row) for name, own in series.items() for row in own]


def impact_figure(cross_section: CrossSection, impact: ShownImpact) -> Figure:
    """The path x-y with the block at its end, above the angle over time."""
    figure = blank_figure(3.35, 3.9)
    way, angle = figure.subplots(2, 1, height_ratios=(1.55, 1.0))
    every = np.vstack([impact.measured, *impact.models.values()])
    small = max(np.ptp(every[:, 1]), np.ptp(every[:, 2])) < 1.0
    factor, unit = (1e3, "mm") if small else (1.0, "m")
    radius = impact.block.radius_m
    low, high = every[:, 1:3].min(axis=0) - 1.3 * radius, every[:, 1:3].max(axis=0) + 1.3 * radius
    draw_ground(way, cross_section, factor, (high - low).max())
    start = impact.measured[0, 0]
    instants = impact.measured[:, 0] - start
    clock, tick = (1e3, "ms") if instants[-1] < 2.0 else (1.0, "s")
    # base last: its dashes show both lines where they agree
    for name, rows in reversed(impact.models.items()):
        colour, line = MODEL_STYLES[name]
        style = {"color": colour, "ls": line, "lw": 1.6, "zorder": 3}
        way.plot(*(rows[:, 1:3] * factor).T, **style)
        angle.plot((rows[:, 0] - start) * clock, np.rad2deg(rows[:, 3]), **style)
        _outline(way, impact.block, rows[-1, 1:], factor, colour, line)
    dots = {"color": MEASURED_COLOUR, "ms": 3.0, "mew": 0, "zorder": 2.5}
    way.plot(*(impact.measured[:, 1:3] * factor).T, ".", **dots)
    angle.plot(instants * clock, np.rad2deg(impact.measured[:, 3]), ".", **dots)
    _outline(way, impact.block, impact.measured[0, 1:], factor, MEASURED_COLOUR, "-", fill=0.08)
    _outline(way, impact.block, impact.measured[-1, 1:], factor, MEASURED_COLOUR, "-", fill=0.2)
    middle, half = 0.5 * (low + high), 0.5 * max(high[0] - low[0], (high[1] - low[1]) * 1.25)
    way.set(aspect="equal", xlim=(middle[0] - half) * factor + np.array([0, 2 * half * factor]),
            ylim=(middle[1] - half / 1.25) * factor + np.array([0, 1.6 * half * factor]))  # fmt: skip
    way.set_title(impact.title, fontsize=TEXT_PT, loc="left")
    way.set_xlabel(f"x ({unit})", labelpad=1)
    way.set_ylabel(f"y ({unit})")
    angle.set_xlabel(f"time ({tick})", labelpad=1)
    angle.set_ylabel("angle (°)")
    angle.grid(color="#e4e4e4", lw=0.6)
    return finish(figure)


def impact_alt(impact: ShownImpact, labels: Mapping[str, str]) -> str:
    """One impact in words: how far each model is from the film at the last measured frame."""
    seen = impact.measured[np.isfinite(impact.measured).all(axis=1)]
    t_s, *pose = seen[-1]
    parts = []
    for name, rows in impact.models.items():
        x, y, theta = (float(np.interp(t_s, rows[:, 0], rows[:, i])) for i in (1, 2, 3))
        away, turn = float(np.hypot(x - pose[0], y - pose[1])), abs(float(np.rad2deg(theta - pose[2])))
        parts.append(f"{labels[name]} {length(away)} and {turn:.1f}°")
    return (
        f"{impact.title.replace(chr(10), ', ')}. Path and angle of {len(seen)} measured frames and of the "
        f"predictions; distance from the film at the last frame: {', '.join(parts)}."
    )


def _outline(axis: Any, block: Block, pose: Array, factor: float, colour: str, line: Any, fill: float = 0.0) -> None:
    """The outline of a block with a spoke, so that a round block shows its angle."""
    edge = draw_outline(axis, block, pose, factor, colour, line, fill)
    axis.plot([pose[0] * factor, edge[0, 0]], [pose[1] * factor, edge[0, 1]], color=colour, lw=0.8, zorder=2)


# --- learnt changes -----------------------------------------------------------------------------------


def described(change: Change) -> str:
    """A change in words."""
    depends = "the same everywhere" if change.basis.name == CONSTANT else f"depending on the {change.basis.name}"
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
    return finish(figure)


def _draw_curves(axis: Axes, result: Diagnosis, lever: str, curve: Curve, coefficients: Array) -> None:
    """Draw the components of a lever that change most, over one quantity."""
    at = _points(curve)
    values = curve.features(at) @ coefficients.T
    components = COMPONENTS[lever][-len(coefficients) :]
    values = np.exp(values - values.mean(axis=0)) if lever == LAW else values
    swing = np.ptp(values, axis=0) / [typical for _, _, typical in components]
    drawn = [k for k in np.argsort(-swing)[:MOST_DRAWN] if swing[k] >= LEAST_SWING * swing.max()]
    for i, k in enumerate(drawn):
        name, unit, _ = components[k]
        style: dict[str, Any] = {"color": BLOCK_COLOURS[i % len(BLOCK_COLOURS)], "label": f"{name} ({unit})"}
        if curve.kind == KINDS:
            axis.plot(np.arange(len(at)), values[:, k], linestyle="none", marker="os^"[i], **style)
        else:
            axis.plot(at, values[:, k], linestyle=LINESTYLES[i], **style)
    if curve.kind == KINDS:
        names = kind_names(result.setup).get(curve.quantity)
        axis.set_xticks(np.arange(len(at)), [names[int(k)] if names else f"{k:g}" for k in curve.numbers])
    elif curve.quantity == PLACE_M:
        points = result.experiment.cross_section.points_m
        ground = axis.twinx()
        ground.plot(points[:, X], points[:, Y], color="#bbbbbb", linewidth=1.0, zorder=0)
        ground.set_yticks([])
        axis.set_xlim(at[0], at[-1])
    axis.axhline(1.0 if lever == LAW else 0.0, color="#999999", linewidth=0.8)
    name, unit = without_unit(curve.quantity)
    axis.set_xlabel(f"{spoken(name)} ({unit})" if unit else name)
    axis.legend(fontsize=SMALL_PT, frameon=False)


def _points(curve: Curve) -> Array:
    """Values of a quantity at which its curve is drawn."""
    if curve.kind == KINDS:
        return np.array(curve.numbers)
    if curve.kind == SPLINE:
        return np.linspace(curve.numbers[0], curve.numbers[-1], POINTS)
    if curve.kind == LINE:
        return np.linspace(-2.0, 2.0, POINTS) * curve.numbers[0]
    if curve.kind == WAVES:
        return np.linspace(0.0, 2.0 * np.pi / curve.numbers[0], POINTS)
    return np.linspace(-np.pi, np.pi, POINTS)
