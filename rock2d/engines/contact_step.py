"""One block in contact, advanced in time: fourth-order steps that land on the events of the law.

The state is q = (x, y, θ, vx, vy, ω). Each contact point of the block has a *contact* that carries its memory.
Within a step features are frozen and the law is evaluated at four Runge-Kutta stages; a step in which a contact
begins, ends, reloads, meets its former peak or passes its deepest point is repeated so that it ends right
there, which keeps the order of the scheme and the energy audit. Outside contacts a step is exact.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from rock2d.compiled import copy, kernel, njit
from rock2d.effects.columns import N_COLUMNS, damping_Ns_m
from rock2d.effects.forces import ACTS, FIRST, flight, ground_forces, recoil
from rock2d.engines.contact_state import (
    ACTING,
    ACTIVE,
    DEPTH,
    DEPTH_MAX,
    INDEX,
    KEY,
    KIND,
    NOWHERE,
    OFFSET,
    PART,
    RATE,
    ROTATION,
    STRETCH,
    ZONE,
    find_features,
    hand_over,
)
from rock2d.engines.event_detection import first_event
from rock2d.engines.free_flight import fly, in_air
from rock2d.engines.geometry import (
    CORNER_FACET,
    SMOOTH_FACET,
    ZONE_ID,
    contact_point,
    is_ball,
    load_feature,
    place_feature,
)
from rock2d.laws.contact import (
    CAP,
    INDENTATION,
    K_L,
    K_R,
    K_T,
    K_UL,
    MU,
    cross_zone,
    elastic_energy,
    normal_force,
    plastic_work,
    residual,
    rolling_energy,
    rolling_moment,
    tangential_force,
)
from rock2d.scene.blocks import Block

# audit: energy in J that each mechanism has taken, effects of the catalogue as one; and, for the length of an impact,
# the velocity in m/s that it owes to ground that recoils, in whose frame the impact runs
PLASTIC, FRICTION, ROLLING, EFFECTS, RECOIL = range(5)
AUDIT, N_AUDIT = ("plastic", "friction", "rolling", "effects"), 5
# columns of a loaded contact: its feature (8), parameters of the law (7), memory, kind, whether effects act, and theirs
L_LAW, L_OFFSET, L_PEAK, L_STRETCH, L_ROTATION, L_KIND, L_ACTS, L_FIRST = 8, 15, 16, 17, 18, 19, 20, 21
LOADED = L_FIRST + N_COLUMNS - FIRST

ROUNDING = 1e-10  # of the radius: a landing on the surface may fall so short
PRESSED = 1e-6  # of an impact's peak force: below it the ground no longer presses
STEP_FRACTION = 0.03  # phase in rad of the stiffest contact oscillation that one step may cover


def contact_steps_s(block: Block, tables: np.ndarray, fraction: float = STEP_FRACTION) -> tuple[Any, Any]:
    """Contact steps in s, while every contact is on its loading branch and else: `fraction` of a radian of the
    stiffest oscillation, ω² = k (1/m + r²/I), where r is the largest lever of the force: the normal force of a
    circle has none. Damping c of effects counts as the rate c (1/m + r²/I). For parameters (zones, columns) two
    numbers; for tables (n, zones, columns) two (n,) arrays."""
    lever, reach = block.reach_m, block.reach_m
    if block.smooth:
        lever = abs(block.semi_axes_m[0] - block.semi_axes_m[1]) + float(np.hypot(*block.centre_of_mass_m))
    free = 1 / block.mass_kg + lever**2 / block.inertia_kg_m2
    freest = 1 / block.mass_kg + reach**2 / block.inertia_kg_m2

    def greatest(values: np.ndarray) -> Any:
        return np.fmax.reduce(values, axis=-1)  # zones that a table has not are NaN

    tangential = greatest(tables[..., K_T]) * freest
    others = np.maximum(tangential, greatest(tables[..., K_R]) / block.inertia_kg_m2)
    damping = (greatest(damping_Ns_m(tables)) * freest) ** 2
    loading, unloading = (np.maximum(greatest(tables[..., k]) * free, others) for k in (K_L, K_UL))
    return fraction / np.sqrt(loading + damping), fraction / np.sqrt(unloading + damping)


@kernel
def load_active(facets, block, params, ints, reals, loaded, which):
    """Copy feature, parameters and memory of the active contacts into rows; returns how many there are."""
    active = 0
    for j in range(ints.shape[0]):
        if ints[j, ACTIVE]:
            feature = load_feature(ints[j, KIND], ints[j, INDEX], ints[j, PART], block, facets)
            px, py, nx, ny, w1, w2, w3, w4 = feature
            loaded[active, 0], loaded[active, 1], loaded[active, 2], loaded[active, 3] = px, py, nx, ny
            loaded[active, 4], loaded[active, 5], loaded[active, 6], loaded[active, 7] = w1, w2, w3, w4
            zone = ints[j, ZONE]
            for i in range(FIRST):
                loaded[active, L_LAW + i] = params[zone, i]
            loaded[active, L_ACTS] = params[zone, ACTS]
            if params[zone, ACTS] != 0.0:
                for i in range(N_COLUMNS - FIRST):
                    loaded[active, L_FIRST + i] = params[zone, FIRST + i]
            loaded[active, L_OFFSET], loaded[active, L_PEAK] = reals[j, OFFSET], reals[j, DEPTH_MAX]
            loaded[active, L_STRETCH], loaded[active, L_ROTATION] = reals[j, STRETCH], reals[j, ROTATION]
            loaded[active, L_KIND] = ints[j, KIND]
            which[active] = j
            active += 1
    return active


@kernel
def effects_act(block, active, loaded):
    """Whether effects of the catalogue act on the block, by the air or in a loaded contact."""
    act = in_air(block)
    for a in range(active):
        act = act or loaded[a, L_ACTS] != 0.0
    return act


@kernel(inline="always")
def placed(loaded, a, x, y, c, s):
    """`contact_point` of the a-th loaded contact."""
    feature = (
        loaded[a, 0], loaded[a, 1], loaded[a, 2], loaded[a, 3], loaded[a, 4], loaded[a, 5], loaded[a, 6], loaded[a, 7]
    )  # fmt: skip
    return place_feature(int(loaded[a, L_KIND]), feature, x, y, c, s)


@kernel(inline="always")
def _contact_rates(loaded, a, x, y, c, s, vx, vy, omega, stretch, rotation, effects):
    """Force (x, y) and moment of one contact, its slip velocity, the spin that winds its rolling spring (none while
    unpressed), the power that its tangential and rolling springs and its effects take up, and the acceleration along x
    that recoiling ground adds."""
    depth, nx, ny, rx, ry = placed(loaded, a, x, y, c, s)
    k_l, k_ul, cap = loaded[a, L_LAW + K_L], loaded[a, L_LAW + K_UL], loaded[a, L_LAW + CAP]
    depth -= loaded[a, L_OFFSET]
    peak = loaded[a, L_PEAK]
    ux, uy = vx - omega * ry, vy + omega * rx
    slip = ux * ny - uy * nx
    force_n, mu = normal_force(depth, peak, k_l, k_ul), loaded[a, L_LAW + MU]
    bottom = residual(peak, k_l, k_ul)
    indentation = loaded[a, L_LAW + INDENTATION]
    spin = omega if depth >= bottom or indentation > 0.0 else 0.0
    drag = taken = push = 0.0
    if effects and loaded[a, L_ACTS] != 0.0:
        rate, law_n = -(ux * nx + uy * ny), force_n
        force_n, factor, drag = ground_forces(loaded[a], L_FIRST, depth, rate, slip, peak, bottom, law_n)
        mu *= factor
        taken = (force_n - law_n) * rate + drag * slip
        if force_n <= 0.0 < law_n and indentation == 0.0:
            spin = 0.0
    force_t = tangential_force(stretch, force_n, loaded[a, L_LAW + K_T], mu)
    arm = np.sqrt(rx * rx + ry * ry) if cap > 0.0 else 0.0
    rolling = rolling_moment(rotation, force_n, arm, loaded[a, L_LAW + K_R], cap, indentation)
    along = force_t
    if effects:
        along += drag
    fx, fy = force_n * nx - along * ny, force_n * ny + along * nx
    if effects and loaded[a, L_ACTS] != 0.0:
        push = recoil(loaded[a], L_FIRST) * fx
    return fx, fy, rx * fy - ry * fx - rolling, slip, spin, force_t * slip, rolling * omega, taken, push


@kernel(inline="always")
def _turned(c, s, angle):
    """(cos, sin) of a direction turned by a small angle in rad: series to rounding below a tenth, else exact."""
    if abs(angle) > 0.1:
        ca, sa = np.cos(angle), np.sin(angle)
    else:
        u = angle * angle
        ca = 1.0 - u * (1.0 / 2 - u * (1.0 / 24 - u * (1.0 / 720 - u / 40320.0)))
        sa = angle * (1.0 - u * (1.0 / 6 - u * (1.0 / 120 - u * (1.0 / 5040 - u / 362880.0))))
    return c * ca - s * sa, s * ca + c * sa


@kernel
def runge_kutta(q, c0, s0, h, gravity, block, active, effects, loaded, sums, q1):
    """Classical fourth-order step of a block whose `active` contacts are loaded; (c0, s0) is its direction at q.

    effects : whether effects of the catalogue act on it
    Fills q1, and in the rows of `sums` each spring's stretch and rotation at the end (columns 0 and 1). Returns the
    work of the tangential springs, of the rolling springs and of effects, and the velocity in m/s that recoiling ground
    added. Without contacts it is free flight.
    """
    if not effects:
        return _plain_step(q, c0, s0, h, gravity, block, active, loaded, sums, q1)
    if active == 0:
        copy(q, q1)
        return 0.0, 0.0, fly(q1, h, gravity, block), 0.0
    return _step_with_effects(q, c0, s0, h, gravity, block, active, loaded, sums, q1)


@kernel
def _plain_step(q, c0, s0, h, gravity, block, active, loaded, sums, q1):
    return _four_stages(q, c0, s0, h, gravity, block, active, loaded, sums, q1, False)


@kernel
def _step_with_effects(q, c0, s0, h, gravity, block, active, loaded, sums, q1):
    return _four_stages(q, c0, s0, h, gravity, block, active, loaded, sums, q1, True)


@kernel(inline="always")
def _four_stages(q, c0, s0, h, gravity, block, active, loaded, sums, q1, effects):
    """`runge_kutta`, compiled once with effects and once without: they are in the way of the plain law's speed."""
    x, y, vx, vy, omega = q[0], q[1], q[3], q[4], q[5]
    if active == 0:
        q1[0], q1[1], q1[2] = x + h * vx, y + h * (vy - 0.5 * gravity * h), q[2] + h * omega
        q1[3], q1[4], q1[5] = vx, vy - h * gravity, omega
        return 0.0, 0.0, 0.0, 0.0
    ax = ay = alpha = 0.0
    per_mass, per_inertia = 1.0 / block.mass, 1.0 / block.inertia
    for a in range(active):
        for i in range(4):
            sums[a, i] = 0.0
    dx = dy = dtheta = dvx = dvy = domega = 0.0
    work_t = work_r = work_e = pushed = 0.0
    c, s = c0, s0
    turning = not is_ball(block)
    for k in range(4):
        weight = 1.0 / 6.0 if k % 3 == 0 else 1.0 / 3.0
        ahead = 0.0 if k == 0 else (0.5 * h if k < 3 else h)
        if k > 0:  # the next stage, from the rates of the stage before
            x, y = q[0] + ahead * vx, q[1] + ahead * vy
            if turning:
                c, s = _turned(c0, s0, ahead * omega)
            vx, vy, omega = q[3] + ahead * ax, q[4] + ahead * ay, q[5] + ahead * alpha
        fx = fy = moment = push = 0.0
        for a in range(active):
            f, g, m, slip, spin, power_t, power_r, power_e, recoiled = _contact_rates(
                loaded, a, x, y, c, s, vx, vy, omega,
                loaded[a, L_STRETCH] + ahead * sums[a, 2], loaded[a, L_ROTATION] + ahead * sums[a, 3], effects,
            )  # fmt: skip
            fx, fy, moment = fx + f, fy + g, moment + m
            sums[a, 0] += weight * slip
            sums[a, 1] += weight * spin
            sums[a, 2], sums[a, 3] = slip, spin
            work_t += weight * power_t
            work_r += weight * power_r
            if effects:
                work_e += weight * power_e
                push += recoiled
        ax, ay, alpha = fx * per_mass, fy * per_mass - gravity, moment * per_inertia
        if effects:
            bx = by = beta = 0.0
            if in_air(block):
                bx, by, beta = flight(block.air, vx, vy, omega, block.mass, block.inertia)
            bx += push
            pushed += weight * push
            ax, ay, alpha = ax + bx, ay + by, alpha + beta
            work_e -= weight * (block.mass * (bx * vx + by * vy) + block.inertia * beta * omega)
        dx, dy, dtheta = dx + weight * vx, dy + weight * vy, dtheta + weight * omega
        dvx, dvy, domega = dvx + weight * ax, dvy + weight * ay, domega + weight * alpha
    q1[0], q1[1], q1[2] = q[0] + h * dx, q[1] + h * dy, q[2] + h * dtheta
    q1[3], q1[4], q1[5] = q[3] + h * dvx, q[4] + h * dvy, q[5] + h * domega
    for a in range(active):
        sums[a, 0] = loaded[a, L_STRETCH] + h * sums[a, 0]
        sums[a, 1] = loaded[a, L_ROTATION] + h * sums[a, 1]
    return h * work_t, h * work_r, h * work_e, h * pushed


