"""HTML pages of results: one file each that contains its figures and needs no network."""

from __future__ import annotations

import base64
import io
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from rock2d.graphics.downloads import Download
from rock2d.graphics.live_data import live_assets
from rock2d.graphics.rendering import rendered

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

PAGE_INK, PAGE_ACCENT, PAGE_WARM, PAGE_RULE = "#2b2b2b", "#0072b2", "#d55e00", "#bbbbbb"
PAGE_FIGURE_DPI = 110  # resolution of embedded PNG pictures
SVG_DPI = 150  # resolution of pixel images inside an SVG


@dataclass(frozen=True)
class Picture:
    """A figure inside a page: its data URI, the alternative text and the caption."""

    source: str
    alt: str
    caption: str = ""


@dataclass(frozen=True)
class Table:
    """A table of texts; `data` is a download of the unrounded numbers."""

    head: Sequence[str]
    rows: Sequence[Sequence[str]]
    title: str = ""
    note: str = ""
    data: Download | None = None


@dataclass(frozen=True)
class Section:
    """A part of a page, in the order of its fields; empty fields are left out. All text is escaped; text in backticks
    is code.

    Attributes
    ----------
    texts, items : paragraphs, and items of a list
    video : name of a file in the folder of the page
    """

    title: str = ""
    texts: Sequence[str] = ()
    items: Sequence[str] = ()
    video: str = ""
    pictures: Sequence[Picture] = ()
    tables: Sequence[Table] = ()


def page(title: str, sections: Sequence[Section]) -> str:
    """A complete HTML page."""
    return rendered("rock2d.graphics", "sections.html.j2", {"title": title, "sections": sections}, {})


def live_page(title: str, above: Sequence[Section], name: str, live: object, below: Sequence[Section]) -> str:
    """A complete HTML page with a live view between the sections `above` and `below`.

    The files of the view are `name`.html.j2, .js and .css; `live` holds the values for the template.
    """
    view = {"live": live, "view": f"{name}.html.j2", **live_assets(name)}
    context = {"title": title, "sections": above, "below": below, **view}
    return rendered("rock2d.graphics", "live_sections.html.j2", context, {})


def drawn(figure: Figure, alt: str, image_format: str = "png") -> Picture:
    """A figure as a picture of a page."""
    return Picture(embedded(figure, image_format), alt)


def embedded(figure: Figure, image_format: str = "png") -> str:
    """The data URI of a figure, for `src` of an img element; `image_format` is "png" or "svg".

    The text of an SVG is drawn as paths, so that it looks the same without the font.
    """
    import matplotlib

    buffer = io.BytesIO()
    if image_format == "png":
        figure.savefig(buffer, format="png", dpi=PAGE_FIGURE_DPI)
        return _data_uri(buffer, "png")
    with matplotlib.rc_context({"svg.fonttype": "path", "svg.hashsalt": "rock2d"}):
        figure.savefig(buffer, format="svg", dpi=SVG_DPI, metadata={"Date": None})
    return _data_uri(buffer, "svg+xml")


def embedded_picture(path: Path) -> str:
    """The data URI of a PNG that `save_figure` has written, reduced to the size for pages. This is much faster than
    drawing the figure again."""
    from PIL import Image

    from rock2d.graphics.figure_style import FILE_DPI

    buffer = io.BytesIO()
    with Image.open(path) as picture:
        size = [round(pixels * PAGE_FIGURE_DPI / FILE_DPI) for pixels in picture.size]
        picture.convert("RGB").resize(size, Image.Resampling.LANCZOS).save(buffer, format="png")
    return _data_uri(buffer, "png")


def _data_uri(buffer: io.BytesIO, kind: str) -> str:
    return f"data:image/{kind};base64,{base64.b64encode(buffer.getvalue()).decode()}"


def blank_axes(width_in: float, height_in: float, columns: int = 1) -> tuple[Figure, list[Axes]]:
    """A figure of this size in inches with `columns` axes side by side, without top and right frame lines."""
    from rock2d.graphics.figure_style import blank_figure

    figure = blank_figure(width_in, height_in)
    axes = list(np.atleast_1d(figure.subplots(1, columns)))
    for axis in axes:
        axis.spines[["top", "right"]].set_visible(False)
    return figure, axes
