"""The live view of a page: the slope with paths and data collector, as data for live_slope.js.

The data collector gives number, height, speed and energy of the passing blocks at many stations along the slope.
Everything is computed here; the script only computes positions on the screen."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np

from rock2d.arrays import Array
from rock2d.design.report_tables import quantity_text
from rock2d.graphics.canvas import Limits
from rock2d.graphics.live_data import MOST_BYTES, STEPS, compact, in_page, live_scene, packed
from rock2d.graphics.palette import block_colours
from rock2d.graphics.thinned_paths import thinned_paths
from rock2d.graphics.trajectories import STOP_MARKERS
from rock2d.records.columns import INSTANT_OMEGA, INSTANT_VX, INSTANT_Y, UNRESOLVED_STOPS
from rock2d.records.track import Track
from rock2d.runs.indicators.envelopes import ENVELOPE_PERCENTILES, QUANTITIES, STATIONS, evenly_spaced, passing_values
from rock2d.runs.indicators.passing import passing_share
from rock2d.runs.simulation import Simulation
from rock2d.scene.cross_section import CrossSection
from rock2d.statistics import Estimate, least_count, percentile_estimate
from rock2d.wording import energy_unit, listed, spoken, with_interval

# for up to FEW_PATHS paths, the tolerance is the width of the view over FINE_PARTS, else over COARSE_PARTS
FEW_PATHS, FINE_PARTS, COARSE_PARTS = 2000, 1000, 250
SHOWN_SHARE = 0.5  # share of these bytes for the paths of the run that is shown first, if there are several
SHOWN_OF_OTHERS = 100  # releases of each block of the other runs
BINS = 20  # bins of a histogram
MOST_IMPACTS = 8000  # impacts in the tables of single releases, each about 30 bytes
BELOW_SHARE, ABOVE_SHARE = 0.1, 0.02  # margins below the lowest and above the highest point, in heights
WORST_SHARE = 0.01  # share of the releases of each block, those with the largest energies
COLLECTOR_STATIONS = 2  # for each station of the envelopes
AT_LINES = {"height_m": "passing_height_m"}  # quantity of the envelopes -> its name at a measure line
BYTES_OF_A_RELEASE = 22  # for number, block, stop and energy
LABELS = {"height_m": "height", "speed_m_s": "speed", "kinetic_J": "energy"}
# head of a column -> its value in an impact of a track
LISTED_COLUMNS: Sequence[tuple[str, Callable[[Mapping[str, Any]], float]]] = (
    ("t (s)", lambda impact: impact["t_s"]),
    ("x (m)", lambda impact: impact["x_m"]),
    ("speed before (m/s)", lambda impact: math.hypot(impact["vx_m_s"], impact["vy_m_s"])),
    ("speed after (m/s)", lambda impact: math.hypot(impact["vx_after_m_s"], impact["vy_after_m_s"])),
    ("penetration (m)", lambda impact: impact["penetration_m"]),
    ("largest force (kN)", lambda impact: 1e-3 * impact["force_N"]),
)


@dataclass(frozen=True)
class ShownRun:
    """A run in the live view: the run of the page, or a run with another model or size.

    Attributes
    ----------
    name : name in the list or beside the slider
    run : its releases
    note : note to the reader"""

    name: str
    run: Simulation
    note: str = ""


def live_slope(views: Sequence[ShownRun], released: int, shown: int = 0, sizes: str = "") -> dict[str, Any] | None:
    """What live_slope.html.j2 shows of runs of the same blocks; None if nothing was released.

    Parameters
    ----------
    views : the runs
    released : number of releases in the tables of the page; the shown run may have only the first ones
    shown : index of the run that is shown first
    sizes : place of the number in which the runs differ"""
    run = views[shown].run
    if not run.tracks:
        return None
    runs = [view.run for view in views]
    names = list(dict.fromkeys(track.block for track in run.tracks))
    stops = [stop for stop in STOP_MARKERS if any(track.stop == stop for own in runs for track in own.tracks)]
    limits = _limits(runs)
    collectors = [collector_stations(each) for each in runs]
    units = _units(collectors)
    found = []
    energies_J = [largest_energies(own) for own in runs]
    worst = list(map(worst_releases, runs, energies_J))
    for view, stations, first in zip(views, collectors, worst, strict=True):
        impacts, of_impacts = _impacts(view.run, first, MOST_IMPACTS // len(views))
        found.append({
            "name": view.name, "note": view.note, "radius": [view.run.blocks[name].radius_m for name in names],
            "first_release": [min(t.release for t in view.run.tracks if t.block == name) for name in names],
            **live_scene(view.run.cross_section), **_collector(stations, names, units),
            "impacts": impacts, "notes": of_impacts,
        })  # fmt: skip
    data: dict[str, Any] = {
        "shown": shown, "limits": limits, "runs": found, "bins": BINS,
        "stops": [STOP_MARKERS[stop][1] for stop in stops],
        "blocks": [{"name": spoken(name), "colour": colour} for name, colour in block_colours(names).items()],
        "quantities": [LABELS[name] for name in QUANTITIES],
        "percentiles": [f"{percentile:g} %" for percentile in ENVELOPE_PERCENTILES],
        "energy_unit": units["kinetic_J"][1],
        "curve_labels": ["passing frequency (%)", *(f"{LABELS[q]} ({unit})" for q, (_, unit) in units.items())],
    }  # fmt: skip
    room, shown_share = MOST_BYTES - len(compact(data)), SHOWN_SHARE if len(views) > 1 else 1.0
    for i, (view, own) in enumerate(zip(views, found, strict=True)):
        share = shown_share if i == shown else (1.0 - shown_share) / (len(views) - 1)
        own["paths"], of_paths = _paths(
            view.run, names, stops, worst[i], units["kinetic_J"][0] * energies_J[i], limits[1] - limits[0],
            int(room * share),
        )  # fmt: skip
        own["notes"] = of_paths + own["notes"]
    return {
        "data": in_page(data), "blocks": list(map(spoken, names)), "stops": data["stops"],
        "quantities": ["passing frequency", *data["quantities"]], "views": [view.name for view in views],
        "sizes": sizes, "notes": _notes(run, released, len(views)),
    }  # fmt: skip


def _notes(run: Simulation, released: int, views: int) -> list[str]:
    """Notes to the reader that hold for all runs."""
    counts = ", ".join(map(str, map(least_count, ENVELOPE_PERCENTILES)))
    few = f"This view shows the first {len(run.tracks)} of {released} releases; the tables below count all."
    same = "Releases with the same number start in the same way in all runs; some runs may have fewer releases."
    return [
        *[few] * (len(run.tracks) < released), *[same] * (views > 1),
        f"{listed([f'{p:g} %' for p in ENVELOPE_PERCENTILES])} of the blocks stay below a value; these need {counts} "
        "passing blocks. In brackets: 95 % intervals, sampling only. At a measure line the numbers are those of the "
        "blocks that cross it; elsewhere they count the first passing of a vertical line, in the direction of x. "
        "Heights are those of the centroid above the ground.",
    ]  # fmt: skip


def _limits(runs: Sequence[Simulation]) -> Limits:
    """Limits of the view: the whole length of the cross-sections, and all heights of ground, lines and paths."""
    grounds = [run.cross_section for run in runs]
    heights = [track.knots[:, INSTANT_Y] for run in runs for track in run.tracks]
    y = np.concatenate(
        [*(ground.points_m[:, 1] for ground in grounds),
         *(ends[:, 1] for ground in grounds for ends in ground.measure_lines.values()),
         [extreme(each) for each in heights for extreme in (np.min, np.max)]]
    )  # fmt: skip
    x = np.concatenate([ground.points_m[:, 0] for ground in grounds])
    high = float(np.ptp(y))
    low, top = float(y.min()) - BELOW_SHARE * high, float(y.max()) + ABOVE_SHARE * high
    return float(x.min()), float(x.max()), low, top


def largest_energies(run: Simulation) -> Array:
    """(tracks,) the largest kinetic energy of each track at its knots, in J."""
    found = []
    for track in run.tracks:
        body, (vx, vy, omega) = run.block_of(track), track.knots[:, INSTANT_VX : INSTANT_OMEGA + 1].T
        found.append((0.5 * body.mass_kg * (vx**2 + vy**2) + 0.5 * body.inertia_kg_m2 * omega**2).max())
    return np.array(found)


def worst_releases(run: Simulation, energy_J: Array) -> list[int]:
    """Indices of the tracks with the largest energies: WORST_SHARE of each block, at least one."""
    block = np.array([track.block for track in run.tracks])
    found: list[int] = []
    for name in dict.fromkeys(block.tolist()):
        own = np.flatnonzero(block == name)
        found += own[np.argsort(-energy_J[own], kind="stable")][: math.ceil(WORST_SHARE * len(own))].tolist()
    return found


def _units(collectors: Sequence[Sequence[Station]]) -> dict[str, tuple[float, str]]:
    """Factor and unit of each of QUANTITIES, the same for all runs."""
    estimates = (at.estimates["kinetic_J"] for own in collectors for s in own for at in s.of_block.values())
    energies = (e.value for own in estimates for e in own if math.isfinite(e.value))
    return {"height_m": (1.0, "m"), "speed_m_s": (1.0, "m/s"), "kinetic_J": energy_unit(max(energies, default=0.0))}


def _collector(
    stations: Sequence[Station], names: Sequence[str], units: Mapping[str, tuple[float, str]]
) -> dict[str, Any]:
    """Data of the collector: texts of each block at each station, histograms there, and curves of each quantity and
    block."""
    texts = [
        [
            [at.passed, f"{with_interval(*at.frequency, 100.0)} %",
             [[quantity_text(name, *estimate) for estimate in at.estimates[name]] for name in QUANTITIES]]
            for at in (station.of_block[block] for station in stations)
        ]
        for block in names
    ]  # fmt: skip
    upright = [station for station in stations if not station.line]
    shares = [[_rounded([s.of_block[b].frequency for s in upright], 100.0) for b in names]]
    curves = [
        [_rounded([[e.value for e in s.of_block[b].estimates[q]] for s in upright], units[q][0]) for b in names]
        for q in QUANTITIES
    ]
    histograms = [
        [_histogram([station.of_block[b].values[q] for b in names], units[q][0]) for q in QUANTITIES]
        for station in stations
    ]
    return {
        "stations": [[station.x_m, spoken(station.zone), spoken(station.line)] for station in stations],
        "texts": texts, "curves": shares + curves,
        "ends": [[end for end, _ in own] for own in histograms],
        "counts": packed(np.array([[counts for _, counts in own] for own in histograms], "<u2").tobytes()),
    }  # fmt: skip


def _histogram(values: Sequence[Array], factor: float) -> tuple[float, Array]:
    """(upper end of the last of BINS bins from 0 on, the same for all blocks; counts of each block). Values below 0
    count in the first bin."""
    most = max((float(own[-1]) for own in values if len(own)), default=0.0)
    end = most if most > 0.0 else 1.0
    counts = np.array([np.histogram(np.maximum(own, 0.0), BINS, (0.0, end))[0] for own in values])
    return float(f"{factor * end:.4g}"), counts


def _rounded(rows: Sequence[Sequence[float]], factor: float) -> list[list[float | None]]:
    """Columns of the rows times a factor, with four digits; None for NaN."""
    return [
        [float(f"{factor * value:.4g}") if math.isfinite(value) else None for value in column]
        for column in zip(*rows, strict=True)
    ]


def _paths(
    run: Simulation,
    names: Sequence[str],
    stops: Sequence[str],
    worst: Sequence[int],
    energy: Array,
    width_m: float,
    room: int,
) -> tuple[dict[str, Any], list[str]]:
    """The paths that fit into `room` bytes, and a note; `energy` (tracks,): largest energy of each, in the unit of the
    page."""
    tracks, kept = run.tracks, list(range(len(run.tracks)))
    tolerance_m = width_m / (FINE_PARTS if len(tracks) <= FEW_PATHS else COARSE_PARTS)
    thinned = thinned_paths(tracks, tolerance_m)
    points, scales = thinned.packed()
    size = len(points) + BYTES_OF_A_RELEASE * len(tracks)
    if size > room:
        kept = _first_and_worst(tracks, worst, int(len(tracks) * room / size))
        thinned = thinned.subset(kept)
        points, scales = thinned.packed()
    chosen = set(worst)
    shown = [tracks[i] for i in kept]
    data: dict[str, Any] = {
        "points": points, "scales": scales, "steps": STEPS, "gravity": tracks[0].gravity_m_s2,
        "counts": thinned.counts.tolist(), "release": [track.release for track in shown],
        "block": [names.index(track.block) for track in shown], "stop": [stops.index(track.stop) for track in shown],
        "worst": [int(i in chosen) for i in kept],
        "energy": [float(f"{energy[i]:.3g}") for i in kept],
    }  # fmt: skip
    number = f"All {len(kept)} paths" if len(kept) == len(tracks) else (
        f"{len(kept)} of {len(tracks)} paths, the first ones and the worst 1 % of each block"
    )  # fmt: skip
    return data, [f"{number}: flights are parabolas, contacts are thinned to {tolerance_m:.2g} m."]


def _first_and_worst(tracks: Sequence[Track], worst: Sequence[int], most: int) -> list[int]:
    """Indices of at most about `most` tracks: the worst, and equally many first ones of each block."""
    rank: Counter[str] = Counter()
    ranked = []
    for i, track in enumerate(tracks):
        ranked.append((rank[track.block], i))
        rank[track.block] += 1
    first = [i for _, i in sorted(ranked)]
    return sorted({*worst, *first[: max(most - len(worst), 0)]})


def _impacts(run: Simulation, worst: Sequence[int], most: int) -> tuple[dict[str, Any], list[str]]:
    """Up to `most` impacts, of the worst and of the first releases, and a note."""
    tracks, total = run.tracks, 0
    chosen = []
    for i in dict.fromkeys([*worst, *_first_and_worst(tracks, (), len(tracks))]):
        total += len(tracks[i].impacts)
        if total > most:
            break
        chosen.append(i)
    zones = list(dict.fromkeys(run.cross_section.zones))
    rows = [impact for i in chosen for impact in tracks[i].impacts]
    columns = [[value(impact) for impact in rows] for _, value in LISTED_COLUMNS]
    of_zone = np.array([zones.index(impact["zone"]) for impact in rows], "<u2")
    raw = np.array(columns, "<f4").tobytes() + of_zone.tobytes()
    data: dict[str, Any] = {
        "rows": packed(raw), "columns": [name for name, _ in LISTED_COLUMNS], "zones": list(map(spoken, zones)),
        "release": [tracks[i].release for i in chosen], "counts": [len(tracks[i].impacts) for i in chosen],
    }  # fmt: skip
    few = [f"Impacts are listed for {len(chosen)} of {len(tracks)} releases."]
    return data, few if len(chosen) < len(tracks) else []


# --- data collector ------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Passings:
    """The blocks of one kind that pass one station.

    Attributes
    ----------
    passed : number of these blocks
    frequency : their share of the releases
    values : quantity of the envelopes -> values of these blocks, in ascending order"""

    passed: int
    frequency: Estimate
    values: Mapping[str, Array]

    @cached_property
    def estimates(self) -> Mapping[str, list[Estimate]]:
        """Quantity of the envelopes -> an estimate for each of ENVELOPE_PERCENTILES; NaN if too few blocks pass."""
        return {
            name: [percentile_estimate(ranked, len(ranked), percentile) for percentile in ENVELOPE_PERCENTILES]
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

    At a measure line the numbers are those of the tables `passing` and `crossings`, elsewhere those of `envelopes`."""
    x = evenly_spaced(run.cross_section, COLLECTOR_STATIONS * (STATIONS - 1) + 1)
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
