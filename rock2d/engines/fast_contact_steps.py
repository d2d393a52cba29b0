"""Contact steps in a row while the block keeps its contacts: the fast part of an impact, compiled.

A full step of `contact_step.step` searches the ground for the nearest features. As long as the block stays within the
*guard* of a pose (`guard.guard_distance`) that search would find the same features again, so it is left out. Whatever
ends a series of fast steps (a contact that begins, ends or changes its feature or zone) is left to
`contact_step.step`.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from rock2d.compiled import copy, kernel
from rock2d.engines.contact_state import DEPTH, DISPLACEMENT, INDEX, OFFSET, PEAK, RATE, ROTATION
from rock2d.engines.contact_update import note_outcome
from rock2d.engines.event_detection import LANDED, MOST_LANDINGS, hold_event, law_event
from rock2d.engines.geometry import (
    CORNER_FACET,
    F_NORMAL,
    F_POINT,
    F_SHAPE,
    LENGTH,
    NORMAL_X,
    NORMAL_Y,
    POINT_X,
    POINT_Y,
    RUN_FIRST,
    RUN_LAST,
    SMOOTH_FACET,
    TANGENT_X,
    TANGENT_Y,
    Body,
    is_ball,
)
from rock2d.engines.guard import TURN_ARM
from rock2d.engines.loaded_contacts import (
    ACTING_1,
    ARM,
    DEPTH_0,
    DEPTH_1,
    DISPLACEMENT_1,
    L_ACTS,
    L_BOTTOM,
    L_DISPLACEMENT,
    L_EFFECTS,
    L_KIND,
    L_LAW,
    L_OFFSET,
    L_PEAK,
    L_ROTATION,
    LEAST_EVENT,
    PEAK_1,
    PLASTIC_WORK,
    RATE_0,
    RATE_1,
    ROTATION_1,
    SLIP,
    TAKEN_DISPLACEMENT,
    TAKEN_ROTATION,
    TANGENTIAL_0,
    TANGENTIAL_1,
    effects_act,
    load_active,
    note_pressed,
    placed,
)
from rock2d.engines.recording import note_pressure
from rock2d.engines.runge_kutta import runge_kutta, runge_kutta_with_effects
from rock2d.engines.truncation import keep_energy, step_error
from rock2d.laws.contact import (
    INDENTATION,
    K_L,
    K_R,
    K_T,
    K_UL,
    MU,
    change_feature,
    normal_force,
    residual,
    tangential_force,
)
from rock2d.records.columns import EFFECTS, FRICTION, OMEGA, PLASTIC, RECOIL, ROLLING, THETA, VX, VY, X, Y

GUARD_LEFT, CONTACT_ENDS, STEP_TOO_LONG = 1, 2, 3  # why a series of fast steps ended; 0: none of these
GUARD_SHARE = 0.3  # of the guard that one step without pressure may use
GUARD = 3  # column of an anchor (x, y, theta, guard in m): the pose whose guard is known


class StepSizes(NamedTuple):
    """Contact steps in s."""

    loading: float  # while every contact goes deeper in first loading
    floating: float  # while no contact touches the bottom of its indentation
    other: float


class Horizon(NamedTuple):
    """How far a series of fast steps may go."""

    steps: Any  # int64
    time_limit: float  # s
    pause: (
        float  # instant in s that only the first step may reach, so that a caller sees the states around it
    )


@kernel(forceinline=True)
def _follow_run(loaded, a, facets, index, q, direction, audit):
    """Load the facet of its run that a contact has moved to at state q, whose direction is (cos θ, sin θ); returns the
    facet's index."""
    rows = loaded.rows
    c, s = direction
    kind, px, py = int(rows[a, L_KIND]), q[X], q[Y]
    if kind == CORNER_FACET:
        corner_x, corner_y = rows[a, F_SHAPE], rows[a, F_SHAPE + 1]
        px, py = px + c * corner_x - s * corner_y, py + s * corner_x + c * corner_y
    elif kind != SMOOTH_FACET:
        return index
    elif not _below_centre(rows, a):
        _, _, _, rx, ry = placed(rows, a, (px, py, c, s))
        px, py = px + rx, py + ry
    first, last, found = int(facets[index, RUN_FIRST]), int(facets[index, RUN_LAST]), index
    while True:
        along = (px - facets[found, POINT_X]) * facets[found, TANGENT_X]
        along += (py - facets[found, POINT_Y]) * facets[found, TANGENT_Y]
        if along < 0.0 and found > first and found <= index:
            found -= 1
        elif along > facets[found, LENGTH] and found < last and found >= index:
            found += 1
        else:
            break
    if found != index:
        _load_facet(loaded, a, facets[found], q, (q[X], q[Y], c, s), audit)
    return found


