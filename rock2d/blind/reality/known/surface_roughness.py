"""Rough surface: each impact draws a slope, or the ground has a rough profile."""

from __future__ import annotations

from rock2d.blind.reality.cause import Cause, Rng
from rock2d.blind.reality.scale import Scale


def sizes(form: int, share: float, rng: Rng, scale: Scale) -> dict[str, float]:
    if form == 0:
        return {"sd_rad": 0.2 * share}
    return {"sd_rad": 0.2 * share, "spacing_m": 1.5 * scale.size, "profile": float(rng.integers(1 << 30))}


CAUSE = Cause(sizes, forms=2, draw_order=7)
