"""HTML of results: pages, one file each that contains its figures and data and needs no network; and parts of
notebooks."""

from __future__ import annotations

import base64
import csv
import io
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from rock2d.errors import InputError
from rock2d.files.folders import atomic_file
from rock2d.graphics.live_data import live_assets
from rock2d.graphics.rendering import rendered

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

PAGE = "report.html"  # name of the file
PAGE_INK, PAGE_ACCENT, PAGE_WARM, PAGE_RULE = "#2b2b2b", "#0072b2", "#d55e00", "#bbbbbb"
PAGE_FIGURE_DPI = 110  # resolution of embedded PNG pictures
SVG_DPI = 150  # resolution of pixel images inside an SVG
SIGNIFICANT_DIGITS = 6  # of the numbers of a download
# a spreadsheet takes a text that begins with one of these as a formula
FORMULA_SIGNS = ("=", "+", "-", "@", "\t", "\r")


@dataclass(frozen=True)
class Picture:
    """A figure inside a page: its data URI, the alternative text and the caption."""

    source: str
    alt: str
    caption: str = ""


@dataclass(frozen=True)
class Download:
    """A link to a CSV whose data are inside the page: file name, data URI and the number of rows without the header."""

    name: str
    href: str
    rows: int


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
    video : name of a file in the folder of the page"""

    title: str = ""
    texts: Sequence[str] = ()
    items: Sequence[str] = ()
    video: str = ""
    pictures: Sequence[Picture] = ()
    tables: Sequence[Table] = ()


def page(title: str, sections: Sequence[Section]) -> str:
    """A complete HTML page."""
    return rendered("rock2d.graphics", "sections.html.j2", {"title": title, "sections": sections})


def live_page(title: str, above: Sequence[Section], name: str, live: object, below: Sequence[Section]) -> str:
    """A complete HTML page with a live view between the sections `above` and `below`.

    The files of the view are `name`.html.j2, .js and .css; `live` holds the values for the template."""
    view = {"live": live, "view": f"{name}.html.j2", **live_assets(name)}
    context = {"title": title, "sections": above, "below": below, **view}
    return rendered("rock2d.graphics", "sections.html.j2", context)


def view(write: Callable[[Path], object], name: str) -> Path:
    """Call `write` with a new temporary folder, open its page `name` in the browser and return the path of the page.

    The folder is not deleted, because the browser reads it later."""
    import shutil
    import tempfile
    import webbrowser

    folder = Path(tempfile.mkdtemp(prefix="rock2d_"))
    try:
        write(folder)
    except BaseException:
        shutil.rmtree(folder, ignore_errors=True)
        raise
    webbrowser.open((folder / name).as_uri())
    return folder / name


def download(name: str, columns: Sequence[str], rows: Iterable[Sequence[Any]]) -> Download:
    """A CSV with a header. Numbers have SIGNIFICANT_DIGITS; missing numbers are empty cells."""
    buffer = io.StringIO()
    writer = csv.writer(buffer, lineterminator="\n")
    writer.writerow(columns)
    cells = [[_cell(value) for value in row] for row in rows]
    writer.writerows(cells)
    return Download(name, data_uri("text/csv;charset=utf-8", buffer.getvalue().encode()), len(cells))


def _cell(value: Any) -> str:
    if isinstance(value, (float, np.floating)):
        return f"{value:.{SIGNIFICANT_DIGITS}g}" if np.isfinite(value) else ""
    if isinstance(value, str) and value.startswith(FORMULA_SIGNS):
        return f"'{value}"
    return "" if value is None else str(value)


def drawn(figure: Figure, alt: str, image_format: str = "png") -> Picture:
    """A figure as a picture of a page."""
    return Picture(embedded(figure, image_format), alt)


def embedded(figure: Figure, image_format: str = "png") -> str:
    """The data URI of a figure, for `src` of an img element; `image_format` is "png" or "svg".

    The text of an SVG is drawn as paths, so that it looks the same without the font."""
    import matplotlib

    buffer = io.BytesIO()
    if image_format == "png":
        figure.savefig(buffer, format="png", dpi=PAGE_FIGURE_DPI)
        return data_uri("image/png", buffer.getvalue())
    with matplotlib.rc_context({"svg.fonttype": "path", "svg.hashsalt": "rock2d"}):
        figure.savefig(buffer, format="svg", dpi=SVG_DPI, metadata={"Date": None})
    return data_uri("image/svg+xml", buffer.getvalue())


def embedded_picture(path: Path) -> str:
    """The data URI of a PNG that `save_figure` has written, reduced to the size for pages. This is much faster than
    drawing the figure again."""
    from PIL import Image

    from rock2d.graphics.figure_style import FILE_DPI

    buffer = io.BytesIO()
    with Image.open(path) as picture:
        size = [round(pixels * PAGE_FIGURE_DPI / FILE_DPI) for pixels in picture.size]
        picture.convert("RGB").resize(size, Image.Resampling.LANCZOS).save(buffer, format="png")
    return data_uri("image/png", buffer.getvalue())


def data_uri(kind: str, raw: bytes) -> str:
    """Bytes of a media type as an address that contains them."""
    return f"data:{kind};base64,{base64.b64encode(raw).decode()}"


def blank_axes(width_in: float, height_in: float, columns: int = 1) -> tuple[Figure, list[Axes]]:
    """A figure of this size in inches with `columns` axes side by side, without top and right frame lines."""
    from rock2d.graphics.figure_style import blank_figure

    figure = blank_figure(width_in, height_in)
    axes = list(np.atleast_1d(figure.subplots(1, columns)))
    for axis in axes:
        axis.spines[["top", "right"]].set_visible(False)
    return figure, axes


def notebook_table(table: pd.DataFrame) -> str:
    """A small table as HTML; numbers with three significant digits."""
    return str(table.to_html(index=False, border=0, na_rep="", float_format=lambda value: f"{value:.3g}"))


def notebook_figure(figure: Figure) -> str:
    """An img element that holds the figure itself."""
    return f'<img src="{embedded(figure)}">'


def check_printer() -> None:
    """Raise InputError if WeasyPrint, or a system library that it needs, is missing."""
    try:
        import weasyprint  # noqa: F401
    except ImportError:
        message = "a PDF needs WeasyPrint: pip install 'rock2d[pdf]'"
        raise InputError(message, code="missing_package", package="weasyprint") from None
    except OSError as error:  # pip does not install Pango
        message = f"WeasyPrint does not find a library that it needs: {str(error).splitlines()[0]}"
        raise InputError(message, code="missing_package", package="weasyprint") from None


def write_pdf(page: str, path: Path) -> None:
    """Write a page as PDF, without access to files or the network. Raises InputError as `check_printer` does."""
    check_printer()
    from weasyprint import HTML
    from weasyprint.urls import URLFetcher

    fetcher = URLFetcher(allowed_protocols={"data"})
    with atomic_file(path) as part:
        HTML(string=page, url_fetcher=fetcher).write_pdf(part)
