"""HTML pages of results: one file each, with their figures inside, without script or network."""

from __future__ import annotations

import base64
import html
import io
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

PAGE_INK, PAGE_ACCENT, PAGE_WARM, PAGE_RULE = "#2b2b2b", "#0072b2", "#d55e00", "#bbbbbb"
PAGE_STYLE = (
    f"body{{font:15px/1.5 system-ui,sans-serif;max-width:62rem;margin:2rem auto;color:{PAGE_INK};padding:0 1rem}}"
    "td,th{padding:.15rem .8rem .15rem 0;border-bottom:1px solid #eee;vertical-align:top;text-align:left}"
    ".wide{overflow-x:auto}img,video{max-width:100%}p,li,code{overflow-wrap:anywhere}"
)
PAGE_FIGURE_DPI = 110  # resolution of embedded PNG pictures
SVG_DPI = 150  # resolution of the parts of an SVG that are pixels


def html_page(title: str, body: str) -> str:
    """A whole page. `title` is text and is escaped; `body` is HTML."""
    return (
        "<!doctype html><html lang='en'><head><meta charset='utf-8'>"
        "<meta name='viewport' content='width=device-width,initial-scale=1'>"
        f"<title>{html.escape(title)}</title><style>{PAGE_STYLE}</style></head>"
        f"<body>{body}</body></html>\n"
    )


def html_table(rows: Iterable[Sequence[str]], head: Sequence[str] = ()) -> str:
    """A table of text cells, which are escaped, below an optional line of column names. It scrolls where the page is
    narrower."""
    names = "".join(f"<th>{html.escape(name)}</th>" for name in head)
    lines = [f"<tr>{names}</tr>"] if head else []
    lines += [f"<tr>{''.join(f'<td>{html.escape(cell)}</td>' for cell in row)}</tr>" for row in rows]
    return f"<div class='wide'><table>{''.join(lines)}</table></div>"


def html_list(items: Iterable[str]) -> str:
    """A bullet list of texts, which are escaped."""
    return f"<ul>{''.join(f'<li>{html.escape(item)}</li>' for item in items)}</ul>"


def html_figure(title: str, figure: Figure, text: str = "", image_format: str = "png") -> str:
    """A heading, an optional paragraph and a figure inside the page. `title` and `text` are escaped."""
    paragraph = f"<p>{html.escape(text)}</p>" if text else ""
    heading = html.escape(title)
    return f"<h2>{heading}</h2>{paragraph}<img alt='{heading}' src='{embedded(figure, image_format)}'>"


def embedded(figure: Figure, image_format: str = "png") -> str:
    """The data URI of a figure, for `src` of an img element; `image_format` is "png" or "svg".

    The text of an SVG is drawn as paths, so that the reader needs no font.
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
    """The data URI of a figure that `save_figure` has written as PNG, reduced to the size for pages: to draw it once
    more would take much longer."""
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
    for own in axes:
        own.spines[["top", "right"]].set_visible(False)
    return figure, axes
