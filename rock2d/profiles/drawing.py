"""Profiles from DXF drawings: the longest polyline, or the longest of one layer."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from rock2d.errors import InputError
from rock2d.files.text_files import require_regular
from rock2d.profiles.profile import EXTRA, Profile, along_way, checked

Array = np.ndarray

KINDS = "LWPOLYLINE POLYLINE LINE"


def read_drawing(path: Path, layer: str | None = None) -> Profile:
    """The longest polyline of a DXF file. One in a plane is read as drawn: x is the station, y the height. One whose
    points differ in z is a line on a map: the station is the way along it, z the height.

    Raises InputError if the file is no DXF, or if there is no polyline (on this layer).
    """
    try:
        import ezdxf
    except ImportError:
        raise InputError(
            f"ezdxf is missing, which reads drawings: {EXTRA}", code="missing_package", package="ezdxf"
        ) from None
    require_regular(path)
    try:
        document = ezdxf.readfile(path)
    except (OSError, ezdxf.DXFError, UnicodeDecodeError, ValueError) as error:
        raise InputError(f"no DXF drawing that can be read: {error}", path, code="bad_table") from None
    lines = {entity: _points(entity) for entity in document.modelspace().query(KINDS)}
    layers = sorted({entity.dxf.layer for entity in lines})
    found = [
        points for entity, points in lines.items() if layer in (None, entity.dxf.layer) and len(points) > 1
    ]
    if not found:
        there = f"; layers with lines: {', '.join(layers)}" if layers else ""
        where = f" on layer {layer!r}" if layer is not None else ""
        raise InputError(f"no polyline{where}{there}", path, code="empty")
    longest = max(found, key=lambda points: float(np.hypot(*np.diff(points[:, :2], axis=0).T).sum()))
    flat = np.ptp(longest[:, 2]) == 0.0
    return checked(longest[:, :2] if flat else along_way(longest), f"drawing {path.name}")


def _points(entity: Any) -> Array:
    """(n, 3) vertices."""
    if entity.dxftype() == "LWPOLYLINE":
        level = float(entity.dxf.elevation)
        return np.array([(x, y, level) for x, y in entity.get_points("xy")], float).reshape(-1, 3)
    if entity.dxftype() == "POLYLINE":
        return np.array([tuple(v.dxf.location) for v in entity.vertices], float).reshape(-1, 3)
    return np.array([tuple(entity.dxf.start), tuple(entity.dxf.end)], float)
