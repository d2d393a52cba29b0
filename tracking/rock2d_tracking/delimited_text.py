"""Text in columns: cells, separators and numbers, with a decimal point or a decimal comma."""

from __future__ import annotations

import math
from pathlib import Path

from rock2d.errors import InputError
from rock2d.files.checked_yaml import shown
from rock2d.files.experiment import LARGEST


def cells(line: str, separator: str) -> list[str]:
    """The cells of a line, without quotes and spaces around them; separators in quotes do not separate."""
    parts = line.split('"')
    parts[::2] = [part.replace(separator, "\n") for part in parts[::2]]
    return [cell.strip() for cell in "".join(parts).split("\n")]


def separator_of(header: str) -> str:
    """The separator of a header: the first tab, semicolon or comma outside quotes, or else a space."""
    return next((c for c in "".join(header.split('"')[::2]) if c in "\t;,"), " ")


def number(cell: str, path: Path, line: int, column: str) -> float:
    """A number with a decimal point or comma, nan for an empty cell; raises `InputError` for anything else."""
    if cell in ("", "NaN", "nan"):
        return math.nan
    try:
        value = float(cell.replace(",", "."))
    except ValueError:
        value = math.nan
    # float() also takes infinity, 1_000 and digits of other scripts
    if not abs(value) <= LARGEST or "_" in cell or not cell.isascii():
        raise InputError(f"column {column}: expected a number, found {shown(cell)}", path, line)
    return value
