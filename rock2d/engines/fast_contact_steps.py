"""Series of contact steps in which the block keeps its contacts, compiled.

A full step of `contact_step.step` searches the ground for the nearest features. As long as the block stays within the
*guard* of a pose (`contact_search.guard_distance`), the search would find the same features, so it is omitted. The
series ends when a contact begins, ends or changes its feature or zone; `contact_step.step` handles that.

A ball that rolls or slides fast trembles, and is above the bottom of its indentation most of the time. There only
gravity acts: each hop is one exact parabola and one contact step. Within a run of facets that are nearly in line, a
contact moves from facet to facet without a change."""

from typing import Any, NamedTuple

import numpy as np

from rock2d.compiled import copy, kernel
from rock2d.engines.contact_search import GUARD, TURN_ARM
from rock2d.engines.contact_state import (
    ACTING_1,
    DEPTH,
    DEPTH_0,
    DEPTH_1,
    DISPLACEMENT,
    DISPLACEMENT_1,
    INDEX,
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
    OFFSET,
    PEAK,
    PEAK_1,
    PLASTIC_WORK,
    RATE,
    RATE_0,
    RATE_1,
    ROTATION,
    ROTATION_1,
    TANGENTIAL_0,
    TANGENTIAL_1,
    effects_act,
    load_active,
    placed,
)
from rock2d.engines.event_detection import force_limit_event, later, law_event
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
    along_and_above,
    depth_rate,
    is_ball,
)
from rock2d.engines.recording import note_pressure, note_recoil
from rock2d.engines.trial_step import correct_energy, step_to_event
from rock2d.laws.contact import (
    K_L,
    K_R,
    K_T,
    K_UL,
    MU,
    ROLLING_IN_INDENTATION,
    change_feature,
    normal_force,
    residual_indentation,
    tangential_force,
)
from rock2d.records.columns import EFFECTS, FRICTION, OMEGA, PLASTIC, ROLLING, THETA, VX, VY, X, Y

# why a series of fast steps ended; 0: none of these. After a hop the guard is still valid
GUARD_LEFT, CONTACT_ENDS, HOPPED = 1, 2, 3
GUARD_SHARE = 0.3  # share of the guard that one step without pressure may use
BEHIND_LANDING = 1.01  # duration of a hop over the time to its landing, so that the step detects the landing
BEFORE_LIFT_OFF = 0.9  # duration of a hop over the time to lift-off, which a full step must detect


class StepSizes(NamedTuple):
    """Contact steps in s."""

    loading: float  # while every contact goes deeper in first loading
    floating: float  # while no contact touches the bottom of its indentation
    other: float
    share: float  # factor on `loading` and `other` after steps with too large an error


class SeriesLimits(NamedTuple):
    """Limits of a series of fast steps."""

    steps: Any  # int64
    time_limit: float  # s
    next_sample: float  # s; only the first step may reach it, so that the caller can interpolate there
    longest_hop: float  # of a ball, in s, see `hops`
    suspend_x: float  # m; only the last step may pass it, and no hop


@kernel(forceinline=True)
def floats(depth, rate, step):
    """Whether a contact point at this depth below the bottom of its indentation does not press, and will not press
    within a hundredth of the step. Rounding can end a landing slightly above the bottom; it counts as pressed."""
    return depth <= 0.0 and depth + 0.01 * rate * step < 0.0


@kernel(forceinline=True)
def goes_deeper(depth, rate, step):
    """Whether a contact in first loading does not unload at once; otherwise the stiffer unloading determines the
    step."""
    return rate * step > LEAST_EVENT * depth


@kernel
def fast_contact_steps(q, t, limits, anchor, world, contacts, log):
    """Advance q from time t by contact steps within the guard.

    limits : (SeriesLimits, StepSizes)
    anchor : (4,) x, y, theta of the pose whose guard is the fourth
    contacts : (memory, loaded)
    log : (row of the open impact, whether the block has lifted off, audit); see `recording.note_pressure`

    Returns (time now in s, number of steps, whether the block has lifted off, why the series ended: GUARD_LEFT,
    CONTACT_ENDS if a contact is about to end, HOPPED if the only step was a hop, else 0; new `share` of the step
    sizes)."""
    memory, loaded = contacts
    active = load_active(world, memory, loaded)
    # compiled twice, because the code of effects slows the plain law down
    if effects_act(world.block, active, loaded.rows):
        return _with_effects(q, t, limits, anchor, world, contacts, log, active)
    return _plain(q, t, limits, anchor, world, contacts, log, active)


@kernel
def _with_effects(q, t, limits, anchor, world, contacts, log, active):
    return _series(q, t, limits, anchor, world, contacts, log, active, True)


