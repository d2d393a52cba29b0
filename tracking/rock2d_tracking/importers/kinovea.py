"""Kinovea: trajectories exported as CSV or as text for gnuplot.

CSV (from 0.9.6): a line `"Time","Ball/0/X","Ball/0/Y",...`, then one line per time, empty where a track has no point.
Text (`.txt`, all versions): `#Kinovea Trajectory data export`, `#T X Y`, then for each track `# name` (none in old
versions) and lines `time x y`; a blank line ends a track. Cells may be quoted. The decimal separator is a point or a
comma, by locale or preference; with a comma the cells of a CSV are separated by semicolons. Coordinates are in the
calibrated unit with y up or, if so chosen, in pixels with y down.

Times are in the timecode of the preferences: s rounded to ms (`0.033`), `h:mm:ss:cc`, ms, or frame numbers. They are
true only if the capture frame rate was set in Kinovea, and the file states no rate: `file_fps` is that capture rate
if it was set, else the rate of the video file (1 if times are frame numbers).

Documented in Kinovea's manual, "Exporting data and measurements", and in its source: `ExporterCSV`,
`ExporterTXTTrajectory`, `CSVHelper`, `Metadata.GetNumericalTime`, `kva2txt-en.xsl`."""

import re
from pathlib import Path
from typing import Any

from rock2d.errors import InputError
from rock2d.files.checked_yaml import shown
from rock2d_tracking.importers import Importer
from rock2d_tracking.tracked_points import Points, number, rows_of

TEXT_TITLE = "#kinovea"
TIMECODE = re.compile(r"(-?)(\d+):(\d\d):(\d\d)[:.,](\d+)")
COORDINATE_NAME = re.compile(r"(?:(.*?)(?:/0)?/)?([XY])")


def looks_like(text: str) -> bool:
    """If the text begins as one of Kinovea's exports."""
    first = text.lstrip().split("\n")[0].lower()
    return first.startswith(TEXT_TITLE) or re.match(r'"?time\b', first) is not None


def read(path: Path, text: str) -> Points:
    """Points in the unit of the export; `time` in s if the file says so, else in the unit of the export.

    Raises `InputError` with file and line."""
    if text.lstrip().lower().startswith(TEXT_TITLE):
        return _read_text(path, text)
    return _read_csv(path, text)


def _read_csv(path: Path, text: str) -> Points:
    (top, header), *table = rows_of(text)
    if not header[0].lower().startswith("time"):
        raise InputError(f"expected Time as the first column, found {shown(header[0])}", path, top)
    in_s = 1e-3 if "(ms)" in header[0] else 1.0
    tracks: dict[str, dict[str, int]] = {}
    for j, cell in enumerate(header[1:], 1):
        match = COORDINATE_NAME.fullmatch(cell)
        if not match:
            message = f"column {shown(cell)} is no coordinate: expected a track's NAME/X and NAME/Y"
            raise InputError(f"{message}; export the trajectories, not a diagram's data", path, top)
        tracks.setdefault(match[1] or path.stem, {})[match[2]] = j
    for track, of in tracks.items():
        if len(of) != 2:
            raise InputError(f"track {shown(track)} has no column {'Y' if 'X' in of else 'X'}", path, top)
    rows: list[dict[str, Any]] = []
    for line, row in table:
        if len(row) != len(header):
            hint = "; decimal commas need semicolons or quotes between them" if len(row) > len(header) else ""
            raise InputError(f"expected {len(header)} cells, found {len(row)}{hint}", path, line)
        time = _time(row[0], path, line) * in_s
        for track, of in tracks.items():
            u, v = (number(row[of[axis]], path, line, header[of[axis]]) for axis in "XY")
            rows.append({"track": track, "line": line, "time": time, "u": u, "v": v})
    return Points.of_rows(path, top, rows)


def _read_text(path: Path, text: str) -> Points:
    rows: list[dict[str, Any]] = []
    name, nameless = "", 0
    for line, content in enumerate(text.split("\n"), 1):
        words = content.split()
        if content.startswith("# "):
            name = content[2:].strip()
        elif not words:
            name = ""
        elif not content.startswith("#"):
            if not name:
                nameless += 1
                name = f"track {nameless}"
            if len(words) < 3 or len(words) % 2 == 0:
                raise InputError(f"expected a time, x and y, found {len(words)} cells", path, line)
            time = _time(words[0], path, line)
            for k in range(1, len(words), 2):  # an object of several points has them side by side
                u, v = (number(word, path, line, axis) for word, axis in zip(words[k : k + 2], "xy", strict=True))
                track = name if k == 1 else f"{name}/{k // 2}"
                rows.append({"track": track, "line": line, "time": time, "u": u, "v": v})
    return Points.of_rows(path, 1, rows)


def _time(cell: str, path: Path, line: int) -> float:
    """A number, or the seconds of a timecode h:mm:ss:cc (or :mmm)."""
    match = TIMECODE.fullmatch(cell)
    if not match:
        return number(cell, path, line, "time")
    sign, hours, minutes, seconds, fraction = match.groups()
    time_s = 3600 * int(hours) + 60 * int(minutes) + int(seconds) + int(fraction) / 10 ** len(fraction)
    return -time_s if sign else time_s


IMPORTER = Importer("Kinovea", looks_like, read)
