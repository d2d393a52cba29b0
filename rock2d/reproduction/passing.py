"""Releases of many hypotheses at once, with either model: how far up the facing each came, and where it first hit."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields
from typing import TYPE_CHECKING, Any

import numpy as np

from rock2d.blocks import Block
from rock2d.reproduction.hypotheses import ZONES, Values, contact_table, starts, terrain
from rock2d.world import World

if TYPE_CHECKING:
    from rock2d.engines.batch import BatchResult

Array = np.ndarray

CHUNK = 40_000  # releases in one call
TIME_LIMIT_S = 3.0
FEW_IMPACTS, MANY_IMPACTS = 6, 40  # recorded at first, and of releases that had not left the slope by then
FACING = ZONES.index("uphill_face")
DITCH = ZONES.index("ditch")

Change = Callable[[World, int], World]  # world of hypothesis i -> the world to simulate


@dataclass(frozen=True)
class Known:
    """What is known of the bench: the paper's blocks, the embankment, gravity."""

    blocks: Mapping[str, Block]
    height_m: float
    crest_m: float
    gravity_m_s2: float


@dataclass(frozen=True)
class Outcome:
    """Of n releases of each of k hypotheses.

    Attributes
    ----------
    crossed : (k, n, lines) whether a release passed each line
    first : (k, n) zone id of the first impact beyond the slope, -1 if there was none
    off_normal_deg : (k, n) angle between the velocity before that impact and the facing's normal, NaN if none
    at_line_2 : (k, n, 7) time and state at the first crossing of line 2, NaN if it was not passed
    possible : (k,) whether the drop's energy allows the hypothesis' starts
    """

    crossed: Array
    first: Array
    off_normal_deg: Array
    at_line_2: Array
    possible: Array

    @property
    def levels(self) -> Array:
        """(k, lines + 1) releases by the last line they passed."""
        last = (self.crossed * np.arange(1, self.crossed.shape[-1] + 1)).max(axis=-1)
        return (last[..., None] == np.arange(self.crossed.shape[-1] + 1)).sum(axis=1)

    @property
    def frequencies(self) -> Array:
        """(k, lines) passing frequencies."""
        return self.crossed.mean(axis=1)

    def of(self, chosen: Array) -> Outcome:
        """The outcome of some of the hypotheses."""
        return Outcome(*(getattr(self, f.name)[chosen] for f in fields(self)))

    def first_in(self, zone: int) -> Array:
        """(k,) releases whose first impact was in this zone."""
        return (self.first == zone).sum(axis=1)


def fall(
    known: Known, values: Values, block_name: str, draws: Array, change: Change | None = None
) -> Outcome:
    """The deterministic model: every hypothesis' releases of a block, from standard normal `draws` (n, 6).

    `change` gives the world a candidate effect; the effects of the catalogue do.
    """
    block, n = known.blocks[block_name], len(draws)
    begin = starts(values, block, known.gravity_m_s2)
    tables = contact_table(values)
    parts = []
    for chosen in _chunks(len(begin.mean), n):
        worlds = []
        for i in chosen:
            ground = terrain(values, i, known.height_m, known.crest_m)
            world = World(known.blocks, ground, tables[i : i + 1], known.gravity_m_s2)
            worlds.append(world if change is None else change(world, i))
        ids = np.repeat(np.arange(len(chosen)), n)
        states = begin.states(draws)[chosen].reshape(-1, 6)
        result = _run(worlds, block_name, ids, states, FEW_IMPACTS, stop_when_spent=True)
        zones, before = result.impacts[..., 0], result.impacts[..., 1:8]
        late = np.flatnonzero(~(zones > 0).any(axis=1))
        if late.size:  # spent before, or still on the slope: once more, until they have arrived
            again = _run(worlds, block_name, ids[late], states[late], MANY_IMPACTS, impact_limit=MANY_IMPACTS)
            zones, before = _first_beyond(zones, before)
            zones[late], before[late] = _first_beyond(again.impacts[..., 0], again.impacts[..., 1:8])
        parts.append(first_impacts(result.crossings, zones, before, values["facing_deg"][chosen], n))
    return _together(parts, begin.possible)


