"""The limits of a report: which sizes of each effect the film would have shown, as table, words and figure."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from rock2d.diagnosis.known_causes import largest_size, size_parameter
from rock2d.diagnosis.report.text import in_degrees
from rock2d.effects import catalogue
from rock2d.graphics.pages import PAGE_ACCENT, PAGE_INK, PAGE_WARM, blank_axes, embedded
from rock2d.scene.world import World
from rock2d.wording import number, spoken

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Limits = Mapping[str, Mapping[str, Any]]

HEAD = ("effect", "size", "seen in 5 of 10", "seen in 9 of 10", "at most (95 %)")


def limit_rows(limits: Limits) -> list[tuple[str, ...]]:
    """A row `HEAD` of texts for each effect."""
    rows = []
    for name, limit in limits.items():
        own, cells = catalogue()[name].parameters[0], []
        for key in ("seen50", "seen90", "upper95"):
            value, unit = in_degrees(own, limit[key] or 0.0)
            cells.append("found" if limit[key] is None else f"{number(value)} {unit}".strip())
        off = "" if own.neutral == 0.0 else f", off {number(own.neutral)}"
        rows.append((spoken(name), own.meaning + off, *cells))
    return rows


def limit_lines(limits: Limits) -> list[str]:
    """What the limits mean, for an engineer."""
    return [
        f"{name} of {more} ({what}) would have been seen in 9 of 10 such films; "
        + ("it was found" if most == "found" else f"none was found, so it is at most {most}")
        for name, what, _, more, most in limit_rows(limits)
    ]


def limits_figure(limits: Limits, world: World) -> Figure:
    """Bars from the size that is seen in 5 of 10 films to that in 9 of 10, and a mark at the upper limit, all over the
    largest plausible size."""
    figure, (axis,) = blank_axes(7.0, 0.8 + 0.24 * len(limits))
    for row, (name, limit) in enumerate(limits.items()):
        own = size_parameter(catalogue()[name], world)
        assert own is not None
        ends = [100.0 * limit[key] / largest_size(own) for key in ("seen50", "seen90")]
        axis.plot(ends, [row, row], color=PAGE_ACCENT, linewidth=6, solid_capstyle="butt")
        if limit["upper95"] is not None:
            axis.plot(
                [100.0 * limit["upper95"] / largest_size(own)],
                [row],
                marker="|",
                color=PAGE_WARM,
                markersize=10,
            )
    axis.set_yticks(range(len(limits)), [spoken(name) for name in limits], color=PAGE_INK)
    axis.invert_yaxis()
    axis.set_xscale("log")
    axis.xaxis.set_major_formatter("{x:g}")
    axis.xaxis.set_minor_formatter("")
    axis.set_xlabel("size in % of the largest plausible one")
    return figure


def limits_section(content: Mapping[str, Any], world: World) -> dict[str, Any]:
    """What the template shows of the limits of diagnosis.json."""
    own = content.get("limits") or {}
    return {
        "limit_lines": limit_lines(own),
        "limit_head": HEAD,
        "limit_rows": limit_rows(own),
        "limits_figure": embedded(limits_figure(own, world), "svg") if own else "",
    }