@kernel(forceinline=True)
def _below_centre(rows, a):
    """Whether a smooth profile is a ball's, whose contact point lies below its centre."""
    round_about = rows[a, F_SHAPE + 2] == 0.0 and rows[a, F_SHAPE + 3] == 0.0
    return round_about and rows[a, F_SHAPE] == rows[a, F_SHAPE + 1]


@kernel
def _load_facet(loaded, a, facet, q, pose, audit):
    """Let a contact go on at the next facet of its run, see `change_feature`."""
    rows, trial = loaded.rows, loaded.trial
    rows[a, F_POINT], rows[a, F_POINT + 1] = facet[POINT_X], facet[POINT_Y]
    rows[a, F_NORMAL], rows[a, F_NORMAL + 1] = facet[NORMAL_X], facet[NORMAL_Y]
    depth, nx, ny, rx, ry = placed(rows, a, pose)
    row = rows[a, L_LAW:]
    force_n = normal_force(trial[a, DEPTH_0] - rows[a, L_OFFSET], rows[a, L_PEAK], row[K_L], row[K_UL])
    force_t = tangential_force(rows[a, L_DISPLACEMENT], force_n, row[K_T], row[MU])
    rows[a, L_OFFSET], _, _, lost = change_feature(
        row, depth, depth - trial[a, DEPTH_0], (rows[a, L_OFFSET], rows[a, L_PEAK]), (force_n, force_t)
    )
    audit[PLASTIC] += lost
    trial[a, DEPTH_0] = depth
    trial[a, RATE_0] = -((q[VX] - q[OMEGA] * ry) * nx + (q[VY] + q[OMEGA] * rx) * ny)


@kernel(forceinline=True)
def floats(depth, rate, step):
    """Whether a contact point at this depth below its indentation's bottom does not press, and will not press
    within a hundredth of the step. Rounding can stop a landing that far above the bottom; such a step presses."""
    return depth <= 0.0 and depth + 0.01 * rate * step < 0.0


@kernel(forceinline=True)
def goes_deeper(depth, rate, step):
    """Whether a contact in first loading does not turn back at once: then the stiffer unloading sets the step."""
    return rate * step > LEAST_EVENT * depth


@kernel
def fast_contact_steps(q, t, limits, anchor, world, contacts, log):
    """Advance q from time t by contact steps within the guard.

    limits : (Horizon, StepSizes)
    anchor : (4,) x, y, theta of the pose whose guard is the fourth
    contacts : (memory, scratch)
    log : (row of the open impact, whether the ground has stopped pressing, audit); see `recording.note_pressure`

    Returns (time now in s, number of steps, whether the ground has stopped pressing, why it ended: GUARD_LEFT,
    CONTACT_ENDS if a contact is about to end, STEP_TOO_LONG if a step errs too much, else 0).
    """
    loaded = contacts[1].loaded
    active = load_active(world, contacts[0], loaded)
    # compiled twice: the code of effects slows the plain law down
    if effects_act(world.block, active, loaded.rows):
        return _with_effects(q, t, limits, anchor, world, contacts, log, active)
    return _plain(q, t, limits, anchor, world, contacts, log, active)


@kernel
def _with_effects(q, t, limits, anchor, world, contacts, log, active):
    return _series(q, t, limits, anchor, world, contacts, log, active, runge_kutta_with_effects, True)


@kernel
def _plain(q, t, limits, anchor, world, contacts, log, active):
    return _series(q, t, limits, anchor, world, contacts, log, active, runge_kutta, False)


