"""What the figures show, in words, for who cannot see them."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from rock2d.diagnosis.report import text
from rock2d.diagnosis.report.figures import MISS_CLASSES, Misses, Segment


def section_alt(misses: Misses, flights: int, shares: Mapping[str, float]) -> str:
    """Of the cross-section: how many impacts have which residuals, and the zones with the largest shares of the gap."""
    bounds = [*(least for least, _, _ in MISS_CLASSES), np.inf]
    counts = np.histogram(misses.sigma, bounds)[0]
    words = [
        f"{n} from {low:g} to {high:g} σ" for n, low, high in zip(counts, bounds, bounds[1:], strict=False)
    ]
    words[-1] = f"{counts[-1]} above {bounds[-2]:g} σ"
    drawn = f"{flights} measured flights and " if flights else ""
    said = f"The cross-section with {drawn}{len(misses.sigma)} impacts. Residuals of the base law: {', '.join(words)}."
    largest = sorted(shares.items(), key=lambda item: -item[1])[:3]
    parts = [f"{text.spoken(zone)} {100 * share:.0f} %" for zone, share in largest if share >= 0.005]
    return f"{said} Shares of the gap: {', '.join(parts)}." if parts else said


def segment_alt(segment: Segment, labels: Mapping[str, str]) -> str:
    """Of one impact: how far each model is from the film at the last measured frame."""
    seen = segment.measured[np.isfinite(segment.measured).all(axis=1)]
    t_s, *pose = seen[-1]
    parts = []
    for name, rows in segment.models.items():
        x, y, theta = (float(np.interp(t_s, rows[:, 0], rows[:, i])) for i in (1, 2, 3))
        away, turn = float(np.hypot(x - pose[0], y - pose[1])), abs(float(np.rad2deg(theta - pose[2])))
        parts.append(f"{labels[name]} {text.length(away)} and {turn:.1f}°")
    return (
        f"{segment.title.replace(chr(10), ', ')}. Path and angle of {len(seen)} measured frames and of the "
        f"predictions; distance from the film at the last frame: {', '.join(parts)}."
    )