@njit
def scratch(n):
    """Work arrays for n contacts."""
    return (
        np.empty(6), np.empty(n), np.empty(n), np.empty(4), np.empty((n, LOADED)), np.empty(n, np.int64),
        np.empty((n, 4)), np.empty((n, 6)),
    )  # fmt: skip


@kernel
def _commit(q, stretch, rotation, shares, ground, block, params, ints, reals, found_i, found_r, audit):
    """Take a finished step into the memory and the audit; returns the number of active contacts."""
    active = 0
    before_t, before_r, after_t, after_r = 0.0, 0.0, 0.0, 0.0
    for j in range(ints.shape[0]):
        depth = found_r[j, DEPTH]
        if depth == NOWHERE and not ints[j, ACTIVE]:
            reals[j, DEPTH] = NOWHERE
            ints[j, KEY] = -1
            continue
        gone = ints[j, ACTIVE] and depth == NOWHERE  # slid off its feature: the step still acted on it
        if gone:
            depth, _, _, _, _ = contact_point(
                ints[j, KIND], ints[j, INDEX], ints[j, PART], q[0], q[1], np.cos(q[2]), np.sin(q[2]), block,
                ground,
            )  # fmt: skip
        reals[j, DEPTH], was = depth, reals[j, DEPTH]
        if ints[j, ACTIVE]:
            p = params[ints[j, ZONE]]
            arm = _arm(ints, j, q, block, ground) if p[CAP] > 0.0 else 0.0
            old_n = normal_force(was - reals[j, OFFSET], reals[j, DEPTH_MAX], p[K_L], p[K_UL])
            old_t = tangential_force(reals[j, STRETCH], old_n, p[K_T], p[MU])
            if p[ACTS] != 0.0:
                old_t = p[K_T] * reals[j, STRETCH]  # friction was what it was then
            before_t += elastic_energy(0.0, old_t, p)
            before_r += rolling_energy(reals[j, ROTATION], p)
            pressed = depth - reals[j, OFFSET]
            peak = reals[j, DEPTH_MAX]
            if pressed > peak:
                audit[PLASTIC] += plastic_work(pressed, p[K_L], p[K_UL]) - plastic_work(peak, p[K_L], p[K_UL])
                reals[j, DEPTH_MAX] = peak = pressed
            _follow(ints, found_i, j)
            force_n = normal_force(pressed, peak, p[K_L], p[K_UL])
            whole, mu = force_n, p[MU]
            if p[ACTS] != 0.0:
                whole, mu = _act(j, q, pressed, peak, force_n, p, ground, block, ints, reals)
            force_t = tangential_force(stretch[j], whole, p[K_T], mu)
            moment = rolling_moment(rotation[j], whole, arm, p[K_R], p[CAP], p[INDENTATION])
            after_t += elastic_energy(0.0, force_t, p)
            # springs slip with their limits; the soil bank of the rolling spring outlasts a lift in the indentation
            reals[j, STRETCH] = force_t / p[K_T] if p[K_T] > 0.0 else 0.0
            reals[j, ROTATION] = moment / p[K_R] if p[CAP] > 0.0 and p[K_R] > 0.0 else rotation[j]
            if depth > 0.0:
                after_r += rolling_energy(reals[j, ROTATION], p)
            zone = _zone(ints, j, ground)
            new = params[zone]
            if zone != ints[j, ZONE] and _differ(p, new):
                kept = reals[j, ROTATION]
                stored = elastic_energy(force_n, force_t, p) + rolling_energy(kept, p)
                loaded, reals[j, STRETCH], reals[j, ROTATION] = cross_zone(force_n, force_t, kept, p, new)
                # lifted off within its indentation, the contact meets the new soil at the indentation's bottom
                bottom = reals[j, OFFSET] + residual(peak, p[K_L], p[K_UL])
                reals[j, DEPTH_MAX] = loaded
                reals[j, OFFSET] = depth - loaded if force_n > 0.0 else bottom
                stored -= elastic_energy(new[K_L] * loaded, new[K_T] * reals[j, STRETCH], new)
                audit[PLASTIC] += stored - rolling_energy(reals[j, ROTATION], new)
            ints[j, ZONE] = zone
            if gone or depth <= 0.0:
                if gone:  # what is still stored is lost
                    p = params[zone]
                    force_n = normal_force(depth - reals[j, OFFSET], reals[j, DEPTH_MAX], p[K_L], p[K_UL])
                    force_t = tangential_force(reals[j, STRETCH], force_n, p[K_T], p[MU])
                    audit[PLASTIC] += elastic_energy(force_n, force_t, p)
                    if depth > 0.0:
                        audit[ROLLING] += rolling_energy(reals[j, ROTATION], p)
                    reals[j, DEPTH] = NOWHERE
                _release(ints, reals, j)
        elif _touches(depth, found_r[j, RATE], block):
            ints[j, ACTIVE] = 1
            _follow(ints, found_i, j)
            ints[j, ZONE] = _zone(ints, j, ground)
            reals[j, DEPTH_MAX], reals[j, STRETCH], reals[j, ROTATION] = 0.0, 0.0, 0.0
            reals[j, ACTING] = 0.0
            reals[j, OFFSET] = depth  # contacts begin without force, at the surface to rounding
        reals[j, RATE] = found_r[j, RATE]
        if ints[j, ACTIVE]:
            active += 1
        else:
            ints[j, KEY] = found_i[j, KEY] if reals[j, DEPTH] != NOWHERE else -1
    audit[FRICTION] += shares[0] - (after_t - before_t)
    audit[ROLLING] += shares[1] - (after_r - before_r)
    audit[EFFECTS] += shares[2]
    audit[RECOIL] += shares[3]
    return active


