"""The data collector: number, height, speed and energy of the passing blocks at many stations along the slope."""

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
    evenly_spaced,
    passing_values,
)
from rock2d.runs.indicators.passing import passing_share
from rock2d.runs.simulation import Simulation
from rock2d.scene.cross_section import CrossSection
from rock2d.statistics import Estimate, percentile_estimate

Array = np.ndarray

BETWEEN = 2  # stations of the collector for each station of the envelopes
AT_LINES = {"height_m": "passing_height_m"}  # quantity of the envelopes -> its name at a measure line


@dataclass(frozen=True)
class Passings:
    """The blocks of one kind that pass one station.

    Attributes
    ----------
    passed : number of these blocks
    frequency : their share of the releases
    values : quantity of the envelopes -> values of these blocks, in ascending order
    """

    passed: int
    frequency: Estimate
    values: Mapping[str, Array]

    @cached_property
    def estimates(self) -> Mapping[str, list[Estimate]]:
        """Quantity of the envelopes -> an estimate for each of PERCENTILES; NaN if too few blocks pass."""
        return {
            name: [percentile_estimate(ranked, len(ranked), percentile) for percentile in PERCENTILES]
            for name, ranked in self.values.items()
        }


@dataclass(frozen=True)
class Station:
    """A station of the collector: a vertical line at `x_m`, or the measure line `line` with its foot there."""

    x_m: float
    zone: str
    line: str = ""
    of_block: dict[str, Passings] = field(default_factory=dict)


def collector_stations(run: Simulation) -> list[Station]:
    """The stations of a run from left to right: those of the envelopes, some between them, and the measure lines.

    At a measure line the numbers are those of the tables `passing` and `crossings`, elsewhere those of `envelopes`.
    """
    x = evenly_spaced(run.cross_section, BETWEEN * (STATIONS - 1) + 1)
    found = [Station(at, zone) for at, zone in zip(x.tolist(), zones_at(run.cross_section, x), strict=True)]
    for block, values in passing_values(run.tracks, x, run.cross_section, run.blocks, run.own_blocks).items():
        tracks = [track for track in run.tracks if track.block == block]
        cut = np.array([track.stop in UNRESOLVED_STOPS for track in tracks])
        seen = np.isfinite(values[:, :, 0])
        ranked = np.sort(values, axis=0)  # NaN last
        for s, station in enumerate(found):
            passed = int(seen[:, s].sum())
            share = Estimate(*passing_share(passed, int((cut & ~seen[:, s]).sum()), len(tracks)))
            by_quantity = {name: ranked[:passed, s, q] for q, name in enumerate(QUANTITIES)}
            station.of_block[block] = Passings(passed, share, by_quantity)
    return sorted([*found, *_line_stations(run)], key=lambda station: station.x_m)


def _line_stations(run: Simulation) -> list[Station]:
    ground, crossings = run.cross_section, run.to_pandas("crossings")
    found = {}
    for name, ends in ground.measure_lines.items():
        foot = ground.foot_and_head(ends)[0][:1]
        found[name] = Station(float(foot[0]), zones_at(ground, foot)[0], name)
    rows: list[Any] = list(run.to_pandas("passing").itertuples())
    for row in rows:
        crossed = crossings[(crossings["line"] == row.line) & (crossings["block"] == row.block)]
        values = {name: np.sort(crossed[AT_LINES.get(name, name)].to_numpy(float)) for name in QUANTITIES}
        share = Estimate(row.frequency, row.low95, row.high95)
        found[row.line].of_block[row.block] = Passings(int(row.passed), share, values)
    return list(found.values())


def zones_at(ground: CrossSection, x_m: Array) -> list[str]:
    """The zone of the surface at each station; of overlapping facets, the zone of the highest one."""
    (x0, y0), (x1, y1) = ground.points_m[:-1].T, ground.points_m[1:].T
    found = []
    for x in x_m:
        over = np.flatnonzero((np.minimum(x0, x1) <= x) & (x <= np.maximum(x0, x1)) & (x0 != x1))
        height = y0[over] + (x - x0[over]) / (x1[over] - x0[over]) * (y1[over] - y0[over])
        found.append(ground.zones[over[np.argmax(height)]] if len(over) else "")
    return found
