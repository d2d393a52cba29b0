"""The hunt for releases that break physics: `python -m tests.hunt.releases --releases 200000 --seed 1`.

Random releases over random sites (`cases`) run in the batch engine, a share of them in the pymunk engine too. Each is
held to what every release must do, see FAULTS. The hunt counts what breaks, worst first, and with --save shrinks the
worst of each kind and writes scenario files that repeat them.
"""

from __future__ import annotations

import argparse
import os
import sys
import time
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import NamedTuple

import numpy as np

from tests.hunt.cases import GRAVITY_M_S2, SHAPES, Case, Site, random_site, random_states

Array = np.ndarray

FAULTS = {
    "audit": "the energy audit leaves more than 1e-6 of the initial energy",
    "gain": "an impact ends with more energy than it began with, by 1e-6 of its kinetic energy",
    "lost": "a state is not finite",
    "tunnel": "the centroid was inside the ground, and the release did not end as buried there",
    "inside": "a release ends with its centroid inside the ground and is not buried",
    "restless": "a block at rest moves: more kinetic energy than it needs to rise by a quarter of its radius",
}
GAIN = 1e-6  # of an impact's kinetic energy
RESTLESS = 0.25  # of m g r
SITE_RELEASES = 10  # on each random site
SITES = 60  # of one call of the engine
SAMPLES = 150  # instants at which the centroid is looked at
IMPACTS = 60  # recorded of each release


class Finding(NamedTuple):
    """A release that broke something: by how much, in units of what FAULTS allow or as a share of energy."""

    fault: str
    size: float
    case: Case
    stop: str


def run_cases(sites: list[Site], states: list[Array]):
    """`run_batch` of releases (k, 6) on each of several sites."""
    from rock2d.engines.batch import Ensemble, run_batch
    from rock2d.laws.contact import parameter_table

    tables = [parameter_table(s.soils, s.cross_section.zone_names) for s in sites]
    ensemble = Ensemble([s.block for s in sites], [s.cross_section for s in sites], tables)
    ids = np.repeat(np.arange(len(sites)), [len(s) for s in states])
    limits = np.array([s.time_limit_s for s in sites])[ids]
    return run_batch(
        ensemble, np.concatenate(states), block_ids=ids, cross_section_ids=ids, table_ids=ids,
        gravity_m_s2=GRAVITY_M_S2, time_limit_s=limits, impact_room=IMPACTS,
        times_s=limits[:, None] * np.linspace(0.0, 1.0, SAMPLES + 1)[1:] ** 2,
    )  # fmt: skip


def check(sites: list[Site], states: list[Array]) -> Iterator[Finding]:
    """What breaks among these releases."""
    result = run_cases(sites, states)
    first = 0
    for site, starts in zip(sites, states, strict=True):
        rows = slice(first, first + len(starts))
        first += len(starts)
        for fault, sizes in faults(site, result, rows).items():
            for i in np.flatnonzero(sizes > 0.0):
                yield Finding(fault, float(sizes[i]), Case(site, starts[i]), _stop(result, rows.start + i))


def _stop(result, i: int) -> str:
    from rock2d.records.columns import STOPS

    return STOPS[result.stop[i]]


def faults(site: Site, result, rows: slice) -> dict[str, Array]:
    """Fault -> (releases,) its size, 0 where there is none."""
    from rock2d.engines.energy_balance import unclosed
    from rock2d.records.columns import (
        AT_X,
        AT_Y,
        E_INITIAL,
        E_KINETIC,
        E_RESIDUAL,
        STOP_BURIED,
        STOP_REST,
    )

    block = site.block
    ends, stop, energy = result.ends[rows], result.stop[rows], result.energy_J[rows]
    found = {"lost": (~np.isfinite(ends).all(axis=1)).astype(float)}
    share = np.abs(energy[:, E_RESIDUAL] / energy[:, E_INITIAL])
    found["audit"] = np.where(unclosed(energy), share, 0.0)
    found["gain"] = impact_gains(site, result.impacts[rows])
    weight = block.mass_kg * GRAVITY_M_S2 * block.radius_m
    found["restless"] = np.where(
        stop == STOP_REST, np.maximum(energy[:, E_KINETIC] / weight - RESTLESS, 0.0), 0.0
    )
    inside = depth_in_ground(site, ends[:, AT_X], ends[:, AT_Y])
    found["inside"] = np.where(stop != STOP_BURIED, inside, 0.0)
    seen = result.samples[rows]
    way = depth_in_ground(site, seen[..., 0], seen[..., 1]).max(axis=1)
    found["tunnel"] = np.where(stop != STOP_BURIED, way, 0.0)
    return found


