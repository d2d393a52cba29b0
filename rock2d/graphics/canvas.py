"""Drawing on pixel images (OpenCV, BGR, anti-aliased, sub-pixel): views, lines, areas and text.

A `Viewport` maps metres to pixels; pixel centres have integer coordinates, row 0 is at the top."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from rock2d.arrays import Array
from rock2d.graphics.palette import INK, rgb
from rock2d.scene.cross_section import CrossSection

Limits = tuple[float, float, float, float]  # x_min, x_max, y_min, y_max in m

PIXEL_FRACTION_BITS = 6  # fractional bits of cv2's fixed-point coordinates: 1/64 px


@dataclass(frozen=True)
class Viewport:
    """A view of `width_px` x `height_px` with equal aspect, whose top left corner shows (left_m, top_m)."""

    left_m: float
    top_m: float
    px_per_m: float
    width_px: int
    height_px: int

    def pixels(self, points_m: Array) -> Array:
        """Pixel coordinates (n, 2) of points (n, 2) in m."""
        points = np.asarray(points_m, float).reshape(-1, 2)
        return np.column_stack([points[:, 0] - self.left_m, self.top_m - points[:, 1]]) * self.px_per_m - 0.5

    @property
    def limits_m(self) -> Limits:
        """x_min, x_max, y_min, y_max."""
        right = self.left_m + self.width_px / self.px_per_m
        return self.left_m, right, self.top_m - self.height_px / self.px_per_m, self.top_m

    def around(self, x_m: float, y_m: float, px_per_m: float, side_px: int) -> Viewport:
        """A square view of `side_px` centred on (x_m, y_m)."""
        half = 0.5 * side_px / px_per_m
        return Viewport(x_m - half, y_m + half, px_per_m, side_px, side_px)


def motion_limits(cross_section: CrossSection, x_m: Array, y_m: Array, radius_m: float) -> Limits:
    """The part of the cross-section to show: the motion, the measure lines and the ground vertices near them.

    The far ends of long facets are left out, so that a short motion on a wide floor is not drawn too small."""
    x, y = np.asarray(x_m, float), np.asarray(y_m, float)
    seen = np.isfinite(x) & np.isfinite(y)
    x, y = x[seen], y[seen]
    points = list(cross_section.measure_lines.values())
    if len(x):
        points.append(np.array([[x.min(), y.min()], [x.max(), y.max()]]))
    if not points:
        points = [cross_section.points_m]
    low = np.min([p.min(axis=0) for p in points], axis=0) - radius_m
    high = np.max([p.max(axis=0) for p in points], axis=0) + radius_m
    low, high = np.minimum(low, high - 5 * radius_m), np.maximum(high, low + 5 * radius_m)
    reach = 0.5 * float((high - low).max())
    ground = cross_section.points_m
    near = ((ground >= low - reach) & (ground <= high + reach)).all(axis=1)
    here = cross_section.height_m(np.linspace(low[0], high[0], 9))
    heights = np.concatenate([ground[near, 1], here[np.isfinite(here)]])
    if near.any():
        low[0], high[0] = min(low[0], ground[near, 0].min()), max(high[0], ground[near, 0].max())
    if len(heights):
        low[1], high[1] = min(low[1], heights.min()), max(high[1], heights.max())
    return float(low[0]), float(high[0]), float(low[1]), float(high[1])


def fitted_view(limits: Limits, width_px: int, height_px: int) -> Viewport:
    """The view that contains `limits` at equal aspect, with room for zone names below the ground."""
    wide, high = limits[1] - limits[0], limits[3] - limits[2]
    px_per_m = min(0.92 * width_px / max(wide, 1e-9), 0.78 * height_px / max(high, 1e-9))
    shown_m = height_px / px_per_m
    below = max(0.16 * shown_m, 0.45 * (shown_m - high))
    left = 0.5 * (limits[0] + limits[1]) - 0.5 * width_px / px_per_m
    return Viewport(left, limits[2] - below + shown_m, px_per_m, width_px, height_px)


def exact_view(limits: Limits, width_px: int, height_px: int) -> Viewport:
    """The smallest view with equal aspect that contains `limits`, centred on them. Raises ValueError if they are
    empty."""
    wide, high = limits[1] - limits[0], limits[3] - limits[2]
    if not (wide > 0 and high > 0 and np.isfinite([*limits]).all()):
        raise ValueError(f"view must be x_min < x_max, y_min < y_max in m, got {limits}")
    px_per_m = min(width_px / wide, height_px / high)
    x, y = 0.5 * (limits[0] + limits[1]), 0.5 * (limits[2] + limits[3])
    return Viewport(x - 0.5 * width_px / px_per_m, y + 0.5 * height_px / px_per_m, px_per_m, width_px, height_px)


def bgr(colour: str) -> tuple[int, int, int]:
    """ "#rrggbb" in OpenCV's order."""
    return rgb(colour)[::-1]


