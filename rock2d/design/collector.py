"""A data collector: at many stations along the slope, how many blocks come past, how high, how fast and how hard."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np

from rock2d.records.columns import UNRESOLVED_STOPS
from rock2d.runs.indicators.envelopes import (
    PERCENTILES,
    QUANTITIES,
    STATIONS,
    evenly_spread,
    passing_values,
)
from rock2d.runs.indicators.passing import passing_share
from rock2d.runs.simulation import Simulation
from rock2d.scene.cross_section import CrossSection
from rock2d.statistics import Estimate, percentile_estimate

Array = np.ndarray

BETWEEN = 2  # stations of the collector for each of the envelopes
AT_LINES = {"height_m": "passing_height_m"}  # what a quantity of the envelopes is called at a measure line


@dataclass(frozen=True)
class Passings:
    """What is known of the blocks of one kind that come past one station.

    Attributes
    ----------
    passed : how many
    frequency : their share of the releases
    values : quantity of the envelopes -> the value of each of these blocks, in ascending order
    """

    passed: int
    frequency: Estimate
    values: Mapping[str, Array]

    @cached_property
    def estimates(self) -> Mapping[str, list[Estimate]]:
        """Quantity of the envelopes -> an estimate for each of PERCENTILES, NaN of too few blocks."""
        return {
            name: [percentile_estimate(own, len(own), percentile) for percentile in PERCENTILES]
            for name, own in self.values.items()
        }


@dataclass(frozen=True)
class Station:
    """A place of the collector: an upright line at `x_m`, or a measure line with its foot there."""

    x_m: float
    zone: str
    line: str = ""
    of_block: dict[str, Passings] = field(default_factory=dict)


def collected(run: Simulation) -> list[Station]:
    """The stations of a run from left to right: those of the envelopes, some between them, and the measure lines.

    At a measure line the numbers are those of the tables `passing` and `crossings`, elsewhere those of `envelopes`.
    """
    x = evenly_spread(run.cross_section, BETWEEN * (STATIONS - 1) + 1)
    found = [Station(at, zone) for at, zone in zip(x.tolist(), zones_at(run.cross_section, x), strict=True)]
    for block, values in passing_values(run.tracks, x, run.cross_section, run.blocks, run.own_blocks).items():
        own = [track for track in run.tracks if track.block == block]
        cut = np.array([track.stop in UNRESOLVED_STOPS for track in own])
        seen = np.isfinite(values[:, :, 0])
        ranked = np.sort(values, axis=0)  # NaN last
        for s, station in enumerate(found):
            passed = int(seen[:, s].sum())
            share = Estimate(*passing_share(passed, int((cut & ~seen[:, s]).sum()), len(own)))
            of = {name: ranked[:passed, s, q] for q, name in enumerate(QUANTITIES)}
            station.of_block[block] = Passings(passed, share, of)
    return sorted([*found, *_line_stations(run)], key=lambda station: station.x_m)


def _line_stations(run: Simulation) -> list[Station]:
    ground, crossings = run.cross_section, run.to_pandas("crossings")
    found = {}
    for name, ends in ground.measure_lines.items():
        foot = ground.foot_and_head(ends)[0][:1]
        found[name] = Station(float(foot[0]), zones_at(ground, foot)[0], name)
    rows: list[Any] = list(run.to_pandas("passing").itertuples())
    for row in rows:
        own = crossings[(crossings["line"] == row.line) & (crossings["block"] == row.block)]
        of = {name: np.sort(own[AT_LINES.get(name, name)].to_numpy(float)) for name in QUANTITIES}
        share = Estimate(row.frequency, row.low95, row.high95)
        found[row.line].of_block[row.block] = Passings(int(row.passed), share, of)
    return list(found.values())


def zones_at(ground: CrossSection, x_m: Array) -> list[str]:
    """The zone of the surface at stations; where facets lie above one another, that of the highest."""
    (x0, y0), (x1, y1) = ground.points_m[:-1].T, ground.points_m[1:].T
    found = []
    for x in x_m:
        over = np.flatnonzero((np.minimum(x0, x1) <= x) & (x <= np.maximum(x0, x1)) & (x0 != x1))
        height = y0[over] + (x - x0[over]) / (x1[over] - x0[over]) * (y1[over] - y0[over])
        found.append(ground.zones[over[np.argmax(height)]] if len(over) else "")
    return found
