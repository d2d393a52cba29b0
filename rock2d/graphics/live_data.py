"""Data for the live views of pages, small enough to travel inside a page, and the scripts that show them."""

from __future__ import annotations

import base64
import json
import zlib
from typing import Any

import numpy as np

from rock2d.graphics.palette import DEEP_GROUND, INK, LINE_INK, SKY
from rock2d.graphics.rendering import asset
from rock2d.graphics.scenery import zone_tones
from rock2d.scene.cross_section import CrossSection

Array = np.ndarray

STEPS = 65535  # values of a packed number


def live_assets(name: str) -> dict[str, str]:
    """The `script` and the style sheet `live_style` of a view: what all views share, then its own."""
    return {
        "script": asset("live.js") + asset(f"{name}.js"),
        "live_style": asset("live.css") + asset(f"{name}.css"),
    }


def compact(data: Any) -> str:
    """JSON without spaces."""
    return json.dumps(data, separators=(",", ":"), allow_nan=False)


def in_page(data: Any) -> str:
    """JSON that can stand in a page: it holds no "<"."""
    return compact(data).replace("<", "\\u003c")


def packed(raw: bytes) -> str:
    """Bytes as text: base64 of zlib."""
    return base64.b64encode(zlib.compress(raw, 9)).decode()


def packed_columns(values: Array) -> tuple[bytes, list[list[float]]]:
    """Numbers (n, columns), which change little from row to row, as bytes; least value and span of each column.

    For each column the high and the low byte (n,) of the differences to the row before (modulo 2^16), in 1/STEPS of the
    span.
    """
    low = values.min(axis=0)
    span = np.maximum(np.ptp(values, axis=0), 1e-9)
    whole = np.round((values - low) / span * STEPS).astype(np.uint16)
    change = np.diff(whole, axis=0, prepend=np.zeros((1, values.shape[1]), np.uint16))
    rows = [part for column in change.T for part in (column >> 8, column & 255)]
    return np.array(rows, np.uint8).tobytes(), [[float(a), float(b)] for a, b in zip(low, span, strict=True)]


def live_scene(ground: CrossSection) -> dict[str, Any]:
    """What stands still: ground, zones, measure lines, and the colours."""
    tones = zone_tones(ground)
    return {
        "ground": ground.points_m.tolist(), "tones": [tones[zone] for zone in ground.zones],
        "lines": [ends.tolist() for ends in ground.measure_lines.values()],
        "colours": {"deep": DEEP_GROUND, "sky": SKY, "ink": INK, "line": LINE_INK},
    }  # fmt: skip
