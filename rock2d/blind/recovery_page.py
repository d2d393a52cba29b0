"""The results of a study of known causes: limits.json, and a page with its table and figure."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from rock2d.diagnosis.limits import LIMITS
from rock2d.diagnosis.report.limits_section import HEAD, limit_lines, limit_rows, limits_figure
from rock2d.diagnosis.report.text import number, spoken
from rock2d.files.folders import write_whole
from rock2d.graphics.pages import html_figure, html_list, html_page, html_table
from rock2d.scene.world import World

Cases = Sequence[Mapping[str, Any]]

PAGE = "limits.html"
CASE_HEAD = ("case", "put in", "size", "releases", "cut", "named", "found / expected", "false names")


def case_lines(cases: Cases, limits: Mapping[str, Any], tried: Sequence[str]) -> list[str]:
    """What became of the cases, and which effects no plausible size shows."""
    found = [case for case in cases if case["found"] is not None]
    lines = [f"{sum(case['seen'] for case in cases)} of {len(cases)} known causes were seen"]
    if found:
        off = np.median([abs(case["found"] - case["expected"]) / case["size"] for case in found])
        lines.append(f"their sizes are {100 * off:.0f} % off (median)")
    lines.append(f"names that are false: {sum(len(case['false']) for case in cases)}")
    hidden = [spoken(name) for name in tried if name not in limits]
    return lines + ([f"no plausible size would be seen of: {', '.join(hidden)}"] if hidden else [])


def write_recovery(
    world: World, cases: Cases, limits: Mapping[str, Mapping[str, Any]], tried: Sequence[str], out: Path
) -> list[str]:
    """Write limits.json and limits.html into a folder; returns the lines that say what they hold."""
    rows = [
        (
            case["case"], spoken(case["effect"]), number(case["size"]), str(case["releases"]), str(case["cut"]),
            "yes" if case["seen"] else "no",
            "" if case["found"] is None else f"{number(case['found'])} / {number(case['expected'])}",
            ", ".join(map(spoken, case["false"])),
        )
        for case in cases
    ]  # fmt: skip
    lines = case_lines(cases, limits, tried)
    figure = html_figure(
        "Sizes seen in 5 to 9 of 10 films (bar), upper limit (mark)", limits_figure(limits, world)
    )
    body = f"<h1>Which causes this film would show</h1>{html_list([*lines, *limit_lines(limits)])}{figure}"
    body += (
        html_table(limit_rows(limits), HEAD)
        + "<h2>Known causes that were put in</h2>"
        + html_table(rows, CASE_HEAD)
    )
    write_whole(out / LIMITS, json.dumps(limits, indent=1, allow_nan=False) + "\n")
    write_whole(out / PAGE, html_page("Which causes this film would show", body))
    return [*lines, *limit_lines(limits)]
