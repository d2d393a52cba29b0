"""Envelopes along the slope: percentiles of height above the ground, speed and energy."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING

import numpy as np

from rock2d.arrays import Array
from rock2d.records.columns import TIME
from rock2d.records.track import Track
from rock2d.runs.simulation import Indicator, Simulation
from rock2d.scene.blocks import Block
from rock2d.scene.cross_section import CrossSection
from rock2d.statistics import least_count, percentile_estimate

if TYPE_CHECKING:
    import pandas as pd

ENVELOPE_COLUMNS = ("block", "x_m", "quantity", "percentile", "passed", "value", "low95", "high95")
QUANTITIES = ("height_m", "speed_m_s", "kinetic_J")
ENVELOPE_PERCENTILES = (50.0, 95.0, 99.0)
STATIONS = 61
INSTANTS = 400  # instants of a track, in addition to its knots, for linear interpolation


def envelope_table(run: Simulation) -> pd.DataFrame:
    """Percentiles over the blocks that pass each station in the direction of x; ENVELOPE_COLUMNS.

    - x_m: evenly spaced stations; a percentile is left out if too few blocks pass
    - height_m: vertical height of the centroid above the ground at its first passing; speed_m_s and kinetic_J likewise
    - low95, high95: distribution-free interval of the percentile"""
    import pandas as pd

    stations, rows = evenly_spaced(run.cross_section, STATIONS), []
    passing = passing_values(run.tracks, stations, run.cross_section, run.blocks, run.own_blocks)
    for block, found in passing.items():
        counts = np.isfinite(found).sum(axis=0)
        ranked = np.sort(found, axis=0)  # NaN last
        for s, x in enumerate(stations.tolist()):
            for q, quantity in enumerate(QUANTITIES):
                n, values = int(counts[s, q]), ranked[:, s, q]
                for percentile in ENVELOPE_PERCENTILES:
                    if n >= least_count(percentile):
                        rows.append((block, x, quantity, percentile, n, *percentile_estimate(values, n, percentile)))
    return pd.DataFrame(rows, columns=list(ENVELOPE_COLUMNS))


def evenly_spaced(cross_section: CrossSection, count: int) -> Array:
    """(count,) stations from the left end of a cross-section to the right one, in m."""
    ends = cross_section.points_m[:, 0]
    return np.linspace(ends.min(), ends.max(), count)


def passing_values(
    tracks: Iterable[Track],
    stations: Array,
    cross_section: CrossSection,
    blocks: Mapping[str, Block],
    own_blocks: Mapping[int, Block],
) -> dict[str, Array]:
    """Block -> (releases, stations, 3) values of QUANTITIES where a release first passes each station in the direction
    of x; NaN if it does not pass."""
    ground = cross_section.height_m(stations)
    values: dict[str, list[Array]] = {}
    for track in tracks:
        block = own_blocks.get(track.release, blocks[track.block])
        values.setdefault(track.block, []).append(_at_stations(track, stations, ground, block))
    return {name: np.stack(found) for name, found in values.items()}


def _at_stations(track: Track, stations: Array, ground: Array, block: Block) -> Array:
    """(stations, 3) values of QUANTITIES where the track first passes each station; NaN if it does not pass."""
    knots = track.knots
    times = np.union1d(np.linspace(knots[0, TIME], track.end_s, INSTANTS), knots[:, TIME])
    states = track.states(times)
    states[-1] = knots[-1, 1:]
    farthest = np.maximum.accumulate(states[:, 0])
    after = np.searchsorted(farthest, stations)
    out = np.full((len(stations), len(QUANTITIES)), np.nan)
    seen = (after > 0) & (after < len(times))
    b = after[seen]
    a = b - 1
    share = ((stations[seen] - states[a, 0]) / (states[b, 0] - states[a, 0]))[:, None]
    there = states[a] + share * (states[b] - states[a])
    speed = np.hypot(there[:, 3], there[:, 4])
    energy = 0.5 * block.mass_kg * speed**2 + 0.5 * block.inertia_kg_m2 * there[:, 5] ** 2
    out[seen] = np.column_stack([there[:, 1] - ground[seen], speed, energy])
    return out


INDICATOR = Indicator("envelopes", ENVELOPE_COLUMNS, envelope_table)