@kernel
def _act(j, q, pressed, peak, force_n, p, ground, block, ints, reals):
    """(Whole normal force in N, friction coefficient) of contact j with the effects of its row; notes the force
    acting."""
    _, nx, ny, rx, ry = contact_point(
        ints[j, KIND], ints[j, INDEX], ints[j, PART], q[0], q[1], np.cos(q[2]), np.sin(q[2]), block, ground
    )
    ux, uy = q[3] - q[5] * ry, q[4] + q[5] * rx
    rate, slip = -(ux * nx + uy * ny), ux * ny - uy * nx
    bottom = residual(peak, p[K_L], p[K_UL])
    whole, factor, drag = ground_forces(p, FIRST, pressed, rate, slip, peak, bottom, force_n)
    reals[j, ACTING] = abs(whole) + abs(drag)
    return whole, p[MU] * factor


@kernel(inline="always")
def _touches(depth, rate, block):
    """Whether a contact begins: at the surface to rounding, if it goes in."""
    return depth > 0.0 or (depth > -ROUNDING * block.radius and rate >= 0.0)


@kernel
def _follow(ints, found_i, j):
    """Let contact j follow the feature found for it."""
    ints[j, KIND], ints[j, INDEX] = found_i[j, KIND], found_i[j, INDEX]
    ints[j, PART], ints[j, KEY] = found_i[j, PART], found_i[j, KEY]