@kernel
def _plain(q, t, limits, anchor, world, contacts, log, active):
    return _series(q, t, limits, anchor, world, contacts, log, active, False)


@kernel(forceinline=True)
def _series(q, t, limits, anchor, world, contacts, log, active, effects):
    """`fast_contact_steps` with `active` contacts loaded; effects: whether effects of the catalogue may act."""
    limit, sizes = limits
    current, lifted, audit = log
    memory, loaded = contacts
    ints, reals, body = memory.ints, memory.reals, Body(world.block, world.gravity)
    q1, rows, which, trial = loaded.state, loaded.rows, loaded.which, loaded.trial
    c, s = np.cos(q[THETA]), np.sin(q[THETA])
    zero: Any = np.int64(0)
    done, why, share = zero, zero, sizes.share
    while done < limit.steps and q[X] < limit.suspend_x:
        loading, floating = _branches(active, rows, trial, sizes, effects)
        floating = floating and lifted
        h, hops = share * (sizes.loading if loading else sizes.other), False
        if floating:
            h, hops = _floating_step(q, active, loaded, ints, world, anchor, limits, effects)
        if hops and done > 0:
            break
        h = min(h, limit.time_limit - t)
        if h <= 0.0 or (done > 0 and t + h >= limit.next_sample):
            break
        counts, view = (zero if floating else active, active), (world.block, anchor, active, loaded)
        why, elapsed, (c1, s1), works, (error, scale), halved = step_to_event(
            q, (c, s), h, body, counts, loaded, q1, effects, audit, _inspect, view
        )
        if why > 0:
            break
        share *= halved
        force, deepest = _commit(active, loaded, works, audit)
        if effects:
            audit[EFFECTS] += works[2]
            note_recoil(elapsed, works[3], audit)
        else:
            correct_energy(q, q1, elapsed, error, scale, body, audit)
        for a in range(active):
            ints[which[a], INDEX] = _follow_run(
                loaded, a, world.ground.facets, ints[which[a], INDEX], q1, (c1, s1), audit
            )
        copy(q1, q)
        c, s = c1, s1
        t = later(t, elapsed)
        done += 1
        lifted = note_pressure(current, lifted, force, deepest, t, q)
        if hops:
            why = np.int64(HOPPED)
            break
    for a in range(active):
        j = which[a]
        reals[j, DEPTH], reals[j, RATE], reals[j, PEAK] = trial[a, DEPTH_0], trial[a, RATE_0], rows[a, L_PEAK]
        reals[j, OFFSET] = rows[a, L_OFFSET]
        reals[j, DISPLACEMENT], reals[j, ROTATION] = rows[a, L_DISPLACEMENT], rows[a, L_ROTATION]
    return t, done, lifted, why, share


@kernel(forceinline=True)
def _inspect(q, q1, h, whole, effects, view):
    """`inspect` of `trial_step.step_to_event`: whether the step ends the series (GUARD_LEFT or CONTACT_ENDS), and the
    first event."""
    block, anchor, active, loaded = view
    ball, trial = is_ball(block), loaded.trial
    arm = 0.0 if ball else TURN_ARM * block.radius  # rotation does not move the profile of a ball
    why: Any = np.int64(0)
    moved = abs(q1[X] - anchor[X]) + abs(q1[Y] - anchor[Y]) + arm * abs(q1[THETA] - anchor[THETA])
    if moved >= anchor[GUARD]:
        why = np.int64(GUARD_LEFT)
    for a in range(active):
        if trial[a, DEPTH_1] <= 0.0:
            why = np.int64(CONTACT_ENDS)
        elif ball and trial[a, DEPTH_1] > block.radius:
            why = np.int64(GUARD_LEFT)
    if why > 0:
        return why, h
    return why, _first_event(h, whole, active, loaded.rows, trial, effects)


@kernel(forceinline=True)
def _floating_step(q, active, loaded, ints, world, anchor, limits, effects):
    """(length in s of a step without pressed contacts, whether it is a hop)."""
    block, (limit, sizes) = world.block, limits
    if not effects and is_ball(block):
        longest = min(limit.longest_hop, (limit.suspend_x - q[X]) / q[VX]) if q[VX] > 0.0 else limit.longest_hop
        hop = _hop_s(q, active, loaded, ints, world, anchor, longest)
        if hop > sizes.floating:
            return hop, True
    pace = np.sqrt(q[VX] * q[VX] + q[VY] * q[VY]) + abs(q[OMEGA]) * block.radius
    return min(sizes.floating, max(sizes.other, GUARD_SHARE * anchor[GUARD] / max(pace, 1e-300))), False


