"""The hunt for releases that break physics: `python -m tests.hunt.releases --releases 200000 --seed 1`.

Random releases over random sites (`cases`) run in the batch engine. Each is held to what every release must do, see
FAULTS. The hunt counts what breaks, worst first, and with --save shrinks the worst of each kind and writes scenario
files that repeat them."""

import argparse
import os
import sys
import time
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numba
import numpy as np
import shapely
from tqdm import tqdm

from rock2d.engines.batch import Ensemble, run_batch
from rock2d.engines.energy_balance import Masses, mechanical_energy, unclosed
from rock2d.laws.contact import contact_table
from rock2d.records import columns
from rock2d.scene.cross_section import CrossSection, CrossSectionError
from tests.hunt.cases import GRAVITY_M_S2, SHAPES, Case, Site, random_site, random_states

Array = np.ndarray

FAULTS = {
    "audit": "the energy audit leaves more than 1e-6 of the initial energy",
    "gain": "an impact ends with more energy than it began with, by 1e-6 of its kinetic energy",
    "lost": "a state is not finite",
    "tunnel": "the centroid was inside the ground, and the release did not end as buried there",
    "inside": "a release ends with its centroid inside the ground and is not buried",
    "restless": "a block at rest moves: more kinetic energy than it needs to rise by a quarter of its radius",
    "moved": "the same release, run without its companions, ends elsewhere, if only in the last bit",
}
GAIN = 1e-6  # share of an impact's kinetic energy that it may gain
RESTLESS = 0.25  # kinetic energy that a block at rest may have, in m g r
SITE_RELEASES = 10  # on each random site
SITES = 60  # sites in one call of the engine
SAMPLES = 150  # instants at which the centroid is looked at
IMPACTS = 60  # recorded of each release
ALONE = 10  # one in so many sites is run again without its companions
KEPT = 0.3  # share of the fault's size that a smaller case must show


class Finding(NamedTuple):
    """A release that broke something: by how much, in units of what FAULTS allow or as a share of energy."""

    fault: str
    size: float
    case: Case
    stop: str


def run_cases(sites: list[Site], states: list[Array]):
    """`run_batch` of releases (k, 6) on each of several sites."""
    tables = [contact_table(s.soils, s.cross_section.zone_names) for s in sites]
    ensemble = Ensemble([s.block for s in sites], [s.cross_section for s in sites], tables)
    ids = np.repeat(np.arange(len(sites)), [len(s) for s in states])
    limits = np.array([s.time_limit_s for s in sites])[ids]
    return run_batch(
        ensemble, np.concatenate(states), block_ids=ids, cross_section_ids=ids, table_ids=ids,
        gravity_m_s2=GRAVITY_M_S2, time_limit_s=limits, impact_room=IMPACTS,
        times_s=limits[:, None] * np.linspace(0.0, 1.0, SAMPLES + 1)[1:] ** 2,
    )  # fmt: skip


def check(sites: list[Site], states: list[Array], result=None) -> Iterator[Finding]:
    """What breaks among these releases; `result`: what the engine made of them, if it has run."""
    result = result or run_cases(sites, states)
    first = 0
    for site, starts in zip(sites, states, strict=True):
        rows = slice(first, first + len(starts))
        first += len(starts)
        for fault, sizes in faults(site, result, rows).items():
            for i in np.flatnonzero(sizes > 0.0):
                yield Finding(fault, float(sizes[i]), Case(site, starts[i]), _stop(result, rows.start + i))


def moved(sites: list[Site], states: list[Array], result) -> Iterator[Finding]:
    """Releases that end elsewhere when one in ALONE sites is run without its companions."""
    for k in range(0, len(sites), ALONE):
        own = run_cases([sites[k]], [states[k]])
        first = sum(len(s) for s in states[:k])
        ends = result.ends[first : first + len(states[k])]
        for i in np.flatnonzero(~((own.ends == ends) | (np.isnan(own.ends) & np.isnan(ends))).all(axis=1)):
            size = float(np.abs(own.ends[i] - ends[i]).max())
            yield Finding("moved", size, Case(sites[k], states[k][i]), _stop(own, i))


def _stop(result, i: int) -> str:
    return columns.STOPS[result.stop[i]]


