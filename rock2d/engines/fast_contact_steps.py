"""Contact steps in a row while the block keeps its contacts: the fast stretch of an impact, compiled.

A full step of `stepper.step` searches the ground for the nearest features. As long as the block stays within the
*guard* of a pose (how far any of its points may move before a contact can begin or pass to another feature) that
search would find what is already known, so it is left out. What ends a stretch (a contact that begins, ends or
changes its feature or zone) is left to `stepper.step`.
"""

from __future__ import annotations

import numpy as np

from rock2d.compiled import copy, kernel
from rock2d.effects.forces import ground_forces
from rock2d.engines.contact_state import ACTIVE, DEPTH, DEPTH_MAX, INDEX, KIND, RATE, ROTATION, STRETCH
from rock2d.engines.contact_step import (
    EFFECTS,
    FRICTION,
    L_ACTS,
    L_FIRST,
    L_KIND,
    L_LAW,
    L_OFFSET,
    L_PEAK,
    L_ROTATION,
    L_STRETCH,
    PLASTIC,
    RECOIL,
    ROLLING,
    effects_act,
    load_active,
    placed,
    runge_kutta,
)
from rock2d.engines.event_detection import hold_event, law_event
from rock2d.engines.geometry import (
    CONVEX,
    CORNER_FACET,
    CORNER_X,
    CORNER_Y,
    FACE_OFFSET,
    FACE_X,
    FACE_Y,
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
    facet_range,
    is_ball,
    near_depth,
)
from rock2d.engines.recording import note_pressure
from rock2d.laws.contact import (
    CAP,
    INDENTATION,
    K_L,
    K_R,
    K_T,
    K_UL,
    MU,
    normal_force,
    plastic_work,
    residual,
    rolling_moment,
    tangential_force,
)

TURN_ARM = (
    1.5  # arm in block radii with which rotation counts as motion: a vertex near the block is as far off
)
# columns of a contact's row in `seen`: depth and its rate before and after a step, arm and slip of the contact point
# after it
D0, R0, D1, R1, ARM, SLIP = range(6)
GUARD_LEFT, ENDS = 1, 2
GUARD_SHARE = 0.3  # of the guard that one step afloat may use up


@kernel
def guard_distance(q, allowance, f0, f1, ground, block, ints):
    """How far in m any point of the block may move from pose q before a contact begins or changes its feature.

    At most `allowance`, the width that facets f0 to f1 - 1 reach beyond the block; 0 where it is not known. Passing
    on within a run of facets is no change: `press` follows it.
    """
    x, y, c, s = q[0], q[1], np.cos(q[2]), np.sin(q[2])
    facets, sides = ground.facets, block.sides
    n, guard = sides.shape[0], allowance
    if n == 0:
        return _circle_guard(x, y, guard, f0, f1, facets, block, ints)
    for i in range(n):
        px = x + c * sides[i, CORNER_X] - s * sides[i, CORNER_Y]
        py = y + s * sides[i, CORNER_X] + c * sides[i, CORNER_Y]
        if not ints[i, ACTIVE]:
            depth, _, _ = near_depth(px, py, ground, f0, f1, guard + block.rounding)
            guard = min(guard, -depth - block.rounding)
        elif ints[i, KIND] != CORNER_FACET:
            return 0.0
        else:
            own = ints[i, INDEX]
            dx, dy = px - facets[own, POINT_X], py - facets[own, POINT_Y]
            above = dx * facets[own, NORMAL_X] + dy * facets[own, NORMAL_Y]
            guard = min(guard, _within_run(px, py, own, facets))
            width = guard + 2.0 * abs(above)
            g0, g1 = facet_range(ground, px - width, px + width)
            other = np.inf  # squared distance to the nearest facet of another run
            for f in range(max(f0, g0), min(f1, g1)):
                if facets[own, RUN_FIRST] <= f <= facets[own, RUN_LAST]:
                    continue
                dx, dy = px - facets[f, POINT_X], py - facets[f, POINT_Y]
                along = dx * facets[f, TANGENT_X] + dy * facets[f, TANGENT_Y]
                away = dx * facets[f, NORMAL_X] + dy * facets[f, NORMAL_Y]
                beyond = max(-along, along - facets[f, LENGTH], 0.0)
                other = min(other, away * away + beyond * beyond)
            guard = min(guard, 0.5 * (np.sqrt(other) - abs(above)))
        if guard <= 0.0:
            return 0.0
    for v in range(max(f0, 1), f1):
        if facets[v, CONVEX] <= 0.0:
            continue
        dx, dy = facets[v, POINT_X] - x, facets[v, POINT_Y] - y
        bx, by = c * dx + s * dy, -s * dx + c * dy
        nearest, second = np.inf, np.inf  # depth below the faces
        for k in range(n):
            d = sides[k, FACE_OFFSET] - sides[k, FACE_X] * bx - sides[k, FACE_Y] * by
            if d < nearest:
                nearest, second = d, nearest
            elif d < second:
                second = d
        if nearest > 0.0 and block.rounding > 0.0:
            return 0.0  # a face's flat part may end there
        guard = min(guard, 0.5 * (second - nearest) if nearest > 0.0 else -nearest)
    return max(guard, 0.0)


