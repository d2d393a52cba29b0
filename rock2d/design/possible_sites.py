"""Possible sites: draws of everything that is not known about a site, and what blocks do there.

The draws are those of Saltelli et al. (2010), Comput. Phys. Commun. 181, 259: N groups of two independent sites, and of
d that share all values but one with the first, from which Sobol indices tell how much of the spread each value makes.
The sites of a group have the same releases (common random numbers). Each group has its own: a chance that all sites
share would not show in their spread.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import closing
from dataclasses import dataclass
from typing import Any

import numpy as np

from rock2d.cluster import Crew
from rock2d.design.shared_descents import SharedDescents
from rock2d.errors import InputError
from rock2d.files.posterior_table import FACTOR, Posterior
from rock2d.files.scenario import Scenario
from rock2d.files.scenario_variants import variant
from rock2d.processes import Processes
from rock2d.runs.campaigns.job import crossings_job
from rock2d.runs.indicators.crossings import CROSSING_VALUES, crossing_values
from rock2d.runs.indicators.passing import arrivals
from rock2d.runs.indicators.percentiles import QUANTITIES

Array = np.ndarray

EXTREME_SHARES = np.array([1e-3, 1.0 - 1e-3])  # of a distribution
IN_THIS_PROCESS: Crew = Processes(1).as_finished
RELEASES_OF_A_GROUP = 7  # first number of the spawn key


@dataclass(frozen=True)
class PossibleSites:
    """Values of what is not known.

    Attributes
    ----------
    places : (d,) where the values stand in the scenario file
    values : (N (d + 2), d) in the order of SALib's Sobol sample: in each of N groups the first and the last site are
        independent draws, the d in between take one value each from the last
    seed : from which the releases of each group follow
    posterior : draws of a calibration; the value of its factor is the number of a draw
    """

    places: tuple[str, ...]
    values: Array
    seed: int = 0
    posterior: Posterior | None = None

    @property
    def independent(self) -> Array:
        """(N,) indices of sites that share neither values nor releases: the first of each group."""
        return np.arange(0, len(self.values), len(self.places) + 2)

    def release_seed(self, i: int) -> int:
        """Seed of the releases of site i, which its group shares."""
        group = i // (len(self.places) + 2)
        return int(
            np.random.SeedSequence(self.seed, spawn_key=(RELEASES_OF_A_GROUP, group)).generate_state(1)[0]
        )

    def __getitem__(self, i: int) -> dict[str, float]:
        """Place -> value of site i."""
        found = dict(zip(self.places, self.values[i].tolist(), strict=True))
        return found if self.posterior is None else found | self.posterior.values(found.pop(FACTOR))


def draw_sites(scenario: Scenario, seed: int, count: int | None = None) -> PossibleSites:
    """Sites that are possible under the scenario's `uncertainty`; `count` instead of its base number N.

    Raises InputError if the scenario says nothing about what is not known.
    """
    from SALib.sample import sobol

    if scenario.uncertainty is None or scenario.document is None:
        raise InputError("missing key 'uncertainty'", code="missing_key", key="uncertainty")
    unknown = scenario.unknown()
    places = tuple(unknown)
    problem = {"num_vars": len(places), "names": list(places), "bounds": [[0.0, 1.0]] * len(places)}
    power = int(np.ceil(np.log2(count or scenario.uncertainty.sites)))
    u = sobol.sample(problem, 2**power, calc_second_order=False, seed=seed)
    columns = []
    for place, own in zip(places, u.T, strict=True):
        columns.append(unknown[place](own.clip(1e-9, 1 - 1e-9)))
    return PossibleSites(places, np.column_stack(columns), seed, scenario.posterior)


@dataclass(frozen=True)
class SiteResults:
    """What n releases of each of b blocks do at l measure lines of s sites.

    Attributes
    ----------
    passed, unresolved : (s, b, l, n) bool, of each line: passed, or cut short or buried before it
    arrived : (s, b, l, n) bool, came to the arrival line of each line
    crossings : quantity (of `percentiles.QUANTITIES`) -> (s, b, l, n), NaN where not passed
    """

    blocks: tuple[str, ...]
    lines: tuple[str, ...]
    passed: Array
    unresolved: Array
    arrived: Array
    crossings: dict[str, Array]


def simulate_sites(
    scenarios: Sequence[Scenario],
    engine: str,
    seeds: Sequence[int],
    releases: int,
    on_progress: Callable[[int], Any] = lambda count: None,
    descents: list[SharedDescents] | None = None,
    crew: Crew = IN_THIS_PROCESS,
) -> SiteResults:
    """Simulate releases on each of these scenarios, which have the same blocks and lines; the seed of each says which.

    `on_progress` gets the number of further scenarios that are done; `descents` of each site, which are kept, are what
    the releases share with those of other sizes; `crew` does the work. Raises InputError if a scenario cannot be
    simulated.
    """
    jobs = [
        (own, engine, seed, releases, descents[s] if descents else None)
        for s, (own, seed) in enumerate(zip(scenarios, seeds, strict=True))
    ]
    found: dict[int, SiteResults] = {}
    with closing(crew(_simulated, jobs)) as finished:
        for s, (found[s], new) in finished:
            if descents and new:
                descents[s] = new
            on_progress(1)
    return _joined([found[s] for s in range(len(scenarios))])


def _simulated(
    scenario: Scenario, engine: str, seed: int, releases: int, descents: SharedDescents | None
) -> tuple[SiteResults, SharedDescents | None]:
    """One site, and its descents if they were not known."""
    known = descents is None or descents.found is not None
    shared = descents.of_blocks() if descents else []
    blocks, lines = tuple(scenario.make_blocks()), tuple(scenario.make_cross_section().measure_lines)
    shape = (1, len(blocks), len(lines), releases)
    passed, unresolved, arrived = (np.zeros(shape, bool) for _ in range(3))
    crossings = {quantity: np.full(shape, np.nan) for quantity in QUANTITIES}
    job = crossings_job(scenario, engine, seed)
    job.conditions.check_starts(releases)
    for b in range(len(job.blocks)):
        group = job.conditions.group(b, 0, releases)
        served = bool(shared) and shared[b].serves(group)
        found = shared[b].outcome(job, group) if served else job.outcome(group)
        own = found.passed(len(lines))
        passed[0, b], unresolved[0, b] = own.T, found.unresolved(len(lines)).T
        arrived[0, b] = [own[:, here].any(axis=1) for here in arrivals(job.cross_section)]
        for k, ends in enumerate(job.cross_section.measure_lines.values()):
            masses = group.masses()[own[:, k]]
            values = crossing_values(found.crossings[own[:, k], k], ends, job.cross_section, masses)
            for quantity, of in crossings.items():
                of[0, b, k, own[:, k]] = values[:, CROSSING_VALUES.index(quantity)]
    results = SiteResults(blocks, lines, passed, unresolved, arrived, crossings)
    return results, None if known else descents


def _joined(results: Sequence[SiteResults]) -> SiteResults:
    """Results of several sites, one after the other."""
    first = results[0]
    passed, unresolved, arrived = (
        np.concatenate([getattr(own, name) for own in results])
        for name in ("passed", "unresolved", "arrived")
    )
    crossings = {
        quantity: np.concatenate([own.crossings[quantity] for own in results]) for quantity in first.crossings
    }
    return SiteResults(first.blocks, first.lines, passed, unresolved, arrived, crossings)


def check_extremes(scenario: Scenario) -> None:
    """Raises InputError if an extreme value of what is not known makes no sense."""
    for place, quantile in scenario.unknown().items():
        for value in quantile(EXTREME_SHARES) if place != FACTOR else ():
            variant(scenario, {place: float(value)})


def variants_of(scenario: Scenario, sites: PossibleSites) -> list[Scenario]:
    """The scenario of each site. Raises InputError if a drawn value makes no sense."""
    return [variant(scenario, sites[i]) for i in range(len(sites.values))]
