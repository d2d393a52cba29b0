"""A figure of matplotlib that shows every text as it is."""

from __future__ import annotations

from typing import Any

from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine
from matplotlib.text import Text


class PlainFigure(Figure):
    """A figure whose texts are shown as they are: a `$` in a name is no mathematics."""

    def draw(self, renderer: Any) -> None:
        for text in self.findobj(Text):
            text.set_parse_math(False)
        layout = self.get_layout_engine()
        # before it draws a figure into a file, `savefig` draws it for the sake of the layout alone
        if isinstance(layout, ConstrainedLayoutEngine) and self.canvas.is_saving():
            for axes in self.axes:
                axes.apply_aspect()
            layout.execute(self)
            return
        super().draw(renderer)
