"""One release of the batch engine from its start to its end, compiled.

A flight is a few exact parabolas; a lower bound of the time to contact determines their lengths. Near the ground,
contact steps advance the block: a full step where contacts begin, change or end, fast steps (`fast_contact_steps`) in
between."""

from typing import NamedTuple

import numpy as np

from rock2d.compiled import copy, kernel, njit
from rock2d.effects.columns import ANY_EFFECT_ACTS
from rock2d.engines import contact_state, contact_step, rest
from rock2d.engines.contact_search import GUARD, set_anchor
from rock2d.engines.contact_state import ACTIVE, DEPTH, OFFSET, PEAK, RATE, SMOOTH_CONTACTS, VERTEX_CONTACTS, ZONE
from rock2d.engines.event_detection import later
from rock2d.engines.fast_contact_steps import (
    GUARD_LEFT,
    HOPPED,
    SeriesLimits,
    StepSizes,
    fast_contact_steps,
    floats,
    goes_deeper,
)
from rock2d.engines.free_flight import air_acts, air_stride, fly, time_to_contact
from rock2d.engines.geometry import BlockArrays, Body, GroundArrays, WorldArrays, centroid_depth, facet_range
from rock2d.engines.recording import (
    close_impact,
    end_impact,
    is_spent,
    near_line,
    note_crossings,
    note_knot,
    note_pressure,
    note_samples,
    open_impact,
)
from rock2d.laws.contact import K_L, K_UL, ROLLING_IN_INDENTATION, residual_indentation
from rock2d.records.columns import (
    EFFECTS,
    ELASTIC,
    GROUND_SHIFT,
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

LARGEST_BATCH_STEP_GROWTH = 4.0  # largest factor on contact steps while the motion decays
STEPS_BETWEEN_CHECKS = 8  # contact steps between two checks of the remaining energy
LEAST_STRIDE = 0.01  # share of a contact step: a shorter flight of a ball is left to a contact step
LONGEST_CONTACT_STRIDE = 0.1  # largest motion in radii of a block in a long step in which contacts may change
FLOATING_STEPS = 8.0  # factor on steps while no contact touches the bottom of its indentation
TREE_STACK = 64  # size of the stack for the search in the tree of facets

GOES_ON = -1  # not one of STOPS: the release does not end
# Workspace.counts: contact steps so far, and their number at the next check; active contacts; impacts, samples and
# knots so far; flags: an impact is open, the block has lifted off in it, depths of inactive contacts are out of date,
# contacts have been searched at the present pose, the centroid is in the ground
STEPS, NEXT_CHECK, ACTIVE_CONTACTS, IMPACTS, SAMPLES, KNOTS, OPEN, LIFTED, STALE, SEARCHED, BURIED = range(11)
# Workspace.reals: time in s; factor on contact steps; a further factor after steps with too large an error; the highest
# kinetic energy in J at the beginning of a contact so far
TIME, GROWTH, SHARE, HIGHEST = range(4)


class StopRules(NamedTuple):
    """When a release ends before the block is at rest."""

    time_limit: float  # s
    impact_limit: int  # number of impacts after which the release ends; 0: no limit
    spent: bool  # stop when the remaining energy is too small for any measure line that was not crossed
    captured: bool  # stop when the remaining energy cannot move the block on, see `rest.captured`
    suspend_x: float  # m; a release is suspended there, see `batch.run_batch`


class Workspace(NamedTuple):
    """Work arrays of one release."""

    memory: contact_state.Contacts
    found: contact_state.Contacts
    loaded: contact_state.LoadedContacts
    stack: np.ndarray  # (TREE_STACK,)
    old: np.ndarray  # (6,) state before the present step
    anchor: np.ndarray  # (4,) the pose whose guard is known, and the guard in m (0: none)
    watch: np.ndarray  # (rest.N_WATCH,) see `rest.watch_rest`
    impact: np.ndarray  # (N_IMPACT,) the open impact
    counts: np.ndarray  # (11,) progress of the release, see STEPS: counts, and flags that are 0 or 1
    reals: np.ndarray  # (4,) progress of the release, see TIME


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
def run_release(packed, q, ids, gravity, step_sizes, rules, outputs):
    """Run one release; q becomes its last state.

    packed : see `batch.Packed`; ids : (block, cross-section, table) of the release
    step_sizes : contact steps in s, (while every contact is in first loading, otherwise)
    rules : StopRules
    outputs : (`recording.Recorder`, (contacts, N_SAVED) contacts with which a suspended release continues, NaN: none).
        The contacts are overwritten at the end. With 0 contacts nothing is read or saved

    Returns (index into STOPS, time in s, number of impacts, number of knots)."""
    block_id, cross_section_id, table_id = ids
    block, ground = _block(packed, block_id), _ground(packed, cross_section_id)
    tree = packed.trees[packed.tree_start[cross_section_id] : packed.tree_start[cross_section_id + 1]]
    corners = block.sides.shape[0]
    convex = int(packed.ground_reals[cross_section_id, 5])
    n = corners + min(VERTEX_CONTACTS, convex) if corners > 0 else SMOOTH_CONTACTS
    workspace = Workspace(
        contact_state.new_contacts(n), contact_state.new_contacts(n), contact_state.new_loaded(n),
        np.empty(TREE_STACK, np.int64), np.empty(N_STATE), np.empty(N_POSE + 1), np.empty(rest.N_WATCH),
        np.full(N_IMPACT, np.nan), np.zeros(BURIED + 1, np.int64), np.zeros(HIGHEST + 1),
    )  # fmt: skip
    world = WorldArrays(block, ground, packed.tables[table_id], gravity)
    return _run_phases(world, tree, q, step_sizes, rules, outputs, workspace)


@kernel
def _run_phases(world, tree, q, step_sizes, rules, outputs, workspace):
    """`run_release` on prepared arrays: one phase after the other, until a phase ends the release."""
    recorder, saved = outputs
    samples, counts, reals = recorder.samples, workspace.counts, workspace.reals
    workspace.anchor[GUARD], reals[GROWTH], reals[SHARE] = 0.0, 1.0, 1.0
    while counts[SAMPLES] < samples.times.size and samples.times[counts[SAMPLES]] <= 0.0:
        copy(q[:N_POSE], samples.poses[counts[SAMPLES]])
        counts[SAMPLES] += 1
    rest.forget_rest(workspace.watch)
    stored = _resume(q, world, saved, workspace)
    stop = STOP_BURIED if centroid_depth(q, world) > 0.0 else GOES_ON
    while stop == GOES_ON and reals[TIME] < rules.time_limit:
        if not world.ground.x_low <= q[X] <= world.ground.x_high:
            stop = STOP_EXIT
        elif q[X] >= rules.suspend_x:
            stop = STOP_REACHED
        else:
            clear, longest = _clear_time(q, world, tree, step_sizes, workspace)
            if clear > 0.0:
                tau = min(clear, longest, rules.time_limit - reals[TIME])
                stop = _fly(q, tau, world, rules, recorder, workspace)
            else:
                stop = _near_ground(q, world, step_sizes, rules, recorder, workspace)
    if stop == GOES_ON:
        stop = STOP_TIME
    if counts[OPEN] != 0 and stop != STOP_IMPACTS:
        counts[IMPACTS] = close_impact(workspace.impact, counts[LIFTED] != 0, recorder.impacts, counts[IMPACTS])
    while counts[SAMPLES] < samples.times.size and stop == STOP_REST:
        copy(q[:N_POSE], samples.poses[counts[SAMPLES]])
        counts[SAMPLES] += 1
    counts[KNOTS] = note_knot(recorder.knots, counts[KNOTS], reals[TIME], q, recorder.audit[GROUND_SHIFT], 1.0)
    recorder.audit[ELASTIC] = contact_state.stored_energy(workspace.memory, world.law) - stored
    if len(saved) > 0:
        contact_state.save_contacts(workspace.memory, reals[HIGHEST], saved)
    return stop, reals[TIME], counts[IMPACTS], counts[KNOTS]


@kernel
def _resume(q, world, saved, workspace):
    """Restore the contacts of a suspended release, if any. Returns the energy in J in their springs."""
    counts, memory = workspace.counts, workspace.memory
    if not (len(saved) > 0 and saved[0, 0] == saved[0, 0]):
        return 0.0
    counts[ACTIVE_CONTACTS], workspace.reals[HIGHEST] = contact_state.restore_contacts(saved, memory)
    if counts[ACTIVE_CONTACTS] > 0:
        counts[OPEN] = counts[STALE] = 1
        open_impact(workspace.impact, workspace.reals[TIME], q, memory)
    return contact_state.stored_energy(memory, world.law)


@kernel
def _clear_time(q, world, tree, step_sizes, workspace):
    """(lower bound in s of the time to contact, 0 if it is less than a contact step; longest step in s through air)."""
    h_contact = step_sizes[1]
    if workspace.counts[ACTIVE_CONTACTS] > 0:
        return 0.0, 0.0
    longest, extra = air_stride(q, world.gravity, world.block)
    tau = time_to_contact(q, extra, world, tree, workspace.stack, h_contact)
    least = h_contact if world.block.sides.shape[0] > 0 else LEAST_STRIDE * h_contact
    return (tau if tau >= least else 0.0), longest


@kernel
def _fly(q, tau, world, rules, recorder, workspace):
    """Fly for tau (s). Returns why the release ends, or GOES_ON."""
    counts, reals, old = workspace.counts, workspace.reals, workspace.old
    t, parabola = reals[TIME], not air_acts(world.block)
    body, lines = Body(world.block, world.gravity), recorder.lines
    copy(q, old)
    shift = recorder.audit[GROUND_SHIFT]
    counts[KNOTS] = note_knot(recorder.knots, counts[KNOTS], t, q, shift, 1.0 if parabola else 0.0)
    dissipated = fly(q, tau, world.gravity, world.block)
    if q[X] >= rules.suspend_x:
        copy(old, q)
        return STOP_REACHED
    recorder.audit[EFFECTS] += dissipated
    new = note_crossings((t, tau), old, q, True, body, lines)
    counts[SAMPLES] = note_samples((t, tau), (old, q), parabola, body, shift, recorder.samples, counts[SAMPLES])
    reals[TIME] = t + tau
    counts[SEARCHED] = counts[STALE] = 0
    if rules.spent and (new > 0 or counts[IMPACTS] == 0) and is_spent(q, 0.0, body, lines):
        return STOP_SPENT
    return GOES_ON


@kernel
def _near_ground(q, world, step_sizes, rules, recorder, workspace):
    """Contact steps near the ground or on it. Returns why the release ends, or GOES_ON."""
    counts, reals, old = workspace.counts, workspace.reals, workspace.old
    t, body = reals[TIME], Body(world.block, world.gravity)
    if counts[STEPS] >= counts[NEXT_CHECK]:
        stop = _check_energy(q, world, rules, recorder, workspace)
        if stop != GOES_ON:
            return stop
    copy(q, old)
    if counts[ACTIVE_CONTACTS] > 0 and workspace.anchor[GUARD] > 0.0:
        flying, near, t_end = _fast_steps(q, world, step_sizes, rules, recorder, workspace)
        if t_end == t:
            return GOES_ON
    else:
        near = True
        flying, t_end = _full_step(q, world, step_sizes, rules, recorder, workspace)
    gone = t_end - t
    if near:
        note_crossings((t, gone), old, q, flying, body, recorder.lines)
    parabola, shift = flying and not air_acts(world.block), recorder.audit[GROUND_SHIFT]
    counts[SAMPLES] = note_samples((t, gone), (old, q), parabola, body, shift, recorder.samples, counts[SAMPLES])
    reals[TIME] = t_end
    if counts[BURIED] != 0:
        return STOP_BURIED
    if counts[ACTIVE_CONTACTS] == 0 and counts[OPEN] != 0:
        return _end_impact(q, world, rules, recorder, workspace)
    return GOES_ON


@kernel
def _check_energy(q, world, rules, recorder, workspace):
    """Set the size of contact steps, and check for rest and spent energy. Returns why the release ends, or GOES_ON."""
    counts, reals, memory = workspace.counts, workspace.reals, workspace.memory
    body = Body(world.block, world.gravity)
    counts[NEXT_CHECK] = counts[STEPS] + STEPS_BETWEEN_CHECKS
    growth = contact_state.step_growth(reals[HIGHEST], world.block, memory, world.law)
    reals[GROWTH], reals[SHARE] = min(LARGEST_BATCH_STEP_GROWTH, growth), 1.0
    if counts[ACTIVE_CONTACTS] > 0 and counts[OPEN] != 0:
        if rules.captured and rest.captured(q, world, memory):
            return STOP_REST
        if rest.watch_rest(workspace.watch, reals[TIME], q, body):
            return STOP_REST
        if rules.spent:
            springs = contact_state.stored_energy(memory, world.law)
            if is_spent(q, springs, body, recorder.lines):
                return STOP_SPENT
    return GOES_ON


@kernel
def _fast_steps(q, world, step_sizes, rules, recorder, workspace):
    """A series of fast steps within the guard. Returns (whether it was a hop, whether a measure line may be near, new
    time in s, which is unchanged if no step was made)."""
    counts, reals, anchor, memory = workspace.counts, workspace.reals, workspace.anchor, workspace.memory
    lines, samples = recorder.lines, recorder.samples
    t, growth, at = reals[TIME], reals[GROWTH], counts[SAMPLES]
    h = step_sizes[1] * growth
    near = len(lines.ends) > 0 and near_line(q, min(_reach(q, h, world, memory), 2.0 * anchor[GUARD]), lines)
    next_sample = samples.times[at] if at < samples.times.size else np.inf
    longest_hop = STEPS_BETWEEN_CHECKS * FLOATING_STEPS * h
    most_steps = 1 if near or len(recorder.knots) > 0 else counts[NEXT_CHECK] - counts[STEPS]
    limit = SeriesLimits(most_steps, rules.time_limit, next_sample, longest_hop, rules.suspend_x)
    grown, shift = StepSizes(step_sizes[0] * growth, FLOATING_STEPS * h, h, reals[SHARE]), recorder.audit[GROUND_SHIFT]
    t_end, done, lifted, why, reals[SHARE] = fast_contact_steps(
        q, t, (limit, grown), anchor, world, (memory, workspace.loaded),
        (workspace.impact, counts[LIFTED] != 0, recorder.audit),
    )  # fmt: skip
    counts[LIFTED] = lifted
    counts[STEPS] += done
    hopped = why == HOPPED
    if hopped:
        counts[NEXT_CHECK] = counts[STEPS]
    elif why > 0:
        old = workspace.old
        moved = done > 0 or old[X] != anchor[X] or old[Y] != anchor[Y]
        anchor[GUARD] = 0.0
        if why == GUARD_LEFT and moved:
            counts[BURIED] = set_anchor(anchor, q, h, world, memory)
    if done == 0:
        return hopped, near, t
    counts[STALE] = 1
    counts[KNOTS] = note_knot(recorder.knots, counts[KNOTS], t, workspace.old, shift, 1.0 if hopped else 0.0)
    return hopped, near, t_end


@kernel
def _full_step(q, world, step_sizes, rules, recorder, workspace):
    """A full contact step, in which contacts may begin, change or end. Returns (whether no contact was active before
    it, new time in s)."""
    counts, reals, memory, found = workspace.counts, workspace.reals, workspace.memory, workspace.found
    block, law, t, active = world.block, world.law, reals[TIME], counts[ACTIVE_CONTACTS]
    h_loading, h_contact = step_sizes
    h = h_contact * reals[GROWTH]
    counts[STEPS] += 1
    loading, floating = _branches(memory, law, h_loading * reals[GROWTH], FLOATING_STEPS * h)
    floating = floating and counts[LIFTED] != 0 and active > 0
    if active > 0:
        h = FLOATING_STEPS * h if floating else (h_loading * reals[GROWTH] if loading else h)
    pace = max(np.sqrt(q[VX] * q[VX] + q[VY] * q[VY]) + abs(q[OMEGA]) * block.radius, 1e-300)
    h = min(h, rules.time_limit - t, max(h_contact, LONGEST_CONTACT_STRIDE * block.radius / pace))
    half = (np.sqrt(q[VX] * q[VX] + q[VY] * q[VY]) + world.gravity * h) * h + 1.1 * block.radius
    near = facet_range(world.ground, q[X] - half, q[X] + half)
    if active == 0 and counts[SEARCHED] == 0:
        contact_state.clear(memory)
        active = contact_step.begin_contacts(q, near, world, memory, found)
        counts[SEARCHED] = 1
        if active > 0:
            _begin_impact(t, q, block, workspace)
    flying = active == 0
    if counts[STALE] != 0:
        contact_step.refresh_depths(q, near, world, memory, found)
        counts[STALE] = 0
    parabola, shift = flying and not air_acts(block), recorder.audit[GROUND_SHIFT]
    counts[KNOTS] = note_knot(recorder.knots, counts[KNOTS], t, q, shift, 1.0 if parabola else 0.0)
    contacts = memory, found, workspace.loaded
    t_end = later(t, contact_step.step(q, h, near, world, contacts, recorder.audit, floating))
    before = active
    force, depth, active = contact_state.pressure(memory, law)
    counts[ACTIVE_CONTACTS] = active
    if counts[OPEN] != 0:
        counts[LIFTED] = note_pressure(workspace.impact, counts[LIFTED] != 0, force, depth, t_end, q)
    elif active > 0:
        _begin_impact(t_end, q, block, workspace)
    if active > before or flying:
        counts[NEXT_CHECK] = counts[STEPS]  # a new contact may need smaller steps
    counts[BURIED] = set_anchor(workspace.anchor, q, h, world, memory) if active > 0 else centroid_depth(q, world) > 0.0
    return flying, t_end


@kernel
def _begin_impact(t, q, block, workspace):
    """Begin an impact at time t (s)."""
    counts, reals = workspace.counts, workspace.reals
    counts[OPEN], counts[LIFTED] = 1, 0
    open_impact(workspace.impact, t, q, workspace.memory)
    reals[HIGHEST] = max(reals[HIGHEST], contact_state.kinetic_energy(q, block))


@kernel
def _end_impact(q, world, rules, recorder, workspace):
    """End the open impact. Returns why the release ends, or GOES_ON."""
    counts, current = workspace.counts, workspace.impact
    if end_impact(q, current, world.law[int(current[I_ZONE])], world.block, recorder.audit):
        counts[SEARCHED] = 0
    counts[IMPACTS] = close_impact(current, counts[LIFTED] != 0, recorder.impacts, counts[IMPACTS])
    counts[OPEN] = 0
    rest.forget_rest(workspace.watch)
    if counts[IMPACTS] == rules.impact_limit:
        return STOP_IMPACTS
    if rules.spent and is_spent(q, 0.0, Body(world.block, world.gravity), recorder.lines):
        return STOP_SPENT
    return GOES_ON


@kernel
def _reach(q, h, world, memory):
    """Largest distance in m that the centroid can move until the next check, if the springs release all their
    energy."""
    energy = contact_state.kinetic_energy(q, world.block) + contact_state.stored_energy(memory, world.law)
    span = STEPS_BETWEEN_CHECKS * FLOATING_STEPS * h
    return span * (np.sqrt(2.0 * energy / world.block.mass) + abs(world.gravity) * span)


@kernel
def _branches(memory, law, loading_s, floating_s):
    """(whether every contact goes deeper in first loading, whether none touches the bottom of its indentation)."""
    ints, reals = memory.ints, memory.reals
    loading, floating = True, True
    for j in range(ints.shape[0]):
        if ints[j, ACTIVE]:
            p, pressed, peak = law[ints[j, ZONE]], reals[j, DEPTH] - reals[j, OFFSET], reals[j, PEAK]
            loading = loading and pressed >= peak and goes_deeper(pressed, reals[j, RATE], loading_s)
            floating = floating and p[ANY_EFFECT_ACTS] == 0.0 and p[ROLLING_IN_INDENTATION] == 0.0
            floating = floating and floats(
                pressed - residual_indentation(peak, p[K_L], p[K_UL]), reals[j, RATE], floating_s
            )
    return loading, floating
