"""The common style of figures (sizes, lines, frames, legends), and writing them to files.

Figures do not use the global state of matplotlib (`pyplot`), and show text unchanged."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from rock2d.errors import InputError
from rock2d.files.folders import atomic_file

if TYPE_CHECKING:
    from matplotlib.figure import Figure

LINESTYLES: tuple[Any, ...] = ("-", (0, (5, 1.6)), (0, (1.5, 1.2)), (0, (6, 1.4, 1.5, 1.4)))
TEXT_PT, SMALL_PT = 9.0, 7.5
FILE_DPI = 200  # resolution of figures that are files


def save_figure(figure: Figure, path: str | Path, dpi: int = FILE_DPI) -> Path:
    """Write `figure` to `path`, completely or not at all; the suffix gives the format.

    Raises InputError if matplotlib does not know the suffix."""
    path = Path(path)
    kind = path.suffix.lower().lstrip(".")
    known = figure.canvas.get_supported_filetypes()
    if kind not in known:
        raise InputError(f"{path}: expected a figure as {', '.join(sorted(known))}, found {path.suffix!r}")
    with atomic_file(path) as part:
        figure.savefig(part, dpi=dpi, format=kind)
    return path


def blank_figure(wide_in: float, high_in: float) -> Figure:
    """An empty figure of this size in inches."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    from rock2d.graphics.plain_figure import PlainFigure

    figure = PlainFigure(figsize=(wide_in, high_in), layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def finish(figure: Figure, title: str = "") -> Figure:
    """The figure in the common style: title, label sizes, no frame line at the top and on the right."""
    if title:
        figure.suptitle(title, fontsize=TEXT_PT + 2, fontweight="bold")
    for axis in figure.axes:
        axis.tick_params(labelsize=SMALL_PT, length=3)
        axis.xaxis.label.set_fontsize(TEXT_PT)
        axis.yaxis.label.set_fontsize(TEXT_PT)
        for side in ("top", "right"):
            axis.spines[side].set_visible(False)
    return figure


def handle(label: str, **style: Any) -> Any:
    """An entry of a legend."""
    from matplotlib.lines import Line2D

    return Line2D([], [], label=label, **style)