@kernel(forceinline=True)
def _series(q, t, limits, anchor, world, contacts, log, active, advance, effects):
    """`fast_contact_steps` with `active` contacts loaded; advance: the Runge-Kutta step; effects: whether it is the one
    with effects. Ten parameters: it is written once and compiled for both."""
    horizon, sizes = limits
    current, left, audit = log
    body = Body(world.block, world.gravity)
    memory, scratch = contacts
    ints, reals, block = memory.ints, memory.reals, world.block
    q1, loaded = scratch.state, scratch.loaded
    rows, which, rates, trial = loaded.rows, loaded.which, loaded.rates, loaded.trial
    for a in range(active):
        trial[a, DEPTH_0], trial[a, RATE_0] = reals[which[a], DEPTH], reals[which[a], RATE]
    c, s = np.cos(q[THETA]), np.sin(q[THETA])
    turning = not is_ball(block)
    arm = TURN_ARM * block.radius
    zero: Any = np.int64(0)
    done, why = zero, zero
    while done < horizon.steps:
        loading, unpressed = _branches(active, rows, trial, sizes, effects)
        unpressed = unpressed and left
        h = sizes.loading if loading else sizes.other
        if unpressed:
            pace = np.sqrt(q[VX] * q[VX] + q[VY] * q[VY]) + abs(q[OMEGA]) * block.radius
            h = min(sizes.floating, max(sizes.other, GUARD_SHARE * anchor[GUARD] / max(pace, 1e-300)))
        h = min(h, horizon.time_limit - t)
        if h <= 0.0 or (done > 0 and t + h >= horizon.pause):
            break
        note_pressed(active, loaded, h)
        first, work_t, work_r, work_e, pushed = h, 0.0, 0.0, 0.0, 0.0
        for attempt in range(MOST_LANDINGS):
            pressing = np.int64(0) if unpressed else active
            work_t, work_r, work_e, pushed = advance(q, (c, s), first, body, (pressing, rows, rates), q1)
            if unpressed:
                for a in range(active):
                    rates[a, TAKEN_DISPLACEMENT], rates[a, TAKEN_ROTATION] = 0.0, rows[a, L_ROTATION]
            c1, s1 = c, s
            if turning:
                c1, s1 = np.cos(q1[THETA]), np.sin(q1[THETA])
            moved = abs(q1[X] - anchor[X]) + abs(q1[Y] - anchor[Y]) + arm * abs(q1[THETA] - anchor[THETA])
            if moved >= anchor[GUARD]:
                why = GUARD_LEFT
            pose = (q1[X], q1[Y], c1, s1)
            for a in range(active):
                depth, nx, ny, rx, ry = placed(rows, a, pose)
                trial[a, DEPTH_1] = depth
                ux, uy = q1[VX] - q1[OMEGA] * ry, q1[VY] + q1[OMEGA] * rx
                trial[a, RATE_1] = -(ux * nx + uy * ny)
                if effects:
                    trial[a, SLIP] = ux * ny - uy * nx
                trial[a, ARM] = np.sqrt(rx * rx + ry * ry)
                if depth <= 0.0:
                    why = CONTACT_ENDS
            if why > 0:
                break
            event_s = _first_event(first, h, active, rows, trial, effects)
            if event_s >= first or (attempt > 0 and event_s > LANDED * first):
                break
            first = event_s
        if why > 0:
            break
        for a in range(active):
            note_outcome(a, loaded, effects)
        error, scale, too_long = 0.0, 0.0, False
        if not effects:  # of effects, the work is known no better than the motion
            error, scale, too_long, work_t, work_r = step_error(
                q, q1, first, (work_t, work_r), body, active, loaded
            )
        if too_long:
            why = STEP_TOO_LONG
            break
        force, deepest = _commit(active, loaded, (work_t, work_r), audit)
        if effects:
            audit[EFFECTS] += work_e
            audit[RECOIL] += pushed
        else:
            keep_energy(q, q1, first, error, scale, body, audit)
        for a in range(active):
            ints[which[a], INDEX] = _follow_run(
                loaded, a, world.ground.facets, ints[which[a], INDEX], q1, (c1, s1), audit
            )
        copy(q1, q)
        c, s = c1, s1
        t += first
        done += 1
        left = note_pressure(current, left, force, deepest, t, q)
    for a in range(active):
        j = which[a]
        reals[j, DEPTH], reals[j, RATE], reals[j, PEAK] = trial[a, DEPTH_0], trial[a, RATE_0], rows[a, L_PEAK]
        reals[j, OFFSET] = rows[a, L_OFFSET]
        reals[j, DISPLACEMENT], reals[j, ROTATION] = rows[a, L_DISPLACEMENT], rows[a, L_ROTATION]
    return t, done, left, why


