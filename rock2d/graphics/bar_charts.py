"""Horizontal charts as inline SVG: markers with intervals, bars, spans.

Positions are percentages: a chart fills the available width, while markers and strokes keep their size."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from markupsafe import Markup

MARK_HEIGHT_PX = 12
WIDE_LABEL, NARROW_LABEL = 15.0, 24.0  # least distance of tick labels on a screen and on a phone, in % of the width
# centred on the origin; the shapes differ so that the chart can be read without colour
SHAPES = {
    "measured": "M-4,0a4,4 0 1,0 8,0a4,4 0 1,0 -8,0",
    "base": "M0,-5L5,0L0,5L-5,0Z",
    "effect": "M0,-5L5,4L-5,4Z",
    "plain": "M-4,0a4,4 0 1,0 8,0a4,4 0 1,0 -8,0",
}


@dataclass(frozen=True)
class Axis:
    """A scale from `low` to `high`: linear, or with `linear_to` nearly linear up to this magnitude and logarithmic
    beyond (asinh)."""

    low: float
    high: float
    linear_to: float = 0.0

    def at(self, value: float) -> float:
        """Position of a value in % of the width, limited to 0 and 100."""
        low, high, here = (self._scaled(v) for v in (self.low, self.high, value))
        return float(np.clip(100.0 * (here - low) / (high - low), 0.0, 100.0))

    def _scaled(self, value: float) -> float:
        return float(np.arcsinh(value / self.linear_to)) if self.linear_to else value

    def ticks(self) -> list[float]:
        """At most six round values on the axis."""
        if not self.linear_to:
            from matplotlib.ticker import MaxNLocator

            found = np.asarray(MaxNLocator(4, steps=[1, 2, 2.5, 5, 10]).tick_values(self.low, self.high))
        else:
            powers = 10.0 ** np.arange(np.ceil(np.log10(self.linear_to)), 12)
            found = np.concatenate([-powers[::-1], [0.0], powers])
        inside = [float(v) for v in found if self.low <= v <= self.high]
        while len(inside) > 6:
            keep = inside.index(0.0) % 2 if 0.0 in inside else 0  # keep zero
            inside = inside[keep::2]
        return inside


def axis_over(values: Sequence[float], *, zero: bool = True) -> Axis:
    """A linear axis that contains the finite `values`, and zero if `zero`, with a margin."""
    known = [v for v in values if np.isfinite(v)] + ([0.0] if zero else [])
    low, high = (min(known), max(known)) if known else (0.0, 1.0)
    room = 0.03 * (high - low) or 0.5 * abs(high) or 1.0
    return Axis(low if zero and low == 0.0 else low - room, high + room)


@dataclass(frozen=True)
class Mark:
    """One mark of a chart. Its `kind` is "point" (with a whisker from low to high), "bar" (from zero), "step" (a bar
    from low to high) or "span" (a line from low to high with a marker).

    `model` gives colour and shape ("measured" | "base" | "effect" | "plain"); `label` is the tooltip."""

    model: str
    value: float
    low: float
    high: float
    label: str
    kind: str = "point"


def bar(model: str, value: float, label: str) -> Mark:
    """A bar without an interval."""
    return Mark(model, value, value, value, label, "bar")


def share_mark(model: str, share: float, ci95: Sequence[float], label: str, kind: str = "point") -> Mark:
    """A share with its 95 % interval, in %."""
    low, high = ci95
    return Mark(model, 100.0 * share, 100.0 * low, 100.0 * high, label, kind)


def chart(axis: Axis, marks: Sequence[Mark]) -> Markup:
    """A chart with one row for each mark, from the top down."""
    from markupsafe import Markup, escape

    height = MARK_HEIGHT_PX * max(len(marks), 1) + 8
    parts = []
    for tick in axis.ticks():
        kind, x = "zero" if tick == 0 else "grid", f"{axis.at(tick):.2f}%"
        parts.append(f'<line class="{kind}" x1="{x}" x2="{x}" y1="0" y2="{height}"/>')
    for i, mark in enumerate(marks):
        y = 4 + MARK_HEIGHT_PX * (i + 0.5)
        low, value, high = (f"{axis.at(v):.2f}%" for v in (mark.low, mark.value, mark.high))
        shape = f'<svg x="{value}" y="{y}" overflow="visible"><path d="{SHAPES[mark.model]}"/></svg>'
        whisker = f'<line class="whisker" x1="{low}" x2="{high}" y1="{y}" y2="{y}"/>'
        if mark.kind == "bar":
            start, width = axis.at(0.0), axis.at(mark.value) - axis.at(0.0)
            body = f'<rect x="{min(start, start + width):.2f}%" width="{abs(width):.2f}%" y="{y - 4.5}" height="9"/>'
            if mark.low < mark.high:
                body += whisker
        elif mark.kind == "step":
            start, width = axis.at(mark.low), axis.at(mark.high) - axis.at(mark.low)
            body = f'<rect x="{start:.2f}%" width="{max(width, 0.0):.2f}%" y="{y - 5}" height="10"/>'
        elif mark.kind == "span":
            body = f'<line class="span" x1="{low}" x2="{high}" y1="{y}" y2="{y}"/>{shape}'
        else:
            body = whisker + shape
        parts.append(f'<g class="{mark.model}"><title>{escape(mark.label)}</title>{body}</g>')
    label = escape("; ".join(mark.label for mark in marks))
    head = f'<svg class="strip" role="img" aria-label="{label}" width="100%" height="{height}">'
    return Markup(f"{head}{''.join(parts)}</svg>")


def _apart(axis: Axis, ticks: Iterable[float], least: float, first: Iterable[float] = ()) -> list[float]:
    """Those of the ticks, in rising order, that are `least` % of a chart apart: `first` and zero come before others."""
    found = list(first)
    for tick in sorted(ticks, key=lambda t: t != 0):
        if all(abs(axis.at(tick) - axis.at(other)) >= least for other in found):
            found.append(tick)
    return sorted(found)


def tick_labels(axis: Axis) -> Markup:
    """The tick labels of the axis, as wide as a chart; none overlap. Labels that do not fit on a phone have the class
    "tight"."""
    from markupsafe import Markup

    labels: list[str] = []
    apart = _apart(axis, axis.ticks(), NARROW_LABEL)
    for tick in _apart(axis, axis.ticks(), WIDE_LABEL, apart):
        at = axis.at(tick)
        kind = "" if tick in apart else ' class="tight"'
        anchor = "start" if at < 4 else "end" if at > 96 else "middle"
        text = f"{tick:,.4g}".replace(",", " ").replace("-", "−")  # no-break space, minus
        labels.append(f'<text{kind} x="{at:.2f}%" y="12" text-anchor="{anchor}">{text}</text>')
    return Markup(f'<svg class="strip" aria-hidden="true" width="100%" height="16">{"".join(labels)}</svg>')
