"""What other programs tracked in a film, as the rows of an experiment.

A reader (`tracker_text`, `kinovea`, `dltdv`, `deeplabcut`) turns a file into `Points`, with the file's own names, units
and frame numbers or times; `import_tracks` turns points into trajectories. What no file can be trusted to say is asked
for: the scale, the direction of y, and the camera's frame rate, for a slow-motion film is timed as it is played back.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from rock2d.errors import InputError
from rock2d.files.checked_yaml import did_you_mean, read_text, shown
from rock2d.files.experiment import LARGEST, TRAJECTORY_COLUMNS
from rock2d.scene.blocks import Block
from rock2d_tracking.camera import PixelMap

if TYPE_CHECKING:
    import pandas as pd

KINDS = ("tracker", "kinovea", "dltdv", "deeplabcut")
OFF_FRAME = 0.35  # frames by which a time may miss its frame, for times are printed rounded


@dataclass(frozen=True)
class Points:
    """The points that one file holds.

    Attributes
    ----------
    path, line : the file, and the line of its header
    table : one row a point that was seen: `track` (its name), `line` (in the file), `frame` or `time` or both (a whole
        number; in the file's unit, mostly s), `u` and `v` (in the file's unit of length) and, where the file has them,
        `confidence` (0 to 1) and `theta_rad` (from u toward v)
    """

    path: Path
    line: int
    table: pd.DataFrame

    @classmethod
    def seen(cls, path: Path, line: int, rows: list[dict[str, Any]]) -> Points:
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
        return cls(path, line, table)


def read_points(path: str | Path, kind: str) -> Points:
    """The points of a file; `kind` is one of `KINDS`.

    Raises `InputError` with file and line; if the file is of another kind, it says which.
    """
    from rock2d_tracking.importers import deeplabcut, dltdv, kinovea, tracker_text

    readers = dict(zip(KINDS, (tracker_text, kinovea, dltdv, deeplabcut), strict=True))
    if kind not in readers:
        raise InputError(f"expected {', '.join(KINDS)}, found {shown(kind)}{did_you_mean(kind, KINDS)}")
    path = Path(path)
    text = read_text(path).replace("\r\n", "\n").replace("\r", "\n")
    if not text.strip():
        raise InputError(f"the file is empty; expected what {kind} exports", path, 1)
    likely = [name for name, reader in readers.items() if reader.looks_like(text)]
    if likely and kind not in likely:
        raise InputError(f"this is no file of kind {kind}; it looks like {likely[0]}", path, 1)
    return readers[kind].read(path, text)


def import_tracks(
    paths: str | Path | Iterable[str | Path | Sequence[str | Path]], kind: str, *,
    metres_per_unit: float, y: str, fps: float, block: Block,
    marks: Sequence[str] = (), centroid: Sequence[str] = (),
    origin: tuple[float, float] = (0.0, 0.0), origin_m: tuple[float, float] = (0.0, 0.0),
    file_fps: float | None = None, min_confidence: float | None = None,
    gap_frames: int | None = None, first_release: int = 0, report: Callable[[str], Any] = print,
) -> pd.DataFrame:  # fmt: skip
    """Trajectories of what was tracked in one or several films.

    Parameters
    ----------
    paths : one entry a film: its file, or several files that each hold some of its tracks; or a single file
    metres_per_unit : length in m of the file's unit (a pixel, or what the program was calibrated in)
    y : "up" or "down", where the file's y grows
    fps : the camera's true frame rate in 1/s; `t_s` = frame / fps, whatever the file's times are
    block : what was released
    marks : tracks of points on the block; theta is the angle of the line from the first to the second. None are needed
        if the film has one track
    centroid : tracks whose mean is the centroid; the first mark if none
    origin, origin_m : a point in the file's units, and where it is in the world, in m
    file_fps : frames per unit of the file's time: needed, and used, only where a file has no frame numbers
    min_confidence : a point below it was not seen; needed if the file states confidences (0 takes all)
    gap_frames : more lost frames in a row than this separate two releases; without it each film is one release
    first_release : number of the first release
    tell : hears what a person should know about the result

    Returns
    -------
    Rows of `TRAJECTORY_COLUMNS`. A frame that lacks one of the points is a missing row. One mark alone shows no
    orientation: for a circle `theta_rad` is then 0 throughout, and `report` hears of it; rows with an empty theta would
    count as lost, so any other block is refused.

    Raises `InputError`, with file and line, if the files or what is said of them cannot be right.
    """
    import pandas as pd

    for name, value in {"metres_per_unit": metres_per_unit, "fps": fps, "file_fps": file_fps}.items():
        if value is not None and not 0 < value <= LARGEST:
            raise InputError(f"{name}: expected a positive number, found {shown(value)}")
    if len(marks) > 2:
        raise InputError("expected one or two marks; points that only tell the centroid belong to centroid")
    if y not in ("up", "down"):
        raise InputError(f"y: expected up or down (where the file's y grows), found {shown(y)}")
    world = PixelMap(metres_per_unit, origin, origin_m, up=1 if y == "up" else -1)
    films = [paths] if isinstance(paths, (str, Path)) else list(paths)
    if not films or not all(films):
        raise InputError("expected at least one file to import")
    parts: list[pd.DataFrame] = []
    without_spin = False
    for film in films:
        files = [film] if isinstance(film, (str, Path)) else film
        tracks = _tracks([read_points(path, kind) for path in files], file_fps, min_confidence)
        frame, x_y_m, theta_rad = _motion(tracks, world, block, marks, centroid)
        if theta_rad is None:
            without_spin, theta_rad = True, np.zeros(len(frame))
        splits = np.flatnonzero(np.diff(frame) - 1 > (math.inf if gap_frames is None else gap_frames)) + 1
        for rows in np.split(np.arange(len(frame)), splits):
            release = first_release + len(parts)
            columns = (release, block.name, frame[rows] / fps, *x_y_m[rows].T, theta_rad[rows])
            parts.append(pd.DataFrame(dict(zip(TRAJECTORY_COLUMNS, columns, strict=True))))
    if without_spin:
        report(
            f"{block.name}: theta_rad is 0, for one mark shows no orientation; of its spin nothing is known"
        )
    return pd.concat(parts, ignore_index=True)


def _tracks(points: list[Points], file_fps: float | None, min_confidence: float | None) -> dict[str, Points]:
    """The points of each track of a film, by frame number."""
    tracks: dict[str, Points] = {}
    for part in points:
        table = part.table.assign(frame=_frames(part, file_fps))
        twice = table.duplicated(["track", "frame"])
        if twice.any():
            row = table[twice].iloc[0]
            message = f"track {shown(row['track'])} has a second point in frame {row['frame']}"
            raise InputError(message, part.path, int(row["line"]))
        if "confidence" in table:
            if min_confidence is None:
                message = "the file says how sure each point is: give min_confidence, the least to be taken"
                raise InputError(message, part.path, part.line)
            table = table[table["confidence"] >= min_confidence]
        for name in dict.fromkeys(part.table["track"]):
            if name in tracks:
                raise InputError(f"track {shown(name)} is also in {tracks[name].path}", part.path, part.line)
            tracks[name] = Points(part.path, part.line, table[table["track"] == name].set_index("frame"))
    return tracks


def _frames(points: Points, file_fps: float | None) -> pd.Series:
    """The frame number of each row."""
    table = points.table
    if "frame" in table:
        return table["frame"].astype(np.int64)
    if file_fps is None:
        message = "the file has times but no frame numbers: give file_fps, the frames per unit of its time"
        raise InputError(message, points.path, points.line)
    frame = (table["time"] * file_fps).round()
    off = (table["time"] * file_fps - frame).abs() > OFF_FRAME
    if off.any():
        row = table[off].iloc[0]
        message = f"time {row['time']:g} falls between frames at file_fps {file_fps:g}, or is too coarse"
        raise InputError(message, points.path, int(row["line"]))
    return frame.astype(np.int64)


def _motion(
    tracks: Mapping[str, Points], world: PixelMap, block: Block, marks: Sequence[str], centroid: Sequence[str]
) -> tuple[np.ndarray, np.ndarray, np.ndarray | None]:
    """Frames (n,) that show all points needed, centroid (n, 2) in m, and theta (n,) in rad if it can be known."""
    first, known = next(iter(tracks.values())), ", ".join(map(shown, tracks))
    if not marks and len(tracks) > 1:
        raise InputError(f"name the marks: there is {known}", first.path, first.line)
    marks = marks or list(tracks)
    centroid = centroid or marks[:1]
    for name in [*marks, *centroid]:
        if name not in tracks:
            message = f"no track {shown(name)}{did_you_mean(name, tracks)}; there is {known}"
            raise InputError(message, first.path, first.line)
    used = {name: tracks[name].table for name in [*marks, *centroid]}
    states_theta = "theta_rad" in used[marks[0]]
    if len(marks) == 1 and not states_theta and block.shape != "circle":
        message = f"one mark does not show the orientation of {block.name}, a {block.shape}; name two"
        raise InputError(message, first.path, first.line)
    frame = np.array(sorted(set.intersection(*(set(table.index) for table in used.values()))), np.int64)
    if not frame.size:
        raise InputError(f"no frame shows {' and '.join(map(shown, used))}", first.path, first.line)
    at_m = {name: world.to_world(table.loc[frame, ["u", "v"]].to_numpy()) for name, table in used.items()}
    x_y_m = np.mean([at_m[name] for name in centroid], axis=0)
    if len(marks) == 1:
        seen = used[marks[0]].loc[frame]
        return frame, x_y_m, world.angle_to_world(seen["theta_rad"].to_numpy()) if states_theta else None
    along = at_m[marks[1]] - at_m[marks[0]]
    same = frame[~along.any(axis=1)]
    if same.size:
        line = int(used[marks[1]].loc[same[0], "line"])
        raise InputError(
            "both marks are at one point: their line has no direction", tracks[marks[1]].path, line
        )
    return frame, x_y_m, np.unwrap(np.arctan2(along[:, 1], along[:, 0]))


def cells(line: str, separator: str) -> list[str]:
    """The cells of a line, without quotes and spaces around them; a separator in quotes is none."""
    parts = line.split('"')
    parts[::2] = [part.replace(separator, "\n") for part in parts[::2]]
    return [cell.strip() for cell in "".join(parts).split("\n")]


def separator_of(header: str) -> str:
    """The first tab, semicolon or comma outside quotes; a space if there is none."""
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