@kernel
def _differ(p, new):
    same = True
    for i in range(FIRST):
        same = same and p[i] == new[i]
    return not same


@kernel
def _release(ints, reals, j):
    ints[j, ACTIVE] = 0
    reals[j, DEPTH_MAX], reals[j, STRETCH], reals[j, ROTATION], reals[j, OFFSET] = 0.0, 0.0, 0.0, 0.0
    reals[j, ACTING] = 0.0


@kernel
def _arm(ints, j, q, block, ground):
    _, _, _, rx, ry = contact_point(
        ints[j, KIND], ints[j, INDEX], ints[j, PART], q[0], q[1], np.cos(q[2]), np.sin(q[2]), block, ground
    )
    return np.sqrt(rx * rx + ry * ry)


@kernel
def _zone(ints, j, ground):
    """Zone of a contact's feature; a vertex belongs to the facet before it, unless the contact knows better."""
    facets, index = ground.facets, ints[j, INDEX]
    if ints[j, KIND] in (CORNER_FACET, SMOOTH_FACET):
        return int(facets[index, ZONE_ID])
    before = int(facets[max(index - 1, 0), ZONE_ID])
    after = int(facets[min(index, facets.shape[0] - 2), ZONE_ID])
    return after if ints[j, ACTIVE] and ints[j, ZONE] == after else before


