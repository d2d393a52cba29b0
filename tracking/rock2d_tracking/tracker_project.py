"""Projects of Tracker (Open Source Physics), files `.trk`: the points marked in the film, and the calibration.

A project is XML: objects with named properties. `tracks` holds a list of objects; those of class `PointMass` are points
that were marked, by hand or by autotracking. Their `framedata` has an entry `[n]` for each frame n of the film in which
the point was marked, with `x` and `y` in pixels of the film, y downwards, counted from the upper left corner of the
first pixel. rock2d counts from its centre, so 0.5 is subtracted. `coords` has the calibration (`xscale` in px per unit
of length, `xorigin`, `yorigin`, `angle` in degrees), and `clipcontrol` the time between two frames in ms (`delta_t`).

Documented in the source of Tracker: `PointMass.Loader`, `ImageCoordSystem.Loader`, `XMLControlElement`."""

import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import Element, TreeBuilder
from xml.parsers import expat

from rock2d.errors import InputError
from rock2d.files.checked_yaml import shown
from rock2d_tracking.tracked_points import Points, number

LINE_ATTRIBUTE = "line"  # attribute of an element: its line in the file
LARGEST_FRAME_DIGITS = 9
PIXEL_CENTRE_PX = 0.5  # centre of the first pixel, as Tracker counts; 0 as rock2d does


def looks_like_project(text: str) -> bool:
    """If the text is XML; Tracker's export is not."""
    return text.lstrip().startswith("<")


def read_project(path: Path, text: str) -> Points:
    """The marked points in pixels, y downwards, with `frame`. Raises `InputError` with file and line."""
    root = _tree(path, text)
    if not root.get("class", "").endswith(".TrackerPanel"):
        raise InputError("this XML is no project of Tracker", path, int(root.get(LINE_ATTRIBUTE, 1)))
    rows: list[dict[str, Any]] = []
    names: set[str] = set()
    for mass in _point_masses(root):
        name = _text(mass, "name") or "point"
        if name in names:
            message = f"two tracks have the name {shown(name)}; rename one in Tracker"
            raise InputError(message, path, int(mass.get(LINE_ATTRIBUTE, 1)), code="duplicate", key=name)
        names.add(name)
        for entry in _property(mass, "framedata") or ():
            point = entry.find("object")
            if point is not None:  # a step without a point may have an empty entry
                rows.append({"track": name, **_marked(path, entry, point)})
    if not rows:
        raise InputError("there is no marked point mass in the project", path, 1, code="empty")
    return Points.of_rows(path, 1, rows, y="down", said=_calibration(root))


def _tree(path: Path, text: str) -> Element:
    """The elements of an XML text, each with its line. A document type, and so every entity, is refused: entities could
    expand without limit or refer to other files."""
    parser, builder = expat.ParserCreate(), TreeBuilder()

    def refuse(*_: object) -> None:
        raise InputError("a document type (<!DOCTYPE>) is not allowed", path, parser.CurrentLineNumber)

    def start(tag: str, attributes: dict[str, str]) -> None:
        builder.start(tag, attributes | {LINE_ATTRIBUTE: str(parser.CurrentLineNumber)})

    parser.StartDoctypeDeclHandler = refuse
    parser.StartElementHandler, parser.EndElementHandler = start, builder.end
    parser.CharacterDataHandler = builder.data
    try:
        parser.Parse(text.lstrip(), True)
    except expat.ExpatError as error:
        message = f"not XML: {expat.errors.messages[error.code]}"
        raise InputError(message, path, error.lineno, error.offset + 1) from None
    return builder.close()


def _property(element: Element, name: str) -> Element | None:
    return next((own for own in element.iterfind("property") if own.get("name") == name), None)


def _text(element: Element, name: str) -> str:
    found = _property(element, name)
    return (found.text or "").strip() if found is not None else ""


def _point_masses(root: Element) -> Iterator[Element]:
    tracks = _property(root, "tracks")
    for track in () if tracks is None else tracks.iterfind("property/object"):
        if track.get("class", "").endswith(".PointMass"):
            yield track


def _marked(path: Path, entry: Element, point: Element) -> dict[str, Any]:
    """Frame and place of one marked point."""
    line, index = int(entry.get(LINE_ATTRIBUTE, 1)), entry.get("name", "").strip("[]")
    if not (index.isascii() and index.isdigit() and len(index) <= LARGEST_FRAME_DIGITS):
        raise InputError(f"expected a frame [0], [1], ..., found {shown(entry.get('name'))}", path, line)
    u, v = (number(_text(point, axis), path, line, axis) - PIXEL_CENTRE_PX for axis in "xy")
    return {"line": line, "frame": int(index), "u": u, "v": v}


def _calibration(root: Element) -> str:
    """Scale, origin and time as stated in the project, for the set-up file."""
    parts = []
    coords = _property(root, "coords")
    own = None if coords is None else coords.find("object/property[@name='framedata']/property/object")
    if own is not None and all(0.0 < _float(own, name) < math.inf for name in ("xscale", "yscale")):
        unit = _text(root, "length_unit") or "unit of length"
        u, v = (_float(own, name) - PIXEL_CENTRE_PX for name in ("xorigin", "yorigin"))
        parts.append(
            f"{_float(own, 'xscale'):.6g} px per {unit}, origin at ({u:.6g}, {v:.6g}) px, axes turned by "
            f"{_text(own, 'angle')[:8] or '0'}°"
        )
    clip = _property(root, "clipcontrol")
    control = None if clip is None else clip.find("object")
    if control is not None and 0.0 < _float(control, "delta_t") < math.inf:
        parts.append(f"{1e3 / _float(control, 'delta_t'):.6g} frames/s")
    return f"the project states {', '.join(parts)}; the set-up file decides" if parts else ""


def _float(element: Element, name: str) -> float:
    """The number in a property; NaN if it is not a number."""
    try:
        return float(_text(element, name))
    except ValueError:
        return math.nan
