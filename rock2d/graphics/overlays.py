"""Figures that compare measured releases with their simulation: laid over each other, and their residuals."""

from collections.abc import Mapping, Sequence
from typing import Any, cast

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from rock2d.arrays import Array
from rock2d.errors import InputError
from rock2d.graphics.figure_style import LINESTYLES, SMALL_PT, TEXT_PT, blank_figure, finish, handle
from rock2d.graphics.palette import INK, MEASURED_COLOUR, SIMULATED_COLOUR, block_colours, mixed
from rock2d.graphics.trajectories import positions_of
from rock2d.records.columns import POSE_NAMES
from rock2d.records.track import Track
from rock2d.scene.blocks import Block
from rock2d.scene.cross_section import CrossSection
from rock2d.wording import length

OUTLINE_POINTS = 64  # of a smooth block


def overlay_figure(
    cross_section: CrossSection,
    blocks: Mapping[str, Block],
    measured: pd.DataFrame,
    simulated: Sequence[Track],
    *,
    title: str = "",
) -> Figure:
    """Measured (dots) and simulated (lines), a column for each release: the path with the outline of the block at the
    start and the end, then height and orientation against time.

    `measured` has the columns release, block, t_s, x_m, y_m, theta_rad, with the time of the tracks. Shown
    are the releases with the least, the median, the 90th percentile and the largest rms distance. Raises InputError if
    no measured release has a track."""
    pairs = _pairs(measured, simulated)
    shown, notes = _selected(pairs)
    columns = len(shown)
    points = [(p[0][["x_m", "y_m"]].to_numpy(float), positions_of(p[1], p[0]["t_s"].max())) for p in shown]
    unit, factor = ("mm", 1e3) if max(np.ptp(a, axis=0).max() for a, _ in points) < 1.0 else ("m", 1.0)
    frames = []
    for both, (_, track) in zip(points, shown, strict=True):
        every, radius = np.vstack(both), blocks[track.block].radius_m
        floor = np.nanmin([every[:, 1], cross_section.height_m(every[:, 0])])
        frames.append((every[:, 0].min() - 1.3 * radius, every[:, 0].max() + 1.3 * radius,
                       floor - 0.9 * radius, every[:, 1].max() + 1.4 * radius))  # fmt: skip
    wide = max(f[1] - f[0] for f in frames)
    high = max(max(f[3] - f[2] for f in frames), 0.45 * wide)
    wide = max(wide, high / 1.6)
    top_in = 1.95 * high / wide
    figure = blank_figure(max(4.6, 2.45 * columns), top_in + 2 * 1.6 + (2.0 if title else 1.7))
    axes = figure.subplots(3, columns, squeeze=False, height_ratios=(top_in, 1.6, 1.6))
    for column, ((rows, track), (dots, way), frame, note) in enumerate(zip(shown, points, frames, notes, strict=True)):
        top, height, angle = axes[:, column]
        draw_ground(top, cross_section, factor, high)
        top.plot(*(way * factor).T, color=SIMULATED_COLOUR, lw=1.3, zorder=3)
        top.plot(*(dots * factor).T, ".", color=MEASURED_COLOUR, ms=2.4, mew=0, zorder=4)
        _draw_outlines(top, blocks[track.block], rows, track, factor)
        top.set_aspect("equal")
        left = 0.5 * (frame[0] + frame[1] - wide)
        top.set_xlim(left * factor, (left + wide) * factor)
        top.set_ylim(frame[2] * factor, (frame[2] + high) * factor)
        top.set_title(note, fontsize=SMALL_PT + 0.5)
        top.set_xlabel(f"x ({unit})", labelpad=1)
        _draw_histories(height, angle, rows, track, factor)
        for axis, label in ((top, f"y ({unit})"), (height, f"y ({unit})"), (angle, "orientation (rad)")):
            if column == 0:
                axis.set_ylabel(label)
    _draw_legend(figure, columns)
    return finish(figure, title)


def _draw_outlines(axis: Any, block: Block, rows: pd.DataFrame, track: Track, factor: float) -> None:
    """The block at the measured start and end, and where the simulation ends."""
    first, last = (rows[list(POSE_NAMES)].iloc[i].to_numpy(float) for i in (0, -1))
    final = track.states(np.array([rows["t_s"].iloc[-1]]))[0, :3]
    draw_outline(axis, block, first, factor, MEASURED_COLOUR, "-", 0.10)
    draw_outline(axis, block, final, factor, SIMULATED_COLOUR, "-", 0.25)
    draw_outline(axis, block, last, factor, MEASURED_COLOUR, (0, (3, 1.5)))


def _draw_histories(height: Any, angle: Any, rows: pd.DataFrame, track: Track, factor: float) -> None:
    """Height and orientation against time, measured and simulated."""
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


