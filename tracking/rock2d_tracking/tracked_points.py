"""Points that another program tracked, in the units of its file."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rock2d.errors import InputError

if TYPE_CHECKING:
    import pandas as pd

FRAME_TIME_TOLERANCE = 0.35  # frames between a time and its frame: programs print times rounded


@dataclass(frozen=True)
class Points:
    """The points that one file holds.

    Attributes
    ----------
    path, line : the file, and the line of its header
    table : one row a point that was seen: `track` (its name), `line` (in the file), `frame` or `time` or both (a whole
        number; in the file's unit, mostly s), `u` and `v` (in the file's unit of length) and, where the file has them,
        `confidence` (0 to 1) and `theta_rad` (from u toward v)
    y : where v grows, "up" or "down", if the format fixes it; else ""
    said : what the file states of its own scale and time, for the user; "" if nothing
    """

    path: Path
    line: int
    table: pd.DataFrame
    y: str = ""
    said: str = ""

    @classmethod
    def seen(
        cls, path: Path, line: int, rows: list[dict[str, Any]], *, y: str = "", said: str = ""
    ) -> Points:
        """Points of rows with the keys of `table`, without those whose u, v or theta is empty; raises `InputError`."""
        import pandas as pd

        table = pd.DataFrame(rows)
        table = table.dropna(subset=table.columns.intersection(["u", "v", "theta_rad"])).reset_index(
            drop=True
        )
        if table.empty:
            raise InputError("there is no point in the file", path, line)
        when = "frame" if "frame" in table else "time"
        wrong = table[when].isna() if when == "time" else table[when] % 1 != 0
        if wrong.any():
            row = table[wrong].iloc[0]
            raise InputError(f"column {when}: {row[when]:g} is no {when}", path, int(row["line"]))
        return cls(path, line, table, y, said)
