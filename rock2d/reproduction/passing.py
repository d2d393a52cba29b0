"""Releases of many hypotheses at once, with either model: how far up the facing each came, and where it first hit."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields
from typing import TYPE_CHECKING, Any

import numpy as np

from rock2d.reproduction.hypotheses import ZONES, Values, contact_table, cross_section, starts
from rock2d.reproduction.published import LINES
from rock2d.scene.blocks import Block
from rock2d.scene.world import World

if TYPE_CHECKING:
    from rock2d.engines.batch import BatchResult

Array = np.ndarray

CHUNK = 40_000  # releases in one call
TIME_LIMIT_S = 3.0
AWAY = 0.5  # share of a hypothesis' releases that must not meet the slope again, from which their starts are
SLOPE = ZONES.index("slope")
FACING = ZONES.index("uphill_face")
DITCH = ZONES.index("ditch")

Change = Callable[[World, int], World]  # world of hypothesis i -> the world to simulate


@dataclass(frozen=True)
class Known:
    """What is known of the set-up: the paper's blocks, the embankment, gravity."""

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
    first : (k, n) zone id of the first impact, -1 if there was none
    off_normal_deg : (k, n) angle between the velocity before that impact and the facing's normal, NaN if none
    at_line_2 : (k, n, 7) time and state at the first crossing of line 2, NaN if it was not passed
    possible : (k,) whether the drop's energy allows the hypothesis' starts, and most of them have left the slope for
        good; lines are not looked at otherwise
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

    def of(self, chosen: Array | slice) -> Outcome:
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
    return _fall(known, values, block_name, draws, change, lines=True)


def land(
    known: Known, values: Values, block_name: str, draws: Array, change: Change | None = None
) -> Outcome:
    """As `fall`, but only until the first impact: no line counts as passed."""
    return _fall(known, values, block_name, draws, change, lines=False)


def _fall(
    known: Known, values: Values, block_name: str, draws: Array, change: Change | None, lines: bool
) -> Outcome:
    block, n = known.blocks[block_name], len(draws)
    begin = starts(values, block, known.gravity_m_s2)
    every, tables = begin.states(draws), contact_table(values)
    parts = []
    for chosen in _chunks(len(begin.mean), n):
        worlds = []
        for i in chosen:
            ground = cross_section(values, i, known.height_m, known.crest_m)
            world = World(known.blocks, ground, tables[i : i + 1], known.gravity_m_s2)
            worlds.append(world if change is None else change(world, i))
        states = every[chosen]
        result = _run(worlds, block_name, states, impact_limit=1, impact_room=1)
        zones, before = result.impacts[:, 0, 0], result.impacts[:, 0, 1:8]
        possible = begin.possible[chosen] & _left_slope(zones, n)
        crossings = np.full((len(chosen), n, len(LINES), 7), np.nan)
        if lines and possible.any():
            remaining = [world for world, useful in zip(worlds, possible, strict=True) if useful]
            result = _run(remaining, block_name, states[possible], stop_when_spent=True)
            crossings[possible] = result.crossings.reshape(-1, n, len(LINES), 7)
        parts.append(_outcome(crossings, zones, before, values["facing_deg"][chosen], possible))
    return _together(parts)


def _run(worlds: list[World], block: str, states: Array, **options: Any) -> BatchResult:
    """Releases `states` (k, n, 6) of one block, n in each of k worlds."""
    from rock2d.engines.batch import Ensemble, run_batch

    blocks = list({id(world.blocks[block]): world.blocks[block] for world in worlds}.values())
    of_world = {id(b): i for i, b in enumerate(blocks)}
    block_ids = np.array([of_world[id(world.blocks[block])] for world in worlds])
    ids = np.repeat(np.arange(len(worlds)), states.shape[1])
    ensemble = Ensemble(
        blocks, [world.cross_section for world in worlds], [world.contact[0] for world in worlds]
    )
    return run_batch(
        ensemble, states.reshape(-1, 6), block_ids=block_ids[ids], cross_section_ids=ids, table_ids=ids,
        gravity_m_s2=worlds[0].gravity_m_s2, time_limit_s=TIME_LIMIT_S, **options,
    )  # fmt: skip


def bounce(
    known: Known, values: Values, block_name: str, draws: Array, slope_reduction_deg: Array | None = None
) -> Outcome:
    """The probabilistic model: the same releases as point masses, `slope_reduction_deg` (k,) of each hypothesis.

    The slope and the ground behind the crest take the ditch's parameters.
    """
    from rock2d.engines.point_mass_batch import run_point_mass_batch
    from rock2d.laws.rebound import ReboundParameters

    block, n = known.blocks[block_name], len(draws)
    begin = starts(values, block, known.gravity_m_s2)
    alpha = np.zeros(len(begin.mean)) if slope_reduction_deg is None else slope_reduction_deg
    seeds = np.zeros(n, np.uint64)  # nothing is drawn at impacts
    parts = []
    for i, states in enumerate(begin.states(draws)):
        ground = cross_section(values, i, known.height_m, known.crest_m)
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
            gravity_m_s2=known.gravity_m_s2, time_limit_s=TIME_LIMIT_S, impact_room=1,
        )  # fmt: skip
        facet = result.impacts[:, 0, 10]
        zones = np.where(np.isfinite(facet), ground.zone_ids[np.nan_to_num(facet).astype(int)], np.nan)
        possible = begin.possible[i : i + 1] & _left_slope(zones, n)
        before, angle = result.impacts[:, 0, :7], values["facing_deg"][i : i + 1]
        parts.append(_outcome(result.crossings[None], zones, before, angle, possible))
    return _together(parts)


def _chunks(hypotheses: int, releases: int) -> list[Array]:
    step = max(1, CHUNK // releases)
    return [np.arange(a, min(a + step, hypotheses)) for a in range(0, hypotheses, step)]


def _left_slope(zones: Array, n: int) -> Array:
    """(k,) whether enough of each hypothesis' n releases first meet another zone than the slope."""
    return np.asarray((zones.reshape(-1, n) == SLOPE).mean(axis=1) <= 1.0 - AWAY)


def _outcome(crossings: Array, zones: Array, before: Array, facing_deg: Array, possible: Array) -> Outcome:
    """From crossings (k, n, lines, 7), zones of first impacts (k n, NaN if none) and states before them (k n, 7)."""
    k, n = crossings.shape[:2]
    velocity = before[:, 4:6].reshape(k, n, 2)
    facing = np.radians(facing_deg)
    inward = np.column_stack([np.sin(facing), -np.cos(facing)])[:, None]
    cosine = (velocity * inward).sum(axis=-1) / np.hypot(velocity[..., 0], velocity[..., 1])
    return Outcome(
        np.isfinite(crossings[..., 0]), np.where(np.isfinite(zones), zones, -1).astype(int).reshape(k, n),
        np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0))), crossings[:, :, 1], possible,
    )  # fmt: skip


def _together(parts: list[Outcome]) -> Outcome:
    return Outcome(*(np.concatenate([getattr(part, f.name) for part in parts]) for f in fields(Outcome)))
