"""The batch engine: an ensemble of releases in one compiled call, with the same contact law as the pymunk engine.

Each release may have its own block, cross-section and parameters. Releases are independent, so results do not depend on
the number of threads."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

from rock2d.arrays import Array
from rock2d.compiled import copy, in_threads, njit
from rock2d.effects.columns import N_COLUMNS, engine_rows
from rock2d.engines import contact_state, contact_step
from rock2d.engines.energy_balance import Masses, energy_balance, energy_balances
from rock2d.engines.free_flight import facet_tree
from rock2d.engines.geometry import CACHED_ARRAYS, CONVEX, block_arrays, ground_arrays
from rock2d.engines.recording import LineRecord, Recorder, SampleRecord
from rock2d.engines.release import StopRules, run_release
from rock2d.records.columns import (
    ENERGY_NAMES,
    GROUND_SHIFT,
    INSTANT_STATE,
    KNOT_FLIGHT,
    N_AUDIT,
    N_IMPACT,
    N_INSTANT,
    N_KNOT,
    N_POSE,
    N_STATE,
    STOPS,
    TIME,
)
from rock2d.records.track import Track, impact_mappings
from rock2d.scene.blocks import Block
from rock2d.scene.cross_section import CrossSection
from rock2d.scene.world import World

FIRST_KNOTS = 4096  # first room for the knots of a track
CACHED_ENSEMBLES = 8  # ensembles whose packed blocks and cross-sections are kept
KNOTS_PER_IMPACT = 64  # knots per impact for which there is room
BATCH_STEP_FRACTION = 0.2  # phase in rad per contact step; see `contact_step.contact_steps_s`
PACKED_MASS, PACKED_INERTIA = 2, 3  # columns of Packed.block_reals


class Packed(NamedTuple):
    """Blocks, cross-sections and parameter tables of an ensemble in flat arrays; see `pack`."""

    sides: Array
    side_start: Array
    air: Array
    air_start: Array
    block_reals: Array  # (blocks, 8) semi-axes, mass, inertia, radius, rounding, centre
    facets: Array
    facet_start: Array
    first: Array
    last: Array
    bin_start: Array
    trees: Array
    tree_start: Array
    # (cross-sections, 6) x_start, bins per m, x_exit low and high, mean facet length, convex corners
    ground_reals: Array
    lines: Array  # (cross-sections, lines, 4) end points of measure lines, NaN where there are fewer
    tables: Array  # (tables, zones, columns of `effects.columns.engine_rows`)


@dataclass(frozen=True)
class Ensemble:
    """Blocks, cross-sections and parameter tables (zones, columns; SI), to which releases refer by index. One array
    (n, zones, columns) is the fastest form of thousands of tables."""

    blocks: Sequence[Block]
    cross_sections: Sequence[CrossSection]
    tables: Sequence[Array] | Array


class BatchResult(NamedTuple):
    """Results of an ensemble of n releases, into which compiled code writes.

    Attributes
    ----------
    stop : (n,) index into STOPS
    ends : (n, 7) t and state at the end of each release
    impact_count : (n,) number of impacts of each release
    impacts : (n, room, 17) zone id, t and state before, t and state after, penetration_m, force_N; rows beyond the last
        impact are NaN, and so are the values after an impact that had not ended
    crossings : (n, lines, 7) t and state at the first crossing of each measure line, NaN if there is none
    samples : (n, times, 3) x, y, theta at the given times; other poses are relative to recoiling ground, these are not
    energy_J : (n, 10) final energy balance, columns of ENERGY_NAMES
    saved_contacts : (n, contacts, N_SAVED) contacts at the end of releases that are or were suspended; else no contacts
    audit : (n, N_AUDIT) dissipated energies and the displacement of recoiling ground, see `records.columns`
    knots : (room, N_KNOT) of one release; with room 0 none are written"""

    stop: Array
    ends: Array
    impact_count: Array
    impacts: Array
    crossings: Array
    samples: Array
    energy_J: Array
    saved_contacts: Array
    audit: Array
    knots: Array

    @property
    def ground_shift_m(self) -> Array:
        """(n,) displacements of recoiling ground, by which the samples after the impacts are moved."""
        return self.audit[:, GROUND_SHIFT]


def pack(ensemble: Ensemble) -> Packed:
    """Flat arrays of an ensemble."""
    shapes = _packed_shapes(tuple(ensemble.blocks), tuple(ensemble.cross_sections))
    return Packed._make((*shapes, _tables(ensemble)))


@lru_cache(CACHED_ENSEMBLES)
def _packed_shapes(of_blocks: tuple[Block, ...], cross_sections: tuple[CrossSection, ...]) -> tuple[Array, ...]:
    """The fields of `Packed` without the tables."""
    blocks = [block_arrays(b) for b in of_blocks]
    grounds = [ground_arrays(c) for c in cross_sections]
    trees = [_tree(c) for c in cross_sections]
    lines = np.full((len(grounds), max(len(c.measure_lines) for c in cross_sections), 4), np.nan)
    for i, cross_section in enumerate(cross_sections):
        for k, line in enumerate(cross_section.measure_lines.values()):
            lines[i, k] = line.reshape(4)

    def starts(lengths: list[int]) -> Array:
        return np.concatenate([[0], np.cumsum(lengths)]).astype(np.int64)

    return (
        np.concatenate([b.sides for b in blocks]),
        starts([len(b.sides) for b in blocks]),
        np.concatenate([b.air for b in blocks]),
        starts([len(b.air) for b in blocks]),
        np.array([b[2:] for b in blocks]),
        np.concatenate([g.facets for g in grounds]),
        starts([len(g.facets) for g in grounds]),
        np.concatenate([g.first for g in grounds]),
        np.concatenate([g.last for g in grounds]),
        starts([len(g.first) for g in grounds]),
        np.concatenate(trees),
        starts([len(t) for t in trees]),
        np.array([[g.x_start, g.bins_per_m, g.x_low, g.x_high, g.facet_m, g.facets[:, CONVEX].sum()] for g in grounds]),
        lines,
    )


@lru_cache(CACHED_ARRAYS)
def _tree(cross_section: CrossSection) -> Array:
    return facet_tree(ground_arrays(cross_section).facets[:, :2].copy())


def _tables(ensemble: Ensemble) -> Array:
    """(tables, zones, columns) parameters as the engines read them; NaN for zones that a table lacks."""
    given = ensemble.tables
    if isinstance(given, np.ndarray):
        return engine_rows(given)
    tables = np.full((len(given), max(map(len, given)), N_COLUMNS + 1), np.nan)
    for i, table in enumerate(given):
        tables[i, : len(table)] = engine_rows(table)
    return tables


def world_ensemble(world: World) -> tuple[Ensemble, Array]:
    """The ensemble of a world, with blocks in the order of the world, and the `table_ids` of its releases: (1,) if all
    have the same parameters, else (n,)."""
    ensemble = Ensemble(list(world.blocks.values()), [world.cross_section], world.contact)
    return ensemble, np.arange(len(world.contact))


def run_batch(
    ensemble: Ensemble,
    states: Array,
    *,
    block_ids: Array | int = 0,
    cross_section_ids: Array | int = 0,
    table_ids: Array | int = 0,
    gravity_m_s2: float = 9.81,
    time_limit_s: float | Array = 5.0,
    impact_limit: int = 0,
    impact_room: int = 0,
    stop_when_spent: bool = False,
    stop_when_captured: bool = False,
    times_s: Array | None = None,
    step_fraction: float = BATCH_STEP_FRACTION,
    suspend_x_m: float = np.inf,
    saved_contacts: Array | None = None,
) -> BatchResult:
    """Run n releases from `states` (n, 6: x, y, theta, vx, vy, omega in SI), on all threads.

    Parameters
    ----------
    block_ids, cross_section_ids, table_ids : block, cross-section and parameters of each release, (n,) or one index
    impact_limit : number of impacts after which a release stops (0: no limit)
    impact_room : largest number of impacts that are recorded of a release
    stop_when_spent : stop a release if its energy is too small to reach any measure line that it has not crossed
    stop_when_captured : count a release as at rest as soon as its energy cannot move it by more than 0.4 of its radius
        (`rest.captured`); otherwise only when the trembling of the block has ended
    times_s : (n, k) or (k,) instants at which poses are sampled
    suspend_x_m : x beyond which a release is suspended: after a contact step, or before a flight that leads there
    saved_contacts : (n, contacts, N_SAVED) contacts of suspended releases that continue from `states`; effects must not
        act

    Raises ValueError if states are not finite or an index does not exist."""
    # copies, because numba compiles again for a read-only view or another memory order
    states = np.array(np.atleast_2d(states), float, order="C")
    n = len(states)
    if states.shape != (n, N_STATE) or not np.isfinite(states).all():
        raise ValueError("states must be an (n, 6) array of finite numbers")
    ids = []
    for name, given, choices in (
        ("block_ids", block_ids, ensemble.blocks),
        ("cross_section_ids", cross_section_ids, ensemble.cross_sections),
        ("table_ids", table_ids, ensemble.tables),
    ):
        index = np.broadcast_to(np.asarray(given, np.int64), (n,))
        if index.size and not (index.min() >= 0 and index.max() < len(choices)):
            raise ValueError(f"{name} must lie in [0, {len(choices)})")
        ids.append(np.array(index))
    limits = np.array(np.broadcast_to(np.asarray(time_limit_s, float), (n,)))
    times = np.empty((1, 0)) if times_s is None else np.array(np.atleast_2d(times_s), float, order="C")
    packed = pack(ensemble)
    steps = _contact_steps(ensemble.blocks, packed.tables, ids[0], ids[2], step_fraction)
    if saved_contacts is None:
        room = max(map(contact_state.contact_count, ensemble.blocks)) if np.isfinite(suspend_x_m) else 0
        saved_contacts = np.full((n, room, contact_state.N_SAVED), np.nan)
    saved_contacts = np.array(saved_contacts, float, order="C")
    outputs = _new_outputs(packed, impact_room, times.shape[1], saved_contacts, 0)
    rules = StopRules(0.0, impact_limit, stop_when_spent, stop_when_captured, float(suspend_x_m))
    inputs = _Inputs(states, ids[0], ids[1], ids[2], steps, limits, times)
    in_threads(_run_releases, n, (packed, inputs, float(gravity_m_s2), rules, outputs))
    lowest = np.array([ground.points_m[:, 1].min() for ground in ensemble.cross_sections])
    mass, inertia = packed.block_reals[ids[0], PACKED_MASS], packed.block_reals[ids[0], PACKED_INERTIA]
    masses = Masses(mass, inertia, float(gravity_m_s2), lowest[ids[1]])
    outputs.energy_J[:] = energy_balances(masses, states, outputs.ends[:, INSTANT_STATE], outputs.audit)
    return outputs


def run_world(world: World, states: Array, blocks: Array, **options: Any) -> BatchResult:
    """`run_batch` of releases in a world, from `states` (n, 6), with blocks of the indices `blocks` (n,). The world has
    common parameters, or parameters for each release."""
    ensemble, tables = world_ensemble(world)
    gravity = world.gravity_m_s2
    return run_batch(ensemble, states, block_ids=blocks, table_ids=tables, gravity_m_s2=gravity, **options)


def run_batch_track(
    block: Block,
    cross_section: CrossSection,
    table: Array,
    state: Array,
    *,
    release: int = 0,
    gravity_m_s2: float = 9.81,
    time_limit_s: float = 5.0,
) -> Track:
    """Run one release with the batch engine and return its track, with a knot at every contact step.

    `table` is (zones, columns) in SI; `state` is (6,) as in `run_batch`."""
    packed = pack(Ensemble([block], [cross_section], [table]))
    steps = contact_step.contact_steps_s(block, packed.tables[0], BATCH_STEP_FRACTION)
    none = np.zeros(1, np.int64)
    inputs = _Inputs(
        np.array(state, float)[None], none, none, none, np.array([steps]), np.array([float(time_limit_s)]),
        np.empty((1, 0)),
    )  # fmt: skip
    rules = StopRules(0.0, 0, False, False, np.inf)
    room = FIRST_KNOTS
    while True:
        most = room // KNOTS_PER_IMPACT
        outputs = _new_outputs(packed, most, 0, np.empty((1, 0, contact_state.N_SAVED)), room)
        used = _run_releases(0, 1, packed, inputs, float(gravity_m_s2), rules, outputs)
        count = int(outputs.impact_count[0])
        if used <= room and count <= most:
            break
        room = max(2 * used, 2 * KNOTS_PER_IMPACT * count)  # repeat the release with room for all knots
    rows = impact_mappings(outputs.impacts[0, :count], cross_section.zone_names)
    knots = outputs.knots[:used]
    start, end = knots[0, INSTANT_STATE], knots[-1, INSTANT_STATE]
    return Track(
        release, block.name, knots[:, :N_INSTANT].copy(), knots[:, KNOT_FLIGHT] > 0, rows, STOPS[outputs.stop[0]],
        gravity_m_s2, energy_balance(block, cross_section, gravity_m_s2, start, end, outputs.audit[0]),
    )  # fmt: skip


def _contact_steps(
    blocks: Sequence[Block], tables: Array, block_ids: Array, table_ids: Array, fraction: float
) -> Array:
    """(n, 2) contact steps in s of every release."""
    if len(tables) == 1:
        stiffest = contact_step.Stiffest.of(tables[0])
        each = [stiffest.steps_s(block, fraction) for block in blocks]
        return np.array(each, float)[block_ids]
    steps = np.empty((len(block_ids), 2))
    for b in np.unique(block_ids):
        of_block = block_ids == b
        used, table = np.unique(table_ids[of_block], return_inverse=True)
        steps[of_block] = np.transpose(contact_step.contact_steps_s(blocks[b], tables[used], fraction))[table]
    return steps


class _Inputs(NamedTuple):
    """Inputs of n releases."""

    states: Array  # (n, 6)
    block_ids: Array  # (n,)
    cross_section_ids: Array  # (n,)
    table_ids: Array  # (n,)
    step_sizes: Array  # (n, 2) contact steps in s: in first loading, else
    time_limits: Array  # (n,) s
    times: Array  # (1 or n, times) instants of samples in s


def _new_outputs(packed: Packed, impacts: int, times: int, saved_contacts: Array, knots: int) -> BatchResult:
    """Empty outputs with room for `impacts` and `times` samples of each release, and for `knots`."""
    n = len(saved_contacts)
    return BatchResult(
        np.zeros(n, np.int64), np.empty((n, N_INSTANT)), np.zeros(n, np.int64), np.full((n, impacts, N_IMPACT), np.nan),
        np.full((n, packed.lines.shape[1], N_INSTANT), np.nan), np.full((n, times, N_POSE), np.nan),
        np.empty((n, len(ENERGY_NAMES))), saved_contacts, np.zeros((n, N_AUDIT)), np.empty((knots, N_KNOT)),
    )  # fmt: skip


@njit(nogil=True)
def _run_releases(low, high, packed, inputs, gravity, rules, outputs):
    """Run the releases `low` to `high` - 1; returns the number of knots of the last one, also of those without room."""
    used = np.int64(0)
    rows = np.int64(inputs.times.shape[0])
    for i in range(low, high):
        q = inputs.states[i].copy()
        recorder = Recorder(
            LineRecord(packed.lines[inputs.cross_section_ids[i]], outputs.crossings[i]),
            SampleRecord(inputs.times[min(i, rows - 1)], outputs.samples[i]), outputs.impacts[i], outputs.audit[i],
            outputs.knots,
        )  # fmt: skip
        own_rules = StopRules(inputs.time_limits[i], rules.impact_limit, rules.spent, rules.captured, rules.suspend_x)
        ids = (inputs.block_ids[i], inputs.cross_section_ids[i], inputs.table_ids[i])
        steps = (inputs.step_sizes[i, 0], inputs.step_sizes[i, 1])
        own = (recorder, outputs.saved_contacts[i])
        code, t, count, used = run_release(packed, q, ids, gravity, steps, own_rules, own)
        outputs.stop[i] = code
        outputs.ends[i, TIME] = t
        copy(q, outputs.ends[i, INSTANT_STATE])  # a slice assignment takes 3 s to compile
        outputs.impact_count[i] = count
    return used
