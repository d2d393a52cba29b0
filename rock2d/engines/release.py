"""One release of the batch engine from its start to its end, compiled.

Flight is not stepped: a lower bound of the time to the ground carries the block there in a few exact parabolas. Then
contact steps take over until the block is clear again: a full one where contacts begin, change or end, fast ones
(`fast_contact_steps`) in between.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from rock2d.compiled import copy, kernel, njit
from rock2d.effects.forces import ACTS
from rock2d.engines import contact_energy, contact_state, contact_step, rest
from rock2d.engines.contact_state import (
    ACTIVE,
    DEPTH,
    OFFSET,
    PEAK,
    RATE,
    SMOOTH_CONTACTS,
    VERTEX_CONTACTS,
    ZONE,
)
from rock2d.engines.event_detection import later
from rock2d.engines.fast_contact_steps import (
    GUARD_LEFT,
    HOPPED,
    Horizon,
    StepSizes,
    fast_contact_steps,
    floats,
    goes_deeper,
)
from rock2d.engines.free_flight import air_stride, fly, in_air
from rock2d.engines.geometry import (
    BlockArrays,
    Body,
    GroundArrays,
    WorldArrays,
    facet_range,
    point_depth,
)
from rock2d.engines.guard import GUARD, set_anchor
from rock2d.engines.recording import (
    close_impact,
    cross,
    end_impact,
    is_spent,
    knot,
    near_line,
    note_pressure,
    open_impact,
    sample,
)
from rock2d.engines.time_to_contact import time_aloft
from rock2d.laws.contact import INDENTATION, K_L, K_UL, residual
from rock2d.records.columns import (
    EFFECTS,
    ELASTIC,
    I_ZONE,
    N_IMPACT,
    N_POSE,
    N_STATE,
    OMEGA,
    STOP_BURIED,
    STOP_EXIT,
    STOP_IMPACTS,
    STOP_REACHED,
    STOP_REST,
    STOP_SPENT,
    STOP_TIME,
    VX,
    VY,
    X,
    Y,
)

LARGEST_BATCH_STEP_GROWTH = 4.0  # of contact steps as the motion dies down: a quarter of a radian is the most
STEPS_BETWEEN_LOOKS = 8  # contact steps between two looks at what energy is left
LEAST_STRIDE = 0.01  # of a contact step: the bound of a ball is renewed as long as it gains this much
LONGEST_CONTACT_STRIDE = 0.1  # radii that a longer step may move a block where its contacts may change
FLOATING_STEPS = 8.0  # steps may be so much longer while a block floats unpressed above its own indentation
TREE_STACK = 64  # nodes that a search of the tree of facets may have waiting


class StopRules(NamedTuple):
    """When a release ends before the block lies still."""

    time_limit: float  # s
    impact_limit: int  # number of impacts after which the release ends; 0: no limit
    spent: bool  # when no measure line that was not crossed is within reach of the energy left
    captured: bool  # stop when the remaining energy cannot move the block on, see `rest.captured`
    until: float  # x in m at which the release is held, to go on later: in flight a stride before it


class Workspace(NamedTuple):
    """Scratch of one release."""

    memory: contact_state.Contacts
    found: contact_state.Contacts
    scratch: contact_step.Scratch
    stack: np.ndarray  # (TREE_STACK,)
    old: np.ndarray  # (6,) the state before the step at hand
    anchor: np.ndarray  # (4,) the pose whose guard is known, and the guard in m (0: none)
    watch: np.ndarray  # (rest.N_WATCH,) see `rest.watch_rest`
    impact: np.ndarray  # (N_IMPACT,) the open impact


@njit
def _block(packed, i):
    r = packed.block_reals[i]
    sides = packed.sides[packed.side_start[i] : packed.side_start[i + 1]]
    air = packed.air[packed.air_start[i] : packed.air_start[i + 1]]
    return BlockArrays(sides, air, r[0], r[1], r[2], r[3], r[4], r[5], r[6], r[7])


@njit
def _ground(packed, i):
    a, b = packed.bin_start[i], packed.bin_start[i + 1]
    r = packed.ground_reals[i]
    facets = packed.facets[packed.facet_start[i] : packed.facet_start[i + 1]]
    return GroundArrays(facets, packed.first[a:b], packed.last[a:b], r[0], r[1], r[2], r[3], r[4])


@njit
def release(packed, q, ids, gravity, step_sizes, rules, recorder, held):
    """One release; q ends as the last state.

    packed : see `batch.Packed`; ids : (block, cross-section, table) of the release
    step_sizes : contact steps in s, (while every contact is in first loading, else)
    rules : StopRules; recorder : `recording.Recorder`
    held : (contacts, N_HELD) memory of contacts with which the release goes on (NaN: none), and is held at
        `rules.until`; without room it starts anew

    Returns (index into STOPS, time in s, number of impacts, number of knots).
    """
    block_id, cross_section_id, table_id = ids
    block, ground = _block(packed, block_id), _ground(packed, cross_section_id)
    tree = packed.trees[packed.tree_start[cross_section_id] : packed.tree_start[cross_section_id + 1]]
    corners = block.sides.shape[0]
    convex = int(packed.ground_reals[cross_section_id, 5])
    n = corners + min(VERTEX_CONTACTS, convex) if corners > 0 else SMOOTH_CONTACTS
    workspace = Workspace(
        contact_state.new_contacts(n), contact_state.new_contacts(n), contact_step.new_scratch(n),
        np.empty(TREE_STACK, np.int64), np.empty(N_STATE), np.empty(N_POSE + 1), np.empty(rest.N_WATCH),
        np.full(N_IMPACT, np.nan),
    )  # fmt: skip
    world = WorldArrays(block, ground, packed.tables[table_id], gravity)
    return _descend(world, tree, q, step_sizes, rules, (recorder, held), workspace)


@kernel
def _descend(world, tree, q, step_sizes, rules, written, workspace):
    """`release` on prepared arrays."""
    memory, found, scratch, stack, old, anchor, watch, current = workspace
    recorder, held = written
    contacts, fast_contacts = (memory, found, scratch), (memory, scratch)
    body, line_record, sample_record = Body(world.block, world.gravity), recorder.lines, recorder.samples
    block, ground, law, gravity = world.block, world.ground, world.law, world.gravity
    lines, times, audit, knots = line_record.ends, sample_record.times, recorder.audit, recorder.knots
    spent, time_limit, (h_loading, h_contact) = rules.spent, rules.time_limit, step_sizes
    anchor[GUARD] = 0.0
    radius, corners = block.radius, block.sides.shape[0]
    highest_energy = 0.0  # kinetic, at the beginning of any contact so far
    # numba compiles a function once more for each literal that is passed to it: these are none
    zero, no = np.int64(0), corners < 0
    t, stop, count, at, used = 0.0, STOP_TIME, zero, zero, zero
    while at < times.size and times[at] <= 0.0:
        copy(q[:N_POSE], sample_record.poses[at])
        at += 1
    # the impact that is open: whether there is one, and whether the ground has stopped pressing
    is_open, left = no, no
    rest.forget_rest(watch)
    active, steps, looked, growth, share = zero, zero, zero, 1.0, 1.0
    stale = no  # whether the contacts have not looked at the ground since the block moved
    noticed = no  # whether the contacts know the ground at the present pose
    recording, airy = len(knots) > 0, in_air(block)
    stored = 0.0  # by springs at the start
    if len(held) > 0 and held[0, 0] == held[0, 0]:
        active, highest_energy = contact_state.go_on(held, memory)
        stored = contact_energy.stored_energy(memory, law)
        is_open = stale = active > 0
        if is_open:
            open_impact(current, t, q, memory)
    buried = _is_buried(q, world)
    if buried:
        stop, time_limit = STOP_BURIED, 0.0

    while t < time_limit:
        if not ground.x_low <= q[X] <= ground.x_high:
            stop = STOP_EXIT
            break
        if q[X] >= rules.until:
            stop = STOP_REACHED
            break
        flying = active == 0
        if flying:
            longest, extra = air_stride(q, gravity, block)
            tau = time_aloft(q, extra, world, tree, stack, h_contact)
            if tau >= (h_contact if corners > 0 else LEAST_STRIDE * h_contact):
                tau = min(tau, longest, time_limit - t)
                copy(q, old)
                used = knot(knots, used, t, q, 0.0 if airy else 1.0)
                taken = fly(q, tau, gravity, block)
                if q[X] >= rules.until:
                    copy(old, q)
                    stop = STOP_REACHED
                    break
                audit[EFFECTS] += taken
                new = cross((t, tau), old, q, flying, body, line_record)
                at = sample((t, tau), old, q, not airy, gravity, sample_record, at)
                t += tau
                noticed = stale = False
                if spent and (new > 0 or count == 0) and is_spent(q, 0.0, body, line_record):
                    stop = STOP_SPENT
                    break
                continue

        # near the ground or on it
        if steps >= looked:
            looked = steps + STEPS_BETWEEN_LOOKS
            growth = contact_energy.step_growth(highest_energy, block, memory, law)
            growth, share = min(LARGEST_BATCH_STEP_GROWTH, growth), 1.0
            if active > 0 and is_open:
                if rules.captured and rest.captured(q, world, memory):
                    stop = STOP_REST
                    break
                if rest.watch_rest(watch, t, q, body):
                    stop = STOP_REST
                    break
                if spent:
                    springs = contact_energy.stored_energy(memory, law)
                    if is_spent(q, springs, body, line_record):
                        stop = STOP_SPENT
                        break
        h = h_contact * growth
        copy(q, old)
        if active > 0 and anchor[GUARD] > 0.0:
            near = len(lines) > 0 and near_line(
                q, min(_reach(q, h, world, memory), 2.0 * anchor[GUARD]), line_record
            )
            pause = times[at] if at < times.size else np.inf
            hop = STEPS_BETWEEN_LOOKS * FLOATING_STEPS * h
            several = 1 if near or recording else looked - steps
            horizon = Horizon(several, time_limit, pause, hop, rules.until)
            grown = StepSizes(h_loading * growth, FLOATING_STEPS * h, h, share)
            until, done, left, why, share = fast_contact_steps(
                q, t, (horizon, grown), anchor, world, fast_contacts, (current, left, audit)
            )
            steps += done
            hopped = why == HOPPED
            if hopped:
                looked = steps
            elif why > 0:
                moved = done > 0 or old[X] != anchor[X] or old[Y] != anchor[Y]
                anchor[GUARD] = 0.0
                if why == GUARD_LEFT and moved:
                    buried = set_anchor(anchor, q, h, world, memory)
            stale = stale or done > 0
            if done == 0:
                continue
            used = knot(knots, used, t, old, 1.0 if hopped else 0.0)
            flying = hopped
        else:
            steps += 1
            near = True
            loading, floating = _pressing(memory, law, h_loading * growth, FLOATING_STEPS * h)
            floating = floating and left and active > 0
            if active > 0:
                h = FLOATING_STEPS * h if floating else (h_loading * growth if loading else h)
            pace = max(np.sqrt(q[VX] * q[VX] + q[VY] * q[VY]) + abs(q[OMEGA]) * radius, 1e-300)
            h = min(h, time_limit - t, max(h_contact, LONGEST_CONTACT_STRIDE * radius / pace))
            half = near_reach(q, h, gravity, radius)
            seen = facet_range(ground, q[X] - half, q[X] + half)
            if active == 0 and not noticed:
                contact_state.clear(memory)
                active = contact_step.begin(q, seen, world, memory, found)
                noticed = True
                if active > 0:
                    is_open, left = True, False
                    open_impact(current, t, q, memory)
                    highest_energy = max(highest_energy, contact_energy.kinetic_energy(q, block))
            flying = active == 0
            if stale:
                contact_step.look_again(q, seen, world, memory, found)
                stale = False
            used = knot(knots, used, t, q, 1.0 if flying and not airy else 0.0)
            until = later(t, contact_step.step(q, h, seen, world, contacts, audit, floating))
            before = active
            force, depth, active = contact_energy.pressure(memory, law)
            if is_open:
                left = note_pressure(current, left, force, depth, until, q)
            elif active > 0:
                is_open, left = True, False
                open_impact(current, until, q, memory)
                highest_energy = max(highest_energy, contact_energy.kinetic_energy(q, block))
            if active > before or flying:
                looked = steps  # a contact has begun: how large may its steps be
            buried = set_anchor(anchor, q, h, world, memory) if active > 0 else _is_buried(q, world)
        gone = until - t
        if near:
            cross((t, gone), old, q, flying, body, line_record)
        at = sample((t, gone), old, q, flying and not airy, gravity, sample_record, at)
        t = until
        if buried:
            stop = STOP_BURIED
            break
        if active == 0 and is_open:
            noticed = noticed and not end_impact(q, current, law[int(current[I_ZONE])], block, audit)
            count = close_impact(current, left, recorder.impacts, count)
            is_open = False
            rest.forget_rest(watch)
            if count == rules.impact_limit:
                stop = STOP_IMPACTS
                break
            if spent and is_spent(q, 0.0, body, line_record):
                stop = STOP_SPENT
                break
    if is_open and stop != STOP_IMPACTS:
        count = close_impact(current, left, recorder.impacts, count)
    while at < times.size and stop == STOP_REST:
        copy(q[:N_POSE], sample_record.poses[at])
        at += 1
    used = knot(knots, used, t, q, 1.0)
    audit[ELASTIC] = contact_energy.stored_energy(memory, law) - stored
    if len(held) > 0:
        contact_state.hold(memory, highest_energy, held)
    return stop, t, count, used


@kernel
def _reach(q, h, world, memory):
    """How far in m the centroid can come until the next look, if the springs give all the energy that they hold."""
    held = contact_energy.kinetic_energy(q, world.block) + contact_energy.stored_energy(memory, world.law)
    span = STEPS_BETWEEN_LOOKS * FLOATING_STEPS * h
    return span * (np.sqrt(2.0 * held / world.block.mass) + abs(world.gravity) * span)


@kernel(forceinline=True)
def near_reach(q, h, gravity, radius):
    """Half-width in m of the ground that a contact step looks at."""
    return (np.sqrt(q[VX] * q[VX] + q[VY] * q[VY]) + gravity * h) * h + 1.1 * radius


@kernel
def _pressing(memory, law, loading_s, floating_s):
    """(every contact goes deeper in first loading, none touches the bottom of its indentation)."""
    ints, reals = memory.ints, memory.reals
    loading, floating = True, True
    for j in range(ints.shape[0]):
        if ints[j, ACTIVE]:
            p, pressed, peak = law[ints[j, ZONE]], reals[j, DEPTH] - reals[j, OFFSET], reals[j, PEAK]
            loading = loading and pressed >= peak and goes_deeper(pressed, reals[j, RATE], loading_s)
            floating = floating and p[ACTS] == 0.0 and p[INDENTATION] == 0.0
            floating = floating and floats(
                pressed - residual(peak, p[K_L], p[K_UL]), reals[j, RATE], floating_s
            )
    return loading, floating


@kernel
def _is_buried(q, world):
    """Whether the centroid lies below the surface."""
    ground, radius = world.ground, world.block.radius
    f0, f1 = facet_range(ground, q[X] - 2.0 * radius, q[X] + 2.0 * radius)
    return point_depth(q[X], q[Y], ground.facets, f0, f1)[0] > 0.0