def faults(site: Site, result, rows: slice) -> dict[str, Array]:
    """Fault -> (releases,) its size, 0 where there is none."""
    block = site.block
    ends, stop, energy = result.ends[rows], result.stop[rows], result.energy_J[rows]
    found = {"lost": (~np.isfinite(ends).all(axis=1)).astype(float)}
    share = np.abs(energy[:, columns.E_RESIDUAL] / energy[:, columns.E_INITIAL])
    found["audit"] = np.where(unclosed(energy), share, 0.0)
    found["gain"] = impact_gains(site, result.impacts[rows])
    weight = block.mass_kg * GRAVITY_M_S2 * block.radius_m
    found["restless"] = np.where(
        stop == columns.STOP_REST, np.maximum(energy[:, columns.E_KINETIC] / weight - RESTLESS, 0.0), 0.0
    )
    inside = depth_in_ground(site, ends[:, columns.INSTANT_X], ends[:, columns.INSTANT_Y])
    found["inside"] = np.where(stop != columns.STOP_BURIED, inside, 0.0)
    seen = result.samples[rows]
    way = depth_in_ground(site, seen[..., 0], seen[..., 1]).max(axis=1)
    found["tunnel"] = np.where(stop != columns.STOP_BURIED, way, 0.0)
    return found


def impact_gains(site: Site, impacts: Array) -> Array:
    """(releases,) the largest share of its kinetic energy that an impact gained, beyond GAIN."""
    masses = Masses(site.block.mass_kg, site.block.inertia_kg_m2, GRAVITY_M_S2, 0.0)
    before, after = (impacts[..., part].reshape(-1, columns.N_STATE) for part in (columns.BEFORE, columns.AFTER))
    (kinetic, low), (left, high) = mechanical_energy(masses, before), mechanical_energy(masses, after)
    with np.errstate(invalid="ignore", divide="ignore"):
        gain = (left + high - kinetic - low) / kinetic - GAIN
    gain = np.where(np.isfinite(gain), gain, 0.0).reshape(impacts.shape[:2])
    return np.maximum(gain.max(axis=1, initial=0.0), 0.0)


def depth_in_ground(site: Site, x: Array, y: Array) -> Array:
    """Depth of points inside the ground in block radii, 0 outside; outside the cross-section too."""
    ground, out = site.cross_section, np.zeros(np.shape(x))
    inside = np.isfinite(x) & np.isfinite(y)
    inside[inside] = ground.covers(np.column_stack([x[inside], y[inside]]))
    line = shapely.LineString(ground.points_m)
    out[inside] = shapely.distance(shapely.points(x[inside], y[inside]), line) / site.block.radius_m
    return np.where(out > 1e-6, out, 0.0)


def random_releases(seed: int, chunk: int, shape: str | None, count: int = SITES) -> tuple[list[Site], list[Array]]:
    """`count` random sites of one shape, or of all in turn, and SITE_RELEASES releases (k, 6) on each."""
    rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(chunk,)))
    sites = [random_site(rng, shape or SHAPES[k % len(SHAPES)]) for k in range(count)]
    return sites, [random_states(rng, site, SITE_RELEASES) for site in sites]


# the smallest case -----------------------------------------------------------------------------------------------


def shrunk(finding: Finding) -> Finding:
    """The finding with its case as small as it gets while the fault stays: fewer points and soils, simpler numbers."""
    smaller = True
    while smaller:
        smaller = False
        for case in _simpler(finding.case):
            same = [
                f
                for f in check([case.site], [case.state[None]])
                if f.fault == finding.fault and f.size > KEPT * finding.size
            ]
            if same:
                finding, smaller = same[0], True
                break
    return finding


def _simpler(case: Case) -> Iterator[Case]:
    site = case.site
    ground = site.cross_section
    for i in range(len(ground.points_m)):
        points, zones = np.delete(ground.points_m, i, axis=0), list(ground.zones)
        del zones[min(i, len(zones) - 1)]
        try:
            yield Case(replace(site, cross_section=CrossSection(points, zones)), case.state)
        except CrossSectionError:
            continue
    names = ground.zone_names
    for kept in names if len(names) > 1 else ():
        one = CrossSection(ground.points_m, [kept] * len(ground.zones))
        yield Case(replace(site, cross_section=one, soils={kept: site.soils[kept]}), case.state)
    for name, law in site.soils.items():
        for key, plain in (
            ("k_r_Nm_rad", 0.0), ("rolling_cap", False), ("rolling_in_indentation", False), ("k_t_N_m", 0.0),
        ):  # fmt: skip
            if getattr(law, key) != plain:
                soils = {**site.soils, name: replace(law, **{key: plain})}
                yield Case(Site(site.block, site.sizes, ground, soils), case.state)


