"""DLTdv (Hedrick lab): the digitized image points, `*_xypts.csv`, of one or more cameras.

DLTdv5 to 7 write a line of names, `pt1_cam1_X,pt1_cam1_Y,pt1_cam2_X,...` (for one camera sometimes `pt1_X,pt1_Y`),
then a line for each frame with six decimals, NaN where a point was not digitized. There is no column for the frame: the
first line is frame 0 here, DLTdv's frame 1. DLTdv8 writes the same or, as `*_xypts.tsv`, its sparse form: the names,
the size of the table, then lines `row column value` from 1 on. Coordinates are pixels. Up to version 7 (and in Argus)
they are measured from the bottom of the image, y up; in version 8 from its top, y down. A file does not say which.

Documented in the source at github.com/tlhedrick/dltdv (`DLTdv7.m`, `sparseSave.m`) and at biomech.web.unc.edu/dltdv;
the two directions of y in the export formats of github.com/prnvkhndlwl/Kinetrace."""

import re
from pathlib import Path
from typing import Any

from rock2d.errors import InputError
from rock2d.files.checked_yaml import shown
from rock2d_tracking.importers import Importer
from rock2d_tracking.tracked_points import Points, number, rows_of

COLUMN_NAME = re.compile(r"(pt\d+(?:_cam\d+)?)_([XYZ])", re.IGNORECASE)


def looks_like(text: str) -> bool:
    """If the text begins with the name of a DLTdv point."""
    return COLUMN_NAME.match(text.lstrip().lstrip('"')) is not None


def read(path: Path, text: str) -> Points:
    """Points in pixels, tracks `pt1_cam1` or `pt1`, `frame` counted from 0. Raises `InputError` with file and line."""
    (top, header), *table = rows_of(text)
    tracks: dict[str, dict[str, int]] = {}
    for j, cell in enumerate(header):
        match = COLUMN_NAME.fullmatch(cell)
        if not match:
            raise InputError(f"column {shown(cell)}: expected names as pt1_cam1_X, pt1_cam1_Y", path, top)
        if match[2] in "Zz":
            raise InputError("these are points in space (xyzpts); choose the image points, xypts", path, top)
        tracks.setdefault(match[1], {})[match[2].upper()] = j
    for track, of in tracks.items():
        if len(of) != 2:
            raise InputError(f"point {track} has no column {track}_{'Y' if 'X' in of else 'X'}", path, top)
    if table and path.suffix == ".tsv" and len(table[0][1]) == 3:
        return Points.of_rows(path, top, _sparse(path, table[1:], tracks))
    rows: list[dict[str, Any]] = []
    for frame, (line, row) in enumerate(table):
        if len(row) != len(header):
            raise InputError(f"expected {len(header)} cells, found {len(row)}", path, line)
        for track, of in tracks.items():
            u, v = (number(row[of[axis]], path, line, header[of[axis]]) for axis in "XY")
            rows.append({"track": track, "line": line, "frame": frame, "u": u, "v": v})
    return Points.of_rows(path, top, rows)


def _sparse(path: Path, table: list[tuple[int, list[str]]], tracks: dict[str, dict[str, int]]) -> list[dict[str, Any]]:
    """Rows from lines `row column value`; a cell that has no line is a point that was not digitized."""
    values: dict[tuple[float, float], tuple[int, float]] = {}
    for line, entry in table:
        if len(entry) != 3:
            raise InputError(f"expected row, column and value, found {len(entry)} cells", path, line)
        row, column, value = (
            number(cell, path, line, name) for cell, name in zip(entry, ("row", "column", "value"), strict=True)
        )
        values[row - 1, column - 1] = (line, value)
    return [
        {"track": track, "line": line, "frame": frame, "u": u, "v": values[frame, of["Y"]][1]}
        for track, of in tracks.items()
        for (frame, column), (line, u) in values.items()
        if column == of["X"] and (frame, of["Y"]) in values
    ]


IMPORTER = Importer("DLTdv", looks_like, read)
