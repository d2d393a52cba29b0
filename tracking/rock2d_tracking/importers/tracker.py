"""Tracker (Open Source Physics): exported delimited text, read and written; its projects (`.trk`), read.

File > Export > Data File writes the cells of a data table: a line with the name of the track (`mass_A` alone up to
version 5; later at the track's first column, as in `,mass A,,`), the names of the columns (`t`, `frame`, `x`, `y`,
`pixelx`, `pixely`, more), then a line per frame. Several tracks share a table: `#multi:`, a line with each name at its
first column, and repeated columns. Tabs, commas, semicolons or spaces separate, perhaps also at the end of a line;
numbers are `1.500000E-2`, by locale with a decimal comma; a frame that was not marked has empty cells; x and y are in
the calibrated unit. Only `t` is always exported, so frame numbers may be missing.

Documented in Tracker's help, "Tracker Files" (Saving data in a text file), "Datatable View" and "Data Track", and in
its source: `ExportDataDialog`, `TrackerIO.getData`, `ParticleDataTrack`. `DataTool.parseData` of the OSP library reads
text: a line with one entry names the track, the next the columns; a data track takes x, y and t, and a row per frame.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rock2d.errors import InputError
from rock2d.files.checked_yaml import shown
from rock2d.files.folders import check_own_file, write_whole
from rock2d.records.columns import POSE_NAMES
from rock2d_tracking.importers import Importer
from rock2d_tracking.tracked_points import FRAME_TIME_TOLERANCE, Points, cells, number, separator_of
from rock2d_tracking.tracker_project import looks_like_project, read_project

if TYPE_CHECKING:
    import pandas as pd

WRITTEN_COLUMNS = ("t", "frame", "x", "y", "theta_rad")


def looks_like(text: str) -> bool:
    """If the text has Tracker's line of column names, or is a project."""
    return looks_like_project(text) or _header(text.split("\n")) is not None


def read(path: Path, text: str) -> Points:
    """Points in calibrated units (pixels if only pixelx and pixely were exported); `time` in s and perhaps `frame`.
    Those of a project are in pixels, y downwards, with `frame`.

    `theta_rad` is read if the file is one of `write_tracker`. Raises `InputError` with file and line."""
    if looks_like_project(text):
        return read_project(path, text)
    lines = text.split("\n")
    at = _header(lines)
    if at is None:
        raise InputError("no line with the names of columns: expected t or frame, x and y", path, 1)
    separator = separator_of(lines[at])
    header = [_plain(cell) for cell in cells(lines[at], separator)]
    title = cells(lines[at - 1], separator) if at else []
    columns = _columns(header, [] if title[:1] and title[0].startswith(("#", "//")) else title, path)
    for track, of in columns.items():
        if "u" not in of or "v" not in of:
            raise InputError(f"track {shown(track)} has no column {'y' if 'u' in of else 'x'}", path, at + 1)
    rows: list[dict[str, Any]] = []
    for line, content in enumerate(lines[at + 1 :], at + 2):
        if not content.strip():
            continue
        row = cells(content, separator)
        if any(row[len(header) :]):
            raise InputError(f"expected {len(header)} cells, found {len(row)}", path, line)
        row += [""] * (len(header) - len(row))
        for track, of in columns.items():
            values = {key: number(row[j], path, line, header[j]) for key, j in of.items()}
            rows.append({"track": track, "line": line, **values})
    return Points.of_rows(path, at + 1, rows)


def write_tracker(path: str | Path, trajectories: pd.DataFrame, fps: float) -> list[Path]:
    """Write rows of `TRAJECTORY_COLUMNS` as text that Tracker opens as a data track (File > Import > Data Source).

    A data track has one start, so each release is a file: `path` itself for a single one, else `path` with `_` and the
    release number at its stem. Every frame from the first to the last has a line, lost ones with empty cells, since
    Tracker reads one line per frame. Lengths are in m, y up, theta in rad, numbers with all their digits. Returns the
    files written; raises `InputError` if a time is not that of a frame at `fps` (in 1/s)."""
    path = Path(path)
    several = trajectories["release"].nunique() > 1
    texts = {}
    for release, rows in trajectories.groupby("release", sort=False):
        name = f"{rows['block'].iloc[0]}_release_{release}".replace(" ", "_")
        lines = [name, "\t".join(WRITTEN_COLUMNS), *_frame_lines(rows, fps, f"release {release}")]
        texts[path.with_stem(f"{path.stem}_{release}") if several else path] = "\n".join(lines) + "\n"
    for target in texts:
        check_own_file(target, "\t".join(WRITTEN_COLUMNS))
    for target, text in texts.items():
        write_whole(target, text)
    return list(texts)


def _frame_lines(rows: pd.DataFrame, fps: float, release: str) -> list[str]:
    by_frame: dict[int, list[str]] = {}
    for t_s, *measured in rows[["t_s", *POSE_NAMES]].itertuples(index=False):
        frame = round(t_s * fps)
        if abs(t_s * fps - frame) > FRAME_TIME_TOLERANCE or frame in by_frame:
            raise InputError(f"{release}: t_s {t_s:g} is not that of a frame of its own at {fps:g} per s")
        values = ["" if value != value else repr(float(value)) for value in measured]
        by_frame[frame] = [repr(float(t_s)), str(frame), *values]
    every = range(min(by_frame), max(by_frame) + 1)
    return ["\t".join(by_frame.get(k) or [repr(k / fps), str(k), "", "", ""]) for k in every]


def _header(lines: list[str]) -> int | None:
    """Index of the line with the names of columns; it is among the first few."""
    for k, line in enumerate(lines[:20]):
        names = {_plain(cell) for cell in cells(line, separator_of(line))}
        if names & {"t", "frame"} and names & {"x", "y", "pixelx", "pixely"}:
            return k
    return None


def _plain(name: str) -> str:
    """The name of a column without its unit."""
    return re.split(r"[(\[]", name.lower())[0].strip()


def _columns(header: list[str], title: list[str], path: Path) -> dict[str, dict[str, int]]:
    """Track name -> what is read of it -> column. The time, and perhaps the frame, are common to all tracks."""
    only = [name for name in title if name]
    tracks: dict[str, dict[str, int]] = {}
    track = only[0] if only else path.stem
    for j, name in enumerate(header):
        if j < len(title) and title[j]:
            track = title[j]
        tracks.setdefault(track, {}).setdefault(name, j)
    common = {key: header.index(name) for key, name in (("time", "t"), ("frame", "frame")) if name in header}
    found = {}
    for name, of in tracks.items():
        u, v = ("x", "y") if "x" in of or "y" in of else ("pixelx", "pixely")
        read = {"frame": "frame", "u": u, "v": v, "theta_rad": "theta_rad"}
        found[name] = common | {key: of[column] for key, column in read.items() if column in of}
    return found


IMPORTER = Importer("Tracker", looks_like, read)
