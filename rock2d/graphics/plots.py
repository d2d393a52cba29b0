"""Figures: trajectories on the cross-section, measured against simulated, residuals, energies.

Every function returns a matplotlib Figure outside any global state; `save_figure` writes it.
"""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, cast

import numpy as np
import pandas as pd
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from rock2d.errors import InputError
from rock2d.graphics import drawing
from rock2d.graphics.drawing import View
from rock2d.graphics.palette import (
    INK,
    LEADER_INK,
    LINE_INK,
    MEASURED_COLOUR,
    SIMULATED_COLOUR,
    SKY,
    block_colours,
    mixed,
)
from rock2d.records.track import OMEGA, VX, VY, T, Track, Y
from rock2d.scene.blocks import Block
from rock2d.scene.cross_section import CrossSection

Array = np.ndarray

LINESTYLES: tuple[Any, ...] = ("-", (0, (5, 1.6)), (0, (1.5, 1.2)), (0, (6, 1.4, 1.5, 1.4)))
STOP_MARKERS = {"rest": ("o", "came to rest"), "exit": (">", "left the section"), "time": ("s", "time limit")}
_TEXT_PT, _SMALL_PT = 9.0, 7.5


def save_figure(figure: Figure, path: str | Path, dpi: int = 200) -> Path:
    """Write `figure` (format by suffix) beside `path` and rename it when whole.

    Raises InputError if the suffix is not a picture format.
    """
    path = Path(path)
    kind = path.suffix.lower().lstrip(".")
    known = figure.canvas.get_supported_filetypes()
    if kind not in known:
        raise InputError(f"{path}: expected a figure as {', '.join(sorted(known))}, found {path.suffix!r}")
    path.parent.mkdir(parents=True, exist_ok=True)
    part = path.with_name(f".{path.stem}.{os.getpid()}.part{path.suffix}")
    try:
        figure.savefig(part, dpi=dpi, format=kind)
        os.replace(part, path)
    finally:
        part.unlink(missing_ok=True)
    return path


def trajectories_figure(
    cross_section: CrossSection, blocks: Mapping[str, Block], tracks: Sequence[Track], title: str = ""
) -> Figure:
    """The cross-section with zones and measure lines, and the way of every release; a panel a block.

    Raises InputError if there are no tracks.
    """
    names = [n for n in blocks if any(t.block == n for t in tracks)]
    if not names:
        raise InputError("a figure of trajectories needs at least one track of a known block")
    ways = {n: [positions_of(t) for t in tracks if t.block == n] for n in names}
    every = np.vstack([w for ws in ways.values() for w in ws])
    radius = max(blocks[n].radius_m for n in names)
    limits = drawing.motion_limits(cross_section, every[:, 0], every[:, 1], radius)

    wide_in, axis_in, page_in = 7.5, 6.85, 9.6
    high_in = axis_in * (limits[3] - limits[2]) / (limits[1] - limits[0]) * 1.1 + 0.45
    high_in = float(np.clip(high_in, 1.6, min(4.2, page_in / len(names))))
    figure = blank_figure(wide_in, len(names) * (high_in + 0.32) + 0.65 + (0.3 if title else 0.0))
    axes = figure.subplots(len(names), 1, squeeze=False, sharex=True)[:, 0]
    view = drawing.fitted_view(limits, 1500, round(1500 * high_in / axis_in))
    colours = block_colours(blocks)
    stops: set[str] = set()
    for i, (name, axis) in enumerate(zip(names, axes, strict=True)):
        draw_cross_section(axis, cross_section, view, np.vstack(ways[name]), axis_in)
        own = [t for t in tracks if t.block == name]
        alpha = float(np.clip(6.0 / len(own), 0.35, 1.0))
        for track, way in zip(own, ways[name], strict=True):
            axis.plot(way[:, 0], way[:, 1], color=colours[name], lw=0.9, alpha=alpha, zorder=3)
            stops.add(track.stop)
            axis.plot(
                *way[-1], marker=STOP_MARKERS[track.stop][0], ms=4, mfc=colours[name], mec="white", mew=0.5,
                ls="none", zorder=4, clip_on=False,
            )  # fmt: skip
        plural = "release" if len(own) == 1 else "releases"
        axis.set_title(f"{name.replace('_', ' ')}, {len(own)} {plural}", loc="left", fontsize=_TEXT_PT)
        axis.set_ylabel(f"y ({_length_unit(limits)[0]})")
        if i == len(names) - 1:
            axis.set_xlabel(f"x ({_length_unit(limits)[0]})")
    handles = [
        handle(STOP_MARKERS[s][1], marker=STOP_MARKERS[s][0], ls="none", ms=4.5, mfc="#777777", mec="white")
        for s in STOP_MARKERS
        if s in stops
    ]
    figure.legend(handles=handles, loc="outside lower right", ncols=3, frameon=False, fontsize=_SMALL_PT)
    finish(figure, title)
    return figure


