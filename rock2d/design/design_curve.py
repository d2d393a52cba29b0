"""The figure of a design: passing frequency against the varied size."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rock2d.graphics.figure_style import SMALL_PT, blank_figure, finish
from rock2d.graphics.palette import INK, LINE_INK, block_colours

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from rock2d.design.least_size import Answer


TICKS_PERCENT = (0, 0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 50, 100)


def design_figure(answer: Answer) -> Figure:
    """Median and band of the passing frequency of each block at every judged size, the target, and the least size that
    meets it."""
    from matplotlib.ticker import FuncFormatter, NullLocator

    figure = blank_figure(6.4, 4.0)
    axis = figure.subplots()
    sizes = [judged.size for judged in answer.judgements]
    for block, colour in block_colours(answer.judgements[0].median).items():
        low, median, high = (
            [100.0 * getattr(judged, bound)[block] for judged in answer.judgements]
            for bound in ("low", "median", "high")
        )
        axis.fill_between(sizes, low, high, color=colour, alpha=0.18, lw=0)
        axis.plot(sizes, median, "o-", color=colour, ms=3.5, lw=1.4, label=block)
    target = 100.0 * answer.target.frequency
    axis.axhline(target, color=INK, lw=1.0, ls=(0, (5, 2)))
    axis.annotate(
        f"target {target:.3g} %",
        (sizes[0], target),
        xytext=(0, 3),
        textcoords="offset points",
        fontsize=SMALL_PT,
    )
    axis.set_yscale("symlog", linthresh=max(target, 0.1))
    axis.set_ylim(0)
    top, linear = axis.get_ylim()[1], max(target, 0.1)
    axis.set_yticks([tick for tick in TICKS_PERCENT if tick == 0 or 0.2 * linear <= tick <= top], minor=False)
    axis.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axis.yaxis.set_minor_locator(NullLocator())
    if answer.least is not None:
        axis.axvline(answer.least, color=LINE_INK, lw=1.4)
        axis.annotate(
            f" {'≤ ' if answer.is_bound else ''}{answer.least:.4g}",
            (answer.least, axis.get_ylim()[1]),
            color=LINE_INK,
            va="top",
            fontsize=SMALL_PT + 1,
        )
    axis.set_xlabel(answer.place)
    band = f"{100 * (1 - answer.target.confidence):.3g} to {100 * answer.target.confidence:.3g} %"
    axis.set_ylabel(f"passes {answer.target.line} in % (median, {band})")
    axis.grid(color="#e4e4e4", lw=0.6)
    axis.legend(frameon=False, fontsize=SMALL_PT + 0.5)
    finish(figure, "Share of blocks that pass")
    return figure
