"""HTML with which results are displayed in a notebook."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure


def table_html(table: pd.DataFrame) -> str:
    """A small table; numbers with three significant digits."""
    return str(table.to_html(index=False, border=0, na_rep="", float_format=lambda value: f"{value:.3g}"))


def embedded_figure(figure: Figure) -> str:
    """An img element that holds the figure itself."""
    from rock2d.graphics.pages import embedded

    return f'<img src="{embedded(figure)}">'