@kernel
def begin(q, f0, f1, ground, block, ints, reals, found_i, found_r):
    """Look at the ground for the first time: note depths, and seat what already touches.

    Returns the number of active contacts.
    """
    active = 0
    find_features(q, block.radius, f0, f1, ground, block, ints, found_i, found_r)
    for j in range(ints.shape[0]):
        depth = found_r[j, DEPTH]
        reals[j, DEPTH], reals[j, RATE] = depth, found_r[j, RATE]
        ints[j, KEY] = found_i[j, KEY] if depth != NOWHERE else -1
        if _touches(depth, found_r[j, RATE], block):
            _follow(ints, found_i, j)
            ints[j, ACTIVE] = 1
            ints[j, ZONE] = _zone(ints, j, ground)
            reals[j, OFFSET] = depth
            active += 1
    return active


@kernel
def look_again(q, f0, f1, ground, block, ints, reals, found_i, found_r):
    """Note afresh how deep lies what does not touch, after steps that did not look."""
    find_features(q, block.radius, f0, f1, ground, block, ints, found_i, found_r)
    for j in range(ints.shape[0]):
        if not ints[j, ACTIVE]:
            reals[j, DEPTH], reals[j, RATE] = found_r[j, DEPTH], found_r[j, RATE]
            ints[j, KEY] = found_i[j, KEY] if found_r[j, DEPTH] != NOWHERE else -1


