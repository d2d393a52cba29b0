"""The number of releases that a given precision of the passing frequencies needs."""

import math

import numpy as np

from rock2d.errors import InputError
from rock2d.files.scenario import Scenario
from rock2d.progress import Bars
from rock2d.runs.campaigns.group_outcomes import group_outcome
from rock2d.runs.campaigns.job import crossings_job
from rock2d.runs.incident_states import DRAW_GROUP
from rock2d.statistics import wilson_interval

MOST_RELEASES_FOR_PRECISION = 1_000_000  # of each block
LARGEST_STEP = 10.0  # largest factor by which the number of releases grows at once


def releases_for_precision(
    scenario: Scenario, engine: str, seed: int, half_width: float, first: int, progress: bool = False
) -> int:
    """Number of releases of each block, at least `first`, with which the half-width of every 95 % interval of a passing
    frequency, as a share of the released blocks, is at most `half_width`.

    Releases are simulated until the precision is reached. Raises InputError if the scenario has no measure line, or if
    MOST_RELEASES_FOR_PRECISION are not enough."""
    job = crossings_job(scenario, engine, seed)
    if not job.cross_section.measure_lines:
        raise scenario.error(
            "needs measure_lines: the precision is that of passing frequencies", "cross_section", at="key"
        )
    counts = np.zeros((len(job.blocks), len(job.cross_section.measure_lines)), int)
    most_counts, done, wanted = counts.copy(), 0, first
    with Bars(progress).stage("precision", 0, "releases") as bar:
        while True:
            job.check_starts(wanted)
            for b in range(len(job.blocks)):
                for start in range(done, wanted, DRAW_GROUP):
                    stop = min(start + DRAW_GROUP, wanted)
                    found = group_outcome(job, job.group(b, start, stop)).passing(job.cross_section)
                    counts[b] += found.passed
                    most_counts[b] += found.passed + found.unresolved
                    bar.update(stop - start)
            done = wanted
            widest = max(
                0.5 * (wilson_interval(most, done)[1] - wilson_interval(least, done)[0])
                for least, most in zip(counts.ravel().tolist(), most_counts.ravel().tolist(), strict=True)
            )
            if widest <= half_width:
                return done
            if done >= MOST_RELEASES_FOR_PRECISION:
                raise InputError(
                    f"with {done} releases of each block, the half-width of an interval is still {100 * widest:.2g} %"
                )
            wanted = math.ceil(done * min(1.05 * (widest / half_width) ** 2, LARGEST_STEP))
            wanted = min(max(wanted, done + 1), MOST_RELEASES_FOR_PRECISION)
