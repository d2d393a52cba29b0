"""Sections of the report: the budget of the gap, from the base law to the floor; the predictive checks; and the limits,
the sizes of each effect that the film would have shown."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from rock2d.diagnosis.budget import TRUE_FLOOR_RATIO, TRUE_FLOOR_SD
from rock2d.diagnosis.checks import FALSE_ALARMS, Checks
from rock2d.diagnosis.detection import EXPECTED
from rock2d.diagnosis.known_causes import largest_size, size_parameter
from rock2d.diagnosis.model import is_factor
from rock2d.diagnosis.report import text
from rock2d.effects import catalogue
from rock2d.graphics.bar_charts import Axis, Mark, axis_over, chart, tick_labels
from rock2d.graphics.pages import PAGE_ACCENT, PAGE_INK, PAGE_WARM, blank_axes, download, embedded
from rock2d.scene.world import World
from rock2d.wording import listed, number, spoken

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Limits = Mapping[str, Mapping[str, Any]]

LEAST_SHOWN = 0.005  # smallest share of the gap that is shown
LEARNT_ORIGIN = "learnt from the film"
STUDIED = "Known causes of known size were added to this film and searched for."  # otherwise: `EXPECTED`
LIMIT_COLUMNS = ("effect", "size", "seen in 5 of 10", "seen in 9 of 10", "at most (95 %)")


def budget_section(content: Mapping[str, Any]) -> dict[str, Any]:
    """Template variables of the budget; no rows if there is no gap to close."""
    gap, outside = content["gap"], content.get("outside")
    if outside is None or content["verdict"] == "none" or gap["noise_floor"] >= gap["base"]:
        return {"budget_rows": []}
    axis, rows, at = Axis(0.0, 100.0), [], 0.0
    table: list[tuple[Any, ...]] = []
    for name, origin, share, ci95, model in _parts(content):
        start, at = at, at + share
        label = f"{name}: {round(100 * (at - start))} %"
        bar = chart(axis, [Mark(model, 100 * at, 100 * start, 100 * at, label, "step")])
        shown = text.share_closed(share, ci95) if ci95 else f"{round(100 * share)} %".replace("-", "−")
        rows.append((name, origin, bar, shown))
        table.append((name, origin, share, *(ci95 or (None, None))))
    return {
        "budget_rows": rows,
        "budget_scale": tick_labels(axis),
        "budget_sentence": _sentence(content),
        "budget_data": download("budget.csv", ("part", "origin", "share", "low95", "high95"), table),
    }


def _parts(content: Mapping[str, Any]) -> list[tuple[str, str, float, Sequence[float] | None, str]]:
    """Parts of the gap in order: name, origin, share, 95 % interval, colour."""
    outside = content["outside"]
    causes = sorted(text.model_causes(content), key=lambda cause: -cause["closes"])
    found: list[tuple[str, str, float, Sequence[float] | None, str]] = [
        (cause_name(cause), cause["origin"], cause["closes"], cause["closes_ci95"], "effect") for cause in causes
    ]
    unlearnt, learnt = outside["share"], outside["learnt"]
    if learnt is not None:
        unlearnt -= learnt["closes"]
        if learnt["closes"] >= LEAST_SHOWN:
            closes = learnt["closes"], learnt["closes_ci95"]
            found.append((learnt_name(learnt), LEARNT_ORIGIN, *closes, "plain"))
    if unlearnt >= LEAST_SHOWN:
        found.append(("dependence without a name", "not learnt", unlearnt, None, "plain"))
    rest = 1.0 - sum(part[2] for part in found)
    if rest >= LEAST_SHOWN:
        found.append(("not explained", "", rest, None, "base"))
    return found


def learnt_name(learnt: Mapping[str, Any]) -> str:
    """The learnt changes, and the effects that are not certain with which they were fitted."""
    beside = f", with {listed(learnt['effects'])} (not certain)" if learnt["effects"] else ""
    return f"learnt: {listed(learnt['changes'])}{beside}"


def cause_name(cause: Mapping[str, Any]) -> str:
    """A cause with its size, and the effects that these data cannot distinguish from it. The size is its first
    parameter, unless this is a number without a unit."""
    first = catalogue()[cause["effect"]].parameters[0]
    pure = first.unit == "1" and not is_factor(first)
    size = "" if pure else f" {text.size_words(first, cause['parameters'][first.name])}"
    rivals = f" (or {listed(cause['group'], 'or')})" if cause["group"] else ""
    return spoken(cause["effect"]) + size + rivals


def _sentence(content: Mapping[str, Any]) -> str:
    gap, floor = content["gap"], content["floor"]
    lower = "near-replicates" if floor["replicates"] <= floor["regression"] else "the regression"
    return (
        f"The typical residual of the base law is {gap['base']:.2f} standard deviations of noise and soil. "
        f"A perfect model would leave {floor['used']:.2f}: the lower one of two estimates, here that of {lower}, less "
        f"{100 * (1 - TRUE_FLOOR_RATIO):.0f} % and known to {100 * TRUE_FLOOR_SD:.0f} % (near-replicates: "
        f"{floor['replicates']:.2f}, regression: {floor['regression']:.2f}). The difference is the gap, 100 %."
    )


def checks_sentence(checks: Checks) -> str:
    """The number of checks that agree with the model, and those that do not."""
    every = checks.all
    failed = [f"{c.name} ({c.largest}, p {p_text(c.p)})" for c in every if c.fails]
    rest = f"; not: {', '.join(failed)}" if failed else ""
    return f"{len(every) - len(failed)} of {len(every)} as the model would make them{rest}"


def checks_section(checks: Checks | None) -> dict[str, Any]:
    """Template variables of the checks."""
    if checks is None or not checks.all:
        return {"check_rows": []}
    axis = axis_over([v for c in checks.all for v in (c.value, c.replicates[2])])
    rows = []
    for c in checks.all:
        low, _, high = c.replicates
        words = f"{c.name}: {c.value:z.1f}, replicates {low:z.1f} to {high:z.1f}"
        mark = Mark("base" if c.fails else "measured", c.value, low, high, words, "span")
        rows.append((c.name, c.largest, chart(axis, [mark]), p_text(c.p), c.fails))
    columns = ("check", "compared", "film", "replicates_05", "replicates_50", "replicates_95", "p")
    table = [(c.name, c.words, c.value, *c.replicates, c.p) for c in checks.all]
    return {
        "check_rows": rows,
        "check_scale": tick_labels(axis),
        "check_sentence": checks_sentence(checks),
        "check_chance": p_text(checks.p),
        "false_alarms": f"{100 * FALSE_ALARMS:.0f} %",
        "checks_data": download("checks.csv", columns, table),
    }


def p_text(p: float) -> str:
    """A p value as text."""
    if p < 0.0001:
        return "below 0.0001"
    return f"{p:.4f}" if p < 0.01 else f"{p:.2f}"


def limit_rows(limits: Limits) -> list[tuple[str, ...]]:
    """Texts for each effect, in the order of `LIMIT_COLUMNS`."""
    rows = []
    for name, limit in limits.items():
        own, cells = catalogue()[name].parameters[0], []
        for key in ("seen50", "seen90", "upper95"):
            value, unit = text.in_degrees(own, limit[key] or 0.0)
            cells.append("found" if limit[key] is None else f"{number(value)} {unit}".strip())
        off = "" if own.neutral == 0.0 else f", off {number(own.neutral)}"
        rows.append((spoken(name), own.meaning + off, *cells))
    return rows


def limit_lines(limits: Limits) -> list[str]:
    """The limits in sentences."""
    return [
        f"{name} of {more} ({what}) would have been seen in 9 of 10 such films; "
        + ("it was found" if most == "found" else f"none was found, so it is at most {most}")
        for name, what, _, more, most in limit_rows(limits)
    ]


def limits_figure(limits: Limits, world: World) -> Figure:
    """Bars from the size seen in 5 of 10 films to that seen in 9 of 10, and a mark at the upper limit, as shares of the
    largest plausible size."""
    figure, (axis,) = blank_axes(7.0, 0.8 + 0.24 * len(limits))
    for row, (name, limit) in enumerate(limits.items()):
        own = size_parameter(catalogue()[name], world)
        ends = [100.0 * limit[key] / largest_size(own) for key in ("seen50", "seen90")]
        axis.plot(ends, [row, row], color=PAGE_ACCENT, linewidth=6, solid_capstyle="butt")
        if limit["upper95"] is not None:
            most = 100.0 * limit["upper95"] / largest_size(own)
            axis.plot([most], [row], marker="|", color=PAGE_WARM, markersize=10)
    axis.set_yticks(range(len(limits)), [spoken(name) for name in limits], color=PAGE_INK)
    axis.invert_yaxis()
    axis.set_xscale("log")
    axis.xaxis.set_major_formatter("{x:g}")
    axis.xaxis.set_minor_formatter("")
    axis.set_xlabel("size in % of the largest plausible one")
    return figure


def limits_section(content: Mapping[str, Any], world: World) -> dict[str, Any]:
    """Template variables of the limits in diagnosis.json."""
    own = content.get("limits") or {}
    return {
        "limit_lines": limit_lines(own),
        "limit_head": LIMIT_COLUMNS,
        "limit_rows": limit_rows(own),
        "limits_figure": embedded(limits_figure(own, world), "svg") if own else "",
        "limits_from": EXPECTED if EXPECTED in content["assumptions"] else STUDIED,
    }
