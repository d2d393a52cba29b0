"""The batch engine: whole ensembles of releases in one compiled call, with the contact law of the pymunk engine.

Flight is not stepped: conservative advancement (the block cannot reach the ground before a bound of its speed
has used up a bound of its distance) brings it to the ground in a few exact parabolas; then the stepper takes
over until the block is clear again. Every release may have its own block, cross-section and parameters.
Releases are independent, so results do not depend on the number of threads.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numba
import numpy as np

from rock2d.approach import facet_tree, safe_time, time_to_ground
from rock2d.blocks import Block
from rock2d.compiled import njit
from rock2d.engines import rest, slots, stepper
from rock2d.engines.slots import ACTIVE, SMOOTH_SLOTS, VERTEX_SLOTS, ZONE
from rock2d.geometry import (
    CONVEX,
    CORNER_X,
    CORNER_Y,
    POINT_X,
    POINT_Y,
    BlockArrays,
    TerrainArrays,
    block_arrays,
    facet_range,
    point_depth,
    polygon_depth,
    terrain_arrays,
)
from rock2d.terrain import Terrain
from rock2d.track import IMPACT_COLUMNS, Track

Array = np.ndarray

STOPS = ("time", "rest", "exit", "impacts", "spent", "buried")
TIME, REST, EXIT, IMPACTS, SPENT, BURIED = range(6)
# one impact: zone id, t, state before (6), t after, state after (6), penetration, force
N_IMPACT = 17
EASE_LIMIT = 1.25  # growth of contact steps as the motion dies down: a quarter of a radian is the most
EASE_EVERY = 8  # contact steps between two looks at how far the motion has died down
SPENT_EVERY = 64  # contact steps between two looks at whether the energy is spent
FREE_STEP = 8.0  # steps may be so much longer while a block floats unpressed above its own crater
STEP_FRACTION = 0.2  # phase in rad per contact step; see `stepper.contact_step_s`


class Packed(NamedTuple):
    """Blocks, cross-sections and parameter tables of an ensemble in flat arrays; see `pack`."""

    sides: Array
    side_start: Array
    block_reals: Array  # (blocks, 5) semi-axes, mass, inertia, radius
    facets: Array
    facet_start: Array
    first: Array
    last: Array
    bin_start: Array
    boxes: Array
    box_start: Array
    terrain_reals: Array  # (terrains, 4) x_start, bins per m, x_exit low and high
    lines: Array  # (terrains, lines, 4) end points of measure lines, NaN where there are fewer
    tables: Array  # (tables, zones, 6)


@dataclass(frozen=True)
class Ensemble:
    """What releases may refer to, by index: blocks, cross-sections, parameter tables (zones, 6) in SI."""

    blocks: Sequence[Block]
    terrains: Sequence[Terrain]
    tables: Sequence[Array]


@dataclass
class BatchResult:
    """Results of an ensemble of n releases.

    Attributes
    ----------
    stop : (n,) index into STOPS
    ends : (n, 7) t and state where each release stopped
    impact_count : (n,) impacts of each release
    impacts : (n, room, 17) zone id, t and state before, t and state after, penetration_m, force_N; NaN beyond
        the impacts that were, and after an impact that had not ended
    crossings : (n, lines, 7) t and state at the first crossing of each measure line, NaN if never
    samples : (n, times, 3) x, y, theta at the asked times
    audit : (n, 3) energy in J that plasticity, friction and rolling took
    """

    stop: Array
    ends: Array
    impact_count: Array
    impacts: Array
    crossings: Array
    samples: Array
    audit: Array


def pack(ensemble: Ensemble) -> Packed:
    """Flat arrays of an ensemble."""
    blocks = [block_arrays(b) for b in ensemble.blocks]
    reach = 10 * max(b.radius_m for b in ensemble.blocks)
    grounds = [terrain_arrays(t, reach) for t in ensemble.terrains]
    boxes = [facet_tree(g.facets[:, :2]) for g in grounds]
    names = [list(t.measure_lines.values()) for t in ensemble.terrains]
    lines = np.full((len(grounds), max(map(len, names)), 4), np.nan)
    for i, ends in enumerate(names):
        for k, line in enumerate(ends):
            lines[i, k] = line.reshape(4)
    zones = max(len(t) for t in ensemble.tables)
    tables = np.full((len(ensemble.tables), zones, ensemble.tables[0].shape[1]), np.nan)
    for i, table in enumerate(ensemble.tables):
        tables[i, : len(table)] = table

    def starts(lengths: list[int]) -> Array:
        return np.concatenate([[0], np.cumsum(lengths)]).astype(np.int64)

    return Packed(
        np.concatenate([b.sides for b in blocks]),
        starts([len(b.sides) for b in blocks]),
        np.array([b[1:] for b in blocks]),
        np.concatenate([g.facets for g in grounds]),
        starts([len(g.facets) for g in grounds]),
        np.concatenate([g.first for g in grounds]),
        np.concatenate([g.last for g in grounds]),
        starts([len(g.first) for g in grounds]),
        np.concatenate(boxes),
        starts([len(b) for b in boxes]),
        np.array([[g.x_start, g.bins_per_m, g.x_low, g.x_high] for g in grounds]),
        lines,
        tables,
    )


def run_batch(
    ensemble: Ensemble,
    states: Array,
    *,
    block_ids: Array | int = 0,
    terrain_ids: Array | int = 0,
    table_ids: Array | int = 0,
    gravity_m_s2: float = 9.81,
    time_limit_s: float | Array = 5.0,
    impact_limit: int = 0,
    impact_room: int = 0,
    stop_when_spent: bool = False,
    times_s: Array | None = None,
    step_fraction: float = STEP_FRACTION,
) -> BatchResult:
    """Run n releases from `states` (n, 6: x, y, theta, vx, vy, omega in SI), on all threads.

    Parameters
    ----------
    block_ids, terrain_ids, table_ids : which block, cross-section and parameters each release has
    impact_limit : stop at the end of this many impacts (0: no limit); 1 is the segment mode
    impact_room : how many impacts of a release are recorded
    stop_when_spent : stop a release that has not the energy left to reach any measure line it has not crossed
    times_s : (n, k) or (k,) instants at which to sample the motion

    Raises ValueError if states are not finite or an index does not exist.
    """
    states = np.ascontiguousarray(np.atleast_2d(states), float)
    n = len(states)
    if states.shape != (n, 6) or not np.isfinite(states).all():
        raise ValueError("states must be an (n, 6) array of finite numbers")
    ids = []
    for name, given, choices in (
        ("block_ids", block_ids, ensemble.blocks),
        ("terrain_ids", terrain_ids, ensemble.terrains),
        ("table_ids", table_ids, ensemble.tables),
    ):
        index = np.broadcast_to(np.asarray(given, np.int64), (n,))
        if index.size and not (index.min() >= 0 and index.max() < len(choices)):
            raise ValueError(f"{name} must lie in [0, {len(choices)})")
        ids.append(np.ascontiguousarray(index))
    limits = np.ascontiguousarray(np.broadcast_to(np.asarray(time_limit_s, float), (n,)))
    times = np.empty((1, 0)) if times_s is None else np.atleast_2d(np.asarray(times_s, float))
    packed = pack(ensemble)
    steps = _contact_steps(ensemble, ids[0], ids[2], step_fraction)
    result = BatchResult(
        np.zeros(n, np.int64), np.empty((n, 7)), np.zeros(n, np.int64), np.full((n, impact_room, N_IMPACT), np.nan),
        np.full((n, packed.lines.shape[1], 7), np.nan), np.full((n, times.shape[1], 3), np.nan), np.zeros((n, 3)),
    )  # fmt: skip
    _ensemble(
        packed, states, *ids, steps, gravity_m_s2, limits, impact_limit, stop_when_spent, times,
        result.stop, result.ends, result.impact_count, result.impacts, result.crossings, result.samples, result.audit,
    )  # fmt: skip
    return result


def run_batch_track(
    block: Block,
    terrain: Terrain,
    table: Array,
    state: Array,
    *,
    release: int = 0,
    gravity_m_s2: float = 9.81,
    time_limit_s: float = 5.0,
    impact_limit: int = 0,
    step_fraction: float = STEP_FRACTION,
) -> Track:
    """One release of the batch engine as a track, every contact step a knot."""
    ensemble = Ensemble([block], [terrain], [table])
    packed = pack(ensemble)
    step = float(_contact_steps(ensemble, np.zeros(1, np.int64), np.zeros(1, np.int64), step_fraction)[0])
    room = 4096
    while True:
        knots = np.empty((room, 8))
        impacts = np.full((max(room // 64, 64), N_IMPACT), np.nan)
        audit, crossings, samples = np.zeros(3), np.full((packed.lines.shape[1], 7), np.nan), np.empty((0, 3))
        stop, _, count, used = _release(
            packed, np.array(state, float), 0, 0, 0, step, gravity_m_s2, time_limit_s, impact_limit, False,
            np.empty(0), impacts, crossings, samples, audit, knots,
        )  # fmt: skip
        if used <= room and count <= len(impacts):
            break
        room = max(2 * used, 128 * count)  # the same release once more, with room for all
    rows = []
    for row in impacts[:count]:
        values = [*row[1:15], row[15], row[16]]
        rows.append(
            {
                "zone": terrain.zone_names[int(row[0])],
                **dict(zip(IMPACT_COLUMNS[3:], map(float, values), strict=True)),
            }
        )
    return Track(
        release,
        block.name,
        knots[:used, :7].copy(),
        knots[:used, 7] > 0,
        rows,
        STOPS[stop],
        gravity_m_s2,
        dict(zip(("plastic", "friction", "rolling"), map(float, audit), strict=True)),
    )


def _contact_steps(ensemble: Ensemble, block_ids: Array, table_ids: Array, fraction: float) -> Array:
    pairs, where = np.unique(np.column_stack([block_ids, table_ids]), axis=0, return_inverse=True)
    steps = [stepper.contact_step_s(ensemble.blocks[b], ensemble.tables[t], fraction) for b, t in pairs]
    return np.array(steps)[where.ravel()]


@njit(parallel=True)
def _ensemble(
    packed, states, block_ids, terrain_ids, table_ids, steps, gravity, limits, impact_limit, spent, times,
    stop, ends, impact_count, impacts, crossings, samples, audit,
):  # fmt: skip
    rows = np.int64(times.shape[0])
    for k in numba.prange(len(states)):
        i = np.int64(k)
        q = states[i].copy()
        code, t, count, _ = _release(
            packed, q, block_ids[i], terrain_ids[i], table_ids[i], steps[i], gravity, limits[i], impact_limit,
            spent, times[min(i, rows - 1)], impacts[i], crossings[i], samples[i], audit[i], np.empty((0, 8)),
        )  # fmt: skip
        stop[i] = code
        ends[i, 0] = t
        ends[i, 1:] = q
        impact_count[i] = count


@njit
def _block(packed, i):
    r = packed.block_reals[i]
    sides = packed.sides[packed.side_start[i] : packed.side_start[i + 1]]
    return BlockArrays(sides, r[0], r[1], r[2], r[3], r[4])


@njit
def _terrain(packed, i):
    a, b = packed.bin_start[i], packed.bin_start[i + 1]
    r = packed.terrain_reals[i]
    facets = packed.facets[packed.facet_start[i] : packed.facet_start[i + 1]]
    return TerrainArrays(facets, packed.first[a:b], packed.last[a:b], r[0], r[1], r[2], r[3])


@njit
def _gap(q, terrain, block, f0, f1):
    """Lower bound of the distance between a polygon near the ground and the ground."""
    x, y, c, s = q[0], q[1], np.cos(q[2]), np.sin(q[2])
    facets, sides = terrain.facets, block.sides
    gap = np.inf
    for i in range(sides.shape[0]):
        px = x + c * sides[i, CORNER_X] - s * sides[i, CORNER_Y]
        py = y + s * sides[i, CORNER_X] + c * sides[i, CORNER_Y]
        depth, _, _ = point_depth(px, py, facets, f0, f1)
        gap = min(gap, -depth)
    for v in range(max(f0, 1), f1):
        if facets[v, CONVEX] > 0.0:
            depth, _ = polygon_depth(facets[v, POINT_X], facets[v, POINT_Y], x, y, c, s, sides)
            gap = min(gap, -depth)
    return gap


@njit
def _fly(q, tau, gravity):
    q[0] += q[3] * tau
    q[1] += q[4] * tau - 0.5 * gravity * tau * tau
    q[2] += q[5] * tau
    q[4] -= gravity * tau


@njit
def _cross(t, q0, tau, q1, flight, gravity, lines, crossings):
    """Note the first crossing of each measure line on the way from q0 to q1; returns how many are new."""
    new = 0
    for k in range(lines.shape[0]):
        if crossings[k, 0] == crossings[k, 0] or lines[k, 0] != lines[k, 0]:
            continue
        ax, ay = lines[k, 2] - lines[k, 0], lines[k, 3] - lines[k, 1]
        side0 = (q0[1] - lines[k, 1]) * ax - (q0[0] - lines[k, 0]) * ay
        side1 = (q1[1] - lines[k, 1]) * ax - (q1[0] - lines[k, 0]) * ay
        when = -1.0
        if flight:
            # a s² + b s + c = 0, the side of the line along the parabola
            a, b = -0.5 * gravity * ax, q0[4] * ax - q0[3] * ay
            if a == 0.0:
                if b != 0.0:
                    when = -side0 / b
            else:
                disc = b * b - 4.0 * a * side0
                if disc > 0.0:
                    root = -0.5 * (b + np.copysign(np.sqrt(disc), b))
                    low, high = root / a, side0 / root if root != 0.0 else 0.0
                    if low > high:
                        low, high = high, low
                    when = low if low > 0.0 and _on_line(q0, low, gravity, lines[k], ax, ay) else high
            if not 0.0 < when <= tau:
                continue
        elif side0 * side1 < 0.0:
            when = tau * side0 / (side0 - side1)
        else:
            continue
        if not flight:
            s = when / tau
            x, y = q0[0] + s * (q1[0] - q0[0]), q0[1] + s * (q1[1] - q0[1])
            at = ((x - lines[k, 0]) * ax + (y - lines[k, 1]) * ay) / (ax * ax + ay * ay)
            if not 0.0 <= at <= 1.0:
                continue
            for i in range(6):
                crossings[k, 1 + i] = q0[i] + s * (q1[i] - q0[i])
        else:
            if not _on_line(q0, when, gravity, lines[k], ax, ay):
                continue
            crossings[k, 1:] = q0
            _fly(crossings[k, 1:], when, gravity)
        crossings[k, 0] = t + when
        new += 1
    return new


@njit
def _on_line(q0, when, gravity, line, ax, ay):
    x, y = q0[0] + q0[3] * when, q0[1] + q0[4] * when - 0.5 * gravity * when * when
    at = ((x - line[0]) * ax + (y - line[1]) * ay) / (ax * ax + ay * ay)
    return 0.0 <= at <= 1.0


@njit
def _is_spent(q, stored, gravity, block, lines, crossings):
    """True if no measure line that was not crossed begins low enough for the energy that is left."""
    kinetic = 0.5 * (block.mass * (q[3] * q[3] + q[4] * q[4]) + block.inertia * q[5] * q[5])
    highest = q[1] + (kinetic + stored) / (block.mass * gravity)
    for k in range(lines.shape[0]):
        if crossings[k, 0] != crossings[k, 0] and min(lines[k, 1], lines[k, 3]) <= highest:
            return False
    return True


@njit
def _sample(t, q0, tau, q1, flight, gravity, times, at, samples):
    """Fill the samples that lie in (t, t + tau]; returns the index of the next one."""
    while at < times.size and times[at] <= t + tau:
        s = times[at] - t
        if flight:
            samples[at, 0] = q0[0] + q0[3] * s
            samples[at, 1] = q0[1] + q0[4] * s - 0.5 * gravity * s * s
            samples[at, 2] = q0[2] + q0[5] * s
        else:
            u = s / tau
            for i in range(3):
                samples[at, i] = (
                    q0[i] * (1 + 2 * u) * (1 - u) ** 2
                    + q0[i + 3] * tau * u * (1 - u) ** 2
                    + q1[i] * u * u * (3 - 2 * u)
                    + q1[i + 3] * tau * u * u * (u - 1)
                )
        at += 1
    return at


@njit
def _knot(knots, used, t, q, flight):
    if used < len(knots):
        knots[used, 0] = t
        knots[used, 1:7] = q
        knots[used, 7] = flight
    return used + 1


@njit
def _release(
    packed, q, block_id, terrain_id, table_id, contact_step, gravity, time_limit, impact_limit, spent, times,
    impacts, crossings, samples, audit, knots,
):  # fmt: skip
    """One release; q ends as the last state. Returns (stop, time, number of impacts, number of knots)."""
    block, terrain = _block(packed, block_id), _terrain(packed, terrain_id)
    boxes = packed.boxes[packed.box_start[terrain_id] : packed.box_start[terrain_id + 1]]
    lines, params = packed.lines[terrain_id], packed.tables[table_id]
    corners = block.sides.shape[0]
    n = corners + VERTEX_SLOTS if corners > 0 else SMOOTH_SLOTS
    ints, reals = np.zeros((n, 6), np.int64), np.zeros((n, 6))
    found_i, found_r = np.zeros((n, 6), np.int64), np.zeros((n, 6))
    slots.clear(ints, reals)
    work = stepper.scratch(n)
    stack = np.empty(64, np.int64)
    old = np.empty(6)
    radius = block.radius
    start_energy = 0.5 * (block.mass * (q[3] ** 2 + q[4] ** 2) + block.inertia * q[5] ** 2)
    t, stop, count, at, used = 0.0, TIME, 0, 0, 0
    while at < times.size and times[at] <= 0.0:
        samples[at] = q[0:3]
        at += 1
    # the impact that is open: its record, whether and where the ground has ceased to press
    current = np.full(N_IMPACT, np.nan)
    is_open, left = False, False
    watch = np.empty(8)
    rest.forget_rest(watch)
    active = 0
    steps, eased = 0, 1.0
    noticed = False  # whether the slots know the ground at the present pose

    while t < time_limit:
        if not terrain.x_low <= q[0] <= terrain.x_high:
            stop = EXIT
            break
        if active == 0:
            speed = np.sqrt(q[3] * q[3] + q[4] * q[4])
            tau = time_to_ground(q, gravity, block, terrain.facets, boxes, stack)
            if tau < contact_step and corners > 0:
                f0, f1 = facet_range(terrain, q[0] - 2.0 * radius, q[0] + 2.0 * radius)
                gap = _gap(q, terrain, block, f0, f1)
                if gap > 0.0:
                    # no farther than the facets that were looked at
                    tau = safe_time(min(gap, 0.5 * radius), speed + abs(q[5]) * radius, gravity)
            if tau >= contact_step:
                tau = min(tau, time_limit - t)
                old[:] = q
                used = _knot(knots, used, t, q, 1.0)
                _fly(q, tau, gravity)
                new = _cross(t, old, tau, q, True, gravity, lines, crossings)
                at = _sample(t, old, tau, q, True, gravity, times, at, samples)
                t += tau
                noticed = False
                if spent and (new > 0 or count == 0) and _is_spent(q, 0.0, gravity, block, lines, crossings):
                    stop = SPENT
                    break
                continue

        # near the ground or on it
        if steps % EASE_EVERY == 0:
            eased = min(EASE_LIMIT, stepper.ease(q, start_energy, block, ints, reals, params))
        steps += 1
        h = contact_step * eased
        if active > 0 and left:
            h *= FREE_STEP
        h = min(h, time_limit - t)
        reach = (np.sqrt(q[3] * q[3] + q[4] * q[4]) + gravity * h) * h + 1.1 * radius
        f0, f1 = facet_range(terrain, q[0] - reach, q[0] + reach)
        if active == 0 and not noticed:
            slots.clear(ints, reals)
            active = stepper.begin(q, f0, f1, terrain, block, ints, reals, found_i, found_r)
            noticed = True
            if active > 0:
                is_open, left = True, False
                _open(current, t, q, ints)
        old[:] = q
        used = _knot(knots, used, t, q, 1.0 if active == 0 else 0.0)
        gone = stepper.step(
            q, h, f0, f1, gravity, terrain, block, params, ints, reals, found_i, found_r, work, audit
        )
        flying = active == 0
        new = _cross(t, old, gone, q, flying, gravity, lines, crossings)
        at = _sample(t, old, gone, q, flying, gravity, times, at, samples)
        t += gone
        force, depth, active = stepper.pressure(ints, reals, params)
        if depth > 0.5 * radius and point_depth(q[0], q[1], terrain.facets, f0, f1)[0] > 0.0:
            stop = BURIED
            break
        if not is_open:
            if active > 0:
                is_open, left = True, False
                _open(current, t, q, ints)
            continue
        current[15] = max(current[15], depth)
        current[16] = max(current[16], force)
        if force > stepper.PRESSED * current[16]:
            left = False
        elif not left:
            left = True
            current[8] = t
            current[9:15] = q
        if active == 0:
            count = _close(current, left, impacts, count)
            is_open = False
            rest.forget_rest(watch)
            if count == impact_limit:
                stop = IMPACTS
                break
            if spent and _is_spent(q, 0.0, gravity, block, lines, crossings):
                stop = SPENT
                break
            continue
        if rest.watch_rest(watch, t, q, radius, gravity):
            stop = REST
            break
        if spent and steps % SPENT_EVERY == 0:
            stored = stepper.stored_energy(ints, reals, params)
            if _is_spent(q, stored, gravity, block, lines, crossings):
                stop = SPENT
                break
    if is_open and stop != IMPACTS:
        count = _close(current, left, impacts, count)
    while at < times.size and stop == REST:
        samples[at] = q[0:3]
        at += 1
    used = _knot(knots, used, t, q, 1.0)
    return stop, t, count, used


@njit
def _open(current, t, q, ints):
    current[0] = -1.0
    for j in range(ints.shape[0]):
        if ints[j, ACTIVE]:
            current[0] = ints[j, ZONE]
            break
    current[1] = t
    current[2:8] = q
    current[8:15] = np.nan
    current[15], current[16] = 0.0, 0.0


@njit
def _close(current, left, impacts, count):
    """Record an impact if there is room; one that still presses has no state after."""
    if count < len(impacts):
        impacts[count] = current
        if not left:
            impacts[count, 8:15] = np.nan
    return count + 1
