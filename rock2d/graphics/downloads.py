"""Data of a page as a link that downloads a CSV: the data are inside the page."""

from __future__ import annotations

import base64
import csv
import io
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

SIGNIFICANT_DIGITS = 6
FORMULA_SIGNS = (
    "=",
    "+",
    "-",
    "@",
    "\t",
    "\r",
)  # a text that begins with one would be a formula of a spreadsheet


@dataclass(frozen=True)
class Download:
    """A link: the name of the file, the data URI, the number of rows below the header."""

    name: str
    href: str
    rows: int


def download(name: str, columns: Sequence[str], rows: Iterable[Sequence[Any]]) -> Download:
    """A CSV with a header; numbers with SIGNIFICANT_DIGITS, missing ones empty."""
    buffer = io.StringIO()
    writer = csv.writer(buffer, lineterminator="\n")
    writer.writerow(columns)
    count = 0
    for row in rows:
        writer.writerow([_cell(value) for value in row])
        count += 1
    encoded = base64.b64encode(buffer.getvalue().encode()).decode()
    return Download(name, f"data:text/csv;charset=utf-8;base64,{encoded}", count)


def _cell(value: Any) -> str:
    if isinstance(value, (float, np.floating)):
        return f"{value:.{SIGNIFICANT_DIGITS}g}" if np.isfinite(value) else ""
    if isinstance(value, str) and value.startswith(FORMULA_SIGNS):
        return f"'{value}"
    return "" if value is None else str(value)
