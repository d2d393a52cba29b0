"""Headless video of trajectories: blocks on the cross-section, slowed down, with clock and scale.

A `Clip` is one block's motion, simulated or measured. Clips shown together share one clock; several lists of
clips ("scenes") are shown one after another in one view. VP9 in WebM, which browsers play.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from rock2d.errors import InputError
from rock2d.graphics import drawing
from rock2d.graphics.clips import Clip, clip_from_measured, clip_from_track
from rock2d.graphics.drawing import Limits, View
from rock2d.graphics.palette import INK, MEASURED_COLOUR, SIMULATED_COLOUR, SKY, block_colours, mixed
from rock2d.graphics.video_file import Progress, write_video
from rock2d.scene.blocks import Block
from rock2d.scene.cross_section import CrossSection

Array = np.ndarray
__all__ = [
    "Clip", "clip_from_measured", "clip_from_track", "compare_video", "panel_views", "render_video", "side_by_side",
]  # fmt: skip

_PAPER = "#ffffff"


def render_video(
    path: str | Path,
    cross_section: CrossSection,
    blocks: Mapping[str, Block],
    series: Sequence[Clip] | Sequence[Sequence[Clip]],
    *,
    fps_video: float = 25,
    slow_motion: float = 10,
    size_px: tuple[int, int] = (1280, 720),
    title: str = "",
    view: Limits | None = None,
    trail: bool = True,
    hold_s: float = 1.0,
    progress: Progress | None = None,
) -> Path:
    """Film `series` (clips together, or a list of scenes one after another) and return the file's path.

    A scene lasts (last sample - first sample) x `slow_motion`, then its last picture stays for `hold_s`.
    `slow_motion` below 1 is faster than life. `view` is x_min, x_max, y_min, y_max in m (default: the
    motion). A block whose samples have ended while the scene goes on is drawn hollow if it was filmed, and
    stays as it stopped if it was simulated. `progress(done, all)` is called after each frame.

    Written beside `path` and renamed when whole. Raises InputError if the suffix is neither .webm nor .mp4,
    the codec is missing, nothing is to be shown, or a clip's block is unknown; ValueError on bad sizes.
    """
    scenes = _dressed(_scenes(series), blocks)
    layout = _Layout(size_px, 1)
    seen = _view(cross_section, blocks, scenes, layout, view)
    frames = _Frames(layout, fps_video, slow_motion, hold_s, title, trail)
    for scene in scenes:
        frames.add([_Panel(cross_section, blocks, scene, (), seen, "", scene)], scene)
    return write_video(path, frames, len(frames), fps_video, size_px, progress)


def side_by_side(
    path: str | Path,
    cross_section: CrossSection,
    blocks: Mapping[str, Block],
    left: Sequence[Clip],
    right: Sequence[Clip],
    *,
    labels: tuple[str, str] = ("measured", "simulated"),
    fps_video: float = 25,
    slow_motion: float = 10,
    size_px: tuple[int, int] = (1280, 720),
    title: str = "",
    view: Limits | None = None,
    trail: bool = True,
    hold_s: float = 1.0,
    progress: Progress | None = None,
) -> Path:
    """Two panels with one clock and one view; the left panel's blocks appear as ghosts in the right one.

    With one clip a side, the distance and the angle between the two are written under the right panel.
    Other arguments, file handling and errors as in `render_video`.
    """
    first = [replace(c, colour=c.colour or MEASURED_COLOUR) for c in left]
    second = [replace(c, colour=c.colour or SIMULATED_COLOUR) for c in right]
    return compare_video(
        path, cross_section, blocks, [(first, second)], labels, fps_video=fps_video, slow_motion=slow_motion,
        size_px=size_px, titles=[title], view=view, trail=trail, hold_s=hold_s, progress=progress,
    )  # fmt: skip


def compare_video(
    path: str | Path,
    cross_section: CrossSection,
    blocks: Mapping[str, Block],
    scenes: Sequence[Sequence[Sequence[Clip]]],
    labels: Sequence[str],
    *,
    fps_video: float = 25,
    slow_motion: float = 10,
    size_px: tuple[int, int] = (1280, 720),
    titles: Sequence[str] = (),
    view: Limits | None = None,
    trail: bool = True,
    hold_s: float = 1.0,
    progress: Progress | None = None,
    quick: bool = False,
) -> Path:
    """Panels with one clock and one view, a panel for each of `labels`; the first panel's blocks appear as ghosts in
    the others. `scenes` follow one another; each holds the clips of every panel, and has one of `titles`.

    Where every panel shows one clip, its distance and angle from the first panel's are written below it. `quick` as in
    `write_video`; other arguments, file handling and errors as in `render_video`.
    """
    if not scenes or not all(len(scene) == len(labels) and all(scene) for scene in scenes):
        raise InputError("side by side needs at least one clip on each side")
    layout = _Layout(size_px, len(labels))
    dressed = [[_dressed([panel], blocks)[0] for panel in scene] for scene in scenes]
    together = [[clip for panel in scene for clip in panel] for scene in dressed]
    seen = _view(cross_section, blocks, together, layout, view)
    frames = _Frames(layout, fps_video, slow_motion, hold_s, "", trail)
    for i, (scene, clips) in enumerate(zip(dressed, together, strict=True)):
        panels = [
            _Panel(cross_section, blocks, own, scene[0] if k else (), seen, label, clips)
            for k, (own, label) in enumerate(zip(scene, labels, strict=True))
        ]
        frames.add(panels, clips, titles[i] if i < len(titles) else "")
    return write_video(path, frames, len(frames), fps_video, size_px, progress, quick=quick)


def panel_views(
    cross_section: CrossSection,
    blocks: Mapping[str, Block],
    series: Sequence[Clip] | Sequence[Sequence[Clip]],
    size_px: tuple[int, int] = (1280, 720),
    *,
    panels: int = 1,
    view: Limits | None = None,
) -> list[tuple[int, int, View]]:
    """Where a frame shows what: left and top pixel of each panel, and its `View` relative to that corner."""
    layout = _Layout(size_px, panels)
    seen = _view(cross_section, blocks, _dressed(_scenes(series), blocks), layout, view)
    return [(left, layout.top, seen) for left in layout.lefts]


# --- composition --------------------------------------------------------------------------------------


class _Layout:
    """Header, panels and footer of a frame, px."""

    def __init__(self, size_px: tuple[int, int], panels: int) -> None:
        self.width, self.height = (int(s) for s in size_px)
        if self.width < 320 or self.height < 240 or self.width % 2 or self.height % 2:
            raise ValueError(f"size_px must be even and at least 320 x 240, got {size_px}")
        self.unit = min(self.width / 1280, self.height / 720)
        self.top, self.foot = round(56 * self.unit), round(52 * self.unit)
        self.gutter = round(8 * self.unit) if panels > 1 else 0
        self.panel_width = (self.width - (panels - 1) * self.gutter) // panels
        self.panel_height = self.height - self.top - self.foot
        self.lefts = [i * (self.panel_width + self.gutter) for i in range(panels)]
        self.text, self.small = max(10, round(19 * self.unit)), max(9, round(16 * self.unit))


class _Panel:
    """One view of a scene, kept between frames: the ground and the trails grow pale on `background`."""

    def __init__(
        self,
        cross_section: CrossSection,
        blocks: Mapping[str, Block],
        clips: Sequence[Clip],
        ghosts: Sequence[Clip],
        view: View,
        label: str,
        all_clips: Sequence[Clip],
    ) -> None:
        self.cross_section, self.blocks, self.clips, self.ghosts = cross_section, blocks, clips, ghosts
        self.all_clips = all_clips  # names keep off the ways of the other panel too: the same place in both
        self.view, self.label, self.drawn_s = view, label, -np.inf

    def prepare(self, layout: _Layout) -> None:
        view, unit = self.view, layout.unit
        self.unit = unit
        self.background = drawing.ground_image(self.cross_section, view, 34 * unit, surface_px=2.2 * unit)
        drawing.draw_measure_lines(self.background, self.cross_section, view, 2 * unit)
        ways = [view.pixels(p) for c in self.all_clips for p in c.path(-np.inf, np.inf)]
        busy = np.vstack(ways) if ways else None
        names = drawing.placed_names(self.cross_section, view, layout.small, busy)
        drawing.draw_names(self.background, names, layout.small)
        if self.label:
            _chip(self.background, self.label, self.clips[0].colour, layout)
        self.inset = self._inset([n.box for n in names], layout)

    def draw(self, t_s: float, fresh_s: float, trail: bool) -> Array:
        """The panel at a time; the last `fresh_s` of the way is drawn strong."""
        if trail:
            for clip in self.clips:
                for piece in clip.path(self.drawn_s, t_s):
                    pale = mixed(clip.colour, SKY, 0.6)
                    drawing.polyline(self.background, self.view.pixels(piece), pale, 2 * self.unit)
            self.drawn_s = t_s
        image = self.background.copy()
        if trail:
            self._fresh_trail(image, t_s, fresh_s)
        self._blocks(image, self.view, t_s)
        if self.inset:
            self._draw_inset(image, t_s)
        return image

    def _fresh_trail(self, image: Array, t_s: float, fresh_s: float) -> None:
        ages = np.linspace(1.0, 0.0, 9)
        for clip in self.clips:
            for old, new in pairwise(ages):
                for piece in clip.path(t_s - old * fresh_s, t_s - new * fresh_s):
                    colour = mixed(clip.colour, SKY, 0.6 * old)
                    drawing.polyline(image, self.view.pixels(piece), colour, (2 + 2 * (1 - old)) * self.unit)

    def _blocks(self, image: Array, view: View, t_s: float) -> None:
        for clip in self.ghosts:
            pose = clip.pose(t_s)
            if pose:
                drawing.draw_block(image, view, self.blocks[clip.block], pose, clip.colour, "ghost")
        for clip in self.clips:
            pose = clip.pose(t_s)
            if pose:
                # a film that has ended says nothing about later: hollow
                ended = np.isfinite(clip.max_gap_s) and t_s > clip.t_s[-1] + 1e-9
                style = "hollow" if ended else "solid"
                drawing.draw_block(image, view, self.blocks[clip.block], pose, clip.colour, style)

    def _inset(self, names: Sequence[drawing.Box], layout: _Layout) -> tuple[int, int, int, float] | None:
        """Corner (left, top), side and px a metre of a magnifier, for blocks too small to see them turn."""
        clip = self.clips[0]
        size_px = self.blocks[clip.block].size_m * self.view.px_per_m
        if size_px > 26 * layout.unit:
            return None
        side = round(0.36 * min(self.view.height_px, self.view.width_px))
        margin = round(12 * layout.unit)
        right, low = self.view.width_px - side - margin, self.view.height_px - side - margin
        busy = np.zeros((self.view.height_px, self.view.width_px), np.uint8)
        drawing.polyline(busy, self.view.pixels(self.cross_section.points_m), "#404040", 12)
        for c in self.clips:
            for piece in c.path(-np.inf, np.inf):
                drawing.polyline(busy, self.view.pixels(piece), "#ffffff", 24)
        for line in self.cross_section.measure_lines.values():
            drawing.polyline(busy, self.view.pixels(line), "#ffffff", 24)
        for x0, y0, x1, y1 in names:
            busy[int(y0) : int(y1), int(x0) : int(x1)] = 255
        top = margin + (round(44 * layout.unit) if self.label else 0)
        corners = [(right, top), (margin, top), (margin, low), (right, low)]
        cost = [float(busy[y : y + side, x : x + side].sum()) for x, y in corners]
        x, y = corners[int(np.argmin(cost))]
        return x, y, side, 0.24 * side / self.blocks[clip.block].size_m

    def _draw_inset(self, image: Array, t_s: float) -> None:
        assert self.inset is not None
        left, top, side, px_per_m = self.inset
        pose = self.clips[0].pose(t_s)
        if pose is None:
            return
        near = self.view.around(pose[0], pose[1], px_per_m, side)
        part = drawing.ground_image(self.cross_section, near, 20 * self.unit, surface_px=2 * self.unit)
        self._blocks(part, near, t_s)
        text = f"{px_per_m / self.view.px_per_m:.0f}× closer"
        size = max(9, round(14 * self.unit))
        drawing.draw_text(part, (8 * self.unit, 5 * self.unit), text, size, INK, halo=SKY)
        image[top : top + side, left : left + side] = part
        edge = np.array([[0, 0], [side, 0], [side, side], [0, side]], float)
        drawing.polyline(image, edge + np.array([left, top]), "#8a8a8a", 1.5 * self.unit, closed=True)
        half = 0.5 * side / px_per_m * self.view.px_per_m
        centre = self.view.pixels(np.array(pose[:2]))[0]
        drawing.polyline(image, centre + (edge / side * 2 - 1) * half, "#8a8a8a", 1, closed=True)


class _Frames:
    """The pictures of a video, in order."""

    def __init__(
        self, layout: _Layout, fps_video: float, slow_motion: float, hold_s: float, title: str, trail: bool
    ) -> None:
        if not (fps_video > 0 and slow_motion > 0 and hold_s >= 0):
            raise ValueError("fps_video and slow_motion must be positive, hold_s not negative")
        self.layout, self.step_s = layout, 1.0 / (fps_video * slow_motion)
        self.hold, self.fresh_s = round(hold_s * fps_video), 0.9 / slow_motion
        self.slow_motion, self.title, self.trail = slow_motion, title, trail
        self.scenes: list[tuple[list[_Panel], Sequence[Clip], Array, str]] = []

    def add(self, panels: list[_Panel], clips: Sequence[Clip], title: str = "") -> None:
        start, end = min(c.t_s[0] for c in clips), max(c.t_s[-1] for c in clips)
        count = int(np.floor((end - start) / self.step_s + 1e-6)) + 1
        times = np.concatenate([start + self.step_s * np.arange(count), np.full(self.hold, end)])
        self.scenes.append((panels, clips, times, title or self.title))

    def __len__(self) -> int:
        return sum(len(times) for *_, times, _ in self.scenes)

    def __iter__(self) -> Iterator[Array]:
        for panels, clips, times, title in self.scenes:
            sheet = self._sheet(panels[0].view, clips, len(panels), title)
            for panel in panels:
                panel.prepare(self.layout)
            milliseconds = times[-1] - times[0] < 2.0
            for t in times:
                frame = sheet.copy()
                for left, panel in zip(self.layout.lefts, panels, strict=True):
                    high, wide = self.layout.panel_height, self.layout.panel_width
                    frame[self.layout.top : self.layout.top + high, left : left + wide] = panel.draw(
                        t, self.fresh_s, self.trail
                    )
                clock = f"{1e3 * t:.0f} ms" if milliseconds else f"{t:.2f} s"
                self._right(frame, clock, 24, 8, bold=True)
                if len(panels) > 1 and len(clips) == len(panels):
                    for left, clip in zip(self.layout.lefts[1:], clips[1:], strict=True):
                        self._difference(frame, clips[0], clip, t, left + self.layout.panel_width)
                yield frame

    def _sheet(self, view: View, clips: Sequence[Clip], panels: int, title: str) -> Array:
        """What stays the same over a scene: title, slow motion, scale bar, legend."""
        lay, unit = self.layout, self.layout.unit
        sheet = np.full((lay.height, lay.width, 3), drawing.bgr(_PAPER), np.uint8)
        side = 16 * unit
        factor = self.slow_motion
        pace = (
            "real time"
            if factor == 1
            else f"{factor:g}× slow motion"
            if factor > 1
            else f"{1 / factor:g}× faster"
        )
        clock_width = drawing.text_size("00000 ms", max(10, round(24 * unit)), True)[0]
        pace_width, tall = drawing.text_size(pace, lay.text)
        at = lay.width - side - clock_width - 24 * unit - pace_width
        drawing.draw_text(sheet, (at, 0.5 * (lay.top - tall)), pace, lay.text, "#6a6a6a")
        size = round(24 * unit)
        title = _shortened(title, size, at - 2 * side)
        drawing.draw_text(sheet, (side, 0.5 * (lay.top - 1.2 * size)), title, size, bold=True)

        middle = lay.height - 0.5 * lay.foot
        bar_m = _round_length(0.16 * lay.panel_width / view.px_per_m)
        bar = bar_m * view.px_per_m
        ends = np.array([[side, middle], [side + bar, middle]])
        drawing.polyline(sheet, ends, INK, 3 * unit)
        for x in ends[:, 0]:
            drawing.polyline(sheet, np.array([[x, middle - 6 * unit], [x, middle + 6 * unit]]), INK, 3 * unit)
        text = _length_text(bar_m)
        drawing.draw_text(sheet, (side + bar + 10 * unit, middle - 0.6 * lay.text), text, lay.text)
        x = side + bar + 10 * unit + drawing.text_size(text, lay.text)[0] + 40 * unit
        # two panels leave room for a legend, more do not: their labels must do
        limit = {1: lay.width - side, 2: lay.lefts[-1] + 0.28 * lay.panel_width}.get(panels, 0.0)
        for label, colour in dict.fromkeys((c.label, c.colour) for c in clips):
            wide = drawing.text_size(label, lay.text)[0] + 26 * unit
            if x + wide > limit:
                break
            chip = np.array([[0, -7], [16, -7], [16, 7], [0, 7]]) * unit + (x, middle)
            drawing.fill(sheet, chip, colour)
            drawing.draw_text(sheet, (x + 24 * unit, middle - 0.6 * lay.text), label, lay.text)
            x += wide + 26 * unit
        return sheet

    def _right(
        self,
        frame: Array,
        text: str,
        size: float,
        top: float,
        *,
        right: float | None = None,
        bold: bool = False,
    ) -> None:
        lay = self.layout
        size_px = max(10, round(size * lay.unit))
        wide, tall = drawing.text_size(text, size_px, bold)
        y = 0.5 * (lay.top - tall) if top < lay.top else top
        x = (lay.width if right is None else right) - 16 * lay.unit - wide
        drawing.draw_text(frame, (x, y), text, size_px, bold=bold)

    def _difference(self, frame: Array, first: Clip, other: Clip, t_s: float, right: float) -> None:
        a, b = first.pose(t_s), other.pose(t_s)
        if a is None or b is None:
            return
        turn = np.rad2deg((b[2] - a[2] + np.pi) % (2 * np.pi) - np.pi)
        away = float(np.hypot(b[0] - a[0], b[1] - a[1]))
        apart = f"{1e3 * away:.1f} mm" if away < 1 else f"{away:.2f} m"
        lay = self.layout
        y = lay.height - 0.5 * lay.foot - 0.6 * lay.text
        self._right(frame, f"difference: {apart}, {abs(turn):.0f}°", lay.text / lay.unit, y, right=right)


def _chip(image: Array, label: str, colour: str, layout: _Layout) -> None:
    wide, tall = drawing.text_size(label, layout.text, True)
    pad = 8 * layout.unit
    left, top = 12 * layout.unit, 10 * layout.unit
    box = np.array([[0, 0], [wide + 2 * pad, 0], [wide + 2 * pad, tall + pad], [0, tall + pad]])
    box = box + np.array([left, top])
    drawing.fill(image, box, colour)
    drawing.draw_text(image, (left + pad, top + 0.5 * pad), label, layout.text, "#ffffff", bold=True)


def _shortened(text: str, size_px: int, width_px: float) -> str:
    while text and drawing.text_size(text, size_px, True)[0] > width_px:
        text = text.rstrip("…")[:-1].rstrip() + "…" if len(text) > 1 else ""
    return text


def _round_length(length_m: float) -> float:
    """The largest of 1, 2, 5 x 10^n not above a length."""
    power = 10.0 ** np.floor(np.log10(length_m))
    return float(max(f * power for f in (1, 2, 5) if f * power <= length_m * (1 + 1e-9)))


def _length_text(length_m: float) -> str:
    if length_m < 0.01:
        return f"{1e3 * length_m:g} mm"
    return f"{1e2 * length_m:g} cm" if length_m < 1 else f"{length_m:g} m"


def _scenes(series: Sequence[Clip] | Sequence[Sequence[Clip]]) -> list[list[Clip]]:
    items: list[Any] = list(series)
    scenes = [items] if items and isinstance(items[0], Clip) else [list(s) for s in items if len(s)]
    if not scenes:
        raise InputError("nothing to show: no clips")
    return scenes


def _dressed(scenes: Iterable[Sequence[Clip]], blocks: Mapping[str, Block]) -> list[list[Clip]]:
    """Clips with the label and colour of their block where they have none of their own."""
    colours = block_colours(blocks)
    out = []
    for scene in scenes:
        for clip in scene:
            if clip.block not in blocks:
                raise InputError(f"a clip shows block {clip.block}, the blocks are {', '.join(blocks)}")
        out.append(
            [
                replace(c, label=c.label or c.block.replace("_", " "), colour=c.colour or colours[c.block])
                for c in scene
            ]
        )
    return out


def _view(
    cross_section: CrossSection,
    blocks: Mapping[str, Block],
    scenes: Sequence[Sequence[Clip]],
    layout: _Layout,
    limits: Limits | None,
) -> View:
    if limits is not None:
        return drawing.exact_view(limits, layout.panel_width, layout.panel_height)
    clips = [c for scene in scenes for c in scene]
    radius = max(blocks[c.block].radius_m for c in clips)
    x, y = (np.concatenate([getattr(c, key) for c in clips]) for key in ("x_m", "y_m"))
    return drawing.fitted_view(
        drawing.motion_limits(cross_section, x, y, radius), layout.panel_width, layout.panel_height
    )
