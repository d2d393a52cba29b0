"""Profiles from DXF drawings: the longest polyline, or the longest of one layer."""

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from rock2d.arrays import Array
from rock2d.errors import InputError, require
from rock2d.files.surveys.profile import PROFILE_EXTRA, Profile, checked_profile, station_and_height
from rock2d.files.text_files import require_regular

POLYLINES = "LWPOLYLINE POLYLINE"
NO_UNIT, METRE = 0, 6  # values of $INSUNITS, the unit of a drawing


def read_drawing(path: Path, layer: str | None = None) -> Profile:
    """The longest polyline of a DXF file, or chain of lines that meet end to end.

    If all points have the same z, x is the station and y the height. Otherwise it is a line on a map: the station is
    the distance along it, z the height.

    Raises InputError if the file is not DXF, if it states another unit than m, if there is no polyline (on this layer),
    or if the longest ones of several layers have the same length."""
    require("ezdxf", f"ezdxf is missing, which reads drawings: {PROFILE_EXTRA}")
    require_regular(path)
    document, damaged = _document(path)
    _check_metres(document, path)
    model = document.modelspace()
    polylines, lines = list(model.query(POLYLINES)), list(model.query("LINE"))
    layers = sorted({entity.dxf.layer for entity in [*polylines, *lines]})
    longest = {}
    for name in layers if layer is None else [layer]:
        found = [points for e in polylines if e.dxf.layer == name and len(points := _points(e)) > 1]
        found += _chains([_points(e) for e in lines if e.dxf.layer == name])
        if found:
            longest[name] = max(found, key=_length_m)
    if not longest:
        there = f"; layers with lines: {', '.join(layers)}" if layers else ""
        where = f" on layer {layer!r}" if layer is not None else ""
        raise InputError(f"no polyline{where}{there}", path, code="empty")
    greatest = max(map(_length_m, longest.values()))
    chosen = [name for name, points in longest.items() if math.isclose(_length_m(points), greatest)]
    if len(chosen) > 1:
        message = f"the longest lines of the layers {', '.join(chosen)} have the same length: choose one with --layer"
        raise InputError(message, path, code="bad_value")
    points = longest[chosen[0]]
    flat = np.ptp(points[:, 2]) == 0.0
    profile = checked_profile(points[:, :2] if flat else station_and_height(points), f"drawing {path.name}")
    remark = ("the drawing is damaged; this is what could be recovered",) if damaged else ()
    return replace(profile, remarks=(*remark, *profile.remarks))


def _document(path: Path) -> tuple[Any, bool]:
    """The drawing, and whether it is damaged. Of a damaged drawing what can be recovered."""
    import logging

    import ezdxf
    from ezdxf import recover

    logging.getLogger("ezdxf").setLevel(logging.ERROR)
    try:
        try:
            return ezdxf.readfile(path), False
        except (ezdxf.DXFError, UnicodeDecodeError, ValueError, TypeError):
            return recover.readfile(path)[0], True
    except (OSError, ezdxf.DXFError, UnicodeDecodeError, ValueError, TypeError) as error:
        raise InputError(f"no DXF drawing that can be read: {error}", path, code="bad_table") from None


def _check_metres(document: Any, path: Path) -> None:
    """Raise InputError for a drawing whose unit is another than m. Without a stated unit, it is in m."""
    from ezdxf.units import unit_name

    unit = document.header.get("$INSUNITS", NO_UNIT)
    if unit not in (NO_UNIT, METRE):
        message = (
            f"the unit of the drawing is {unit_name(unit)} ($INSUNITS = {unit}): expected metres; scale it to m, or if "
            f"its numbers are in m, set $INSUNITS to {METRE}"
        )
        raise InputError(message, path, code="bad_value")


def _length_m(points: Array) -> float:
    return float(np.hypot(*np.diff(points[:, :2], axis=0).T).sum())


def _chains(lines: list[Array]) -> list[Array]:
    """Polylines (n, 3) of lines (2, 3) that meet end to end."""
    import shapely

    merged = shapely.line_merge(shapely.MultiLineString([line for line in lines if np.ptp(line, axis=0).any()]))
    return [shapely.get_coordinates(row, include_z=True) for row in shapely.get_parts(merged) if not row.is_empty]


def _points(entity: Any) -> Array:
    """(n, 3) vertices."""
    if entity.dxftype() == "LWPOLYLINE":
        level = float(entity.dxf.elevation)
        return np.array([(x, y, level) for x, y in entity.get_points("xy")], float).reshape(-1, 3)
    if entity.dxftype() == "POLYLINE":
        return np.array([tuple(v.dxf.location) for v in entity.vertices], float).reshape(-1, 3)
    return np.array([tuple(entity.dxf.start), tuple(entity.dxf.end)], float)
