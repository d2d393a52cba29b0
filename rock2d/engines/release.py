"""One release of the batch engine from its start to its end, compiled.

Flight is not stepped: a lower bound of the time to the ground carries the block there in a few exact parabolas; then
contact steps take over until the block is clear again: a full one where contacts begin, change or end, fast ones
(`press`) in between.
"""

from __future__ import annotations

import numpy as np

from rock2d.compiled import copy, kernel, njit
from rock2d.effects.forces import ACTS
from rock2d.engines import contact_energy, contact_state, contact_step, fast_contact_steps, rest
from rock2d.engines.contact_state import (
    ACTIVE,
    DEPTH,
    DEPTH_MAX,
    N_INTS,
    N_REALS,
    OFFSET,
    RATE,
    SMOOTH_CONTACTS,
    VERTEX_CONTACTS,
    ZONE,
)
from rock2d.engines.free_flight import air_stride, fly, in_air
from rock2d.engines.geometry import (
    CONVEX,
    CORNER_X,
    CORNER_Y,
    POINT_X,
    POINT_Y,
    BlockArrays,
    GroundArrays,
    facet_range,
    near_depth,
    point_depth,
    polygon_depth,
)
from rock2d.engines.recording import (
    N_IMPACT,
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
from rock2d.engines.time_to_contact import safe_time, time_to_ground
from rock2d.laws.contact import INDENTATION, K_L, K_UL, residual

STOPS = ("time", "rest", "exit", "impacts", "spent", "buried")
TIME, REST, EXIT, IMPACTS, SPENT, BURIED = range(6)
EASE_LIMIT = 4.0  # growth of contact steps as the motion dies down: a quarter of a radian is the most
LOOK_EVERY = 8  # contact steps between two looks at what energy is left
LAST_STRIDE = 0.01  # of a contact step: a ball is carried on as long as its bound gains that much
VIEW = 2.0  # radii to each side within which a contact knows the ground
VIEW_FACETS = 16  # facets beyond the block that it is worth while to know
LONGEST_STRIDE = 0.1  # radii that a longer step may move a block where its contacts may change
FREE_STEP = 8.0  # steps may be so much longer while a block floats unpressed above its own indentation


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
def release(
    packed, q, block_id, cross_section_id, table_id, h_loading, h_contact, gravity, time_limit, impact_limit, spent,
    settled, times, impacts, crossings, samples, audit, knots,
):  # fmt: skip
    """One release; q ends as the last state. Returns (stop, time, number of impacts, number of knots)."""
    block, ground = _block(packed, block_id), _ground(packed, cross_section_id)
    tree = packed.trees[packed.tree_start[cross_section_id] : packed.tree_start[cross_section_id + 1]]
    corners = block.sides.shape[0]
    convex = int(packed.ground_reals[cross_section_id, 5])
    n = corners + min(VERTEX_CONTACTS, convex) if corners > 0 else SMOOTH_CONTACTS
    ints, found_i = np.zeros((n, N_INTS), np.int64), np.zeros((n, N_INTS), np.int64)
    reals, found_r = np.zeros((n, N_REALS)), np.zeros((n, N_REALS))
    contact_state.clear(ints, reals)
    return _descend(
        block, ground, tree, packed.lines[cross_section_id], packed.tables[table_id], q, h_loading, h_contact, gravity,
        time_limit, impact_limit, spent, settled, times, impacts, crossings, samples, audit, knots, ints, reals,
        found_i, found_r, contact_step.scratch(n), np.empty(64, np.int64), np.empty((3, 8)), np.full(N_IMPACT, np.nan),
    )  # fmt: skip


@kernel
def _descend(
    block, ground, tree, lines, params, q, h_loading, h_contact, gravity, time_limit, impact_limit, spent, settled,
    times, impacts, crossings, samples, audit, knots, ints, reals, found_i, found_r, work, stack, room, current,
):  # fmt: skip
    """`release` on prepared arrays: `room` (3, 8), `stack` and `work` are scratch, `current` an impact's row."""
    old, anchor, watch = room[0, :6], room[1, :4], room[2]
    anchor[3] = 0.0
    radius, corners = block.radius, block.sides.shape[0]
    highest_energy = 0.0  # kinetic, at the beginning of any contact so far
    t, stop, count, at, used = 0.0, TIME, 0, 0, 0
    while at < times.size and times[at] <= 0.0:
        copy(q[0:3], samples[at])
        at += 1
    # the impact that is open: its record, whether and where the ground has ceased to press
    is_open, left = False, False
    rest.forget_rest(watch)
    active, steps, looked, eased = 0, 0, 0, 1.0
    stale = False  # whether the contacts have not looked at the ground since the block moved
    noticed = False  # whether the contacts know the ground at the present pose
    recording, airy = len(knots) > 0, in_air(block)

    while t < time_limit:
        if not ground.x_low <= q[0] <= ground.x_high:
            stop = EXIT
            break
        if active == 0:
            speed = np.sqrt(q[3] * q[3] + q[4] * q[4])
            longest, extra = air_stride(q, gravity, block)
            tau = time_to_ground(q, gravity, block, ground.facets, tree, stack, extra)
            least = h_contact if corners > 0 else LAST_STRIDE * h_contact
            if tau < least and corners > 0:
                f0, f1 = facet_range(ground, q[0] - 2.0 * radius, q[0] + 2.0 * radius)
                gap = _gap(q, ground, block, f0, f1)
                if gap > 0.0:
                    # no farther than the facets that were looked at
                    tau = safe_time(min(gap, 0.5 * radius), speed + abs(q[5]) * radius, gravity + extra)
            if tau >= least:
                tau = min(tau, longest, time_limit - t)
                copy(q, old)
                used = knot(knots, used, t, q, 0.0 if airy else 1.0)
                audit[contact_step.EFFECTS] += fly(q, tau, gravity, block)
                new = cross(t, old, tau, q, True, gravity, block, lines, crossings)
                at = sample(t, old, tau, q, not airy, gravity, times, at, samples)
                t += tau
                noticed = stale = False
                if spent and (new > 0 or count == 0) and is_spent(q, 0.0, gravity, block, lines, crossings):
                    stop = SPENT
                    break
                continue

        # near the ground or on it
        if steps >= looked:
            looked = steps + LOOK_EVERY
            eased = min(EASE_LIMIT, contact_energy.ease(highest_energy, block, ints, reals, params))
            if active > 0 and is_open:
                if settled and rest.captured(q, gravity, ground, block, params, ints, reals):
                    stop = REST
                    break
                if rest.watch_rest(watch, t, q, radius, gravity):
                    stop = REST
                    break
                if spent:
                    stored = contact_energy.stored_energy(ints, reals, params)
                    if is_spent(q, stored, gravity, block, lines, crossings):
                        stop = SPENT
                        break
        h = h_contact * eased
        copy(q, old)
        flying = active == 0
        pace = max(np.sqrt(q[3] * q[3] + q[4] * q[4]) + abs(q[5]) * radius, 1e-300)
        if active > 0 and anchor[3] > 0.0:
            # as fast as the block may become in so many steps, if the springs give all that they hold
            held = contact_energy.kinetic_energy(q, block) + contact_energy.stored_energy(ints, reals, params)
            span = LOOK_EVERY * FREE_STEP * h
            reach = span * (np.sqrt(2.0 * held / block.mass) + abs(gravity) * span)
            near = len(lines) > 0 and near_line(q, min(reach, 2.0 * anchor[3]), lines, crossings)
            pause = times[at] if at < times.size else np.inf
            until, done, left, why = fast_contact_steps.press(
                q, t, 1 if near or recording else looked - steps, h_loading * eased, h, FREE_STEP * h, time_limit,
                pause, anchor, gravity, ground, block, params, ints, reals, work, audit, current, left,
            )  # fmt: skip
            steps += done
            if why > 0:
                fresh = why == fast_contact_steps.GUARD_LEFT and (
                    done > 0 or old[0] != anchor[0] or old[1] != anchor[1]
                )
                anchor[3] = 0.0
                if fresh:
                    f0, f1 = facet_range(ground, q[0] - VIEW * radius, q[0] + VIEW * radius)
                    set_anchor(anchor, q, h, f0, f1, ground, block, ints)
            stale = stale or done > 0
            if done == 0:
                continue
            used = knot(knots, used, t, old, 0.0)
        else:
            steps += 1
            floating, near = False, True
            if active > 0:
                loading, floating = pressing(ints, reals, params, FREE_STEP * h)
                floating = floating and left
                h = FREE_STEP * h if floating else (h_loading * eased if loading else h)
            h = min(h, time_limit - t, max(h_contact, LONGEST_STRIDE * radius / pace))
            reach = near_reach(q, h, gravity, radius)
            f0, f1 = facet_range(ground, q[0] - reach, q[0] + reach)
            if active == 0 and not noticed:
                contact_state.clear(ints, reals)
                active = contact_step.begin(q, f0, f1, ground, block, ints, reals, found_i, found_r)
                noticed = True
                if active > 0:
                    is_open, left = True, False
                    open_impact(current, t, q, ints)
                    highest_energy = max(highest_energy, contact_energy.kinetic_energy(q, block))
            flying = active == 0
            if stale:
                contact_step.look_again(q, f0, f1, ground, block, ints, reals, found_i, found_r)
                stale = False
            used = knot(knots, used, t, q, 1.0 if flying and not airy else 0.0)
            until = t + contact_step.step(
                q,
                h,
                f0,
                f1,
                gravity,
                ground,
                block,
                params,
                ints,
                reals,
                found_i,
                found_r,
                work,
                audit,
                floating,
            )
            before = active
            force, depth, active = contact_energy.pressure(ints, reals, params)
            if is_open:
                left = note_pressure(current, left, force, depth, until, q)
            elif active > 0:
                is_open, left = True, False
                open_impact(current, until, q, ints)
                highest_energy = max(highest_energy, contact_energy.kinetic_energy(q, block))
            if active > before or flying:
                looked = steps  # a contact has begun: how large may its steps be
            if active > 0:
                f0, f1 = facet_range(ground, q[0] - VIEW * radius, q[0] + VIEW * radius)
                set_anchor(anchor, q, h, f0, f1, ground, block, ints)
        gone = until - t
        if near:
            cross(t, old, gone, q, flying, gravity, block, lines, crossings)
        at = sample(t, old, gone, q, flying and not airy, gravity, times, at, samples)
        t = until
        if is_open and current[15] > 0.5 * radius:
            f0, f1 = facet_range(ground, q[0] - 2.0 * radius, q[0] + 2.0 * radius)
            if point_depth(q[0], q[1], ground.facets, f0, f1)[0] > 0.0:
                stop = BURIED
                break
        if active == 0 and is_open:
            noticed = noticed and not end_impact(q, current, params[int(current[0])], block, audit)
            count = close_impact(current, left, impacts, count)
            is_open = False
            rest.forget_rest(watch)
            if count == impact_limit:
                stop = IMPACTS
                break
            if spent and is_spent(q, 0.0, gravity, block, lines, crossings):
                stop = SPENT
                break
    if is_open and stop != IMPACTS:
        count = close_impact(current, left, impacts, count)
    while at < times.size and stop == REST:
        copy(q[0:3], samples[at])
        at += 1
    used = knot(knots, used, t, q, 1.0)
    return stop, t, count, used


@kernel(inline="always")
def near_reach(q, h, gravity, radius):
    """Half-width in m of the ground that a contact step looks at."""
    return (np.sqrt(q[3] * q[3] + q[4] * q[4]) + gravity * h) * h + 1.1 * radius


@kernel
def set_anchor(anchor, q, h, f0, f1, ground, block, ints):
    """Take q as the pose whose guard is known, if it lasts for a step of h; facets f0 to f1 - 1 reach VIEW radii to
    each side."""
    anchor[0], anchor[1], anchor[2] = q[0], q[1], q[2]
    allowance = min(VIEW - 1.0, max(0.1, VIEW_FACETS * ground.facet_m / block.radius)) * block.radius
    anchor[3] = fast_contact_steps.guard_distance(q, allowance, f0, f1, ground, block, ints)
    if anchor[3] < h * (abs(q[3]) + abs(q[4]) + fast_contact_steps.TURN_ARM * block.radius * abs(q[5])):
        anchor[3] = 0.0


@kernel
def pressing(ints, reals, params, step):
    """(every contact goes deeper into first-loading soil, none touches the bottom of its indentation)."""
    loading, floating = True, True
    for j in range(ints.shape[0]):
        if ints[j, ACTIVE]:
            p, pressed, peak = params[ints[j, ZONE]], reals[j, DEPTH] - reals[j, OFFSET], reals[j, DEPTH_MAX]
            loading = loading and reals[j, RATE] > 0.0 and pressed >= peak
            floating = floating and p[ACTS] == 0.0 and p[INDENTATION] == 0.0
            floating = floating and fast_contact_steps.floats(
                pressed - residual(peak, p[K_L], p[K_UL]), reals[j, RATE], step
            )
    return loading, floating


@kernel
def _gap(q, ground, block, f0, f1):
    """Lower bound of the distance between a polygon near the ground and the ground."""
    x, y, c, s = q[0], q[1], np.cos(q[2]), np.sin(q[2])
    facets, sides = ground.facets, block.sides
    gap = np.inf
    for i in range(sides.shape[0]):
        px = x + c * sides[i, CORNER_X] - s * sides[i, CORNER_Y]
        py = y + s * sides[i, CORNER_X] + c * sides[i, CORNER_Y]
        depth, _, _ = near_depth(px, py, ground, f0, f1, min(gap, block.radius) + block.rounding)
        gap = min(gap, -depth - block.rounding)
    for v in range(max(f0, 1), f1):
        if facets[v, CONVEX] > 0.0:
            depth, _ = polygon_depth(facets[v, POINT_X], facets[v, POINT_Y], x, y, c, s, sides)
            gap = min(gap, -depth)
    return gap