def _draw_legend(figure: Figure, columns: int) -> None:
    handles = [
        handle("measured", marker=".", ls="none", color=MEASURED_COLOUR, ms=7),
        handle("simulated", color=SIMULATED_COLOUR, lw=1.5),
        handle("start", color=MEASURED_COLOUR, marker="s", mfc="#e8e8e8", ms=7, ls="none"),
        handle("measured end", color=MEASURED_COLOUR, ls=(0, (3, 1.5)), lw=1.1),
        handle("simulated end", color=SIMULATED_COLOUR, marker="s", ms=7, ls="none",
                mfc=mixed(SIMULATED_COLOUR, "#ffffff", 0.7)),
    ]  # fmt: skip
    ncols = 5 if columns > 2 else 3
    figure.legend(handles=handles, loc="outside lower center", ncols=ncols, frameon=False, fontsize=SMALL_PT + 0.5)


def _pairs(measured: pd.DataFrame, simulated: Sequence[Track]) -> list[tuple[pd.DataFrame, Track]]:
    tracks = {(t.block, t.release): t for t in simulated}
    rows = measured.dropna(subset=["t_s", *POSE_NAMES])
    pairs = []
    for key, own in rows.groupby(["block", "release"], sort=False):
        block, release = cast(tuple[str, int], key)
        track = tracks.get((block, int(release)))
        if track is not None and len(own) > 1:
            pairs.append((own.sort_values("t_s"), track))
    if not pairs:
        raise InputError("no measured release has a simulated track: nothing to lay over each other")
    return pairs


def _selected(pairs: list[tuple[pd.DataFrame, Track]]) -> tuple[list[tuple[pd.DataFrame, Track]], list[str]]:
    """The pairs to show and a note for each."""
    rms = np.empty(len(pairs))
    for i, (rows, track) in enumerate(pairs):
        apart = track.states(rows["t_s"].to_numpy(float))[:, :2] - rows[["x_m", "y_m"]].to_numpy(float)
        rms[i] = np.sqrt((apart**2).sum(axis=1).mean())
    order = np.argsort(rms, kind="stable")
    ranks = {0.0: "closest", 1.0: "farthest", 0.5: "median", 0.9: "90th percentile"}
    picks: dict[int, str] = {}
    for rank, word in ranks.items():
        picks.setdefault(int(order[round(rank * (len(pairs) - 1))]), word)
    shown = sorted(picks, key=lambda i: rms[i])
    several = len({p[1].block for p in pairs}) > 1
    notes = []
    for i in shown:
        track = pairs[i][1]
        name = f"{track.block} {track.release}" if several else f"release {track.release}"
        notes.append(f"{name}, {picks[i]}\nrms distance {length(rms[i])}")
    return [pairs[i] for i in shown], notes


def draw_ground(axis: Any, cross_section: CrossSection, factor: float, high_m: float) -> None:
    """Fill the ground far below a view that is `high_m` high, and draw its surface; in m times `factor`."""
    ground = cross_section.points_m * factor
    deep = ground[:, 1].min() - 10 * high_m * factor
    axis.fill_between(ground[:, 0], ground[:, 1], deep, color="#e6dfd0", lw=0)
    axis.plot(*ground.T, color=INK, lw=1.2)


def draw_outline(
    axis: Any, block: Block, pose: Array, factor: float, colour: str, style: Any, alpha: float = 0.0
) -> Array:
    """Draw the outline of a block at a pose (x_m, y_m, theta_rad), in m times `factor`, filled if `alpha` is not 0;
    returns its points (n, 2)."""
    c, s = np.cos(pose[2]), np.sin(pose[2])
    edge = np.asarray((block.outline(OUTLINE_POINTS) @ np.array([[c, s], [-s, c]]) + pose[:2]) * factor)
    if alpha:
        axis.fill(*edge.T, color=colour, alpha=alpha, lw=0, zorder=1.5)
    axis.plot(*np.vstack([edge, edge[:1]]).T, color=colour, ls=style, lw=1.1, zorder=2)
    return edge


def residuals_figure(residuals: pd.DataFrame, title: str = "") -> Figure:
    """Simulated minus measured, a column for each channel: median and 10-90 % band against the time since the start
    of the release, and the distribution at the end of the releases.

    `residuals` has the columns release, block, t_s, dx_m, dy_m, dtheta_rad. Raises InputError if no row is complete."""
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
            quantiles = quantiles[count >= min(5, count.max())]  # a few long releases give no band
            t, colour = quantiles.index.to_numpy(float), colours[name]
            over.fill_between(t, quantiles[0.1], quantiles[0.9], color=colour, alpha=0.22, lw=0)
            style = LINESTYLES[i % len(LINESTYLES)]
            over.plot(t, quantiles[0.5], color=colour, ls=style, lw=1.5, label=name.replace("_", " "))
            over.set_xlim(0, max(t.max(), over.get_xlim()[1] if i else 0.0))
        over.axhline(0, color="#555555", lw=0.7)
        over.grid(color="#e4e4e4", lw=0.6)
        over.set_title("Δ " + labels[channel], fontsize=TEXT_PT)
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
    figure.legend(handles=handles, loc="outside lower center", ncols=5, frameon=False, fontsize=SMALL_PT + 0.5)
    return finish(figure, title)


def _histogram(axis: Any, values: Mapping[str, Array], colours: Mapping[str, str]) -> None:
    """Counts in common bins over the middle 98 %, as outlines if there are several blocks; a note gives the number
    beyond the bins."""
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
    axis.set_title(", ".join(notes), loc="right", fontsize=SMALL_PT, pad=2)