@kernel(forceinline=True)
def _branches(active, rows, trial, sizes, effects):
    """(whether every contact goes deeper in first loading, whether no contact presses within `sizes.floating`)."""
    loading, floating = True, True
    for a in range(active):
        d0, peak = trial[a, DEPTH_0] - rows[a, L_OFFSET], rows[a, L_PEAK]
        loading = loading and d0 >= peak and goes_deeper(d0, trial[a, RATE_0], sizes.loading)
        floating = floating and floats(d0 - rows[a, L_BOTTOM], trial[a, RATE_0], sizes.floating)
        floating = floating and not (effects and rows[a, L_ACTS] != 0.0)
        floating = floating and rows[a, L_LAW + ROLLING_IN_INDENTATION] == 0.0
    return loading, floating


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
            law, ends = rows[a, L_LAW:], ((d0, r0), (d1, r1))
            t = min(t, force_limit_event(law, rows[a], L_EFFECTS, ends, (peak, bottom), h, whole))
        if LEAST_EVENT * whole < t < first:
            first = t
    return first


@kernel(forceinline=True)
def _commit(active, loaded, works, audit):
    """Write a finished step into the loaded memory and the audit; returns (sum of forces in N, largest depth in m).

    works : work in J done on the tangential and on the rolling springs"""
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
            rows[a, L_BOTTOM] = residual_indentation(rows[a, L_PEAK], rows[a, L_LAW + K_L], rows[a, L_LAW + K_UL])
        rows[a, L_DISPLACEMENT], rows[a, L_ROTATION] = trial[a, DISPLACEMENT_1], turned
        trial[a, DEPTH_0], trial[a, RATE_0] = trial[a, DEPTH_1], trial[a, RATE_1]
        total += trial[a, ACTING_1]
        deepest = max(deepest, trial[a, DEPTH_1])
    audit[FRICTION] += works[0] - stored_t
    audit[ROLLING] += works[1] - stored_r
    return total, deepest


@kernel
def _hop_s(q, active, loaded, ints, world, anchor, longest):
    """Time in s (at most `longest`) of a hop, an exact parabola of a ball above the bottom of its indentation: until
    just behind its landing there, or until just before it leaves the ground, its facet or the guard."""
    rows, trial, gravity, time = loaded.rows, loaded.trial, world.gravity, longest
    pace = abs(q[VX]) + abs(q[VY]) + gravity * longest
    time = min(time, (anchor[GUARD] - abs(q[X] - anchor[X]) - abs(q[Y] - anchor[Y])) / max(pace, 1e-300))
    for a in range(active):
        facet = world.ground.facets[ints[loaded.which[a], INDEX]]
        pull = 0.5 * gravity * facet[NORMAL_Y]  # depth gains rate × time + pull × time²
        if rows[a, L_KIND] != SMOOTH_FACET or pull <= 0.0:
            return 0.0
        tx, ty = facet[TANGENT_X], facet[TANGENT_Y]
        along = (q[X] - facet[POINT_X]) * tx + (q[Y] - facet[POINT_Y]) * ty
        ahead = facet[LENGTH] - along if q[VX] * tx + q[VY] * ty > 0.0 else along
        time = min(time, ahead / max(pace, 1e-300))
        depth, rate = trial[a, DEPTH_0], trial[a, RATE_0]
        if rate < 0.0 and rate * rate >= 4.0 * pull * depth:
            out = 2.0 * depth / (np.sqrt(rate * rate - 4.0 * pull * depth) - rate)
            time = min(time, BEFORE_LIFT_OFF * out)
        else:
            above = rows[a, L_BOTTOM] + rows[a, L_OFFSET] - depth
            time = min(time, BEHIND_LANDING * (np.sqrt(rate * rate + 4.0 * pull * above) - rate) / (2.0 * pull))
    return time


@kernel(forceinline=True)
def _follow_run(loaded, a, facets, index, q, direction, audit):
    """Load the facet to which a contact has moved within its run at state q, whose direction is (cos θ, sin θ); returns
    the index of the facet."""
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
        along, _ = along_and_above(px, py, found, facets)
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
    """Whether a smooth profile is that of a ball: then its contact point lies below its centre."""
    centred = rows[a, F_SHAPE + 2] == 0.0 and rows[a, F_SHAPE + 3] == 0.0
    return centred and rows[a, F_SHAPE] == rows[a, F_SHAPE + 1]


@kernel
def _load_facet(loaded, a, facet, q, pose, audit):
    """Continue a contact at another facet of its run, see `change_feature`."""
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
    trial[a, RATE_0] = depth_rate(q, nx, ny, rx, ry)
