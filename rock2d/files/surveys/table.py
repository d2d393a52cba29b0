"""Profiles from text tables: a column of stations and a column of heights."""

import csv
import math
import re
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from rock2d.errors import InputError
from rock2d.files.surveys.profile import Profile, checked_profile, station_and_height
from rock2d.files.text_files import read_text, reads_as_number

# Names of columns, the most specific first.
STATION_COLUMNS = ("station", "chainage", "distance", "x")
HEIGHT_COLUMNS = ("height", "elevation", "z", "y")
MAP_COLUMNS = ("x", "y", "z")  # a line on a map with heights
ZONE_COLUMNS = ("zone", "soil")
SEPARATORS = ";\t, "
METRES = ("", "m", "metre", "metres", "meter", "meters")  # units that a survey may state


def read_table(path: Path) -> Profile:
    """The profile of a text file with one point a line.

    A point is a station and a height in m, or x, y and z along a line on a map. Without a header, the first two columns
    are station and height. Columns are separated by commas, semicolons, tabs or spaces; `#` begins a comment. A header
    may give the unit, as in "station [m]". A remark names the columns that are not read; `zones.zones_of_points` reads
    the column of zones.

    Raises InputError with the line of the first mistake."""
    rows, separator = text_rows(path)
    columns: tuple[int, ...] = (0, 1)
    unread: list[str] = []
    width = len(rows[0][1])
    if not all(map(reads_as_number, rows[0][1])):
        line, header = rows.pop(0)
        for cell in header:
            if _has_decimal_comma(cell):
                number(cell, path, line)  # raises
        columns = profile_columns(header, path, line)
        read = {*columns, column_of(header, ZONE_COLUMNS) if len(columns) == 2 else None}
        unread = [name for i, name in enumerate(header) if i not in read]
    elif len(rows[0][1]) > len(columns):
        message = f"{len(rows[0][1])} columns without names: begin the file with a line that names them, for example "
        raise InputError(f"{message}station,height or x,y,z", path, rows[0][0], 1, code="bad_table")
    points = []
    for line, cells in rows:
        if len(cells) <= max(columns) or any(cells[width:]):  # empty cells may follow
            found = separator.join(cells)[:60]
            hint = "; write decimal points, not commas" if len(cells) > width and separator == "," else ""
            message = f"expected {width} columns as in the first line, found {found!r}{hint}"
            raise InputError(message, path, line, 1, code="bad_table")
        points.append([number(cells[column], path, line) for column in columns])
    points_m = station_and_height(np.array(points).reshape(-1, len(columns)))
    profile = checked_profile(points_m, f"table {path.name}")
    if unread:
        profile = replace(profile, remarks=(*profile.remarks, f"columns that are not read: {', '.join(unread)}"))
    return profile


def text_rows(path: Path) -> tuple[list[tuple[int, list[str]]], str]:
    """Line number and cells of each line that is not empty, without comments, and the separator of the cells. Raises
    InputError if the file is empty."""
    lines = [(n, line.split("#")[0].strip()) for n, line in enumerate(read_text(path).splitlines(), 1)]
    lines = [(n, line) for n, line in lines if line]
    if not lines:
        raise InputError("the file is empty", path, 1, 1, code="empty")
    separator = next((s for s in SEPARATORS if s in lines[-1][1]), ",")
    return [(n, _cells(line, separator)) for n, line in lines], separator


def number(cell: str, path: Path, line: int) -> float:
    """The finite number in a cell. Raises InputError with the line if there is none."""
    if reads_as_number(cell) and math.isfinite(float(cell)):
        return float(cell)
    hint = "; write decimal points, not commas" if _has_decimal_comma(cell) else ""
    raise InputError(f"expected numbers, found {cell[:60]!r}{hint}", path, line, 1, code="bad_table")


def _has_decimal_comma(cell: str) -> bool:
    return "," in cell and reads_as_number(cell.replace(",", ".", 1))


def column_of(header: Sequence[str], choices: Sequence[str]) -> int | None:
    """Index of the column named by the first of the choices that the header has, with or without a unit, which
    `check_metres` checks; None if there is none."""
    names = [name.partition("[")[0].partition("(")[0].strip().lower() for name in header]
    names = [name.removesuffix("_m") for name in names]
    return next((names.index(name) for name in choices if name in names), None)


def _cells(line: str, separator: str) -> list[str]:
    if separator == " ":
        return line.split()
    return [cell.strip() for cell in next(csv.reader([line], delimiter=separator))]


def profile_columns(header: list[str], path: Path, line: int) -> tuple[int, ...]:
    """Indices of the columns of station and height, or of x, y and z. Raises InputError if one is missing, or not in
    m."""
    on_map = [column_of(header, (name,)) for name in MAP_COLUMNS]
    columns = [column_of(header, names) for names in (STATION_COLUMNS, HEIGHT_COLUMNS)]
    if None not in on_map and column_of(header, STATION_COLUMNS[:-1]) is None:
        columns = on_map
    found = tuple(column for column in columns if column is not None)
    if len(found) < len(columns):
        message = f"expected columns of station and height (for example x and y), found {', '.join(header)[:80]!r}"
        raise InputError(message, path, line, 1, code="bad_table")
    check_metres([header[column] for column in found], path, line)
    return found


def check_metres(names: Sequence[str], path: Path, line: int) -> None:
    """Raise InputError if one of the names of columns states another unit than m, as in "station [km]"."""
    for name in names:
        unit = re.search(r"[\[(]\s*(.*?)\s*[\])]", name)
        if unit and unit[1].lower() not in METRES:
            message = f"column {name!r}: expected metres; write the numbers in m"
            raise InputError(message, path, line, 1, code="bad_table")