def impact_gains(site: Site, impacts: Array) -> Array:
    """(releases,) the largest share of its kinetic energy that an impact gained, beyond GAIN."""
    from rock2d.engines.energy_balance import Masses, mechanical_energy
    from rock2d.records.columns import AFTER, BEFORE, N_STATE

    masses = Masses(site.block.mass_kg, site.block.inertia_kg_m2, GRAVITY_M_S2, 0.0)
    before, after = (impacts[..., part].reshape(-1, N_STATE) for part in (BEFORE, AFTER))
    (kinetic, low), (left, high) = mechanical_energy(masses, before), mechanical_energy(masses, after)
    with np.errstate(invalid="ignore", divide="ignore"):
        gain = (left + high - kinetic - low) / kinetic - GAIN
    gain = np.where(np.isfinite(gain), gain, 0.0).reshape(impacts.shape[:2])
    return np.maximum(gain.max(axis=1, initial=0.0), 0.0)


def depth_in_ground(site: Site, x: Array, y: Array) -> Array:
    """Depth of points inside the ground in block radii, 0 outside; beside the cross-section too."""
    import shapely

    ground, out = site.cross_section, np.zeros(np.shape(x))
    inside = np.isfinite(x) & np.isfinite(y)
    inside[inside] = ground.covers(np.column_stack([x[inside], y[inside]]))
    line = shapely.LineString(ground.points_m)
    out[inside] = shapely.distance(shapely.points(x[inside], y[inside]), line) / site.block.radius_m
    return np.where(out > 1e-6, out, 0.0)


def hunt_chunk(job: tuple[int, int, str | None]) -> tuple[int, list[Finding], float]:
    """Releases, findings and seconds of one chunk of sites; `job`: (seed, chunk, shape or None for all)."""
    seed, chunk, shape = job
    start = time.perf_counter()
    rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(chunk,)))
    sites = [random_site(rng, shape or SHAPES[k % len(SHAPES)]) for k in range(SITES)]
    states = [random_states(rng, site, SITE_RELEASES) for site in sites]
    found = list(check(sites, states))
    return SITES * SITE_RELEASES, found, time.perf_counter() - start


def hunt(releases: int, seed: int, shape: str | None, workers: int) -> tuple[int, list[Finding], float]:
    """Run the hunt in worker processes; returns (releases, findings, seconds of the slowest chunk)."""
    from tqdm import tqdm

    jobs = [(seed, k, shape) for k in range(-(-releases // (SITES * SITE_RELEASES)))]
    done, found, slowest = 0, [], 0.0
    with ProcessPoolExecutor(workers) as pool, tqdm(total=len(jobs), unit="chunk", disable=None) as bar:
        for count, findings, seconds in pool.map(hunt_chunk, jobs):
            done, slowest = done + count, max(slowest, seconds)
            found += findings
            bar.update()
    return done, found, slowest


def print_table(done: int, found: list[Finding]) -> None:
    """What broke, by fault and shape."""
    print(f"{done} releases")
    for fault, meaning in FAULTS.items():
        mine = [f for f in found if f.fault == fault]
        by_shape = {s: sum(f.case.site.block.shape == s for f in mine) for s in SHAPES}
        worst = max((f.size for f in mine), default=0.0)
        print(f"{fault:9s} {len(mine):6d}  worst {worst:9.2e}  {by_shape}  ({meaning})")


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--releases", type=int, default=6000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--shape", choices=SHAPES)
    parser.add_argument("--workers", type=int, default=os.cpu_count() or 1)
    parser.add_argument("--save", type=Path, help="folder for scenario files of the worst of each kind")
    parser.add_argument("--worst", type=int, default=3, help="how many of each kind are saved")
    given = parser.parse_args(arguments)
    done, found, slowest = hunt(given.releases, given.seed, given.shape, given.workers)
    print_table(done, found)
    print(f"slowest chunk of {SITES * SITE_RELEASES} releases: {slowest:.1f} s")
    if given.save:
        from tests.hunt.shrink import shrunk

        given.save.mkdir(parents=True, exist_ok=True)
        for fault in FAULTS:
            mine = sorted((f for f in found if f.fault == fault), key=lambda f: -f.size)
            for k, worst in enumerate(mine[: given.worst]):
                small = shrunk(worst)
                path = given.save / f"{fault}_{k}.yaml"
                path.write_text(small.case.scenario(path.stem, f"{FAULTS[fault]}: {small.size:.3g}"))
                print(f"{path}: {small.size:.3g} [{small.stop}]")
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())