def fill(image: Array, points_px: Array, colour: str) -> None:
    """Filled polygon, (n, 2) pixel coordinates."""
    cv2.fillPoly(image, [fixed_point(points_px)], bgr(colour), cv2.LINE_AA, PIXEL_FRACTION_BITS)


def polyline(image: Array, points_px: Array, colour: str, thick_px: float, *, closed: bool = False) -> None:
    """Line through (n, 2) pixel coordinates."""
    thick = max(1, round(thick_px))
    cv2.polylines(image, [fixed_point(points_px)], closed, bgr(colour), thick, cv2.LINE_AA, PIXEL_FRACTION_BITS)


def text_size(text: str, size_px: int, bold: bool = False) -> tuple[float, float]:
    """Width and height of a line of text, px."""
    return float(_font(size_px, bold).getlength(text)), 1.2 * size_px


def draw_text(
    image: Array,
    at: Sequence[float],
    text: str,
    size_px: int,
    colour: str = INK,
    *,
    bold: bool = False,
    halo: str | None = None,
) -> None:
    """A line of text whose top left corner is `at`."""
    from PIL import Image, ImageDraw

    width, height = text_size(text, size_px, bold)
    left, top = round(at[0]), round(at[1])
    x0, y0 = max(left - 3, 0), max(top - 3, 0)
    part = image[y0 : top + int(height) + 4, x0 : left + int(width) + 4]
    if part.size == 0:
        return
    # PIL takes BGR as RGB here; the order is the same on return
    picture = Image.fromarray(np.ascontiguousarray(part))
    style: dict[str, Any] = {"stroke_width": 2, "stroke_fill": bgr(halo)} if halo else {}
    ImageDraw.Draw(picture).text(
        (left - x0, top - y0 + 0.5 * height), text, bgr(colour), _font(size_px, bold), anchor="lm", **style
    )
    part[:] = np.asarray(picture)


@lru_cache(maxsize=32)
def _font(size_px: int, bold: bool) -> Any:
    import matplotlib
    from PIL import ImageFont

    name = "DejaVuSans-Bold.ttf" if bold else "DejaVuSans.ttf"  # part of matplotlib
    return ImageFont.truetype(str(Path(matplotlib.get_data_path()) / "fonts" / "ttf" / name), size_px)


def fixed_point(points_px: Array) -> Array:
    """Pixel coordinates as the fixed-point integers of OpenCV."""
    limit = 2.0**23  # far outside the canvas, within the integers of OpenCV
    return np.rint(np.clip(points_px, -limit, limit) * 2**PIXEL_FRACTION_BITS).astype(np.int32)


def in_image(points_px: Array, image: Array) -> bool:
    """Whether the bounding box of points overlaps the image."""
    high, wide = image.shape[:2]
    low, top = points_px.min(axis=0), points_px.max(axis=0)
    return bool(low[0] < wide and low[1] < high and top[0] > 0 and top[1] > 0)
