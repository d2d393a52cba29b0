"""A panel of a video: one view of the cross-section in which blocks move."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import pairwise

import cv2
import numpy as np

from rock2d.graphics.canvas import Viewport, draw_text, fill, polyline, text_size
from rock2d.graphics.clips import Clip
from rock2d.graphics.palette import INK, SKY, mixed
from rock2d.graphics.scenery import (
    Box,
    draw_block,
    draw_measure_lines,
    draw_names,
    ground_image,
    placed_names,
)
from rock2d.scene.blocks import Block
from rock2d.scene.cross_section import CrossSection

Array = np.ndarray

LINE_TOLERANCE_PX = 0.1  # largest error of a drawn path


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


class Panel:
    """One view of a scene. `background` holds ground, names and the older parts of the trails, in a pale colour."""

    def __init__(
        self,
        cross_section: CrossSection,
        blocks: Mapping[str, Block],
        clips: Sequence[Clip],
        ghosts: Sequence[Clip],
        view: Viewport,
        label: str,
        all_clips: Sequence[Clip],
    ) -> None:
        self.cross_section, self.blocks, self.clips, self.ghosts = cross_section, blocks, clips, ghosts
        self.all_clips = (
            all_clips  # names avoid the paths of all panels, so that they have the same place in each
        )
        self.view, self.label, self.drawn_s = view, label, -np.inf

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
        for clip in self.ghosts:
            pose = clip.pose(t_s)
            if pose:
                draw_block(image, view, self._body(clip), pose, clip.colour, "ghost")
        for clip in self.clips:
            pose = clip.pose(t_s)
            if pose:
                # hollow: the film has ended, the position is no longer known
                ended = np.isfinite(clip.max_gap_s) and t_s > clip.t_s[-1] + 1e-9
                style = "hollow" if ended else "solid"
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
