"""A matplotlib figure that never reads text as mathematics."""

from typing import Any

from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine
from matplotlib.text import Text


class PlainFigure(Figure):
    """A figure that shows text unchanged: `$` in a name does not begin a formula."""

    def draw(self, renderer: Any) -> None:
        for text in self.findobj(Text):
            text.set_parse_math(False)
        layout = self.get_layout_engine()
        # `savefig` first calls `draw` only to compute the layout
        if isinstance(layout, ConstrainedLayoutEngine) and self.canvas.is_saving():
            for axes in self.axes:
                axes.apply_aspect()
            layout.execute(self)
            return
        super().draw(renderer)