@kernel(inline="always")
def _within_run(px, py, own, facets):
    """How far in m a point may move along the ground before it leaves the run of facet `own`."""
    first, last = int(facets[own, RUN_FIRST]), int(facets[own, RUN_LAST])
    dx, dy = px - facets[first, POINT_X], py - facets[first, POINT_Y]
    behind = dx * facets[first, TANGENT_X] + dy * facets[first, TANGENT_Y]
    dx, dy = px - facets[last, POINT_X], py - facets[last, POINT_Y]
    ahead = facets[last, LENGTH] - dx * facets[last, TANGENT_X] - dy * facets[last, TANGENT_Y]
    return min(behind, ahead)


@kernel
def _circle_guard(x, y, guard, f0, f1, facets, block, ints):
    """`guard_distance` of a smooth profile: that of a ball, whose contact points lie below its centre."""
    if not is_ball(block):
        return 0.0  # an ellipse's contact point runs ahead of its motion
    r = block.radius
    for j in range(ints.shape[0]):
        if ints[j, ACTIVE]:
            if ints[j, KIND] != SMOOTH_FACET:
                return 0.0
            guard = min(guard, _within_run(x, y, ints[j, INDEX], facets))
    f = f0
    while f < f1 and guard > 0.0:
        owned = False  # by a contact: its run has been seen to
        for j in range(ints.shape[0]):
            if ints[j, ACTIVE] and facets[f, RUN_FIRST] <= ints[j, INDEX] <= facets[f, RUN_LAST]:
                owned = True
        if owned:
            f = int(facets[f, RUN_LAST]) + 1
            continue
        dx, dy = x - facets[f, POINT_X], y - facets[f, POINT_Y]
        along = dx * facets[f, TANGENT_X] + dy * facets[f, TANGENT_Y]
        above = dx * facets[f, NORMAL_X] + dy * facets[f, NORMAL_Y]
        guard = min(guard, max(above - r, -along, along - facets[f, LENGTH]))
        f += 1
    for v in range(max(f0, 1), f1):
        if facets[v, CONVEX] > 0.0:
            owned = False  # by a contact whose run begins or ends there
            for j in range(ints.shape[0]):
                if ints[j, ACTIVE]:
                    own = ints[j, INDEX]
                    owned = owned or facets[own, RUN_FIRST] == v or facets[own, RUN_LAST] == v - 1
            if not owned:
                dx, dy = x - facets[v, POINT_X], y - facets[v, POINT_Y]
                guard = min(guard, np.sqrt(dx * dx + dy * dy) - r)
    return max(guard, 0.0)


@kernel
def _follow_run(loaded, a, facets, index, x, y, c, s):
    """Load the facet of its run that a contact has moved to; returns the facet's index."""
    kind, px, py = int(loaded[a, L_KIND]), x, y
    if kind == CORNER_FACET:
        px, py = x + c * loaded[a, 4] - s * loaded[a, 5], y + s * loaded[a, 4] + c * loaded[a, 5]
    elif kind != SMOOTH_FACET:
        return index
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
        loaded[a, 0], loaded[a, 1] = facets[found, POINT_X], facets[found, POINT_Y]
        loaded[a, 2], loaded[a, 3] = facets[found, NORMAL_X], facets[found, NORMAL_Y]
    return found


@kernel(inline="always")
def floats(depth, rate, step):
    """Whether a contact point at this depth below its indentation's bottom does not press, nor will within a
    hundredth of the step: a landing on the bottom may fall that short, and a step afloat must not begin there."""
    return depth <= 0.0 and depth + 0.01 * rate * step < 0.0


@kernel
def press(q, t, steps, h_loading, h_other, h_floating, time_limit, pause, anchor, gravity, ground, block, params, ints,
          reals, work, audit, current, left):  # fmt: skip
    """Advance q from time t by up to `steps` contact steps within the guard.

    h_loading, h_floating, h_other : contact step in s while every contact goes deeper into first-loading soil, while
        none touches the bottom of its indentation, and else
    pause : instant in s that only the first step may reach, so that a caller sees the state before and after it
    anchor : (4,) x, y, theta of the pose whose guard is the fourth
    current, left : the open impact, and whether the ground has ceased to press; see `note_pressure`
    Returns (time now in s, number of steps, left, why it ended: GUARD_LEFT, ENDS if a contact is about to end, 0).
    """
    active = load_active(ground.facets, block, params, ints, reals, work[4], work[5])
    # compiled twice: what effects need is in the way of the plain law's speed
    if effects_act(block, active, work[4]):
        return _press_with_effects(
            q, t, steps, h_loading, h_other, h_floating, time_limit, pause, anchor, gravity, ground, block, active,
            ints, reals, work, audit, current, left,
        )  # fmt: skip
    return _press_plainly(
        q, t, steps, h_loading, h_other, h_floating, time_limit, pause, anchor, gravity, ground, block, active, ints,
        reals, work, audit, current, left,
    )  # fmt: skip


