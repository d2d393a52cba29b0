"""Points that another program tracked, in the units of its file, and reading them from text in columns."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rock2d.errors import InputError
from rock2d.files.checked_yaml import shown
from rock2d.files.experiment import finite_number

if TYPE_CHECKING:
    import pandas as pd

FRAME_TIME_TOLERANCE = 0.35  # largest distance of a time from its frame, in frames; programs round times


@dataclass(frozen=True)
class Points:
    """The points that one file holds.

    Attributes
    ----------
    path, line : the file, and the line of its header
    table : one row for each visible point: `track` (its name), `line` (in the file), `frame` (whole number) or `time`
        (in the file's unit, mostly s) or both, `u` and `v` (in the file's unit of length) and, if the file has them,
        `confidence` (0 to 1) and `theta_rad` (from u toward v)
    y : direction of the v axis, "up" or "down", if the format defines it; otherwise ""
    said : scale and time as stated in the file, for the user; "" if nothing"""

    path: Path
    line: int
    table: pd.DataFrame
    y: str = ""
    said: str = ""

    @classmethod
    def of_rows(cls, path: Path, line: int, rows: list[dict[str, Any]], *, y: str = "", said: str = "") -> Points:
        """Points of rows with the keys of `table`, without those whose u, v or theta is empty; raises `InputError`."""
        import pandas as pd

        table = pd.DataFrame(rows)
        table = table.dropna(subset=table.columns.intersection(["u", "v", "theta_rad"])).reset_index(drop=True)
        if table.empty:
            raise InputError("there is no point in the file", path, line)
        when = "frame" if "frame" in table else "time"
        wrong = table[when].isna() if when == "time" else table[when] % 1 != 0
        if wrong.any():
            row = table[wrong].iloc[0]
            raise InputError(f"column {when}: {row[when]:g} is no {when}", path, int(row["line"]))
        return cls(path, line, table, y, said)


def cells(line: str, separator: str) -> list[str]:
    """The cells of a line, without quotes and spaces around them; separators in quotes do not separate."""
    parts = line.split('"')
    parts[::2] = [part.replace(separator, "\n") for part in parts[::2]]
    return [cell.strip() for cell in "".join(parts).split("\n")]


def separator_of(header: str) -> str:
    """The separator of a header: the first tab, semicolon or comma outside quotes, or else a space."""
    return next((c for c in "".join(header.split('"')[::2]) if c in "\t;,"), " ")


def rows_of(text: str) -> list[tuple[int, list[str]]]:
    """(number of the line, cells) of each line that is not empty; the first one shows the separator."""
    lines = [(k, line) for k, line in enumerate(text.split("\n"), 1) if line.strip()]
    separator = separator_of(lines[0][1])
    return [(k, cells(line, separator)) for k, line in lines]


def number(cell: str, path: Path, line: int, column: str) -> float:
    """A number with a decimal point or comma, nan for an empty cell; raises `InputError` for anything else."""
    if cell in ("", "NaN", "nan"):
        return math.nan
    try:
        return finite_number(cell.replace(",", "."))
    except ValueError:
        raise InputError(f"column {column}: expected a number, found {shown(cell)}", path, line) from None
