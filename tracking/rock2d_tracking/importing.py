"""Trajectories of an experiment from what other programs tracked in its films.

An importer (`rock2d_tracking.importers`, one module for each format) turns a file into `Points`, with the names, units
and frame numbers or times of the file. `import_tracks` turns points into trajectories. The user states what files do
not say reliably: the scale, the direction of y, and the frame rate of the camera (a slow-motion film is timed as it is
played back)."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from rock2d.errors import InputError
from rock2d.files.checked_yaml import did_you_mean, shown
from rock2d.files.experiment import LARGEST_NUMBER, TRAJECTORY_COLUMNS
from rock2d.files.text_files import read_text
from rock2d.scene.blocks import Block
from rock2d_tracking.camera import PixelMap
from rock2d_tracking.importers import find_importer, importer_names
from rock2d_tracking.tracked_points import FRAME_TIME_TOLERANCE, Points

if TYPE_CHECKING:
    import pandas as pd


@dataclass(frozen=True)
class TrackedFiles:
    """Files that another program wrote.

    Attributes
    ----------
    paths : one for each film
    kind : one of `importer_names()`
    y : "up" or "down", where the files' y grows"""

    paths: Sequence[str | Path]
    kind: str
    y: str


@dataclass(frozen=True)
class ImportOptions:
    """How tracks become releases.

    Attributes
    ----------
    marks : at most two tracks of points on the block; theta is the angle of the line from the first to the second. A
        film with one track needs none
    centroid : tracks whose mean is the centroid; the first mark if none
    file_fps : frames per unit of the files' time; needed, and used, only where a file has no frame numbers
    min_confidence : points below it were not seen; needed if the file states confidences (0 takes all)
    gap_frames : more lost frames in a row than this separate two releases; without it each film is one release"""

    marks: Sequence[str] = ()
    centroid: Sequence[str] = ()
    file_fps: float | None = None
    min_confidence: float | None = None
    gap_frames: int | None = None


def read_points(path: str | Path, kind: str) -> Points:
    """The points of a file; `kind` is one of `importer_names()`.

    Raises `InputError` with file and line; if the file is of another kind, the message says which."""
    kinds = importer_names()
    if kind not in kinds:
        raise InputError(f"kind: expected {', '.join(kinds)}, found {shown(kind)}{did_you_mean(kind, kinds)}")
    path = Path(path)
    text = read_text(path).replace("\r\n", "\n").replace("\r", "\n")
    importers = {name: find_importer(name) for name in kinds}
    if not text.strip():
        raise InputError(f"the file is empty; expected an export of {importers[kind].title}", path, 1)
    likely = [name for name, importer in importers.items() if importer.looks_like(text)]
    if likely and kind not in likely:
        raise InputError(f"this is no file of kind {kind}; it looks like {likely[0]}", path, 1)
    return importers[kind].read(path, text)


def import_tracks(
    files: TrackedFiles,
    camera: PixelMap,
    fps: float,
    block: Block,
    options: ImportOptions = ImportOptions(),
    *,
    report: Callable[[str], Any] = print,
) -> pd.DataFrame:
    """Trajectories of what was tracked in one or several films of releases of `block`.

    camera : map of the files' unit of length (a pixel, or the unit that the program was calibrated in); `up` as in
        the set-up, and turned round where the files' y grows upward
    fps : true frame rate of the camera in 1/s; `t_s` is frame / fps, whatever times the files hold

    Returns rows of `TRAJECTORY_COLUMNS`. A frame that lacks one of the points is a missing row. One mark alone shows no
    orientation: for a circle `theta_rad` is then NaN throughout, and `report` gets a remark about it. Any other block
    is refused, since rows without theta would count as lost.

    Raises `InputError`, with file and line, if the files or the statements about them cannot be right."""
    import pandas as pd

    if options.file_fps is not None and not 0 < options.file_fps <= LARGEST_NUMBER:
        raise InputError(f"file_fps: expected a positive number, found {shown(options.file_fps)}")
    if len(options.marks) > 2:
        raise InputError("marks: expected one or two; name points that show only the centroid in centroid")
    parts: list[pd.DataFrame] = []
    without_spin = False
    for path in files.paths:
        points = read_points(path, files.kind)
        if points.y and points.y != files.y:
            raise InputError(f"y grows {points.y}wards in this format: state y {points.y}", points.path, points.line)
        if points.said:
            report(points.said)
        frame, x_y_m, theta_rad = _motion(points, options, camera, block)
        if theta_rad is None:
            without_spin, theta_rad = True, np.full(len(frame), np.nan)
        longest_gap = math.inf if options.gap_frames is None else options.gap_frames
        splits = np.flatnonzero(np.diff(frame) - 1 > longest_gap) + 1
        for rows in np.split(np.arange(len(frame)), splits):
            columns = (len(parts), block.name, frame[rows] / fps, *x_y_m[rows].T, theta_rad[rows])
            parts.append(pd.DataFrame(dict(zip(TRAJECTORY_COLUMNS, columns, strict=True))))
    if without_spin:
        report(f"{block.name}: one mark shows no orientation; theta_rad stays empty and the spin is unknown")
    return pd.concat(parts, ignore_index=True)