def overlay_figure(
    cross_section: CrossSection,
    blocks: Mapping[str, Block],
    measured: pd.DataFrame,
    simulated: Sequence[Track],
    *,
    releases: Sequence[int] | None = None,
    title: str = "",
) -> Figure:
    """Measured (dots) against simulated (lines), a column a release: the way with the block's outline at the
    start and the end, then height and orientation against time.

    `measured` has columns release, block, t_s, x_m, y_m, theta_rad, on the tracks' clock. Without `releases`
    (numbers, at most six are shown) those with the least, the median, the 90 % and the largest rms
    distance are taken. Raises InputError if nothing measured has a track.
    """
    pairs = _pairs(measured, simulated)
    shown, notes = _chosen(pairs, releases)
    columns = len(shown)
    points = [(p[0][["x_m", "y_m"]].to_numpy(float), positions_of(p[1], p[0]["t_s"].max())) for p in shown]
    unit, factor = ("mm", 1e3) if max(np.ptp(a, axis=0).max() for a, _ in points) < 1.0 else ("m", 1.0)
    frames = []
    for both, (_, track) in zip(points, shown, strict=True):
        every, radius = np.vstack(both), blocks[track.block].radius_m
        floor = min(every[:, 1].min(), *_heights_at(cross_section, every))
        frames.append((every[:, 0].min() - 1.3 * radius, every[:, 0].max() + 1.3 * radius,
                       floor - 0.9 * radius, every[:, 1].max() + 1.4 * radius))  # fmt: skip
    wide = max(f[1] - f[0] for f in frames)
    high = max(max(f[3] - f[2] for f in frames), 0.45 * wide)
    wide = max(wide, high / 1.6)
    top_in = 1.95 * high / wide
    figure = blank_figure(max(4.6, 2.45 * columns), top_in + 2 * 1.6 + (2.0 if title else 1.7))
    axes = figure.subplots(3, columns, squeeze=False, height_ratios=(top_in, 1.6, 1.6))
    for column, ((rows, track), (dots, way), frame, note) in enumerate(
        zip(shown, points, frames, notes, strict=True)
    ):
        block = blocks[track.block]
        top, height, angle = axes[:, column]
        ground = cross_section.points_m * factor
        deep = ground[:, 1].min() - 10 * high * factor
        top.fill_between(ground[:, 0], ground[:, 1], deep, color="#e6dfd0", lw=0)
        top.plot(*ground.T, color=INK, lw=1.2)
        top.plot(*(way * factor).T, color=SIMULATED_COLOUR, lw=1.3, zorder=3)
        top.plot(*(dots * factor).T, ".", color=MEASURED_COLOUR, ms=2.4, mew=0, zorder=4)
        first, last = (rows[["x_m", "y_m", "theta_rad"]].iloc[i].to_numpy(float) for i in (0, -1))
        final = track.states(np.array([rows["t_s"].iloc[-1]]))[0, :3]
        _outline(top, block, first, factor, MEASURED_COLOUR, "-", 0.10)
        _outline(top, block, final, factor, SIMULATED_COLOUR, "-", 0.25)
        _outline(top, block, last, factor, MEASURED_COLOUR, (0, (3, 1.5)), 0.0)
        top.set_aspect("equal")
        left = 0.5 * (frame[0] + frame[1] - wide)
        top.set_xlim(left * factor, (left + wide) * factor)
        top.set_ylim(frame[2] * factor, (frame[2] + high) * factor)
        top.set_title(note, fontsize=_SMALL_PT + 0.5)
        top.set_xlabel(f"x ({unit})", labelpad=1)

        t = rows["t_s"].to_numpy(float)
        fine = np.linspace(t[0], t[-1], 1200)
        states = track.states(fine)
        for axis, values, line in (
            (height, rows["y_m"] * factor, states[:, 1] * factor),
            (angle, rows["theta_rad"], states[:, 2]),
        ):
            axis.plot(fine, line, color=SIMULATED_COLOUR, lw=1.3, zorder=3)
            axis.plot(t, values, ".", color=MEASURED_COLOUR, ms=2.4, mew=0, zorder=4)
            axis.grid(color="#e4e4e4", lw=0.6)
            axis.set_xlim(t[0], t[-1])
        height.tick_params(labelbottom=False)
        angle.set_xlabel("time (s)")
        for axis, label in ((top, f"y ({unit})"), (height, f"y ({unit})"), (angle, "orientation (rad)")):
            if column == 0:
                axis.set_ylabel(label)
    handles = [
        handle("measured", marker=".", ls="none", color=MEASURED_COLOUR, ms=7),
        handle("simulated", color=SIMULATED_COLOUR, lw=1.5),
        handle("start", color=MEASURED_COLOUR, marker="s", mfc="#e8e8e8", ms=7, ls="none"),
        handle("measured end", color=MEASURED_COLOUR, ls=(0, (3, 1.5)), lw=1.1),
        handle("simulated end", color=SIMULATED_COLOUR, marker="s", ms=7, ls="none",
                mfc=mixed(SIMULATED_COLOUR, "#ffffff", 0.7)),
    ]  # fmt: skip
    figure.legend(
        handles=handles,
        loc="outside lower center",
        ncols=5 if columns > 2 else 3,
        frameon=False,
        fontsize=_SMALL_PT + 0.5,
    )
    finish(figure, title)
    return figure