@kernel
def _press_with_effects(q, t, steps, h_loading, h_other, h_floating, time_limit, pause, anchor, gravity, ground,
                        block, active, ints, reals, work, audit, current, left):  # fmt: skip
    return _stretch(
        q, t, steps, h_loading, h_other, h_floating, time_limit, pause, anchor, gravity, ground, block, active, ints,
        reals, work, audit, current, left, True,
    )  # fmt: skip


@kernel
def _press_plainly(q, t, steps, h_loading, h_other, h_floating, time_limit, pause, anchor, gravity, ground, block,
                   active, ints, reals, work, audit, current, left):  # fmt: skip
    return _stretch(
        q, t, steps, h_loading, h_other, h_floating, time_limit, pause, anchor, gravity, ground, block, active, ints,
        reals, work, audit, current, left, False,
    )  # fmt: skip


@kernel(inline="always")
def _stretch(q, t, steps, h_loading, h_other, h_floating, time_limit, pause, anchor, gravity, ground, block, active,
             ints, reals, work, audit, current, left, effects):  # fmt: skip
    """`press` with its contacts loaded; effects: whether any of the catalogue act."""
    q1, loaded, which, sums, seen = work[0], work[4], work[5], work[6], work[7]
    for a in range(active):
        seen[a, D0], seen[a, R0] = reals[which[a], DEPTH], reals[which[a], RATE]
    c, s = np.cos(q[2]), np.sin(q[2])
    turning = not is_ball(block)
    arm = TURN_ARM * block.radius
    done, why = 0, 0
    while done < steps:
        loading, unpressed = True, True
        for a in range(active):
            d0, peak = seen[a, D0] - loaded[a, L_OFFSET], loaded[a, L_PEAK]
            loading = loading and seen[a, R0] > 0.0 and d0 >= peak
            bottom = residual(peak, loaded[a, L_LAW + K_L], loaded[a, L_LAW + K_UL])
            unpressed = unpressed and floats(d0 - bottom, seen[a, R0], h_floating)
            unpressed = unpressed and not (effects and loaded[a, L_ACTS] != 0.0)
            unpressed = unpressed and loaded[a, L_LAW + INDENTATION] == 0.0
        unpressed = unpressed and left
        h = h_loading if loading else h_other
        if unpressed:
            pace = np.sqrt(q[3] * q[3] + q[4] * q[4]) + abs(q[5]) * block.radius
            h = min(h_floating, max(h_other, GUARD_SHARE * anchor[3] / max(pace, 1e-300)))
        h = min(h, time_limit - t)
        if h <= 0.0 or (done > 0 and t + h >= pause):
            break
        first, work_t, work_r, work_e, pushed = h, 0.0, 0.0, 0.0, 0.0
        for attempt in range(2):
            if unpressed:
                _, _, work_e, _ = runge_kutta(q, c, s, first, gravity, block, 0, effects, loaded, sums, q1)
                for a in range(active):
                    sums[a, 0], sums[a, 1] = 0.0, loaded[a, L_ROTATION]
            else:
                work_t, work_r, work_e, pushed = runge_kutta(
                    q, c, s, first, gravity, block, active, effects, loaded, sums, q1
                )
            c1, s1 = c, s
            if turning:
                c1, s1 = np.cos(q1[2]), np.sin(q1[2])
            moved = abs(q1[0] - anchor[0]) + abs(q1[1] - anchor[1]) + arm * abs(q1[2] - anchor[2])
            if moved >= anchor[3]:
                why = GUARD_LEFT
            for a in range(active):
                j = which[a]
                ints[j, INDEX] = _follow_run(loaded, a, ground.facets, ints[j, INDEX], q1[0], q1[1], c1, s1)
                depth, nx, ny, rx, ry = placed(loaded, a, q1[0], q1[1], c1, s1)
                seen[a, D1] = depth
                ux, uy = q1[3] - q1[5] * ry, q1[4] + q1[5] * rx
                seen[a, R1] = -(ux * nx + uy * ny)
                if effects:
                    seen[a, SLIP] = ux * ny - uy * nx
                seen[a, ARM] = np.sqrt(rx * rx + ry * ry)
                if depth <= 0.0:
                    why = ENDS
            if why > 0 or attempt == 1:
                break
            first = _first_event(h, active, loaded, seen, effects)
            if first == h:
                break
        if why > 0:
            break
        force, deepest = _commit(active, loaded, sums, seen, work_t, work_r, audit, effects)
        if effects:
            audit[EFFECTS] += work_e
            audit[RECOIL] += pushed
        copy(q1, q)
        c, s = c1, s1
        t += first
        done += 1
        left = note_pressure(current, left, force, deepest, t, q)
    for a in range(active):
        j = which[a]
        reals[j, DEPTH], reals[j, RATE], reals[j, DEPTH_MAX] = seen[a, D0], seen[a, R0], loaded[a, L_PEAK]
        reals[j, STRETCH], reals[j, ROTATION] = loaded[a, L_STRETCH], loaded[a, L_ROTATION]
    return t, done, left, why


