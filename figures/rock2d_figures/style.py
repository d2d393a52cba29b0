"""Colour, line and marker of the experiment and the models; they can be distinguished in grey print too."""

from __future__ import annotations

from typing import Any

import numpy as np

from rock2d.graphics.canvas import Viewport, fitted_view
from rock2d.graphics.palette import BLOCK_COLOURS, MEASURED_COLOUR, SIMULATED_COLOUR
from rock2d.scene.cross_section import CrossSection

# name -> colour, line, marker
STYLES: dict[str, tuple[str, Any, str]] = {
    "experiment": (MEASURED_COLOUR, "-", "o"),
    "deterministic": (SIMULATED_COLOUR, "-", "D"),
    "probabilistic": (BLOCK_COLOURS[0], (0, (5, 1.6)), "s"),
}
MARGIN_LEFT_M, MARGIN_RIGHT_M, MARGIN_BELOW_M = 0.12, 0.12, 0.02  # margins around ditch and embankment
SHOWN_LINE_LENGTH_M = 0.11  # longest drawn part of a measure line, so that its name stays in the picture


def spelled(name: str) -> str:
    """A name as readers see it."""
    return name.replace("_", " ")


def setup_view(cross_section: CrossSection, width_px: int) -> tuple[Viewport, float]:
    """The part of a set-up that figures show, and its height over its width."""
    rise = cross_section.embankment
    assert rise is not None
    limits = (
        -MARGIN_LEFT_M,
        float(cross_section.points_m[rise.crest_end, 0]) + MARGIN_RIGHT_M,
        -MARGIN_BELOW_M,
        2.4 * rise.height_m,
    )
    shape = (limits[3] - limits[2]) / (limits[1] - limits[0])
    return fitted_view(limits, width_px, round(width_px * shape)), shape


def with_short_lines(cross_section: CrossSection) -> CrossSection:
    """The cross-section with its measure lines cut at SHOWN_LINE_LENGTH_M from their first end."""
    lines = {}
    for name, (foot, head) in cross_section.measure_lines.items():
        away = head - foot
        lines[name] = np.stack([foot, foot + away * min(1.0, SHOWN_LINE_LENGTH_M / np.hypot(*away))])
    return CrossSection(cross_section.points_m, cross_section.zones, lines)
