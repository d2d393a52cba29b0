"""Colour, line and marker of the experiment and the models; they can be distinguished in grey print too."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from rock2d.graphics.figure_style import SMALL_PT, finish
from rock2d.graphics.palette import BLOCK_COLOURS, MEASURED_COLOUR, SIMULATED_COLOUR

if TYPE_CHECKING:
    from matplotlib.figure import Figure

# name -> colour, line, marker
STYLES: dict[str, tuple[str, Any, str]] = {
    "experiment": (MEASURED_COLOUR, "-", "o"),
    "deterministic": (SIMULATED_COLOUR, "-", "D"),
    "probabilistic": (BLOCK_COLOURS[0], (0, (5, 1.6)), "s"),
}


def finish_with_legend(figure: Figure, handles: list[Any], columns: int, size_pt: float = SMALL_PT + 0.5) -> Figure:
    """The figure in the common style, with a legend of so many columns below it."""
    figure.legend(handles=handles, loc="outside lower center", ncols=columns, frameon=False, fontsize=size_pt)
    return finish(figure)
