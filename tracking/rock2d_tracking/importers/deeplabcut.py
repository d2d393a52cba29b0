"""DeepLabCut: the CSV of an analysed video.

Three lines of headings, `scorer`, `bodyparts` and `coords`, or four with `individuals` for several animals; below,
one line per frame: its number from 0, then x, y and likelihood of each point, in pixels with y down. A point has a
position even where it is not visible. Its likelihood (0 to 1) is then low, and the user sets the limit (DeepLabCut's
`pcutoff`, 0.6 by default). Files of manual labels and of points in space (x, y, z) have the same headings; both are
refused.

Documented in DeepLabCut's user guide, "Analyze new Videos" (`save_as_csv`), deeplabcut.github.io/DeepLabCut."""

from pathlib import Path
from typing import Any

from rock2d.errors import InputError
from rock2d.files.checked_yaml import shown
from rock2d_tracking.importers import Importer
from rock2d_tracking.tracked_points import Points, number, rows_of

HEADING_LINES = ("scorer", "individuals", "bodyparts", "coords")
COORDINATE_KEYS = {"x": "u", "y": "v", "likelihood": "confidence"}


def looks_like(text: str) -> bool:
    """If the text begins with the line of the scorer."""
    return text.lstrip().lower().startswith("scorer")


def read(path: Path, text: str) -> Points:
    """Points in pixels, tracks `bodypart` or `individual/bodypart`, with `frame` and `confidence`.

    Raises `InputError` with file and line."""
    table = rows_of(text)
    headings = {row[0].lower(): (line, row) for line, row in table[:4] if row[0].lower() in HEADING_LINES}
    for name in ("bodyparts", "coords"):
        if name not in headings:
            raise InputError(f"no line {name}: expected the lines scorer, bodyparts, coords", path, table[0][0])
    top, coords = headings["coords"]
    for line, row in headings.values():
        if len(row) != len(coords):
            raise InputError(f"expected {len(coords)} cells, found {len(row)}", path, line)
    tracks: dict[str, dict[str, int]] = {}
    for j, coord in enumerate(coords[1:], 1):
        if coord == "z":
            raise InputError("these are points in space; choose the CSV of one camera's video", path, top)
        owner = [headings[name][1][j] for name in ("individuals", "bodyparts") if name in headings]
        if coord in COORDINATE_KEYS:
            tracks.setdefault("/".join(owner), {})[COORDINATE_KEYS[coord]] = j
    for track, of in tracks.items():
        if "u" not in of or "v" not in of:
            raise InputError(f"point {shown(track)} has no column {'x' if 'u' not in of else 'y'}", path, top)
    rows: list[dict[str, Any]] = []
    for line, row in table[len(headings) :]:
        if "/" in row[0] or "\\" in row[0] or "labeled-data" in row[0]:
            raise InputError("these are labels of images, for training; choose the CSV of a video", path, line)
        if len(row) != len(coords):
            raise InputError(f"expected {len(coords)} cells, found {len(row)}", path, line)
        frame = number(row[0], path, line, "frame")
        for track, of in tracks.items():
            values = {key: number(row[j], path, line, f"{track} {coords[j]}") for key, j in of.items()}
            rows.append({"track": track, "line": line, "frame": frame, **values})
    return Points.of_rows(path, top, rows)


IMPORTER = Importer("DeepLabCut", looks_like, read)