@kernel(inline="always")
def _first_event(h, active, loaded, seen, effects):
    """Time in (0, h] of the first event of the law in the trial step; h if there is none."""
    first = h
    for a in range(active):
        d0, d1 = seen[a, D0] - loaded[a, L_OFFSET], seen[a, D1] - loaded[a, L_OFFSET]
        r0, r1 = seen[a, R0], seen[a, R1]
        peak = loaded[a, L_PEAK]
        gone = residual(peak, loaded[a, L_LAW + K_L], loaded[a, L_LAW + K_UL])
        t = law_event(d0, r0, d1, r1, peak, gone, h)
        if effects and loaded[a, L_ACTS] != 0.0:
            k_l, k_ul = loaded[a, L_LAW + K_L], loaded[a, L_LAW + K_UL]
            force0, force1 = normal_force(d0, peak, k_l, k_ul), normal_force(d1, peak, k_l, k_ul)
            held = hold_event(loaded[a], L_FIRST, d0, r0, force0, d1, r1, force1, peak, gone, h)
            t = held if 1e-3 * h < held < t else t
        if 1e-3 * h < t < first:
            first = t
    return first


@kernel(inline="always")
def _commit(active, loaded, sums, seen, work_t, work_r, audit, effects):
    """Take a finished step into the loaded memory and the audit; returns (sum of forces, largest depth)."""
    stored_t = stored_r = total = deepest = 0.0
    for a in range(active):
        k_l, k_ul, k_t = loaded[a, L_LAW + K_L], loaded[a, L_LAW + K_UL], loaded[a, L_LAW + K_T]
        mu, k_r, cap = loaded[a, L_LAW + MU], loaded[a, L_LAW + K_R], loaded[a, L_LAW + CAP]
        indentation = loaded[a, L_LAW + INDENTATION]
        peak, stretch, rotation = loaded[a, L_PEAK], loaded[a, L_STRETCH], loaded[a, L_ROTATION]
        was, pressed = seen[a, D0] - loaded[a, L_OFFSET], seen[a, D1] - loaded[a, L_OFFSET]
        old_t = tangential_force(stretch, normal_force(was, peak, k_l, k_ul), k_t, mu)
        if effects and loaded[a, L_ACTS] != 0.0:
            old_t = k_t * stretch  # friction was what it was then
        if pressed > peak:
            audit[PLASTIC] += plastic_work(pressed, k_l, k_ul) - plastic_work(peak, k_l, k_ul)
            loaded[a, L_PEAK] = peak = pressed
        acting = force_n = normal_force(pressed, peak, k_l, k_ul)
        if effects and loaded[a, L_ACTS] != 0.0:
            bottom = residual(peak, k_l, k_ul)
            force_n, factor, drag = ground_forces(
                loaded[a], L_FIRST, pressed, seen[a, R1], seen[a, SLIP], peak, bottom, force_n
            )
            mu, acting = mu * factor, abs(force_n) + abs(drag)
        force_t = tangential_force(sums[a, 0], force_n, k_t, mu)
        loaded[a, L_STRETCH] = 0.0
        if k_t > 0.0:
            stored_t += 0.5 * (force_t * force_t - old_t * old_t) / k_t
            loaded[a, L_STRETCH] = force_t / k_t
        turned = sums[a, 1]
        if cap > 0.0 and k_r > 0.0:
            turned = rolling_moment(sums[a, 1], force_n, seen[a, ARM], k_r, cap, indentation) / k_r
        loaded[a, L_ROTATION] = turned
        stored_r += 0.5 * k_r * (turned * turned - rotation * rotation)
        seen[a, D0], seen[a, R0] = seen[a, D1], seen[a, R1]
        total += acting
        deepest = max(deepest, seen[a, D1])
    audit[FRICTION] += work_t - stored_t
    audit[ROLLING] += work_r - stored_r
    return total, deepest
