"""The pictures of a video: panels side by side, with title, clock, scale bar and legend."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from rock2d.graphics.canvas import Limits, Viewport, bgr, draw_text, fill, polyline, text_size
from rock2d.graphics.clips import Clip
from rock2d.graphics.palette import INK
from rock2d.graphics.video_panel import Layout, Panel
from rock2d.wording import length

Array = np.ndarray

PAPER = "#ffffff"


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
    hold_s : time for which the last picture of a scene is shown, s
    """

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
