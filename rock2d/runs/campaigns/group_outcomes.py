"""The outcome of a group of releases, simulated with a compiled engine."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from rock2d.arrays import Array
from rock2d.records.columns import I_TIME, I_ZONE, INSTANT_THETA, N_INSTANT, STOPS, TIME, UNRESOLVED_STOPS
from rock2d.runs.campaigns.job import Job
from rock2d.runs.conditions import Group
from rock2d.runs.engines import Condition
from rock2d.runs.incident_states import DRAW_GROUP
from rock2d.runs.indicators.passing import PassingCounts, arrivals, count_passing
from rock2d.scene.cross_section import CrossSection

if TYPE_CHECKING:
    from rock2d.engines.batch import Ensemble

UNRESOLVED = np.isin(STOPS, UNRESOLVED_STOPS)  # (STOPS,) bool
FIRST_IMPACT_ROOM = 64  # impacts of a release that are recorded at first; releases with more are repeated
OWN_CONDITIONS_AT_ONCE = 200  # releases with their own conditions that are in memory together
SECOND_IMPACT_ROWS = 64 * DRAW_GROUP  # room for impacts of the repeated releases of one call


@dataclass
class Outcome:
    """Results of n releases; shapes as in `engines.batch.BatchResult`.

    stop : (n,) index into STOPS
    impacts : their releases (k,), zone indices (k,) and values (k, 16) from t_s on, as in IMPACT_COLUMNS
    unclosed : number of releases whose energy audit does not close
    saved_contacts : contacts of suspended releases"""

    stop: Array
    ends: Array
    crossings: Array
    impacts: tuple[Array, Array, Array] | None = None
    samples: Array | None = None
    unclosed: int = 0
    saved_contacts: Array | None = None

    def passed(self, lines: int) -> Array:
        """(n, lines) bool: whether a release crossed each of the first `lines` lines."""
        return np.isfinite(self.crossings[:, :lines, 0])

    def unresolved(self, lines: int) -> Array:
        """(n, lines) bool: whether a release was cut short or buried before it crossed a line."""
        return ~self.passed(lines) & UNRESOLVED[self.stop][:, None]

    def passing(self, ground: CrossSection) -> PassingCounts:
        """Numbers of releases that passed, arrived and were unresolved, at each measure line."""
        passed = self.passed(len(ground.measure_lines))
        return count_passing(passed, UNRESOLVED[self.stop], arrivals(ground))


def group_outcome(job: Job, group: Group) -> Outcome:
    """Simulate a group of releases with the compiled engine of a job."""
    return {"batch": batch_outcome, "point_mass": point_mass_outcome}[job.engine](job, group)


def batch_outcome(job: Job, group: Group, suspend_x_m: float = np.inf) -> Outcome:
    """Simulate a group of releases with the batch engine, and suspend them at `suspend_x_m`. Suspended releases
    continue from their states.

    Times count from the start of a release."""
    from rock2d.engines.batch import run_batch
    from rock2d.engines.energy_balance import unclosed

    times = job.times_s() if "samples" in job.keep else None

    def run(part: Group, room: int) -> Any:
        ensemble, (block_ids, ground_ids, table_ids) = _ensemble(part.conditions)
        elapsed, saved_contacts = part.suspended or (0.0, None)
        return run_batch(
            ensemble, part.states, block_ids=block_ids, cross_section_ids=ground_ids, table_ids=table_ids,
            gravity_m_s2=job.scenario.gravity_m_s2, time_limit_s=job.time_limit_s - elapsed,
            impact_room=room, times_s=times,
            stop_when_spent=job.keep == ("crossings",),  # other outputs need the stop of the block
            stop_when_captured=not {"impacts", "samples"} & set(job.keep),  # these include the trembling of the block
            suspend_x_m=suspend_x_m, saved_contacts=saved_contacts,
        )  # fmt: skip

    def impacts(release: Array, rows: Array) -> tuple[Array, Array]:
        return rows[:, I_ZONE].astype(int), rows[:, I_TIME:]

    outcome, result = _outcome(job, group, run, impacts)
    outcome.unclosed = int(unclosed(result.energy_J).sum())
    outcome.saved_contacts = result.saved_contacts
    if group.suspended is not None:
        outcome.ends[:, TIME] += group.suspended.elapsed_s
        outcome.crossings[:, :, TIME] += group.suspended.elapsed_s[:, None]
    if times is not None:
        outcome.samples = result.samples
    return outcome


def _ensemble(conditions: Sequence[Condition]) -> tuple[Ensemble, tuple[Array, Array, Array]]:
    """The distinct blocks, cross-sections and parameters of releases, and the ids of each release."""
    from rock2d.engines.batch import Ensemble

    blocks, block_ids = distinct([condition.block for condition in conditions])
    grounds, ground_ids = distinct([condition.cross_section for condition in conditions])
    tables, table_ids = distinct([condition.parameters for condition in conditions])
    return Ensemble(blocks, grounds, tables), (block_ids, ground_ids, table_ids)


def distinct(items: Sequence[Any]) -> tuple[list[Any], Array]:
    """The distinct objects in order of appearance, and the index of each item among them."""
    places: dict[int, int] = {}
    index = np.array([places.setdefault(id(item), len(places)) for item in items])
    return list({id(item): item for item in items}.values()), index


def point_mass_outcome(job: Job, group: Group) -> Outcome:
    """Simulate a group of releases with the point-mass engine."""
    from rock2d.engines.point_mass import FACET, VELOCITIES, run_point_mass_batch

    def run(part: Group, room: int) -> Any:
        found = []
        for i in range(len(part.conditions)):
            some = slice(None) if len(part.conditions) == 1 else slice(i, i + 1)
            found.append(
                run_point_mass_batch(
                    *part.conditions[i][:3], part.states[some], part.seeds[some],
                    gravity_m_s2=job.scenario.gravity_m_s2, time_limit_s=job.time_limit_s, impact_room=room,
                )
            )  # fmt: skip
        return _joined(found)

    def impacts(release: Array, rows: Array) -> tuple[Array, Array]:
        unknown = np.full((len(rows), 2), np.nan)  # penetration and force
        before = rows[:, :N_INSTANT]  # a rebound changes neither time nor pose
        values = np.column_stack([before, before[:, : INSTANT_THETA + 1], rows[:, VELOCITIES], unknown])
        facets = rows[:, FACET].astype(int)
        if len(group.conditions) == 1:
            return group.conditions[0].cross_section.zone_ids[facets], values
        grounds = [group.conditions[i].cross_section for i in release]
        return np.array([ground.zone_ids[k] for ground, k in zip(grounds, facets, strict=True)], int), values

    return _outcome(job, group, run, impacts)[0]


def _in_parts(group: Group, run: Callable[[Group, int], Any], room: int) -> Any:
    """Result of `run` for a group. Releases with their own conditions are run in parts, because their grounds take
    memory."""
    if len(group.conditions) == 1:
        return run(group, room)
    firsts = range(0, len(group.states), OWN_CONDITIONS_AT_ONCE)
    return _joined([run(group.subset(slice(i, i + OWN_CONDITIONS_AT_ONCE)), room) for i in firsts])


def _joined(results: list[Any]) -> Any:
    """Results of an engine, concatenated."""
    if len(results) == 1:
        return results[0]
    return type(results[0])(*map(np.concatenate, zip(*results, strict=True)))


def _outcome(
    job: Job, group: Group, run: Callable[[Group, int], Any], impacts: Callable[[Array, Array], tuple[Array, Array]]
) -> tuple[Outcome, Any]:
    """The outcome of `run` (releases, room for impacts) of an engine, and its own result. `impacts` converts releases
    and rows to zone indices and values."""
    keep = "impacts" in job.keep
    result = _in_parts(group, run, FIRST_IMPACT_ROOM if keep else 0)
    outcome = Outcome(result.stop, result.ends, result.crossings)
    if keep:
        release, rows = _all_impacts(
            result.impacts, result.impact_count, lambda some, room: _in_parts(group.subset(some), run, room)
        )
        outcome.impacts = release, *impacts(release, rows)
    return outcome, result


def _all_impacts(impacts: Array, count: Array, run: Callable[[Array, int], Any]) -> tuple[Array, Array]:
    """All impacts of n releases: their releases (k,) and rows (k, width), in order.

    `impacts` (n, room, width) holds the first impacts of the `count` (n,) of each release; `run` (releases, room)
    repeats releases that had more."""
    room = impacts.shape[1]
    found_rows = [(np.flatnonzero(count <= room), impacts[count <= room])]
    crowded = np.flatnonzero(count > room)
    if len(crowded):
        room = int(count[crowded].max())
        at_once = max(1, SECOND_IMPACT_ROWS // room)
        for i in range(0, len(crowded), at_once):
            some = crowded[i : i + at_once]
            found_rows.append((some, run(some, room).impacts))
    releases, rows = [], []
    for some, found in found_rows:
        which, k = np.nonzero(np.arange(found.shape[1]) < count[some, None])
        releases.append(some[which])
        rows.append(found[which, k])
    release = np.concatenate(releases)
    order = np.argsort(release, kind="stable")
    return release[order], np.concatenate(rows)[order]
