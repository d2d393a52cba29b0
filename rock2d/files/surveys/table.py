"""Profiles from tables of text: a column of stations and one of heights."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np

from rock2d.errors import InputError
from rock2d.files.surveys.profile import Profile, along_way, checked
from rock2d.files.text_files import is_number, read_text

# names of columns, those that say most first
STATION_COLUMNS = ("station_m", "station", "chainage_m", "chainage", "distance_m", "distance", "x_m", "x")
HEIGHT_COLUMNS = ("height_m", "height", "elevation_m", "elevation", "z_m", "z", "y_m", "y")
MAP_COLUMNS = (("x_m", "x"), ("y_m", "y"), ("z_m", "z"))  # a line on a map with heights
SEPARATORS = ";\t, "


def read_table(path: Path) -> Profile:
    """The profile of a text file with one point a line.

    Two numbers, or columns that a header names: a station and a height, in m, or x, y and z along a line on a map.
    Columns are separated by commas, semicolons, tabs or spaces; `#` begins a comment.

    Raises InputError with the line of the first mistake.
    """
    lines = [(n, line.split("#")[0].strip()) for n, line in enumerate(read_text(path).splitlines(), 1)]
    lines = [(n, line) for n, line in lines if line]
    if not lines:
        raise InputError("the file is empty; expected points", path, 1, 1, code="empty")
    separator = next((s for s in SEPARATORS if s in lines[0][1]), ",")
    rows = [(n, _cells(line, separator)) for n, line in lines]
    columns: tuple[int, ...] = (0, 1)
    if not all(map(is_number, rows[0][1])):
        columns = _columns(rows[0][1], path, rows[0][0])
        rows = rows[1:]
    points = []
    for n, cells in rows:
        try:
            points.append([float(cells[column]) for column in columns])
        except (ValueError, IndexError):
            hint = (
                "; write decimal points, not commas" if separator in "; \t" and "," in "".join(cells) else ""
            )
            found = separator.join(cells)[:60]
            raise InputError(
                f"expected numbers, found {found!r}{hint}", path, n, 1, code="bad_table"
            ) from None
    return checked(along_way(np.array(points).reshape(-1, len(columns))), f"table {path.name}")


def _cells(line: str, separator: str) -> list[str]:
    if separator == " ":
        return line.split()
    return [cell.strip() for cell in next(csv.reader([line], delimiter=separator))]


def _columns(header: list[str], path: Path, line: int) -> tuple[int, ...]:
    """Indices of the columns of station and height, or of x, y and z."""
    names = [name.lower() for name in header]
    on_map = [next((names.index(name) for name in choices if name in names), None) for choices in MAP_COLUMNS]
    if None not in on_map and not set(names) & set(STATION_COLUMNS[:6]):
        return tuple(i for i in on_map if i is not None)
    station = next((names.index(name) for name in STATION_COLUMNS if name in names), None)
    height = next((names.index(name) for name in HEIGHT_COLUMNS if name in names), None)
    if station is None or height is None:
        message = (
            f"expected columns of station and height (for example x and y), found {', '.join(header)[:80]!r}"
        )
        raise InputError(message, path, line, 1, code="bad_table")
    return station, height