def _tracks(points: Points, options: ImportOptions) -> dict[str, pd.DataFrame]:
    """Rows of `Points.table` of each track of a film, by frame number."""
    table = points.table.assign(frame=_frames(points, options.file_fps))
    twice = table.duplicated(["track", "frame"])
    if twice.any():
        row = table[twice].iloc[0]
        message = f"track {shown(row['track'])} has a second point in frame {row['frame']}"
        raise InputError(message, points.path, int(row["line"]))
    if "confidence" in table:
        if options.min_confidence is None:
            message = "the file states confidences: give min_confidence, below which a point was not seen"
            raise InputError(message, points.path, points.line)
        table = table[table["confidence"] >= options.min_confidence]
    return {name: table[table["track"] == name].set_index("frame") for name in dict.fromkeys(points.table["track"])}


def _frames(points: Points, file_fps: float | None) -> pd.Series:
    """The frame number of each row."""
    table = points.table
    if "frame" in table:
        return table["frame"].astype(np.int64)
    if file_fps is None:
        message = "the file has times but no frame numbers: give file_fps, the frames per unit of its time"
        raise InputError(message, points.path, points.line)
    frame = (table["time"] * file_fps).round()
    off = (table["time"] * file_fps - frame).abs() > FRAME_TIME_TOLERANCE
    if off.any():
        row = table[off].iloc[0]
        message = f"time {row['time']:g} falls between frames at file_fps {file_fps:g}, or is too coarse"
        raise InputError(message, points.path, int(row["line"]))
    return frame.astype(np.int64)


def _motion(
    points: Points, options: ImportOptions, world: PixelMap, block: Block
) -> tuple[np.ndarray, np.ndarray, np.ndarray | None]:
    """Frames (n,) that show all points needed, centroid (n, 2) in m, and theta (n,) in rad, None if unknown."""
    tracks, header = _tracks(points, options), (points.path, points.line)
    known = ", ".join(map(shown, tracks))
    if not options.marks and len(tracks) > 1:
        raise InputError(f"marks: name one or two of the tracks {known}", *header)
    marks = options.marks or list(tracks)
    centroid = options.centroid or marks[:1]
    for name in [*marks, *centroid]:
        if name not in tracks:
            message = f"no track {shown(name)}{did_you_mean(name, tracks)}; the tracks are {known}"
            raise InputError(message, *header)
    used = {name: tracks[name] for name in [*marks, *centroid]}
    states_theta = "theta_rad" in used[marks[0]]
    if len(marks) == 1 and not states_theta and block.shape != "circle":
        message = f"marks: one does not show the orientation of {block.name}, a {block.shape}; name two"
        raise InputError(message, *header)
    frame = np.array(sorted(set.intersection(*(set(table.index) for table in used.values()))), np.int64)
    if not frame.size:
        raise InputError(f"no frame shows {' and '.join(map(shown, used))}", *header)
    at_m = {name: world.to_world(table.loc[frame, ["u", "v"]].to_numpy()) for name, table in used.items()}
    x_y_m = np.mean([at_m[name] for name in centroid], axis=0)
    if len(marks) == 1:
        seen = used[marks[0]].loc[frame]
        return frame, x_y_m, world.angle_to_world(seen["theta_rad"].to_numpy()) if states_theta else None
    along = at_m[marks[1]] - at_m[marks[0]]
    same = frame[~along.any(axis=1)]
    if same.size:
        line = int(used[marks[1]].loc[same[0], "line"])
        raise InputError("both marks are at one point: their line has no direction", points.path, line)
    return frame, x_y_m, np.unwrap(np.arctan2(along[:, 1], along[:, 0]))