def _run(
    worlds: list[World], block: str, ids: Array, states: Array, room: int, **options: Any
) -> BatchResult:
    """Releases `states` (m, 6) of one block in the worlds `ids` (m,)."""
    from rock2d.engines.batch import Ensemble, run_batch

    blocks = list({id(world.blocks[block]): world.blocks[block] for world in worlds}.values())
    of_world = {id(b): i for i, b in enumerate(blocks)}
    block_ids = np.array([of_world[id(world.blocks[block])] for world in worlds])
    ensemble = Ensemble(blocks, [world.terrain for world in worlds], [world.contact[0] for world in worlds])
    return run_batch(
        ensemble, states, block_ids=block_ids[ids], terrain_ids=ids, table_ids=ids,
        gravity_m_s2=worlds[0].gravity_m_s2, time_limit_s=TIME_LIMIT_S, impact_room=room, **options,
    )  # fmt: skip


def bounce(
    known: Known, values: Values, block_name: str, draws: Array, slope_reduction_deg: Array | None = None
) -> Outcome:
    """The probabilistic model: the same releases as point masses, `slope_reduction_deg` (k,) of each hypothesis.

    The slope and the ground behind the crest take the ditch's parameters.
    """
    from rock2d.engines.point_mass_batch import run_point_mass_batch
    from rock2d.rebound import ReboundParameters

    block, n = known.blocks[block_name], len(draws)
    begin = starts(values, block, known.gravity_m_s2)
    alpha = np.zeros(len(begin.mean)) if slope_reduction_deg is None else slope_reduction_deg
    seeds = np.zeros(n, np.uint64)  # nothing is drawn at impacts
    parts = []
    for i, states in enumerate(begin.states(draws)):
        ground = terrain(values, i, known.height_m, known.crest_m)
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
            gravity_m_s2=known.gravity_m_s2, time_limit_s=TIME_LIMIT_S, impact_room=MANY_IMPACTS,
        )  # fmt: skip
        facet = result.impacts[..., 10]
        zones = np.where(np.isfinite(facet), ground.zone_ids[np.nan_to_num(facet).astype(int)], np.nan)
        parts.append(
            first_impacts(
                result.crossings, zones, result.impacts[..., :7], values["facing_deg"][i : i + 1], n
            )
        )
    return _together(parts, begin.possible)


def _chunks(hypotheses: int, releases: int) -> list[Array]:
    step = max(1, CHUNK // releases)
    return [np.arange(a, min(a + step, hypotheses)) for a in range(0, hypotheses, step)]


def _first_beyond(zones: Array, before: Array) -> tuple[Array, Array]:
    """Zone (m, 1) and state (m, 1, 7) of the first impact beyond the slope, NaN if there was none, of all impacts'."""
    beyond = zones > 0  # NaN where there was no impact
    rows, at = np.arange(len(zones)), beyond.argmax(axis=1)
    any_beyond: Array = np.asarray(beyond.any(axis=1))
    zone = np.where(any_beyond, zones[rows, at], np.nan)
    return zone[:, None], np.where(any_beyond[:, None], before[rows, at], np.nan)[:, None]


def first_impacts(crossings: Array, zones: Array, before: Array, facing_deg: Array, n: int) -> Outcome:
    """The outcome of n releases of each of k hypotheses, from crossings (k n, lines, 7), the zones of their impacts
    (k n, room; NaN if none) and the states before them (k n, room, 7)."""
    k = len(facing_deg)
    zone, state = (found[:, 0] for found in _first_beyond(zones, before))
    velocity = state[:, 4:6].reshape(k, n, 2)
    facing = np.radians(facing_deg)
    inward = np.column_stack([np.sin(facing), -np.cos(facing)])[:, None]
    cosine = (velocity * inward).sum(axis=-1) / np.hypot(velocity[..., 0], velocity[..., 1])
    return Outcome(
        np.isfinite(crossings[..., 0]).reshape(k, n, -1),
        np.where(np.isfinite(zone), zone, -1).astype(int).reshape(k, n),
        np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0))), crossings[:, 1].reshape(k, n, 7), np.ones(k, bool),
    )  # fmt: skip


def _together(parts: list[Outcome], possible: Array) -> Outcome:
    whole = {f.name: np.concatenate([getattr(part, f.name) for part in parts]) for f in fields(Outcome)}
    return Outcome(**whole | {"possible": possible})
