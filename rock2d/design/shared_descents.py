"""The descent that all sizes of an earthwork share, simulated once down to the place where their grounds differ.

Uphill of an embankment or a ditch nothing depends on its size, and most of the computing time is spent there. Each
release is suspended before the grounds differ, with the memory of its contacts, and continues from there with each
size."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rock2d.arrays import Array
from rock2d.files.scenario import Scenario
from rock2d.records.columns import INSTANT_STATE, N_INSTANT, STOP_REACHED, TIME
from rock2d.runs.campaigns.group_outcomes import Outcome, batch_outcome
from rock2d.runs.campaigns.job import Job, crossings_job
from rock2d.runs.conditions import Group, Suspended
from rock2d.scene.cross_section import CrossSection

EARTHWORKS = ("embankment", "ditch", "cross_section")  # keys of a scenario that change only the ground
SHARING_ENGINE = "batch"  # the engine that can suspend releases
OVERSHOOT_RADII = 2.0  # by which a release may move beyond the place where it is suspended
# The ground this far ahead of the place of suspension is the same: releases overshoot the place, and touch the ground
# within VIEW_RADII of `contact_search`. Balls look farther, BALL_VIEW_RADII, but only for how far they may move before
# the next search, which changes steps and no contact.
SEARCH_AHEAD_RADII = 5.0


@dataclass(frozen=True)
class Descent:
    """The motion of n releases of one block on one site until the grounds of all sizes differ, or until a measure line.

    Attributes
    ----------
    starts : (n, 6) incident states
    grounds : one for each release, or a single one for all
    suspend_x_m, radius_m : the x at which releases are suspended, and the largest radius of the blocks
    states : (n, 6) states at which they are suspended, or ended
    suspended : time and contact memory of suspended releases
    stop : (n,) index into STOPS; STOP_REACHED: suspended"""

    starts: Array
    grounds: Sequence[CrossSection]
    suspend_x_m: float
    radius_m: float
    states: Array
    suspended: Suspended
    stop: Array

    def applies_to(self, group: Group) -> bool:
        """Whether a group has the same starts, the same ground as far as the descent goes, and no measure line
        there."""
        return np.array_equal(self.starts, group.states) and all(
            equal_until_m(ground, condition.cross_section) >= self.suspend_x_m + SEARCH_AHEAD_RADII * self.radius_m
            and _first_line_m(condition.cross_section) >= self.suspend_x_m + OVERSHOOT_RADII * self.radius_m
            for ground, condition in zip(self.grounds, group.conditions, strict=True)
        )

    def outcome(self, job: Job, group: Group) -> Outcome:
        """The outcome of the releases on the ground of one size."""
        n, lines = len(group.states), len(job.cross_section.measure_lines)
        ends, crossings = np.full((n, N_INSTANT), np.nan), np.full((n, lines, N_INSTANT), np.nan)
        ends[:, TIME], ends[:, INSTANT_STATE], stop = self.suspended.elapsed_s, self.states, self.stop.copy()
        on = np.flatnonzero(stop == STOP_REACHED)
        if len(on):
            resumed = group.subset(on)._replace(states=self.states[on], suspended=self.suspended.subset(on))
            found = batch_outcome(job, resumed)
            ends[on], crossings[on], stop[on] = found.ends, found.crossings, found.stop
        return Outcome(stop, ends, crossings)


@dataclass
class SharedDescents:
    """Descents of all blocks on a site, simulated at the first use.

    Attributes
    ----------
    extremes : scenarios of the site for all corners of the ranges of sizes; the last one has the largest sizes. Empty
        once the descents are computed
    seed, releases : seed of the releases, and their number for each block
    found : the descent of each block, None before the first use"""

    extremes: Sequence[Scenario]
    seed: int
    releases: int
    found: list[Descent] | None = None

    def of_blocks(self) -> list[Descent]:
        """The descent of each block."""
        if self.found is None:
            largest = crossings_job(self.extremes[-1], SHARING_ENGINE, self.seed)
            grounds = [scenario.make_cross_section() for scenario in self.extremes]
            limits = (
                min(equal_until_m(ground, largest.cross_section) for ground in grounds),
                min(map(_first_line_m, grounds)),
            )
            groups = (largest.group(b, 0, self.releases) for b in range(len(largest.blocks)))
            self.found, self.extremes = [_descent(largest, group, limits) for group in groups], ()
        return self.found


def shares_descents(scenario: Scenario, place: str, engine: str) -> bool:
    """Whether variants in the number at this place can share descents: they differ only in the ground, the engine can
    suspend releases, and there is no diagnosis, whose effects may have further memory."""
    only_ground = place.split(".")[0] in EARTHWORKS
    return engine == SHARING_ENGINE and scenario.diagnosed is None and only_ground


def equal_until_m(one: CrossSection, other: CrossSection) -> float:
    """The x up to which two grounds are equal."""
    least = min(len(one.zones), len(other.zones))
    same = (one.points_m[: least + 1] == other.points_m[: least + 1]).all(axis=1)
    same[1:] &= [a == b for a, b in zip(one.zones[:least], other.zones[:least], strict=True)]
    common = len(same) if same.all() else int(np.argmin(same))
    return min(float(ground.points_m[max(common - 1, 0) :, 0].min()) for ground in (one, other))


def _first_line_m(ground: CrossSection) -> float:
    """The smallest x of all measure lines."""
    return min((float(ends[:, 0].min()) for ends in ground.measure_lines.values()), default=np.inf)


def _descent(job: Job, group: Group, limits: tuple[float, float]) -> Descent:
    """The descent before `limits`: the x where the grounds differ, and the x of the first measure line."""
    radius = max(condition.block.reach_m for condition in group.conditions)
    suspend_x_m = min(limits[0] - SEARCH_AHEAD_RADII * radius, limits[1] - OVERSHOOT_RADII * radius)
    found = batch_outcome(job, group, suspend_x_m)
    assert found.saved_contacts is not None
    grounds = [condition.cross_section for condition in group.conditions]
    suspended = Suspended(found.ends[:, TIME], found.saved_contacts)
    return Descent(group.states, grounds, suspend_x_m, radius, found.ends[:, INSTANT_STATE], suspended, found.stop)
