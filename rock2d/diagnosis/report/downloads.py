"""Links to download the data of figures as CSV; the data are inside the page."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from rock2d.diagnosis.report.figures import Misses, Segment
from rock2d.diagnosis.report.practical_indicators import Quantity
from rock2d.graphics.clips import Clip
from rock2d.graphics.pages import Download, download

Array = np.ndarray


def section_data(misses: Misses, blocks: Sequence[str]) -> Download:
    """Place and residual of every impact of the cross-section's figure."""
    rows = [
        (blocks[b], *place, sigma)
        for b, place, sigma in zip(misses.block, misses.place_m, misses.sigma, strict=True)
    ]
    return download("impacts.csv", ("block", "x_m", "y_m", "residual_sigma"), rows)


def flights_data(flights: Sequence[Array]) -> Download:
    """Points of the flights in the figure of the cross-section."""
    rows = [(i, *place) for i, path in enumerate(flights) for place in path]
    return download("flights.csv", ("flight", "x_m", "y_m"), rows)


def content_data(content: Mapping[str, Any]) -> dict[str, Download]:
    """Places, probabilities, gains and gap of diagnosis.json."""
    cells = ("share", "z", "phase", "zone", "block", "channel")
    gap = content["gap"]
    chances = sorted(content["probabilities"].items(), key=lambda item: -item[1])
    effects = content["effects"].items()
    gains = [(name, e["heldout_score_gain"], e["heldout_score_gain_se"]) for name, e in effects]
    closures = [(name, e["closure"], *e["closure_ci95"]) for name, e in effects]
    keys = ("base", "augmented", "noise_floor", "closure")
    bounds = ("closure_low95", "closure_high95")
    ends = gap["closure_ci95"] or (None, None)
    return {
        "where_data": download("where.csv", cells, [[cell[key] for key in cells] for cell in content["where"]]),
        "chances_data": download("probabilities.csv", ("answer", "probability"), chances),
        "gains_data": download("gains.csv", ("effect", "heldout_score_gain", "heldout_score_gain_se"), gains),
        "gap_data": download("gap.csv", (*keys, *bounds), [[*(gap[key] for key in keys), *ends]]),
        "closures_data": download("closures.csv", ("effect", "closure", *bounds), closures),
    }  # fmt: skip


def parameters_data(content: Mapping[str, Any]) -> Download:
    """Parameters of the base law, and of every effect with the law fitted together with it."""
    rows: list[tuple[Any, ...]] = [
        ("base", key, value, None, None, "") for key, value in content["base"].items()
    ]
    for name, effect in content["effects"].items():
        rows += [(name, key, p["value"], *p["ci95"], p["unit"]) for key, p in effect["parameters"].items()]
        rows += [(name, key, value, None, None, "") for key, value in effect.get("base", {}).items()]
    return download("parameters.csv", ("model", "parameter", "value", "low95", "high95", "unit"), rows)


def quantity_data(quantity: Quantity, labels: Mapping[str, str]) -> Download:
    """A practical indicator with its intervals."""
    percentiles = quantity.percentiles or (None,)
    rows = [
        (row.block, row.place, labels[model], percentile, e.value, e.low, e.high, e.count)
        for row in quantity.rows
        for model, own in row.models.items()
        for percentile, e in zip(percentiles, own, strict=False)  # too few values have no estimates
    ]
    name = f"{quantity.title.lower().replace(' ', '_')}.csv"
    columns = (
        "block",
        "place",
        "model",
        "percentile",
        f"value ({quantity.unit})",
        "low95",
        "high95",
        "count",
    )
    return download(name, columns, rows)


def segment_data(segment: Segment, number: int, labels: Mapping[str, str]) -> Download:
    """Measured frames and predicted lines of one impact."""
    series = {labels["measured"]: segment.measured} | {labels[m]: rows for m, rows in segment.models.items()}
    rows = [(name, *row) for name, own in series.items() for row in own]
    return download(f"impact_{number}.csv", ("series", "t_s", "x_m", "y_m", "theta_rad"), rows)


def video_data(scenes: Sequence[Sequence[Sequence[Clip]]], titles: Sequence[str]) -> Download:
    """The motion of every block in the video."""
    rows = [
        (title, clip.label, *pose)
        for title, scene in zip(titles, scenes, strict=True)
        for panel in scene
        for clip in panel
        for pose in np.column_stack([clip.t_s, clip.x_m, clip.y_m, clip.theta_rad])
    ]
    return download("video.csv", ("scene", "series", "t_s", "x_m", "y_m", "theta_rad"), rows)