@kernel(forceinline=True)
def _branches(active, rows, trial, sizes, effects):
    """(every contact goes deeper in first loading, none presses or will within a step of `sizes.floating`)."""
    loading, unpressed = True, True
    for a in range(active):
        d0, peak = trial[a, DEPTH_0] - rows[a, L_OFFSET], rows[a, L_PEAK]
        loading = loading and d0 >= peak and goes_deeper(d0, trial[a, RATE_0], sizes.loading)
        unpressed = unpressed and floats(d0 - rows[a, L_BOTTOM], trial[a, RATE_0], sizes.floating)
        unpressed = unpressed and not (effects and rows[a, L_ACTS] != 0.0)
        unpressed = unpressed and rows[a, L_LAW + INDENTATION] == 0.0
    return loading, unpressed


@kernel(forceinline=True)
def _first_event(h, whole, active, rows, trial, effects):
    """Time in (0, h] of the first event of the law in the trial step; h if there is none. `whole`: see
    `event_detection.first_event`."""
    first = h
    for a in range(active):
        d0, d1 = trial[a, DEPTH_0] - rows[a, L_OFFSET], trial[a, DEPTH_1] - rows[a, L_OFFSET]
        r0, r1 = trial[a, RATE_0], trial[a, RATE_1]
        peak, bottom = rows[a, L_PEAK], rows[a, L_BOTTOM]
        t = law_event(d0, r0, d1, r1, peak, bottom, h)
        if effects and rows[a, L_ACTS] != 0.0:
            k_l, k_ul = rows[a, L_LAW + K_L], rows[a, L_LAW + K_UL]
            force0, force1 = normal_force(d0, peak, k_l, k_ul), normal_force(d1, peak, k_l, k_ul)
            held = hold_event(rows[a], L_EFFECTS, (d0, r0, force0), (d1, r1, force1), peak, bottom, h)
            t = held if LEAST_EVENT * whole < held < t else t
        if LEAST_EVENT * whole < t < first:
            first = t
    return first


@kernel(forceinline=True)
def _commit(active, loaded, works, audit):
    """Take a finished step into the loaded memory and the audit; returns (sum of forces, largest depth).

    works : of the tangential and of the rolling springs in J
    """
    rows, trial = loaded.rows, loaded.trial
    stored_t = stored_r = total = deepest = 0.0
    for a in range(active):
        k_t, k_r = rows[a, L_LAW + K_T], rows[a, L_LAW + K_R]
        old_t, new_t, turned = trial[a, TANGENTIAL_0], trial[a, TANGENTIAL_1], trial[a, ROTATION_1]
        audit[PLASTIC] += trial[a, PLASTIC_WORK]
        if k_t > 0.0:
            stored_t += 0.5 * (new_t * new_t - old_t * old_t) / k_t
        stored_r += 0.5 * k_r * (turned * turned - rows[a, L_ROTATION] * rows[a, L_ROTATION])
        if trial[a, PEAK_1] != rows[a, L_PEAK]:
            rows[a, L_PEAK] = trial[a, PEAK_1]
            rows[a, L_BOTTOM] = residual(rows[a, L_PEAK], rows[a, L_LAW + K_L], rows[a, L_LAW + K_UL])
        rows[a, L_DISPLACEMENT], rows[a, L_ROTATION] = trial[a, DISPLACEMENT_1], turned
        trial[a, DEPTH_0], trial[a, RATE_0] = trial[a, DEPTH_1], trial[a, RATE_1]
        total += trial[a, ACTING_1]
        deepest = max(deepest, trial[a, DEPTH_1])
    audit[FRICTION] += works[0] - stored_t
    audit[ROLLING] += works[1] - stored_r
    return total, deepest