# the hunt -----------------------------------------------------------------------------------------------------------


class Chunk(NamedTuple):
    """What the hunt found in one chunk of sites; `corrected`: what the steps of each release were corrected by, so that
    the audit closes, over its initial energy."""

    releases: int
    corrected: Array
    findings: list[Finding]
    seconds: float


def hunt_chunk(job: tuple[int, int, str | None]) -> Chunk:
    """The hunt in one chunk of sites; `job`: (seed, chunk, shape or None for all)."""
    start = time.perf_counter()
    sites, states = random_releases(*job)
    result = run_cases(sites, states)
    found = [*check(sites, states, result), *moved(sites, states, result)]
    corrected = result.energy_J[:, columns.E_CORRECTED] / result.energy_J[:, columns.E_INITIAL]
    return Chunk(SITES * SITE_RELEASES, corrected, found, time.perf_counter() - start)


def hunt(releases: int, seed: int, shape: str | None, workers: int, first: int = 0) -> list[Chunk]:
    """Run the hunt in worker processes, from chunk `first` on."""
    jobs = [(seed, first + k, shape) for k in range(-(-releases // (SITES * SITE_RELEASES)))]
    with ProcessPoolExecutor(workers, initializer=_one_thread) as pool:
        return list(tqdm(pool.map(hunt_chunk, jobs), total=len(jobs), unit="chunk", disable=None))


def _one_thread() -> None:
    """Let a worker compute on one thread: the workers share the cores."""
    numba.set_num_threads(1)


def print_table(chunks: list[Chunk]) -> None:
    """What broke, by fault and shape."""
    found = [f for chunk in chunks for f in chunk.findings]
    print(f"{sum(chunk.releases for chunk in chunks)} releases")
    for fault, meaning in FAULTS.items():
        mine = [f for f in found if f.fault == fault]
        by_shape = {s: sum(f.case.site.block.shape == s for f in mine) for s in SHAPES}
        worst = max((f.size for f in mine), default=0.0)
        print(f"{fault:9s} {len(mine):6d}  worst {worst:9.2e}  {by_shape}  ({meaning})")
    middle, most, worst = np.quantile(np.concatenate([c.corrected for c in chunks]), [0.5, 0.99, 1.0])
    print(
        f"steps were corrected by {middle:.1e} of the initial energy (median), 99 % of the releases by less than "
        f"{most:.1e}, all by less than {worst:.1e}"
    )
    print(f"slowest chunk of {chunks[0].releases} releases: {max(c.seconds for c in chunks):.1f} s")


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--releases", type=int, default=6000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--first", type=int, default=0, help="number of the first chunk, to go on with a hunt")
    parser.add_argument("--shape", choices=SHAPES)
    parser.add_argument("--workers", type=int, default=os.cpu_count() or 1)
    parser.add_argument("--save", type=Path, help="folder for scenario files of the worst of each kind")
    parser.add_argument("--worst", type=int, default=3, help="how many of each kind are saved")
    given = parser.parse_args(arguments)
    chunks = hunt(given.releases, given.seed, given.shape, given.workers, given.first)
    print_table(chunks)
    found = [f for chunk in chunks for f in chunk.findings]
    if given.save:
        given.save.mkdir(parents=True, exist_ok=True)
        for fault in FAULTS:
            mine = sorted((f for f in found if f.fault == fault), key=lambda f: -f.size)
            for k, worst in enumerate(mine[: given.worst]):
                small = worst if fault == "moved" else shrunk(worst)
                path = given.save / f"{fault}_{k}.yaml"
                path.write_text(small.case.scenario(path.stem, f"{FAULTS[fault]}: {small.size:.3g}"))
                print(f"{path}: {small.size:.3g} [{small.stop}]")
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())
