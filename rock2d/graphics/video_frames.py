"""The pictures of a video: panels side by side, each a view of the cross-section in which blocks move, with title,
clock, scale bar and legend."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

import cv2
import numpy as np

from rock2d.arrays import Array
from rock2d.graphics.canvas import Limits, Viewport, bgr, draw_text, fill, polyline, text_size
from rock2d.graphics.clips import Clip
from rock2d.graphics.palette import INK, SKY, mixed
from rock2d.graphics.scenery import Box, draw_block, draw_measure_lines, draw_names, ground_image, placed_names
from rock2d.scene.blocks import Block
from rock2d.scene.cross_section import CrossSection
from rock2d.wording import length

PAPER = "#ffffff"
LINE_TOLERANCE_PX = 0.1  # largest error of a drawn path


@dataclass(frozen=True)
class VideoOptions:
    """The options of a video.

    Attributes
    ----------
    fps_video : frame rate of the video, 1/s
    slow_motion : duration of a scene divided by the duration of its motion; below 1 the video is faster than real time
    size_px : width and height, even numbers
    titles : title of each scene; later scenes have the last title
    view : x_min, x_max, y_min, y_max in m; default: the region in which blocks move
    trail : whether the paths of the centroids are drawn
    hold_s : time for which the last picture of a scene is shown, s"""

    fps_video: float = 25
    slow_motion: float = 10
    size_px: tuple[int, int] = (1280, 720)
    titles: Sequence[str] = ()
    view: Limits | None = None
    trail: bool = True
    hold_s: float = 1.0


class Frames:
    """The pictures of a video, in order. All share one array: a picture is valid until the next one is drawn."""

    def __init__(self, layout: Layout, options: VideoOptions) -> None:
        if not (options.fps_video > 0 and options.slow_motion > 0 and options.hold_s >= 0):
            raise ValueError("fps_video and slow_motion must be positive, hold_s not negative")
        self.layout, self.options = layout, options
        self.scenes: list[tuple[list[Panel], Sequence[Clip], Array, str]] = []

    def add(self, panels: list[Panel], clips: Sequence[Clip]) -> None:
        """Add a scene: its panels and all its clips."""
        own, titles = self.options, self.options.titles
        step_s, hold = 1.0 / (own.fps_video * own.slow_motion), round(own.hold_s * own.fps_video)
        start, end = min(c.t_s[0] for c in clips), max(c.t_s[-1] for c in clips)
        count = int(np.floor((end - start) / step_s + 1e-6)) + 1
        times = np.concatenate([start + step_s * np.arange(count), np.full(hold, end)])
        title = titles[min(len(self.scenes), len(titles) - 1)] if titles else ""
        self.scenes.append((panels, clips, times, title))

    def __len__(self) -> int:
        return sum(len(times) for *_, times, _ in self.scenes)

    def __iter__(self) -> Iterator[Array]:
        grounds: dict[Viewport, Array] = {}
        for panels, clips, times, title in self.scenes:
            sheet = self._fixed_parts(panels[0].view, clips, len(panels), title)
            for panel in panels:
                if panel.view not in grounds:
                    grounds[panel.view] = panel.ground(self.layout)
                panel.prepare(self.layout, grounds[panel.view])
            milliseconds = times[-1] - times[0] < 2.0
            frame, lay, trail = sheet.copy(), self.layout, self.options.trail
            below, recent_s = lay.top + lay.panel_height, 0.9 / self.options.slow_motion
            for t in times:
                frame[: lay.top], frame[below:] = sheet[: lay.top], sheet[below:]
                for left, panel in zip(lay.lefts, panels, strict=True):
                    panel.draw(frame[lay.top : below, left : left + lay.panel_width], t, recent_s, trail)
                clock = f"{1e3 * t:.0f} ms" if milliseconds else f"{t:.2f} s"
                self._draw_right_aligned(frame, clock, 24, 8, bold=True)
                if len(panels) > 1 and len(clips) == len(panels):
                    for left, clip in zip(self.layout.lefts[1:], clips[1:], strict=True):
                        self._draw_difference(frame, clips[0], clip, t, left + self.layout.panel_width)
                yield frame

    def _fixed_parts(self, view: Viewport, clips: Sequence[Clip], panels: int, title: str) -> Array:
        """The parts that do not change during a scene: title, slow motion, scale bar, legend."""
        lay, unit = self.layout, self.layout.unit
        sheet = np.full((lay.height, lay.width, 3), bgr(PAPER), np.uint8)
        side = 16 * unit
        factor = self.options.slow_motion
        pace = f"{factor:g}× slow motion" if factor > 1 else f"{1 / factor:g}× faster"
        pace = "real time" if factor == 1 else pace
        clock_width = text_size("00000 ms", max(10, round(24 * unit)), True)[0]
        pace_width, tall = text_size(pace, lay.text)
        at = lay.width - side - clock_width - 24 * unit - pace_width
        draw_text(sheet, (at, 0.5 * (lay.top - tall)), pace, lay.text, "#6a6a6a")
        size = round(24 * unit)
        title = _shortened(title, size, at - 2 * side)
        draw_text(sheet, (side, 0.5 * (lay.top - 1.2 * size)), title, size, bold=True)

        middle = lay.height - 0.5 * lay.foot
        bar_m = _round_length(0.16 * lay.panel_width / view.px_per_m)
        bar = bar_m * view.px_per_m
        ends = np.array([[side, middle], [side + bar, middle]])
        polyline(sheet, ends, INK, 3 * unit)
        for x in ends[:, 0]:
            polyline(sheet, np.array([[x, middle - 6 * unit], [x, middle + 6 * unit]]), INK, 3 * unit)
        text = _length_text(bar_m)
        draw_text(sheet, (side + bar + 10 * unit, middle - 0.6 * lay.text), text, lay.text)
        x = side + bar + 10 * unit + text_size(text, lay.text)[0] + 40 * unit
        # with more than two panels there is no room for a legend; the panels have labels
        limit = {1: lay.width - side, 2: lay.lefts[-1] + 0.28 * lay.panel_width}.get(panels, 0.0)
        for label, colour in dict.fromkeys((c.label, c.colour) for c in clips):
            wide = text_size(label, lay.text)[0] + 26 * unit
            if x + wide > limit:
                break
            chip = np.array([[0, -7], [16, -7], [16, 7], [0, 7]]) * unit + (x, middle)
            fill(sheet, chip, colour)
            draw_text(sheet, (x + 24 * unit, middle - 0.6 * lay.text), label, lay.text)
            x += wide + 26 * unit
        return sheet

    def _draw_right_aligned(
        self, frame: Array, text: str, size: float, top: float, *, right: float | None = None, bold: bool = False
    ) -> None:
        lay = self.layout
        size_px = max(10, round(size * lay.unit))
        wide, tall = text_size(text, size_px, bold)
        y = 0.5 * (lay.top - tall) if top < lay.top else top
        x = (lay.width if right is None else right) - 16 * lay.unit - wide
        draw_text(frame, (x, y), text, size_px, bold=bold)

    def _draw_difference(self, frame: Array, first: Clip, other: Clip, t_s: float, right: float) -> None:
        a, b = first.pose(t_s), other.pose(t_s)
        if a is None or b is None:
            return
        turn = np.rad2deg((b[2] - a[2] + np.pi) % (2 * np.pi) - np.pi)
        away = float(np.hypot(b[0] - a[0], b[1] - a[1]))
        lay = self.layout
        y = lay.height - 0.5 * lay.foot - 0.6 * lay.text
        text = f"difference: {length(away)}, {abs(turn):.0f}°"
        self._draw_right_aligned(frame, text, lay.text / lay.unit, y, right=right)


def _shortened(text: str, size_px: int, width_px: float) -> str:
    while text and text_size(text, size_px, True)[0] > width_px:
        text = text.rstrip("…")[:-1].rstrip() + "…" if len(text) > 1 else ""
    return text


def _round_length(length_m: float) -> float:
    """The largest of 1, 2, 5 x 10^n that does not exceed a length."""
    power = 10.0 ** np.floor(np.log10(length_m))
    return float(max(f * power for f in (1, 2, 5) if f * power <= length_m * (1 + 1e-9)))


def _length_text(length_m: float) -> str:
    if length_m < 0.01:
        return f"{1e3 * length_m:g} mm"
    return f"{1e2 * length_m:g} cm" if length_m < 1 else f"{length_m:g} m"


class Layout:
    """Positions and sizes of header, panels and footer of a picture, px."""

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


@dataclass
class Panel:
    """One view of a scene.

    Attributes
    ----------
    clips, ghosts : what moves in it; what moves in it translucently
    all_clips : clips of all panels; names avoid their paths, so that they have the same place in each panel
    background : ground, names and the older parts of the trails, in a pale colour"""

    cross_section: CrossSection
    blocks: Mapping[str, Block]
    clips: Sequence[Clip]
    ghosts: Sequence[Clip]
    view: Viewport
    label: str
    all_clips: Sequence[Clip]
    drawn_s: float = -np.inf

    def ground(self, layout: Layout) -> Array:
        """The parts that do not change between scenes: ground and measure lines."""
        image = ground_image(self.cross_section, self.view, 34 * layout.unit, surface_px=2.2 * layout.unit)
        draw_measure_lines(image, self.cross_section, self.view, 2 * layout.unit)
        return image

    def prepare(self, layout: Layout, ground: Array) -> None:
        """Draw the parts that do not change during the scene, names and label, on a copy of `ground`, and place the
        magnifier."""
        view, self.unit = self.view, layout.unit
        self.background = ground.copy()
        paths = [view.pixels(p) for c in self.all_clips for p in c.path(-np.inf, np.inf)]
        busy = np.vstack(paths) if paths else None
        names = placed_names(self.cross_section, view, layout.small, busy)
        draw_names(self.background, names, layout.small)
        if self.label:
            _draw_label(self.background, self.label, self.clips[0].colour, layout)
        self.magnifier = self._magnifier([n.box for n in names], layout)

    def draw(self, image: Array, t_s: float, recent_s: float, trail: bool) -> None:
        """Draw the panel at a time on an image of its size; the last `recent_s` of the path has a strong colour."""
        if trail:
            for clip in self.clips:
                for piece in clip.path(self.drawn_s, t_s):
                    pale = mixed(clip.colour, SKY, 0.6)
                    polyline(self.background, _simplified(self.view.pixels(piece)), pale, 2 * self.unit)
            self.drawn_s = t_s
        image[:] = self.background
        if trail:
            self._draw_recent_trail(image, t_s, recent_s)
        self._draw_blocks(image, self.view, t_s)
        if self.magnifier:
            self._draw_magnifier(image, t_s)

    def _draw_recent_trail(self, image: Array, t_s: float, recent_s: float) -> None:
        ages = np.linspace(1.0, 0.0, 9)
        for clip in self.clips:
            for old, new in pairwise(ages):
                for piece in clip.path(t_s - old * recent_s, t_s - new * recent_s):
                    colour = mixed(clip.colour, SKY, 0.6 * old)
                    line = _simplified(self.view.pixels(piece))
                    polyline(image, line, colour, (2 + 2 * (1 - old)) * self.unit)

    def _body(self, clip: Clip) -> Block:
        return clip.body or self.blocks[clip.block]

    def _draw_blocks(self, image: Array, view: Viewport, t_s: float) -> None:
        for clip, ghost in [(clip, True) for clip in self.ghosts] + [(clip, False) for clip in self.clips]:
            if pose := clip.pose(t_s):
                # hollow: the film has ended, the position is no longer known
                ended = np.isfinite(clip.max_gap_s) and t_s > clip.t_s[-1] + 1e-9
                style = "ghost" if ghost else "hollow" if ended else "solid"
                draw_block(image, view, self._body(clip), pose, clip.colour, style)

    def _magnifier(self, names: Sequence[Box], layout: Layout) -> tuple[int, int, int, float] | None:
        """Left, top, side (px) and px per metre of a magnifier; None if the block is large enough to see it rotate."""
        clip = self.clips[0]
        size_px = self._body(clip).size_m * self.view.px_per_m
        if size_px > 26 * layout.unit:
            return None
        side = round(0.36 * min(self.view.height_px, self.view.width_px))
        margin = round(12 * layout.unit)
        right, low = self.view.width_px - side - margin, self.view.height_px - side - margin
        busy = np.zeros((self.view.height_px, self.view.width_px), np.uint8)
        polyline(busy, self.view.pixels(self.cross_section.points_m), "#404040", 12)
        for c in self.clips:
            for piece in c.path(-np.inf, np.inf):
                polyline(busy, self.view.pixels(piece), "#ffffff", 24)
        for line in self.cross_section.measure_lines.values():
            polyline(busy, self.view.pixels(line), "#ffffff", 24)
        for x0, y0, x1, y1 in names:
            busy[int(y0) : int(y1), int(x0) : int(x1)] = 255
        top = margin + (round(44 * layout.unit) if self.label else 0)
        corners = [(right, top), (margin, top), (margin, low), (right, low)]
        cost = [float(busy[y : y + side, x : x + side].sum()) for x, y in corners]
        x, y = corners[int(np.argmin(cost))]
        return x, y, side, 0.24 * side / self._body(clip).size_m

    def _draw_magnifier(self, image: Array, t_s: float) -> None:
        assert self.magnifier is not None
        left, top, side, px_per_m = self.magnifier
        pose = self.clips[0].pose(t_s)
        if pose is None:
            return
        near = self.view.around(pose[0], pose[1], px_per_m, side)
        part = ground_image(self.cross_section, near, 20 * self.unit, surface_px=2 * self.unit)
        self._draw_blocks(part, near, t_s)
        text = f"{px_per_m / self.view.px_per_m:.0f}× closer"
        size = max(9, round(14 * self.unit))
        draw_text(part, (8 * self.unit, 5 * self.unit), text, size, INK, halo=SKY)
        image[top : top + side, left : left + side] = part
        edge = np.array([[0, 0], [side, 0], [side, side], [0, side]], float)
        polyline(image, edge + np.array([left, top]), "#8a8a8a", 1.5 * self.unit, closed=True)
        half = 0.5 * side / px_per_m * self.view.px_per_m
        centre = self.view.pixels(np.array(pose[:2]))[0]
        polyline(image, centre + (edge / side * 2 - 1) * half, "#8a8a8a", 1, closed=True)


def _simplified(line_px: Array) -> Array:
    """A line (n, 2) without points that lie on it; each point costs drawing time."""
    found = cv2.approxPolyDP(line_px.astype(np.float32), LINE_TOLERANCE_PX, closed=False)
    return np.asarray(found, float).reshape(-1, 2)


def _draw_label(image: Array, label: str, colour: str, layout: Layout) -> None:
    wide, tall = text_size(label, layout.text, True)
    pad = 8 * layout.unit
    left, top = 12 * layout.unit, 10 * layout.unit
    box = np.array([[0, 0], [wide + 2 * pad, 0], [wide + 2 * pad, tall + pad], [0, tall + pad]])
    box = box + np.array([left, top])
    fill(image, box, colour)
    draw_text(image, (left + pad, top + 0.5 * pad), label, layout.text, "#ffffff", bold=True)
