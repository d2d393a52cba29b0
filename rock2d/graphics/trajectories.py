"""Figures of trajectories on the cross-section."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from rock2d.arrays import Array
from rock2d.errors import InputError, counted
from rock2d.graphics.canvas import Limits, fitted_view, motion_limits
from rock2d.graphics.figure_style import SMALL_PT, TEXT_PT, blank_figure, finish, handle
from rock2d.graphics.palette import INK, LEADER_INK, LINE_INK, SIMULATED_COLOUR, SKY, block_colours
from rock2d.graphics.scenery import ground_image, placed_names
from rock2d.records.columns import TIME
from rock2d.records.track import Track
from rock2d.scene.blocks import Block
from rock2d.scene.cross_section import CrossSection
from rock2d.wording import spoken

if TYPE_CHECKING:
    from matplotlib.figure import Figure

STOP_MARKERS = {
    "rest": ("o", "came to rest"),
    "exit": (">", "left the section"),
    "time": ("s", "time limit"),
    "impacts": ("D", "limit of impacts"),
    "spent": ("X", "energy spent"),
    "reached": ("P", "suspended on its way"),
    "buried": ("v", "sank into the ground"),
}
MOST_PATHS = 200  # paths per block in a figure
WIDE_IN, AXIS_IN, PAGE_IN = 7.5, 6.85, 9.6  # width of a figure and of its axes, height of a page


def shown_tracks(tracks: Sequence[Track]) -> tuple[list[Track], Counter[str]]:
    """The tracks that a figure of trajectories shows, and how many releases of each block there are."""
    count: Counter[str] = Counter()
    shown = []
    for track in tracks:
        count[track.block] += 1
        if count[track.block] <= MOST_PATHS:
            shown.append(track)
    return shown, count


def trajectories_figure(
    cross_section: CrossSection,
    blocks: Mapping[str, Block],
    tracks: Sequence[Track],
    title: str = "",
    window: Limits | None = None,
    releases: Mapping[str, int] | None = None,
) -> Figure:
    """The cross-section with zones and measure lines, and the paths of the first MOST_PATHS releases; a panel for each
    block.

    `window` (x_min, x_max, y_min, y_max in m): the part that is shown; default: where blocks move.
    `releases`: number of releases of each block, of which `tracks` are the first; default: the number of tracks.
    Raises InputError if there is no track of a known block."""
    from matplotlib.collections import LineCollection

    names = [n for n in blocks if any(t.block == n for t in tracks)]
    if not names:
        raise InputError("a figure of trajectories needs at least one track of a known block")
    tracks, count = shown_tracks(tracks)
    of_block = {n: [t for t in tracks if t.block == n] for n in names}
    paths = {n: [positions_of(t) for t in own] for n, own in of_block.items()}
    every = np.vstack([w for ws in paths.values() for w in ws])
    radius = max(blocks[n].radius_m for n in names)
    if window is not None:
        cross_section = _lines_within(cross_section, window)
    limits = window or motion_limits(cross_section, every[:, 0], every[:, 1], radius)

    high_in = float(np.clip(_to_scale_in(limits), 1.6, min(4.2, PAGE_IN / len(names))))
    figure = blank_figure(WIDE_IN, len(names) * (high_in + 0.32) + 0.65 + (0.3 if title else 0.0))
    axes = figure.subplots(len(names), 1, squeeze=False, sharex=True)[:, 0]
    colours = block_colours(blocks)
    stops: set[str] = set()
    for name, axis in zip(names, axes, strict=True):
        unit = draw_cross_section(axis, cross_section, limits, (AXIS_IN, high_in), np.vstack(paths[name]))
        own = of_block[name]
        alpha = float(np.clip(6.0 / len(own), 0.35, 1.0))
        lines = LineCollection(paths[name], colors=colours[name], linewidths=0.9, alpha=alpha, zorder=3)
        axis.add_collection(lines, autolim=False)
        ends: dict[str, list[Array]] = {}
        for track, path in zip(own, paths[name], strict=True):
            stops.add(track.stop)
            x, y = path[-1]
            if window is None or (window[0] <= x <= window[1] and window[2] <= y <= window[3]):
                ends.setdefault(track.stop, []).append(path[-1])
        for stop, points in ends.items():
            axis.plot(
                *np.transpose(points), marker=STOP_MARKERS[stop][0], ms=4, mfc=colours[name], mec="white",
                mew=0.5, ls="none", zorder=4, clip_on=False,
            )  # fmt: skip
        total = (releases or count)[name]
        releases_text = counted(total, "release")
        if total > MOST_PATHS:
            releases_text = f"the first {MOST_PATHS} of {releases_text}"
        axis.set_title(f"{spoken(name)}, {releases_text}", loc="left", fontsize=TEXT_PT)
        axis.set_ylabel(f"y ({unit})")
    axes[-1].set_xlabel(f"x ({unit})")
    handles = [
        handle(STOP_MARKERS[s][1], marker=STOP_MARKERS[s][0], ls="none", ms=4.5, mfc="#777777", mec="white")
        for s in STOP_MARKERS
        if s in stops
    ]
    figure.legend(handles=handles, loc="outside lower right", ncols=3, frameon=False, fontsize=SMALL_PT)
    return finish(figure, title)


def _lines_within(cross_section: CrossSection, window: Limits) -> CrossSection:
    """The cross-section with its measure lines clipped to a window."""
    import shapely

    left, right, low, high = window
    shown = {}
    for name, ends in cross_section.measure_lines.items():
        part = shapely.get_coordinates(shapely.clip_by_rect(shapely.LineString(ends), left, low, right, high))
        if len(part) == 2:
            shown[name] = part
    return CrossSection(cross_section.points_m, cross_section.zones, shown)


def cross_section_figure(
    cross_section: CrossSection, title: str = "", release_m: tuple[float, float] | None = None
) -> Figure:
    """The cross-section with its zones and measure lines, drawn to scale.

    `release_m`: the stations (m) between which blocks start; this part is marked."""
    points = cross_section.points_m
    limits = motion_limits(cross_section, points[:, 0], points[:, 1], 0.0)
    high_in = float(np.clip(_to_scale_in(limits), 1.6, 6.0))
    figure = blank_figure(WIDE_IN, high_in + 0.6)
    axis = figure.subplots()
    unit = draw_cross_section(axis, cross_section, limits, (AXIS_IN, high_in), points)
    if release_m is not None:
        x = np.linspace(*release_m, 50)
        y = cross_section.height_m(x)
        axis.plot(x, y, color=SIMULATED_COLOUR, linewidth=3.0, label="start of blocks")
        axis.legend(loc="upper right", frameon=False)
    axis.set(xlabel=f"x ({unit})", ylabel=f"y ({unit})")
    return finish(figure, title)


def _to_scale_in(limits: Limits) -> float:
    """The height of an axis AXIS_IN wide that shows `limits` to scale, with room for names."""
    return AXIS_IN * (limits[3] - limits[2]) / (limits[1] - limits[0]) * 1.1 + 0.45


def draw_cross_section(
    axis: Any,
    cross_section: CrossSection,
    limits: Limits,
    size_in: tuple[float, float],
    avoid: Array,
    wide_px: int = 1500,
) -> str:
    """Draw the ground with zones, measure lines and their names on an axis of `size_in` (width, height), with equal
    scales and so that it shows `limits`; names avoid the points `avoid` (n, 2) in m. The ground is an image `wide_px`
    wide. Returns the unit of the ticks, cm or m."""
    from matplotlib.patheffects import withStroke
    from matplotlib.ticker import FuncFormatter, MaxNLocator

    axis_in, high_in = size_in
    view = fitted_view(limits, wide_px, round(wide_px * high_in / axis_in))
    limits = view.limits_m
    unit, factor = ("cm", 1e2) if limits[1] - limits[0] < 2.0 else ("m", 1.0)
    image = ground_image(cross_section, view, 42, surface_px=0)[..., ::-1]
    axis.imshow(image, extent=limits, aspect="equal", zorder=0)
    axis.plot(*cross_section.points_m.T, color=INK, lw=1.3, zorder=2, solid_joinstyle="round")
    for line in cross_section.measure_lines.values():
        axis.plot(*line.T, color=LINE_INK, lw=1.1, ls=(0, (3, 2)), zorder=2.5)
    axis.set(xlim=limits[:2], ylim=limits[2:], aspect="equal")
    for side, count in ((axis.xaxis, 9), (axis.yaxis, 5)):
        side.set_major_locator(MaxNLocator(count, steps=[1, 2, 5, 10]))
        side.set_major_formatter(FuncFormatter(lambda value, _: f"{round(value * factor, 6) + 0.0:g}"))

    size_px = round(SMALL_PT / 72 * view.width_px / axis_in)
    for name in placed_names(cross_section, view, size_px, view.pixels(avoid)):
        left, top, _, bottom = name.box
        x = view.left_m + (left + 0.5) / view.px_per_m
        y = view.top_m - (0.5 * (top + bottom) + 0.5) / view.px_per_m
        if name.leader_px is not None:
            leader = (name.leader_px + 0.5) / view.px_per_m
            axis.plot(view.left_m + leader[:, 0], view.top_m - leader[:, 1], color=LEADER_INK, lw=0.6, zorder=2)
        text = axis.text(x, y, name.text, size=SMALL_PT, color=name.colour, va="center", zorder=5)
        text.set_in_layout(False)
        if name.colour == LINE_INK:
            text.set_path_effects([withStroke(linewidth=2.5, foreground=SKY)])
    return unit


def positions_of(track: Track, until_s: float | None = None) -> Array:
    """Positions (n, 2) in m along a track, close enough together for print."""
    end = track.end_s if until_s is None else max(float(until_s), float(track.knots[0, TIME]))
    t = np.union1d(np.linspace(track.knots[0, TIME], end, 600), track.knots[track.knots[:, TIME] <= end, TIME])
    return track.states(t)[:, :2]