def residuals_figure(residuals: pd.DataFrame, title: str = "") -> Figure:
    """Simulated minus measured, a column a channel: median and 10-90 % band against the time since the start
    of each release, and the distribution at the end of each release.

    `residuals` has columns release, block, t_s, dx_m, dy_m, dtheta_rad. Raises InputError if it is empty.
    """
    channels = ["dx_m", "dy_m", "dtheta_rad"]
    rows = residuals.dropna(subset=[*channels, "t_s"])
    if rows.empty:
        raise InputError("no residuals to draw: nothing measured has a simulated counterpart")
    group = rows.groupby(["block", "release"], sort=False)["t_s"]
    step = float(np.median(group.diff().dropna())) if (group.size() > 1).any() else 1e-3
    since = rows["t_s"] - group.transform("min")
    rows = rows.assign(since_s=(since / step).round() * step)
    millimetres = float(rows[["dx_m", "dy_m"]].abs().quantile(0.9).max()) < 0.5
    factors = {"dx_m": 1e3, "dy_m": 1e3, "dtheta_rad": 1.0} if millimetres else dict.fromkeys(channels, 1.0)
    unit = "mm" if millimetres else "m"
    labels = {"dx_m": f"x ({unit})", "dy_m": f"y ({unit})", "dtheta_rad": "orientation (rad)"}

    figure = blank_figure(8.4, 5.2)
    axes = figure.subplots(2, 3)
    names = list(dict.fromkeys(rows["block"]))
    colours = block_colours(names)
    for column, channel in enumerate(channels):
        over, end = axes[:, column]
        finals = {}
        for i, name in enumerate(names):
            own = rows[rows["block"] == name]
            values = own[channel] * factors[channel]
            finals[name] = values.groupby(own["release"]).last().to_numpy(float)
            quantiles = values.groupby(own["since_s"]).quantile([0.1, 0.5, 0.9]).unstack()
            count = values.groupby(own["since_s"]).size()
            quantiles = quantiles[count >= min(5, count.max())]  # no band of a few long releases
            t, colour = quantiles.index.to_numpy(float), colours[name]
            over.fill_between(t, quantiles[0.1], quantiles[0.9], color=colour, alpha=0.22, lw=0)
            style = LINESTYLES[i % len(LINESTYLES)]
            over.plot(t, quantiles[0.5], color=colour, ls=style, lw=1.5, label=name.replace("_", " "))
            over.set_xlim(0, max(t.max(), over.get_xlim()[1] if i else 0.0))
        over.axhline(0, color="#555555", lw=0.7)
        over.grid(color="#e4e4e4", lw=0.6)
        over.set_title("Δ " + labels[channel], fontsize=_TEXT_PT)
        over.set_xlabel("time since the start (s)")
        _histogram(end, finals, colours)
        end.set_xlabel(f"Δ {labels[channel]} at the end")
    axes[0, 0].set_ylabel("simulated − measured")
    axes[1, 0].set_ylabel("releases")
    grey = colours[names[0]] if len(names) == 1 else "#777777"
    handles = [
        handle(n.replace("_", " "), color=colours[n], ls=LINESTYLES[i % len(LINESTYLES)], lw=1.6)
        for i, n in enumerate(names)
        if len(names) > 1
    ]
    handles += [handle("median", color=grey, lw=1.5)] if len(names) == 1 else []
    handles.append(handle("10-90 % of releases", color=grey, alpha=0.3, lw=7))
    figure.legend(
        handles=handles, loc="outside lower center", ncols=5, frameon=False, fontsize=_SMALL_PT + 0.5
    )
    finish(figure, title)
    return figure


