"""Figures of a diagnosis: the cross-section with the residuals of all impacts, and single impacts; and their
descriptions for readers who cannot see them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import zip_longest
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from rock2d.graphics.canvas import motion_limits
from rock2d.graphics.figure_style import SMALL_PT, TEXT_PT, blank_figure, finish, handle
from rock2d.graphics.overlays import draw_ground, draw_outline
from rock2d.graphics.palette import BLOCK_COLOURS, INK, MEASURED_COLOUR, SIMULATED_COLOUR, mixed
from rock2d.graphics.trajectories import draw_cross_section
from rock2d.scene.blocks import Block
from rock2d.scene.cross_section import CrossSection
from rock2d.wording import length, spoken

Array = np.ndarray

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


@dataclass
class Misses:
    """Place of each impact, and size of its residuals.

    Attributes
    ----------
    place_m : (n, 2) centroid at the touch
    block : (n,) index of the block
    sigma : (n,) root mean square of the residuals in standard deviations
    """

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
    figure = blank_figure(wide_in, high_in + 0.95)
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
    _section_legend(figure, blocks)
    axis.set(xlabel=f"x ({unit})", ylabel=f"y ({unit})")
    finish(figure)
    return figure


def section_alt(misses: Misses, flights: int, shares: Mapping[str, float]) -> str:
    """The cross-section in words: how many impacts have which residuals, and the zones with the largest shares of the
    gap."""
    bounds = [*(least for least, _, _ in MISS_CLASSES), np.inf]
    counts = np.histogram(misses.sigma, bounds)[0]
    words = [
        f"{n} from {low:g} to {high:g} σ" for n, low, high in zip(counts, bounds, bounds[1:], strict=False)
    ]
    words[-1] = f"{counts[-1]} above {bounds[-2]:g} σ"
    drawn = f"{flights} measured flights and " if flights else ""
    said = f"The cross-section with {drawn}{len(misses.sigma)} impacts. Residuals of the base law: {', '.join(words)}."
    largest = sorted(shares.items(), key=lambda item: -item[1])[:3]
    parts = [f"{spoken(zone)} {100 * share:.0f} %" for zone, share in largest if share >= 0.005]
    return f"{said} Shares of the gap: {', '.join(parts)}." if parts else said


def _section_legend(figure: Figure, blocks: Mapping[str, Block]) -> None:
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
    pairs = [own or blank for pair in zip_longest(sizes, shapes) for own in pair]  # filled column by column
    wide = max(len(sizes), len(shapes))
    handles = pairs if shapes else sizes
    figure.legend(handles=handles, loc="outside lower center", ncols=wide, frameon=False, fontsize=SMALL_PT)


@dataclass
class Segment:
    """One impact: the measured frames around it and the predictions of the models from the same state.

    Attributes
    ----------
    title : two short lines
    measured : (k, 4) t_s, x_m, y_m, theta_rad of the frames
    models : model -> (m, 4) prediction
    """

    title: str
    block: Block
    measured: Array
    models: dict[str, Array]

    def rows(self, labels: Mapping[str, str]) -> list[tuple[Any, ...]]:
        """(name of the film or of the model, t_s, x_m, y_m, theta_rad), one row for each frame and each prediction."""
        series = {"measured": self.measured, **self.models}
        return [(labels[name], *row) for name, own in series.items() for row in own]


def segment_figure(cross_section: CrossSection, segment: Segment) -> Figure:
    """The path x-y with the block at its end, above the angle over time."""
    figure = blank_figure(3.35, 3.9)
    way, angle = figure.subplots(2, 1, height_ratios=(1.55, 1.0))
    every = np.vstack([segment.measured, *segment.models.values()])
    small = max(np.ptp(every[:, 1]), np.ptp(every[:, 2])) < 1.0
    factor, unit = (1e3, "mm") if small else (1.0, "m")
    radius = segment.block.radius_m
    low, high = every[:, 1:3].min(axis=0) - 1.3 * radius, every[:, 1:3].max(axis=0) + 1.3 * radius
    draw_ground(way, cross_section, factor, (high - low).max())
    start = segment.measured[0, 0]
    instants = segment.measured[:, 0] - start
    clock, tick = (1e3, "ms") if instants[-1] < 2.0 else (1.0, "s")
    # base last: its dashes show both lines where they agree
    for name, rows in reversed(segment.models.items()):
        colour, line = MODEL_STYLES[name]
        style = {"color": colour, "ls": line, "lw": 1.6, "zorder": 3}
        way.plot(*(rows[:, 1:3] * factor).T, **style)
        angle.plot((rows[:, 0] - start) * clock, np.rad2deg(rows[:, 3]), **style)
        _outline(way, segment.block, rows[-1, 1:], factor, colour, line)
    dots = {"color": MEASURED_COLOUR, "ms": 3.0, "mew": 0, "zorder": 2.5}
    way.plot(*(segment.measured[:, 1:3] * factor).T, ".", **dots)
    angle.plot(instants * clock, np.rad2deg(segment.measured[:, 3]), ".", **dots)
    _outline(way, segment.block, segment.measured[0, 1:], factor, MEASURED_COLOUR, "-", fill=0.08)
    _outline(way, segment.block, segment.measured[-1, 1:], factor, MEASURED_COLOUR, "-", fill=0.2)
    middle, half = 0.5 * (low + high), 0.5 * max(high[0] - low[0], (high[1] - low[1]) * 1.25)
    way.set(aspect="equal", xlim=(middle[0] - half) * factor + np.array([0, 2 * half * factor]),
            ylim=(middle[1] - half / 1.25) * factor + np.array([0, 1.6 * half * factor]))  # fmt: skip
    way.set_title(segment.title, fontsize=TEXT_PT, loc="left")
    way.set_xlabel(f"x ({unit})", labelpad=1)
    way.set_ylabel(f"y ({unit})")
    angle.set_xlabel(f"time ({tick})", labelpad=1)
    angle.set_ylabel("angle (°)")
    angle.grid(color="#e4e4e4", lw=0.6)
    finish(figure)
    return figure


def segment_alt(segment: Segment, labels: Mapping[str, str]) -> str:
    """One impact in words: how far each model is from the film at the last measured frame."""
    seen = segment.measured[np.isfinite(segment.measured).all(axis=1)]
    t_s, *pose = seen[-1]
    parts = []
    for name, rows in segment.models.items():
        x, y, theta = (float(np.interp(t_s, rows[:, 0], rows[:, i])) for i in (1, 2, 3))
        away, turn = float(np.hypot(x - pose[0], y - pose[1])), abs(float(np.rad2deg(theta - pose[2])))
        parts.append(f"{labels[name]} {length(away)} and {turn:.1f}°")
    return (
        f"{segment.title.replace(chr(10), ', ')}. Path and angle of {len(seen)} measured frames and of the "
        f"predictions; distance from the film at the last frame: {', '.join(parts)}."
    )


def _outline(
    axis: Any, block: Block, pose: Array, factor: float, colour: str, line: Any, fill: float = 0.0
) -> None:
    """The outline of a block with a spoke, so that a round block shows its angle."""
    edge = draw_outline(axis, block, pose, factor, colour, line, fill)
    axis.plot([pose[0] * factor, edge[0, 0]], [pose[1] * factor, edge[0, 1]], color=colour, lw=0.8, zorder=2)
