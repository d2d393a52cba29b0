"""Groups of releases of a campaign through the compiled ensembles of an engine."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from rock2d.records.columns import AT_THETA, I_TIME, I_ZONE, N_INSTANT, STOPS, UNRESOLVED_STOPS
from rock2d.runs.campaigns.job import Job
from rock2d.runs.incident_states import DRAW_GROUP, drawn_seeds

Array = np.ndarray

FIRST_IMPACT_ROOM = 64  # impacts of a release that are recorded at first; a release with more runs once more
SECOND_IMPACT_ROWS = 64 * DRAW_GROUP  # impacts that such a second run may have room for at once


class Group(NamedTuple):
    """Releases of the block with index `block` that are simulated in one call; `first` is the number of the first.

    states : (n, 6)
    """

    block: int
    first: int
    states: Array


@dataclass
class Outcome:
    """What an engine found out about n releases; shapes as in `engines.batch.BatchResult`.

    impacts : their releases (k,), zone indices (k,) and values (k, 16) from t_s on, as in IMPACT_COLUMNS
    unclosed : number of releases whose energy audit does not close
    """

    stop: list[str]
    ends: Array
    crossings: Array
    impacts: tuple[Array, Array, Array] | None = None
    samples: Array | None = None
    unclosed: int = 0

    def passed(self, lines: int) -> Array:
        """(n, lines) bool, which releases crossed each of the first `lines` lines."""
        return np.isfinite(self.crossings[:, :lines, 0])

    def unresolved(self, lines: int) -> Array:
        """(n, lines) bool, which were cut short or buried before they crossed it."""
        return ~self.passed(lines) & np.isin(self.stop, UNRESOLVED_STOPS)[:, None]


def batch_outcome(job: Job, group: Group) -> Outcome:
    """A group of releases with the batch engine."""
    from rock2d.engines.batch import Ensemble, run_batch
    from rock2d.engines.energy_balance import unclosed
    from rock2d.laws.contact import parameter_table

    table = parameter_table(job.parameters[group.block], job.cross_section.zone_names)
    ensemble = Ensemble([job.blocks[group.block]], [job.cross_section], [table])
    times = job.times_s() if "samples" in job.keep else None

    def run(some: Array | slice, room: int) -> Any:
        return run_batch(
            ensemble, group.states[some], gravity_m_s2=job.gravity_m_s2, time_limit_s=job.time_limit_s,
            impact_room=room, times_s=times,
            stop_when_spent=job.keep == ("crossings",),  # any other output lasts until the block stops
        )  # fmt: skip

    def impacts(rows: Array) -> tuple[Array, Array]:
        return rows[:, I_ZONE].astype(int), rows[:, I_TIME:]

    outcome, result = _outcome(job, run, impacts)
    outcome.unclosed = int(unclosed(result.energy_J).sum())
    if times is not None:
        outcome.samples = result.samples
    return outcome


def point_mass_outcome(job: Job, group: Group) -> Outcome:
    """A group of releases with the point-mass engine."""
    from rock2d.engines.point_mass import FACET, VELOCITIES
    from rock2d.engines.point_mass_batch import run_point_mass_batch

    seeds = drawn_seeds(job.seed, group.block, group.first, group.first + len(group.states))

    def run(some: Array | slice, room: int) -> Any:
        return run_point_mass_batch(
            job.blocks[group.block], job.cross_section, job.parameters[group.block], group.states[some], seeds[some],
            gravity_m_s2=job.gravity_m_s2, time_limit_s=job.time_limit_s, impact_room=room,
        )  # fmt: skip

    def impacts(rows: Array) -> tuple[Array, Array]:
        unknown = np.full((len(rows), 2), np.nan)  # penetration and force
        before = rows[:, :N_INSTANT]  # a rebound takes no time and changes no pose
        values = np.column_stack([before, before[:, : AT_THETA + 1], rows[:, VELOCITIES], unknown])
        return job.cross_section.zone_ids[rows[:, FACET].astype(int)], values

    return _outcome(job, run, impacts)[0]


def _outcome(
    job: Job,
    run: Callable[[Array | slice, int], Any],
    impacts: Callable[[Array], tuple[Array, Array]],
) -> tuple[Outcome, Any]:
    """The outcome of an engine's `run` (releases, room for impacts), and what it gave; `impacts` takes its rows to zone
    indices and values."""
    keep = "impacts" in job.keep
    result = run(slice(None), FIRST_IMPACT_ROOM if keep else 0)
    outcome = Outcome([STOPS[i] for i in result.stop], result.ends, result.crossings)
    if keep:
        release, rows = _all_impacts(result.impacts, result.impact_count, run)
        outcome.impacts = release, *impacts(rows)
    return outcome, result


def _all_impacts(impacts: Array, count: Array, run: Callable[[Array, int], Any]) -> tuple[Array, Array]:
    """Every impact of n releases: their releases (k,) and rows (k, width), in order.

    `impacts` (n, room, width) holds the first ones of `count` (n,); `run` (releases, room) runs those that had
    more once more.
    """
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
    for some, held in found_rows:
        which, k = np.nonzero(np.arange(held.shape[1]) < count[some, None])
        releases.append(some[which])
        rows.append(held[which, k])
    release = np.concatenate(releases)
    order = np.argsort(release, kind="stable")
    return release[order], np.concatenate(rows)[order]
