"""Possible sites: draws of everything that is not known about a site, and the results there.

The draws are those of Saltelli et al. (2010), Comput. Phys. Commun. 181, 259: N groups of two independent sites and d
sites that share all values but one with the first. From these follow Sobol indices, that is the share of each value in
the variance. The sites of a group have the same releases (common random numbers). Different groups have different
releases, so that the error of sampling appears in the spread of the sites."""

from collections.abc import Callable, Sequence
from contextlib import closing
from dataclasses import dataclass
from typing import Any

import numpy as np

from rock2d.arrays import Array
from rock2d.cluster import JobRunner
from rock2d.design.shared_descents import SharedDescents
from rock2d.errors import InputError
from rock2d.files.posterior_table import ROW, Posterior
from rock2d.files.scenario import Scenario
from rock2d.files.scenario_variants import variant
from rock2d.processes import Processes
from rock2d.runs.campaigns.group_outcomes import group_outcome
from rock2d.runs.campaigns.job import crossings_job
from rock2d.runs.indicators.crossings import CROSSING_VALUES, crossing_values
from rock2d.runs.indicators.passing import LINE_QUANTITIES, arrivals

EXTREME_SHARES = np.array([1e-3, 1.0 - 1e-3])  # quantiles that count as extreme
IN_THIS_PROCESS: JobRunner = Processes(1).as_finished
RELEASES_OF_A_GROUP = 7  # first number of the spawn key


@dataclass(frozen=True)
class PossibleSites:
    """Values of everything that is not known, at N (d + 2) sites.

    Attributes
    ----------
    places : (d,) places of the values in the scenario file
    values : (N (d + 2), d) in the order of the Sobol sample of SALib: in each of N groups the first and the last site
        are independent draws; each of the d sites between them takes one value from the last site
    seed : seed of the releases of all groups
    posterior : draws of a calibration; the value of `ROW` is the number of a row"""

    places: tuple[str, ...]
    values: Array
    seed: int = 0
    posterior: Posterior | None = None

    @property
    def independent(self) -> Array:
        """(N,) indices of sites that share neither values nor releases: the first of each group."""
        return np.arange(0, len(self.values), len(self.places) + 2)

    def release_seed(self, i: int) -> int:
        """Seed of the releases of site i; all sites of a group have the same."""
        group = i // (len(self.places) + 2)
        own = np.random.SeedSequence(self.seed, spawn_key=(RELEASES_OF_A_GROUP, group))
        return int(own.generate_state(1)[0])

    def __getitem__(self, i: int) -> dict[str, float]:
        """Place -> value of site i."""
        found = dict(zip(self.places, self.values[i].tolist(), strict=True))
        return found if self.posterior is None else found | self.posterior.values(found.pop(ROW))


def draw_sites(scenario: Scenario, seed: int, count: int | None = None) -> PossibleSites:
    """Draw possible sites of a scenario; `count`, a power of two, replaces its base number N of groups.

    Raises InputError if the scenario has no key `uncertainty`."""
    from SALib.sample import sobol

    if scenario.uncertainty is None:
        raise InputError("missing key 'uncertainty'", code="missing_key", key="uncertainty")
    unknown = scenario.unknown()
    places = tuple(unknown)
    problem = {"num_vars": len(places), "names": list(places), "bounds": [[0.0, 1.0]] * len(places)}
    u = sobol.sample(problem, count or scenario.uncertainty.base_sites, calc_second_order=False, seed=seed)
    columns = [unknown[place](column.clip(1e-9, 1 - 1e-9)) for place, column in zip(places, u.T, strict=True)]
    return PossibleSites(places, np.column_stack(columns), seed, scenario.posterior)


@dataclass(frozen=True)
class SiteResults:
    """Results of n releases of each of b blocks at l measure lines of s sites.

    Attributes
    ----------
    passed, unresolved : (s, b, l, n) bool: whether a release passed a line; whether it was cut short or buried before
    arrived : (s, b, l, n) bool: whether it came to the arrival line of a line
    crossings : quantity (of `indicators.passing.LINE_QUANTITIES`) -> (s, b, l, n), NaN if it did not pass"""

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
    run_jobs: JobRunner = IN_THIS_PROCESS,
) -> SiteResults:
    """Simulate releases on each of these scenarios, which have the same blocks and lines, with these seeds.

    `on_progress` gets the number of further scenarios that are done. `descents` are the descents on each site that the
    releases share with those of other sizes; computed ones are kept there. `run_jobs` distributes the work. Raises
    InputError if a scenario cannot be simulated."""
    jobs = [
        (scenario, engine, seed, releases, descents[s] if descents else None)
        for s, (scenario, seed) in enumerate(zip(scenarios, seeds, strict=True))
    ]
    found: dict[int, SiteResults] = {}
    with closing(run_jobs(_simulated, jobs)) as finished:
        for s, (found[s], new) in finished:
            if descents and new:
                descents[s] = new
            on_progress(1)
    sites = [found[s] for s in range(len(scenarios))]
    passed, unresolved, arrived = (
        np.concatenate([getattr(site, name) for site in sites]) for name in ("passed", "unresolved", "arrived")
    )
    crossings = {name: np.concatenate([site.crossings[name] for site in sites]) for name in LINE_QUANTITIES}
    return SiteResults(sites[0].blocks, sites[0].lines, passed, unresolved, arrived, crossings)


def _simulated(
    scenario: Scenario, engine: str, seed: int, releases: int, descents: SharedDescents | None
) -> tuple[SiteResults, SharedDescents | None]:
    """Results of one site, and its descents if they were not known before."""
    known = descents is None or descents.found is not None
    shared = descents.of_blocks() if descents else []
    blocks, lines = tuple(scenario.make_blocks()), tuple(scenario.make_cross_section().measure_lines)
    shape = (1, len(blocks), len(lines), releases)
    passed, unresolved, arrived = (np.zeros(shape, bool) for _ in range(3))
    crossings = {quantity: np.full(shape, np.nan) for quantity in LINE_QUANTITIES}
    job = crossings_job(scenario, engine, seed)
    job.check_starts(releases)
    for b in range(len(job.blocks)):
        group = job.group(b, 0, releases)
        applies = bool(shared) and shared[b].applies_to(group)
        found = shared[b].outcome(job, group) if applies else group_outcome(job, group)
        passing = found.passed(len(lines))
        passed[0, b], unresolved[0, b] = passing.T, found.unresolved(len(lines)).T
        arrived[0, b] = [passing[:, here].any(axis=1) for here in arrivals(job.cross_section)]
        for k, ends in enumerate(job.cross_section.measure_lines.values()):
            masses = group.masses()[passing[:, k]]
            values = crossing_values(found.crossings[passing[:, k], k], ends, job.cross_section, masses)
            for quantity, table in crossings.items():
                table[0, b, k, passing[:, k]] = values[:, CROSSING_VALUES.index(quantity)]
    results = SiteResults(blocks, lines, passed, unresolved, arrived, crossings)
    return results, None if known else descents


def check_extremes(scenario: Scenario) -> None:
    """Raise InputError if an extreme value of something that is not known makes no sense."""
    for place, quantile in scenario.unknown().items():
        for value in quantile(EXTREME_SHARES) if place != ROW else ():
            variant(scenario, {place: float(value)})


def variants_of(scenario: Scenario, sites: PossibleSites) -> list[Scenario]:
    """The scenario of each site. Raises InputError if a drawn value makes no sense."""
    return [variant(scenario, sites[i]) for i in range(len(sites.values))]
