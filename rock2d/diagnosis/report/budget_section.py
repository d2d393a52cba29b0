"""The budget of the gap at the top of the report: a waterfall from the base law down to the floor, and one sentence."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from rock2d.diagnosis.budget import TRUE_FLOOR, TRUE_FLOOR_SD
from rock2d.diagnosis.model import is_factor
from rock2d.diagnosis.report import text
from rock2d.effects import catalogue
from rock2d.graphics.bar_charts import Axis, Mark, chart, tick_labels
from rock2d.graphics.downloads import download
from rock2d.wording import listed, spoken

if TYPE_CHECKING:
    from markupsafe import Markup

LEAST_SHOWN = 0.005  # share of the gap


def budget_section(content: Mapping[str, Any]) -> dict[str, Any]:
    """What the template shows of the budget; nothing where there is no gap to close."""
    gap, outside = content["gap"], content.get("outside")
    if outside is None or content["verdict"] == "none" or gap["noise_floor"] >= gap["base"]:
        return {"budget_rows": []}
    parts = _parts(content)
    axis, rows, at = Axis(0.0, 100.0), [], 0.0
    table: list[tuple[str, str, float, float | None, float | None]] = []
    for name, origin, share, ci95, model in parts:
        end = at + share
        rows.append((name, origin, _step(axis, at, end, model, name), _said(share, ci95)))
        table.append((name, origin, share, *(ci95 or (None, None))))
        at = end
    return {
        "budget_rows": rows,
        "budget_scale": tick_labels(axis),
        "budget_sentence": _sentence(content),
        "budget_data": download("budget.csv", ("part", "origin", "share", "low95", "high95"), table),
    }


def _parts(
    content: Mapping[str, Any],
) -> list[tuple[str, str, float, tuple[float, float] | None, str]]:
    """Parts of the gap in order: name, origin, share, 95 % interval, colour."""
    outside = content["outside"]
    found: list[tuple[str, str, float, tuple[float, float] | None, str]] = [
        (
            spoken(cause["effect"])
            + _size(cause)
            + (f" (or {listed(cause['group'], 'or')})" if cause["group"] else ""),
            cause["origin"],
            cause["closes"],
            tuple(cause["closes_ci95"]),
            "effect",
        )
        for cause in sorted(text.acting(content), key=lambda cause: -cause["closes"])
    ]
    learnt = outside["learnt"]
    if learnt is not None and learnt["closes"] >= LEAST_SHOWN:
        beside = f", with {listed(learnt['effects'])} (not certain)" if learnt["effects"] else ""
        what = f"learnt: {listed(learnt['changes'])}{beside}"
        found.append((what, "no name", learnt["closes"], _ends(learnt), "plain"))
    unlearnt = outside["share"] - (learnt["closes"] if learnt is not None else 0.0)
    if unlearnt >= LEAST_SHOWN:
        found.append(("dependence without a name", "not learnt", unlearnt, None, "plain"))
    rest = 1.0 - sum(part[2] for part in found)
    if rest >= LEAST_SHOWN:
        found.append(("not explained", "", rest, None, "base"))
    return found


def _size(cause: Mapping[str, Any]) -> str:
    """Its first parameter, unless that is a pure number."""
    first = catalogue()[cause["effect"]].parameters[0]
    pure = first.unit == "1" and not is_factor(first)
    return "" if pure else f" {text.size(first, cause['parameters'][first.name])}"


def _ends(part: Mapping[str, Any]) -> tuple[float, float]:
    low, high = part["closes_ci95"]
    return low, high


def _step(axis: Axis, start: float, end: float, model: str, name: str) -> Markup:
    """A bar from one share to the next."""
    mark = Mark(model, 100 * end, 100 * start, 100 * end, f"{name}: {round(100 * (end - start))} %", "step")
    return chart(axis, [mark])


def _said(share: float, ci95: tuple[float, float] | None) -> str:
    return f"{round(100 * share)} %".replace("-", "−") if ci95 is None else text.share_closed(share, ci95)


def _sentence(content: Mapping[str, Any]) -> str:
    gap, floor = content["gap"], content["floor"]
    lower = "near-replicates" if floor["replicates"] <= floor["regression"] else "the regression"
    return (
        f"The typical residual of the base law is {gap['base']:.2f} standard deviations of noise and soil. "
        f"A perfect model would leave {floor['used']:.2f} (near-replicates say {floor['replicates']:.2f}, a regression "
        f"says {floor['regression']:.2f}; the lower one less {100 * (1 - TRUE_FLOOR):.0f} % counts, here {lower}, "
        f"and is known to {100 * TRUE_FLOOR_SD:.0f} %). The difference is the gap, 100 %."
    )