@kernel
def step(q, h, f0, f1, gravity, ground, block, params, ints, reals, found_i, found_r, work, audit, floating):
    """Advance q in place by at most h, to the first event of the law if that comes before. Returns the time gone.

    floating : no contact touches the bottom of its indentation, so that the way to the next event is a parabola
    (found_i, found_r, work) are scratch of the sizes of `new_contacts` and `scratch`.
    """
    reach = 4.0 * h * (np.sqrt(q[3] * q[3] + q[4] * q[4]) + abs(q[5]) * block.radius) + 1e-6 * block.radius
    q1, stretch, rotation, shares, loaded, which, sums, _ = work
    active = load_active(ground.facets, block, params, ints, reals, loaded, which)
    pressing = 0 if floating else active
    effects = effects_act(block, active, loaded)
    c, s = np.cos(q[2]), np.sin(q[2])
    shares[0], shares[1], shares[2], shares[3] = runge_kutta(
        q, c, s, h, gravity, block, pressing, effects, loaded, sums, q1
    )
    find_features(q1, reach, f0, f1, ground, block, ints, found_i, found_r)
    event_s = first_event(h, q, q1, ground, block, params, ints, reals, found_i, found_r)
    if event_s < h:
        shares[0], shares[1], shares[2], shares[3] = runge_kutta(
            q, c, s, event_s, gravity, block, pressing, effects, loaded, sums, q1
        )
        find_features(q1, reach, f0, f1, ground, block, ints, found_i, found_r)
    for a in range(active):
        if floating:
            sums[a, 0], sums[a, 1] = 0.0, loaded[a, L_ROTATION]
        stretch[which[a]], rotation[which[a]] = sums[a, 0], sums[a, 1]
    copy(q1, q)
    if block.rounding > 0.0:
        hand_over(block.sides.shape[0], ints, reals, found_i, found_r, stretch, rotation)
    _commit(q, stretch, rotation, shares, ground, block, params, ints, reals, found_i, found_r, audit)
    return event_s
