"""The descent that all sizes of an earthwork share: simulated once, down to where their grounds part.

Upslope of an embankment or a ditch nothing depends on its size, and most of a release's time is spent there. Each
release is suspended before the grounds part, with the memory of its contacts, and goes on from there with each size.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rock2d.files.scenario import Scenario
from rock2d.records.columns import INSTANT_STATE, N_INSTANT, STOP_REACHED, TIME
from rock2d.runs.campaigns.ensembles import Outcome, batch_outcome
from rock2d.runs.campaigns.job import Job, crossings_job
from rock2d.runs.conditions import Group, Suspended
from rock2d.scene.cross_section import CrossSection

Array = np.ndarray

EARTHWORKS = ("embankment", "ditch", "cross_section")  # keys of a scenario that change nothing but the ground
SHARING_ENGINE = "batch"  # the one that holds releases
OVERSHOOT = 2.0  # radii that a release may move on in one look before it is suspended
REACH = 5.0  # radii ahead of its centroid up to which a block looks at the ground, at most


@dataclass(frozen=True)
class Descent:
    """The motion of n releases of one block on one site until the grounds of all sizes differ, or until a measure line.

    Attributes
    ----------
    starts : (n, 6) the states at which they start
    grounds : one for each release, or a single one for all
    suspend_x_m, radius_m : the x at which they are suspended, and the largest radius of the blocks
    states : (n, 6) where they go on with each size, or ended
    suspended : time and contact memory with which they go on
    stop : (n,) index into STOPS, why they ended; STOP_REACHED: they go on
    """

    starts: Array
    grounds: Sequence[CrossSection]
    suspend_x_m: float
    radius_m: float
    states: Array
    suspended: Suspended
    stop: Array

    def serves(self, group: Group) -> bool:
        """Whether these releases have the same starts and ground, and no measure line, as far as the descent goes."""
        return np.array_equal(self.starts, group.states) and all(
            parting_m(own, met.cross_section) >= self.suspend_x_m + REACH * self.radius_m
            and _first_line_m(met.cross_section) >= self.suspend_x_m + OVERSHOOT * self.radius_m
            for own, met in zip(self.grounds, group.conditions, strict=True)
        )

    def outcome(self, job: Job, group: Group) -> Outcome:
        """What becomes of the releases with the ground of a size."""
        n, lines = len(group.states), len(job.cross_section.measure_lines)
        ends, crossings = np.full((n, N_INSTANT), np.nan), np.full((n, lines, N_INSTANT), np.nan)
        ends[:, TIME], ends[:, INSTANT_STATE], stop = self.suspended.elapsed_s, self.states, self.stop.copy()
        on = np.flatnonzero(stop == STOP_REACHED)
        if len(on):
            resumed = group.part(on)._replace(states=self.states[on], suspended=self.suspended.part(on))
            found = batch_outcome(job, resumed)
            ends[on], crossings[on], stop[on] = found.ends, found.crossings, found.stop
        return Outcome(stop, ends, crossings)


@dataclass
class SharedDescents:
    """Descents of all blocks on a site, which are simulated when they are first asked for.

    Attributes
    ----------
    extremes : scenarios of the site, with the smallest sizes first and with the largest last; between them, where
        several sizes vary, the other corners of their ranges. Empty once the descents are found
    seed, releases : seed of the releases, and their number, of each block
    found : the descent of each block
    """

    extremes: Sequence[Scenario]
    seed: int
    releases: int
    found: list[Descent] | None = None

    def of_blocks(self) -> list[Descent]:
        """The descent of each block."""
        if self.found is None:
            largest = crossings_job(self.extremes[-1], SHARING_ENGINE, self.seed)
            grounds = [own.make_cross_section() for own in self.extremes]
            limits = (
                min(parting_m(own, largest.cross_section) for own in grounds),
                min(map(_first_line_m, grounds)),
            )
            groups = (largest.conditions.group(b, 0, self.releases) for b in range(len(largest.blocks)))
            self.found, self.extremes = [_descent(largest, group, limits) for group in groups], ()
        return self.found


def shares_descents(scenario: Scenario, place: str, engine: str) -> bool:
    """Whether variants that differ in the number at this place differ in the ground alone, for an engine that can
    suspend releases. Effects of a diagnosis may remember more than the contacts do."""
    ground_alone = place.split(".")[0] in EARTHWORKS
    return engine == SHARING_ENGINE and scenario.diagnosed is None and ground_alone


def parting_m(one: CrossSection, other: CrossSection) -> float:
    """The x up to which two grounds are the same."""
    least = min(len(one.zones), len(other.zones))
    same = (one.points_m[: least + 1] == other.points_m[: least + 1]).all(axis=1)
    same[1:] &= [a == b for a, b in zip(one.zones[:least], other.zones[:least], strict=True)]
    common = len(same) if same.all() else int(np.argmin(same))
    return min(float(own.points_m[max(common - 1, 0) :, 0].min()) for own in (one, other))


def _first_line_m(ground: CrossSection) -> float:
    """The x up to which no measure line comes."""
    return min((float(ends[:, 0].min()) for ends in ground.measure_lines.values()), default=np.inf)


def _descent(job: Job, group: Group, limits: tuple[float, float]) -> Descent:
    """The descent before `limits`: where the grounds part, and the first measure line."""
    radius = max(own.block.reach_m for own in group.conditions)
    suspend_x_m = min(limits[0] - REACH * radius, limits[1] - OVERSHOOT * radius)
    found = batch_outcome(job, group, suspend_x_m)
    assert found.saved_contacts is not None
    grounds = [own.cross_section for own in group.conditions]
    suspended = Suspended(found.ends[:, TIME], found.saved_contacts)
    return Descent(
        group.states, grounds, suspend_x_m, radius, found.ends[:, INSTANT_STATE], suspended, found.stop
    )
