"""Compact data for the live views of pages, and the scripts that show them."""

import base64
import json
import zlib
from typing import Any

import numpy as np

from rock2d.arrays import Array
from rock2d.graphics.palette import DEEP_GROUND, INK, LINE_INK, SKY, zone_tones
from rock2d.graphics.rendering import asset
from rock2d.scene.cross_section import CrossSection

MOST_BYTES = 1_900_000  # largest size of the data in a page
STEPS = 65535  # steps of the 16-bit numbers of `packed_columns`


def live_assets(name: str) -> dict[str, str]:
    """The `script` and the style sheet `live_style` of a view: the common part, then the part of this view."""
    return {"script": asset("live.js") + asset(f"{name}.js"), "live_style": asset("live.css") + asset(f"{name}.css")}


def compact(data: Any) -> str:
    """JSON without spaces."""
    return json.dumps(data, separators=(",", ":"), allow_nan=False)


def in_page(data: Any) -> str:
    """JSON without "<", so that it can be part of an HTML page."""
    return compact(data).replace("<", "\\u003c")


def packed(raw: bytes) -> str:
    """Bytes as text: compressed by zlib, then in base64."""
    return base64.b64encode(zlib.compress(raw, 9)).decode()


def packed_columns(values: Array) -> tuple[bytes, list[list[float]]]:
    """Pack numbers (n, columns) as bytes; returns these, and the minimum and the range of each column.

    A number is its distance from the minimum in 1/STEPS of the range. For each column, the bytes are the high bytes
    (n,), then the low bytes (n,) of the differences to the previous row (modulo 2^16). These compress well if the
    numbers change little from row to row."""
    low = values.min(axis=0)
    span = np.maximum(np.ptp(values, axis=0), 1e-9)
    whole = np.round((values - low) / span * STEPS).astype(np.uint16)
    change = np.diff(whole, axis=0, prepend=np.zeros((1, values.shape[1]), np.uint16))
    rows = [part for column in change.T for part in (column >> 8, column & 255)]
    return np.array(rows, np.uint8).tobytes(), [[float(a), float(b)] for a, b in zip(low, span, strict=True)]


def live_scene(ground: CrossSection) -> dict[str, Any]:
    """The fixed parts of a live view: ground, zones, measure lines and colours."""
    tones = zone_tones(ground.zone_names)
    return {
        "ground": ground.points_m.tolist(), "tones": [tones[zone] for zone in ground.zones],
        "lines": [ends.tolist() for ends in ground.measure_lines.values()],
        "colours": {"deep": DEEP_GROUND, "sky": SKY, "ink": INK, "line": LINE_INK},
    }  # fmt: skip