def energy_figure(track: Track, block: Block, title: str = "") -> Figure:
    """Energies in J: translation, rotation, potential (zero at the lowest position) and their sum."""
    t = np.union1d(np.linspace(track.knots[0, T], track.end_s, 1500), track.knots[:, T])
    state = np.column_stack([t, track.states(t)])
    moving = 0.5 * block.mass_kg * (state[:, VX] ** 2 + state[:, VY] ** 2)
    spinning = 0.5 * block.inertia_kg_m2 * state[:, OMEGA] ** 2
    height = block.mass_kg * track.gravity_m_s2 * (state[:, Y] - state[:, Y].min())
    figure = blank_figure(6.0, 3.4)
    axis = figure.subplots()
    colours = block_colours(["translation", "rotation", "potential"])
    for (name, values), style in zip(
        {"translation": moving, "rotation": spinning, "potential": height}.items(), LINESTYLES, strict=False
    ):
        axis.plot(t, values, color=colours[name], ls=style, lw=1.4, label=name)
    axis.plot(t, moving + spinning + height, color=INK, lw=1.8, label="sum")
    axis.set_xlim(t[0], t[-1])
    axis.set_ylim(0)
    axis.grid(color="#e4e4e4", lw=0.6)
    axis.set_xlabel("time (s)")
    axis.set_ylabel("energy (J)")
    axis.legend(frameon=False, fontsize=_SMALL_PT + 0.5, ncols=4, loc="lower left", bbox_to_anchor=(0, 1))
    finish(figure, title)
    return figure


# --- parts --------------------------------------------------------------------------------------------


