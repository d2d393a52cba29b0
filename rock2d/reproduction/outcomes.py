"""Simulated releases of many hypotheses with both models: passed measure lines and first impacts."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np

from rock2d.arrays import Array
from rock2d.engines.batch import BatchResult, Ensemble, run_batch
from rock2d.engines.point_mass import FACET, run_point_mass_batch
from rock2d.laws.rebound import ReboundParameters
from rock2d.records.columns import BEFORE_INSTANT, I_ZONE, INSTANT_VX, INSTANT_VY, N_INSTANT, TIME, VY, Y
from rock2d.reproduction.hypotheses import (
    ZONES,
    Values,
    contact_table,
    hypothesis_cross_section,
    incident_distributions,
    table_4,
)
from rock2d.reproduction.published import GRAVITY_M_S2, LINES, SETUP_BLOCKS
from rock2d.runs.campaigns.group_outcomes import distinct
from rock2d.scene.world import World

RELEASES_PER_CALL = 40_000  # of the batch engine
TIME_LIMIT_S = 3.0
SHARE_PAST_SLOPE = 0.5  # least share of the releases of a hypothesis that must not touch the slope again
SLOPE_ID = ZONES.index("slope")
FACING_ID = ZONES.index("uphill_face")
DITCH_ID = ZONES.index("ditch")

WorldChange = Callable[[World, int], World]  # world of hypothesis i -> the world to simulate


@dataclass(frozen=True)
class Outcome:
    """Results of n releases of each of k hypotheses.

    Attributes
    ----------
    crossed : (k, n, lines) whether a release passed each line
    first_zone : (k, n) zone id of the first impact, -1 without an impact
    off_normal_deg : (k, n) angle between the velocity before that impact and the normal of the facing, NaN without one
    at_line_2 : (k, n, 7) time and state at the first crossing of line 2, NaN if it was not passed
    possible : (k,) whether the energy of the drop allows the incident states, and most releases do not touch the slope
        again; the lines are evaluated only for possible hypotheses"""

    crossed: Array
    first_zone: Array
    off_normal_deg: Array
    at_line_2: Array
    possible: Array

    @property
    def by_last_line(self) -> Array:
        """(k, lines + 1) number of releases by the last line they passed."""
        return by_last_line(self.crossed)

    @property
    def frequencies(self) -> Array:
        """(k, lines) passing frequencies."""
        return self.crossed.mean(axis=1)

    def of_hypotheses(self, chosen: Array | slice) -> Outcome:
        """The outcome of some of the hypotheses."""
        return Outcome(*(getattr(self, f.name)[chosen] for f in fields(self)))

    def first_in(self, zone: int) -> Array:
        """(k,) number of releases whose first impact was in this zone."""
        return (self.first_zone == zone).sum(axis=1)


def by_last_line(crossed: Array) -> Array:
    """(k, lines + 1) number of releases by the last line they passed, from `crossed` (k, n, lines)."""
    last = (crossed * np.arange(1, crossed.shape[-1] + 1)).max(axis=-1)
    return (last[..., None] == np.arange(crossed.shape[-1] + 1)).sum(axis=1)


def deterministic_outcome(values: Values, block_name: str, draws: Array, change: WorldChange | None = None) -> Outcome:
    """Releases of a block with the deterministic model, for each hypothesis, from standard normal `draws` (n, 6).

    `change` adds a candidate effect to the world of a hypothesis."""
    outcome = deterministic_first_impacts(values, block_name, draws, change)
    possible = np.flatnonzero(outcome.possible)
    crossings = np.full((*outcome.first_zone.shape, len(LINES), N_INSTANT), np.nan)
    crossings[possible] = _crossings(values, block_name, draws, change, possible)
    return replace(outcome, **_line_fields(crossings))


def deterministic_crossed(values: Values, block_name: str, draws: Array, change: WorldChange | None = None) -> Array:
    """(k, n, lines) whether a release passes each line, as in `deterministic_outcome`, but for all hypotheses, also
    impossible ones."""
    every = np.arange(len(values["slope_deg"]))
    return np.isfinite(_crossings(values, block_name, draws, change, every)[..., TIME])


def deterministic_first_impacts(
    values: Values, block_name: str, draws: Array, change: WorldChange | None = None
) -> Outcome:
    """As `deterministic_outcome`, but only up to the first impact: no line counts as passed.

    A release is simulated until its centroid in free fall would be below all ground, so that the first impact must have
    begun. Its beginning does not depend on the contact parameters; those of Table 4 are used."""
    values = table_4(values)
    block, n = SETUP_BLOCKS[block_name], len(draws)
    incident = incident_distributions(values, block)
    every = incident.states(draws)
    height, rise = every[..., Y], every[..., VY]
    fall_time_s = (rise + np.sqrt(rise**2 + 2.0 * GRAVITY_M_S2 * height)) / GRAVITY_M_S2
    parts = []
    for chosen in _chunks(np.arange(len(every)), n):
        result = _simulate(
            _worlds(values, chosen, change), block_name, every[chosen], impact_limit=1, impact_room=1,
            time_limit_s=fall_time_s[chosen].ravel(),
        )  # fmt: skip
        zones, before = result.impacts[:, 0, I_ZONE], result.impacts[:, 0, BEFORE_INSTANT]
        possible = incident.possible[chosen] & _past_slope(zones, n)
        nowhere = np.full((len(chosen), n, len(LINES), N_INSTANT), np.nan)
        parts.append(_outcome(nowhere, zones, before, values["facing_deg"][chosen], possible))
    return _concatenated(parts)


def _crossings(values: Values, block_name: str, draws: Array, change: WorldChange | None, hypotheses: Array) -> Array:
    """(k', n, lines, 7) time and state at the first crossing of each line, for the `hypotheses` (k',) with these
    indices."""
    every = incident_distributions(values, SETUP_BLOCKS[block_name]).states(draws)
    parts = [np.empty((0, len(draws), len(LINES), N_INSTANT))]
    for chosen in _chunks(hypotheses, len(draws)):
        worlds = _worlds(values, chosen, change)
        result = _simulate(worlds, block_name, every[chosen], stop_when_spent=True, time_limit_s=TIME_LIMIT_S)
        parts.append(result.crossings.reshape(-1, *parts[0].shape[1:]))
    return np.concatenate(parts)


def _worlds(values: Values, hypotheses: Array, change: WorldChange | None) -> list[World]:
    tables, worlds = contact_table(values), []
    for i in hypotheses:
        ground = hypothesis_cross_section(values, i)
        world = World(SETUP_BLOCKS, ground, tables[i : i + 1], GRAVITY_M_S2)
        worlds.append(world if change is None else change(world, i))
    return worlds


def _simulate(worlds: list[World], block: str, states: Array, **options: Any) -> BatchResult:
    """Simulate releases `states` (k, n, 6) of one block, n in each of k worlds."""
    blocks, block_ids = distinct([world.blocks[block] for world in worlds])
    ids = np.repeat(np.arange(len(worlds)), states.shape[1])
    ensemble = Ensemble(blocks, [world.cross_section for world in worlds], [world.contact[0] for world in worlds])
    return run_batch(
        ensemble, states.reshape(-1, 6), block_ids=block_ids[ids], cross_section_ids=ids, table_ids=ids,
        gravity_m_s2=GRAVITY_M_S2, **options,
    )  # fmt: skip


def probabilistic_outcome(
    values: Values, block_name: str, draws: Array, slope_reduction_deg: Array | None = None
) -> Outcome:
    """Releases of a block with the probabilistic model, for each hypothesis, from standard normal `draws` (n, 6).

    `slope_reduction_deg` (k,) of each hypothesis; default 0. All zones but the facing have the parameters of the ditch.
    """
    block, n = SETUP_BLOCKS[block_name], len(draws)
    incident = incident_distributions(values, block)
    alpha = np.zeros(len(incident.mean)) if slope_reduction_deg is None else slope_reduction_deg
    seeds = np.zeros(n, np.uint64)  # unused: impacts have no random part
    parts = []
    for i, states in enumerate(incident.states(draws)):
        ground = hypothesis_cross_section(values, i)
        ditch, facing = (
            ReboundParameters(
                float(values[f"{zone}.friction_angle_deg"][i]),
                float(values[f"{zone}.momentum_half_kg_m_s"][i]),
                float(values[f"{zone}.tangential_restitution"][i]),
                float(alpha[i]),
            )
            for zone in ("ditch", "facing")
        )
        result = run_point_mass_batch(
            block, ground, {"default": ditch, "uphill_face": facing}, states, seeds,
            gravity_m_s2=GRAVITY_M_S2, time_limit_s=TIME_LIMIT_S, impact_room=1,
        )  # fmt: skip
        facet = result.impacts[:, 0, FACET]
        zones = np.where(np.isfinite(facet), ground.zone_ids[np.nan_to_num(facet).astype(int)], np.nan)
        possible = incident.possible[i : i + 1] & _past_slope(zones, n)
        before, angle = result.impacts[:, 0, :N_INSTANT], values["facing_deg"][i : i + 1]
        parts.append(_outcome(result.crossings[None], zones, before, angle, possible))
    return _concatenated(parts)


def _chunks(hypotheses: Array, releases: int) -> list[Array]:
    step = max(1, RELEASES_PER_CALL // releases)
    return [hypotheses[a : a + step] for a in range(0, len(hypotheses), step)]


def _past_slope(zones: Array, n: int) -> Array:
    """(k,) whether at least SHARE_PAST_SLOPE of the n releases of each hypothesis do not touch the slope first."""
    return np.asarray((zones.reshape(-1, n) == SLOPE_ID).mean(axis=1) <= 1.0 - SHARE_PAST_SLOPE)


def _outcome(crossings: Array, zones: Array, before: Array, facing_deg: Array, possible: Array) -> Outcome:
    """`crossings` (k, n, lines, 7); `zones` (k n) of first impacts, NaN without one; states `before` them (k n, 7)."""
    k, n = crossings.shape[:2]
    velocity = before[:, INSTANT_VX : INSTANT_VY + 1].reshape(k, n, 2)
    facing = np.radians(facing_deg)
    inward = np.column_stack([np.sin(facing), -np.cos(facing)])[:, None]
    cosine = (velocity * inward).sum(axis=-1) / np.hypot(velocity[..., 0], velocity[..., 1])
    return Outcome(
        first_zone=np.where(np.isfinite(zones), zones, -1).astype(int).reshape(k, n),
        off_normal_deg=np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0))), possible=possible,
        **_line_fields(crossings),
    )  # fmt: skip


def _line_fields(crossings: Array) -> dict[str, Array]:
    """The fields of an Outcome that depend on crossings (k, n, lines, 7)."""
    return {"crossed": np.isfinite(crossings[..., TIME]), "at_line_2": crossings[:, :, LINES.index("line_2")]}


def _concatenated(parts: list[Outcome]) -> Outcome:
    return Outcome(*(np.concatenate([getattr(part, f.name) for part in parts]) for f in fields(Outcome)))
