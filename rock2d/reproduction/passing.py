"""Releases of many hypotheses at once, with either model: how far up the facing each came, and where it first hit."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields, replace

import numpy as np

from rock2d.blocks import Block
from rock2d.reproduction.hypotheses import ZONES, Values, contact_table, starts, terrain
from rock2d.world import World

Array = np.ndarray

CHUNK = 40_000  # releases in one call
TIME_LIMIT_S = 3.0
IMPACT_ROOM = 6  # impacts on the slope before the first one beyond it, at most
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
    from rock2d.engines.batch import Ensemble, run_batch

    block, n = known.blocks[block_name], len(draws)
    begin = starts(values, block, known.gravity_m_s2)
    tables = contact_table(values)
    parts = []
    for chosen in _chunks(len(begin.mean), n):
        worlds = [
            World({block_name: block}, terrain(values, i, known.height_m, known.crest_m), tables[i : i + 1],
                  known.gravity_m_s2)
            for i in chosen
        ]  # fmt: skip
        if change is not None:
            # scaled by the mean of all blocks, as a whole bench is
            whole = [replace(world, blocks=known.blocks) for world in worlds]
            worlds = [change(world, i) for world, i in zip(whole, chosen, strict=True)]
        ids = np.repeat(np.arange(len(chosen)), n)
        result = run_batch(
            Ensemble(
                [world.blocks[block_name] for world in worlds],
                [world.terrain for world in worlds],
                [world.contact[0] for world in worlds],
            ),
            begin.states(draws)[chosen].reshape(-1, 6),
            block_ids=ids, terrain_ids=ids, table_ids=ids, gravity_m_s2=known.gravity_m_s2,
            time_limit_s=TIME_LIMIT_S, impact_room=IMPACT_ROOM, stop_when_spent=True,
        )  # fmt: skip
        zones, before = result.impacts[..., 0], result.impacts[..., 1:8]
        parts.append(first_impacts(result.crossings, zones, before, values["facing_deg"][chosen], n))
    return _together(parts, begin.possible)


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
            gravity_m_s2=known.gravity_m_s2, time_limit_s=TIME_LIMIT_S, impact_room=IMPACT_ROOM,
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


def first_impacts(crossings: Array, zones: Array, before: Array, facing_deg: Array, n: int) -> Outcome:
    """The outcome of n releases of each of k hypotheses, from crossings (k n, lines, 7), the zones of their impacts
    (k n, room; NaN if none) and the states before them (k n, room, 7)."""
    k = len(facing_deg)
    beyond = zones > 0  # NaN where there was no impact
    any_beyond: Array = np.asarray(beyond.any(axis=1))
    at = beyond.argmax(axis=1)
    rows = np.arange(len(zones))
    first = np.where(any_beyond, np.nan_to_num(zones[rows, at], nan=-1.0), -1).astype(int)
    velocity = np.where(any_beyond[:, None], before[rows, at, 4:6], np.nan).reshape(k, n, 2)
    facing = np.radians(facing_deg)
    inward = np.column_stack([np.sin(facing), -np.cos(facing)])[:, None]
    cosine = (velocity * inward).sum(axis=-1) / np.hypot(velocity[..., 0], velocity[..., 1])
    return Outcome(
        np.isfinite(crossings[..., 0]).reshape(k, n, -1), first.reshape(k, n),
        np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0))), crossings[:, 1].reshape(k, n, 7), np.ones(k, bool),
    )  # fmt: skip


def _together(parts: list[Outcome], possible: Array) -> Outcome:
    whole = {f.name: np.concatenate([getattr(part, f.name) for part in parts]) for f in fields(Outcome)}
    return Outcome(**whole | {"possible": possible})
