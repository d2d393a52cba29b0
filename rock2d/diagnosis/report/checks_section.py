"""The predictive checks in the report: each with its place among replicates of the diagnosed model."""

from __future__ import annotations

from typing import Any

from rock2d.diagnosis.checks import FALSE_ALARMS, Checks
from rock2d.graphics.bar_charts import Mark, axis_over, chart, tick_labels
from rock2d.graphics.downloads import download


def checks_sentence(checks: Checks) -> str:
    """How many checks are as the model would make them, and which are not."""
    every = checks.all
    failed = [f"{c.name} ({c.largest}, p {_chance(c.p)})" for c in every if c.fails]
    rest = f"; not: {', '.join(failed)}" if failed else ""
    return f"{len(every) - len(failed)} of {len(every)} as the model would make them{rest}"


def checks_section(checks: Checks | None) -> dict[str, Any]:
    """What the template shows of the checks."""
    if checks is None or not checks.all:
        return {"check_rows": []}
    axis = axis_over([v for c in checks.all for v in (c.value, c.replicates[2])])
    rows = []
    for c in checks.all:
        low, _, high = c.replicates
        said = f"{c.name}: {c.value:.1f}, replicates {low:.1f} to {high:.1f}"
        mark = Mark("base" if c.fails else "measured", c.value, low, high, said, "span")
        rows.append((c.name, c.largest, chart(axis, [mark]), _chance(c.p), c.fails))
    columns = ("check", "compared", "film", "replicates_05", "replicates_50", "replicates_95", "p")
    table = [(c.name, c.words, c.value, *c.replicates, c.p) for c in checks.all]
    return {
        "check_rows": rows,
        "check_scale": tick_labels(axis),
        "check_sentence": checks_sentence(checks),
        "check_chance": _chance(checks.p),
        "false_alarms": f"{100 * FALSE_ALARMS:.0f} %",
        "checks_data": download("checks.csv", columns, table),
    }


def _chance(p: float) -> str:
    return f"{p:.4f}" if p < 0.01 else f"{p:.2f}"
