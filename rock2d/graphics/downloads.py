"""Links that download a CSV whose data are inside the page."""

from __future__ import annotations

import base64
import csv
import io
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

SIGNIFICANT_DIGITS = 6
# a spreadsheet takes a text that begins with one of these as a formula
FORMULA_SIGNS = ("=", "+", "-", "@", "\t", "\r")


@dataclass(frozen=True)
class Download:
    """A link: file name, data URI and the number of rows without the header."""

    name: str
    href: str
    rows: int


def download(name: str, columns: Sequence[str], rows: Iterable[Sequence[Any]]) -> Download:
    """A CSV with a header. Numbers have SIGNIFICANT_DIGITS; missing numbers are empty cells."""
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
