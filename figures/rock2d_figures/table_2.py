"""Table 2: passing frequencies, experiment and four models."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import pandas as pd

from rock2d_figures.style import spelled


def markdown(table: pd.DataFrame) -> str:
    """`table` as `summary.passing_table` gives it, in Markdown: % [95 % interval], p of exact tests."""
    lines = [
        "| block | line | experiment | deterministic | p | probabilistic | p | paper, deterministic | p | "
        "paper, probabilistic | p |",
        "|---|---|---|---|---|---|---|---|---|---|---|",
    ]
    for row in table.to_dict("records"):
        cells = [row["block"], spelled(row["line"]), interval_text(row, "experiment")]
        for name in ("deterministic", "probabilistic"):
            cells += [interval_text(row, name), _p(row[f"{name}_p"])]
        for name in ("paper_deterministic", "paper_probabilistic"):
            cells += [f"{row[name]:.0f}", _p(row[f"{name}_p"])]
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines)


def interval_text(row: Mapping[Any, Any], name: str) -> str:
    """A frequency in % of a row of a table, with its 95 % interval: `name`, `name`_low95 and `name`_high95."""
    return f"{row[name]:.0f} [{row[f'{name}_low95']:.0f}, {row[f'{name}_high95']:.0f}]"


def _p(p: float) -> str:
    shown = f"{p:.3f}"
    return f"**{shown}**" if p < 0.05 else shown