def blank_figure(wide_in: float, high_in: float) -> Figure:
    """An empty figure of this size in inches, outside any global state."""
    figure = Figure(figsize=(wide_in, high_in), layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def finish(figure: Figure, title: str = "") -> None:
    """The common look: title, sizes of the labels, no frame at the top and on the right."""
    if title:
        figure.suptitle(title, fontsize=_TEXT_PT + 2, fontweight="bold")
    for axis in figure.axes:
        axis.tick_params(labelsize=_SMALL_PT, length=3)
        axis.xaxis.label.set_fontsize(_TEXT_PT)
        axis.yaxis.label.set_fontsize(_TEXT_PT)
        for side in ("top", "right"):
            axis.spines[side].set_visible(False)


def handle(label: str, **style: Any) -> Any:
    """An entry of a legend."""
    from matplotlib.lines import Line2D

    return Line2D([], [], label=label, **style)


def positions_of(track: Track, until_s: float | None = None) -> Array:
    """Positions (n, 2) along a track, fine enough for print."""
    end = track.end_s if until_s is None else max(float(until_s), float(track.knots[0, T]))
    t = np.union1d(np.linspace(track.knots[0, T], end, 600), track.knots[track.knots[:, T] <= end, T])
    return track.states(t)[:, :2]


def _length_unit(limits: drawing.Limits) -> tuple[str, float]:
    return ("cm", 1e2) if limits[1] - limits[0] < 2.0 else ("m", 1.0)


def draw_cross_section(
    axis: Any, cross_section: CrossSection, view: View, ways: Array, axis_in: float
) -> None:
    """The ground with zones and measure lines, their names off the points `ways` (n, 2), on an axis `axis_in` wide."""
    from matplotlib.patheffects import withStroke
    from matplotlib.ticker import FuncFormatter, MaxNLocator

    limits, (_, factor) = view.limits_m, _length_unit(view.limits_m)
    image = drawing.ground_image(cross_section, view, 42, surface_px=0)[..., ::-1]
    axis.imshow(image, extent=limits, aspect="equal", zorder=0)
    axis.plot(*cross_section.points_m.T, color=INK, lw=1.3, zorder=2, solid_joinstyle="round")
    for line in cross_section.measure_lines.values():
        axis.plot(*line.T, color=LINE_INK, lw=1.1, ls=(0, (3, 2)), zorder=2.5)
    axis.set(xlim=limits[:2], ylim=limits[2:], aspect="equal")
    for side, count in ((axis.xaxis, 9), (axis.yaxis, 5)):
        side.set_major_locator(MaxNLocator(count, steps=[1, 2, 5, 10]))
        side.set_major_formatter(FuncFormatter(lambda value, _: f"{round(value * factor, 6) + 0.0:g}"))

    size_px = round(_SMALL_PT / 72 * view.width_px / axis_in)
    for name in drawing.placed_names(cross_section, view, size_px, view.pixels(ways)):
        left, top, _, bottom = name.box
        x = view.left_m + (left + 0.5) / view.px_per_m
        y = view.top_m - (0.5 * (top + bottom) + 0.5) / view.px_per_m
        if name.leader_px is not None:
            leader = (name.leader_px + 0.5) / view.px_per_m
            axis.plot(
                view.left_m + leader[:, 0], view.top_m - leader[:, 1], color=LEADER_INK, lw=0.6, zorder=2
            )
        text = axis.text(x, y, name.text, size=_SMALL_PT, color=name.colour, va="center", zorder=5)
        text.set_in_layout(False)
        if name.colour == LINE_INK:
            text.set_path_effects([withStroke(linewidth=2.5, foreground=SKY)])


def _pairs(measured: pd.DataFrame, simulated: Sequence[Track]) -> list[tuple[pd.DataFrame, Track]]:
    tracks = {(t.block, t.release): t for t in simulated}
    rows = measured.dropna(subset=["t_s", "x_m", "y_m", "theta_rad"])
    pairs = []
    for key, own in rows.groupby(["block", "release"], sort=False):
        block, release = cast(tuple[str, int], key)
        track = tracks.get((block, int(release)))
        if track is not None and len(own) > 1:
            pairs.append((own.sort_values("t_s"), track))
    if not pairs:
        raise InputError("no measured release has a simulated track: nothing to lay over each other")
    return pairs


def _chosen(
    pairs: list[tuple[pd.DataFrame, Track]], releases: Sequence[int] | None
) -> tuple[list[tuple[pd.DataFrame, Track]], list[str]]:
    """The pairs shown and a note for each."""
    rms = np.empty(len(pairs))
    for i, (rows, track) in enumerate(pairs):
        apart = track.states(rows["t_s"].to_numpy(float))[:, :2] - rows[["x_m", "y_m"]].to_numpy(float)
        rms[i] = np.sqrt((apart**2).sum(axis=1).mean())
    order = np.argsort(rms, kind="stable")
    if releases is not None:
        picks = {i: "" for r in releases for i, p in enumerate(pairs) if p[1].release == r}
        if not picks:
            raise InputError(
                f"none of the releases {', '.join(map(str, releases))} is measured and simulated"
            )
    else:
        ranks = {0.0: "closest", 1.0: "farthest", 0.5: "median", 0.9: "90th percentile"}
        picks = {}
        for rank, word in ranks.items():
            picks.setdefault(int(order[round(rank * (len(pairs) - 1))]), word)
        picks = {i: picks[i] for i in sorted(picks, key=lambda i: rms[i])}
    several = len({p[1].block for p in pairs}) > 1
    notes = []
    for i, word in list(picks.items())[:6]:
        track = pairs[i][1]
        name = f"{track.block} {track.release}" if several else f"release {track.release}"
        size = f"{1e3 * rms[i]:.1f} mm" if rms[i] < 1 else f"{rms[i]:.2f} m"
        notes.append(f"{name}{f', {word}' if word else ''}\nrms distance {size}")
    return [pairs[i] for i in list(picks)[:6]], notes


def _outline(
    axis: Any, block: Block, pose: Array, factor: float, colour: str, style: Any, alpha: float
) -> None:
    c, s = np.cos(pose[2]), np.sin(pose[2])
    edge = (block.outline(64) @ np.array([[c, s], [-s, c]]) + pose[:2]) * factor
    closed = np.vstack([edge, edge[:1]])
    if alpha:
        axis.fill(*edge.T, color=colour, alpha=alpha, lw=0, zorder=1.5)
    axis.plot(*closed.T, color=colour, ls=style, lw=1.1, zorder=2)


def _heights_at(cross_section: CrossSection, points: Array) -> Array:
    heights = cross_section.height_m(points[:, 0])
    heights = heights[np.isfinite(heights)]
    return heights if len(heights) else points[:, 1]


def _histogram(axis: Any, values: Mapping[str, Array], colours: Mapping[str, str]) -> None:
    """Counts in common bins over the middle 98 %, outlines for several blocks; says what lies beyond."""
    every = np.concatenate(list(values.values()))
    low, high = np.quantile(every, [0.01, 0.99]) if len(every) >= 50 else (every.min(), every.max())
    if high - low < 1e-12 * max(1.0, abs(high)):
        low, high = low - 0.5e-3, high + 0.5e-3
    bins = np.linspace(low, high, int(np.clip(2 * np.sqrt(len(every)), 6, 40)) + 1)
    for i, (name, own) in enumerate(values.items()):
        if len(values) == 1:
            axis.hist(own, bins, color=colours[name], alpha=0.75, edgecolor="white", lw=0.4)
        else:
            style = LINESTYLES[i % len(LINESTYLES)]
            axis.hist(own, bins, color=colours[name], histtype="step", ls=style, lw=1.4)
    axis.axvline(0, color="#555555", lw=0.7)
    beyond = int(((every < low) | (every > high)).sum())
    notes = [f"{beyond} beyond the bins"] if beyond else []
    if len(values) == 1:
        axis.axvline(np.median(every), color=INK, lw=1.1, ls=(0, (4, 2)))
        notes.insert(0, f"median {np.median(every):.3g}")
    axis.set_title(", ".join(notes), loc="right", fontsize=_SMALL_PT, pad=2)
