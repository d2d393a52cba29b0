"""One step of a block in contact, which ends at the first event of the law; all contact steps use it. Compiled.

A step in which a contact begins, ends, reloads, reaches its former peak or passes its deepest point is repeated so that
it ends at this event. This keeps the order of the scheme and the energy audit.

A Runge-Kutta step conserves energy only to its order. The exact balance is known, and so is the error: if it is large,
the step is halved; the remaining error is removed from the impulse. Projection onto an invariant keeps the order of a
scheme (Hairer, Lubich, Wanner: Geometric Numerical Integration, IV.4)."""

from typing import Any

import numpy as np

from rock2d.compiled import copy, kernel
from rock2d.effects.forces import RECOIL_COLUMN, flight, ground_forces, recoil
from rock2d.engines.contact_state import (
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
    L_PRESSED,
    L_ROTATION,
    LEAST_EVENT,
    MOMENT_1,
    NORMAL_0,
    NORMAL_1,
    PEAK_1,
    PLASTIC_WORK,
    RATE_1,
    ROTATION_1,
    SLIP,
    SLIP_RATE,
    SPIN_RATE,
    TANGENTIAL_0,
    TANGENTIAL_1,
    UNLIMITED_DISPLACEMENT,
    UNLIMITED_ROTATION,
    contact_rates,
    kinetic_energy,
    note_pressed,
    placed,
)
from rock2d.engines.event_detection import lands
from rock2d.engines.free_flight import air_acts, fly
from rock2d.engines.geometry import SMOOTH_FACET, is_ball
from rock2d.laws.contact import (
    K_L,
    K_R,
    K_T,
    K_UL,
    MU,
    ROLLING_CAP,
    ROLLING_IN_INDENTATION,
    normal_force_from_bottom,
    plastic_work,
    residual_indentation,
    rolling_moment,
    tangential_force,
)
from rock2d.records.columns import CORRECTED, OMEGA, PENDING, RECOIL, RECOIL_SHIFT, THETA, VX, VY, X, Y

# largest energy error of a step, as a share of the energy; otherwise it is halved
LARGEST_STEP_ERROR = 0.0005
MOST_HALVINGS = 12  # most halvings of a step
# largest correction, as a share of the impulse of a step; the rest is corrected later
LARGEST_CORRECTION = 0.01
LEAST_ERROR = 1e-7  # share of the kinetic energy: a smaller error never halves a step
POSE_ROUNDING = 2e-15  # relative rounding of positions, and of arms times angles: several machine epsilons


@kernel(forceinline=True)
def step_to_event(q, direction, h, body, contacts, loaded, q1, effects, audit, inspect, view):
    """One step of at most h (s) from q, whose direction is (cos θ, sin θ), into q1. It ends at the first event of the
    law, and is halved while its error is too large.

    contacts : (number of contacts that may press, number of active contacts)
    effects : whether effects of the catalogue may act; then the error is unknown, because the work of effects is known
        only as well as the motion
    audit : the motion of recoiling ground in this impact, see `records.columns`
    inspect : function that inspects the end of a step: `inspect(q, q1, h, whole, effects, view)` returns (why there can
        be no step, or 0; time in s of the first event). `whole` is the step in s that was tried first

    Returns (why there is no step, or 0; its length in s; (cos θ, sin θ) after it, for a ball before it; (work in J on
    tangential springs, on rolling springs, of effects, velocity in m/s of recoiling ground); (energy error in J, energy
    in J with which it is compared); factor by which it was halved)."""
    pressing, active = contacts
    rows, rates, trial = loaded.rows, loaded.rates, loaded.trial
    turning = not is_ball(body.block)
    zero: Any = np.int64(0)
    landings, halvings, halved, whole, error, scale = zero, zero, 1.0, h, 0.0, 0.0
    note_pressed(active, loaded, whole)
    while True:
        work_t, work_r, work_e, pushed = runge_kutta(q, direction, h, body, (pressing, rows, rates), q1, effects, audit)
        if pressing == 0:
            for a in range(active):
                rates[a, UNLIMITED_DISPLACEMENT], rates[a, UNLIMITED_ROTATION] = 0.0, rows[a, L_ROTATION]
        c1, s1 = direction
        if turning:
            c1, s1 = np.cos(q1[THETA]), np.sin(q1[THETA])
        for a in range(active):
            trial[a, DEPTH_1], nx, ny, rx, ry = placed(rows, a, (q1[X], q1[Y], c1, s1))
            ux, uy = q1[VX] - q1[OMEGA] * ry, q1[VY] + q1[OMEGA] * rx
            trial[a, RATE_1] = -(ux * nx + uy * ny)
            if effects:
                trial[a, SLIP] = ux * ny - uy * nx
            trial[a, ARM] = np.sqrt(rx * rx + ry * ry)
        why, event_s = inspect(q, q1, h, whole, effects, view)
        if why > 0:
            break
        if lands(event_s, h, landings):
            h = event_s
            landings += 1
            continue
        for a in range(active):
            _note_outcome(a, loaded, effects)
        if effects:
            break
        # only now, because a step across an event has a large error
        error, scale, too_long, work_t, work_r = _step_error(q, q1, h, (work_t, work_r), body, active, loaded)
        if not too_long or halvings == MOST_HALVINGS:
            break
        h *= 0.5
        halved *= 0.5
        whole, landings = h, zero
        halvings += 1
        note_pressed(active, loaded, whole)
    return why, h, (c1, s1), (work_t, work_r, work_e, pushed), (error, scale), halved


@kernel(forceinline=True)
def _note_outcome(a, loaded, effects):
    """Write the outcome of the trial step for the a-th loaded contact, PEAK_1 to PLASTIC_WORK.

    Springs slip at their limits. `effects`: whether effects of the catalogue may act; then their forces are added, and
    the row must hold RATE_1 and SLIP."""
    rows, rates, trial = loaded.rows, loaded.rates, loaded.trial
    k_l, k_ul, k_t = rows[a, L_LAW + K_L], rows[a, L_LAW + K_UL], rows[a, L_LAW + K_T]
    mu, k_r, cap = rows[a, L_LAW + MU], rows[a, L_LAW + K_R], rows[a, L_LAW + ROLLING_CAP]
    peak, bottom, offset = rows[a, L_PEAK], rows[a, L_BOTTOM], rows[a, L_OFFSET]
    before, after = trial[a, DEPTH_0] - offset, trial[a, DEPTH_1] - offset
    normal_0 = normal_force_from_bottom(before, peak, bottom, k_l, k_ul)
    normal_1 = normal_force_from_bottom(after, peak, bottom, k_l, k_ul)
    plastic = 0.0
    if after > peak:
        plastic = plastic_work(after, k_l, k_ul) - plastic_work(peak, k_l, k_ul)
        peak = after
    acting = force_n = normal_1
    if effects and rows[a, L_ACTS] != 0.0:
        trial[a, TANGENTIAL_0] = k_t * rows[a, L_DISPLACEMENT]  # within the friction of the step before
        motion = (after, trial[a, RATE_1], trial[a, SLIP], peak, residual_indentation(peak, k_l, k_ul))
        force_n, factor, drag = ground_forces(rows[a], L_EFFECTS, motion, normal_1)
        mu, acting = mu * factor, abs(force_n) + abs(drag)
    else:
        trial[a, TANGENTIAL_0] = tangential_force(rows[a, L_DISPLACEMENT], normal_0, k_t, mu)
    force_t = tangential_force(rates[a, UNLIMITED_DISPLACEMENT], force_n, k_t, mu)
    rotation = rates[a, UNLIMITED_ROTATION]
    moment = k_r * rotation
    if cap > 0.0 and k_r > 0.0:
        moment = rolling_moment(rotation, force_n, trial[a, ARM], k_r, cap, rows[a, L_LAW + ROLLING_IN_INDENTATION])
        rotation = moment / k_r
    trial[a, PEAK_1], trial[a, PLASTIC_WORK] = peak, plastic
    trial[a, NORMAL_0], trial[a, NORMAL_1], trial[a, ACTING_1] = normal_0, normal_1, acting
    trial[a, TANGENTIAL_1], trial[a, DISPLACEMENT_1] = force_t, force_t / k_t if k_t > 0.0 else 0.0
    trial[a, MOMENT_1], trial[a, ROTATION_1] = moment, rotation


@kernel(forceinline=True)
def _step_error(q, q1, h, works, body, active, loaded):
    """(energy error in J of a step of h (s) from q to q1, energy in J with which it is compared, whether the step is
    too long, work in J on the tangential springs and on the rolling springs).

    works : work in J on these springs by the quadrature of the step. The work on springs that do not slip is exactly
        the energy that they store; on springs that slip it is at least that, because friction creates no energy.

    The step is too long if its error is too large a share of the energy, or more than a correction of the impulse can
    remove. The rows of `loaded.trial` hold the outcome of the step, see `_note_outcome`."""
    block, rows, trial, rates = body.block, loaded.rows, loaded.trial, loaded.rates
    work_t, work_r = works
    kinetic = kinetic_energy(q1, block)
    error = kinetic - kinetic_energy(q, block) + block.mass * body.gravity * (q1[Y] - q[Y])
    scale = kinetic + abs(work_t + work_r)
    stored_t, stored_r, slips, turns, pressing = 0.0, 0.0, False, False, 0.0
    for a in range(active):
        k_ul, k_t, k_r = rows[a, L_LAW + K_UL], rows[a, L_LAW + K_T], rows[a, L_LAW + K_R]
        old, new = trial[a, NORMAL_0], trial[a, NORMAL_1]
        error += trial[a, PLASTIC_WORK] + 0.5 * (new * new - old * old) / k_ul
        scale += 0.5 * max(new * new, old * old) / k_ul
        pressing += new
        if k_t > 0.0:
            old, new = trial[a, TANGENTIAL_0], trial[a, TANGENTIAL_1]
            slips = slips or new != k_t * rates[a, UNLIMITED_DISPLACEMENT]
            stored_t += 0.5 * (new * new - old * old) / k_t
        if k_r > 0.0:
            moment, rotation = trial[a, MOMENT_1], rows[a, L_ROTATION]
            turns = turns or moment != k_r * rates[a, UNLIMITED_ROTATION]
            stored_r += 0.5 * (moment * moment / k_r - k_r * rotation * rotation)
    work_t = max(work_t, stored_t) if slips else stored_t
    work_r = max(work_r, stored_r) if turns else stored_r
    error += work_t + work_r
    # work of the forces by the rounding of the pose does not count as an error of the step
    size = abs(q1[X]) + abs(q1[Y]) + block.radius * (1.0 + abs(q1[THETA]))
    rounding = POSE_ROUNDING * size * (block.mass * body.gravity + pressing)
    allowed = min(LARGEST_STEP_ERROR * scale, LARGEST_CORRECTION * abs(_gain(q, q1, h, body)))
    return error, scale, abs(error) > max(allowed, LEAST_ERROR * kinetic, rounding), work_t, work_r


@kernel(forceinline=True)
def _gain(q, q1, h, body):
    """Energy in J gained per unit relative increase of the impulse of a step of h (s) from q to q1, to first order."""
    block = body.block
    dx, dy, turn = q1[VX] - q[VX], q1[VY] - q[VY] + body.gravity * h, q1[OMEGA] - q[OMEGA]
    return block.mass * (q1[VX] * dx + q1[VY] * dy) + block.inertia * q1[OMEGA] * turn


@kernel(forceinline=True)
def correct_energy(q, q1, h, error, scale, body, audit):
    """Remove the energy error of a step of h (s) from q to q1 by scaling the impulse of the contacts. Momentum that the
    contacts do not change, for example along a smooth plane, is not changed.

    An error beyond LARGEST_STEP_ERROR stays in the balance. The part that LARGEST_CORRECTION does not allow stays in
    audit[PENDING]. audit[CORRECTED] is the sum of the magnitudes of all corrections."""
    if abs(error) <= LARGEST_STEP_ERROR * scale:
        audit[PENDING] += error
    block = body.block
    dx, dy, turn = q1[VX] - q[VX], q1[VY] - q[VY] + body.gravity * h, q1[OMEGA] - q[OMEGA]
    gain = _gain(q, q1, h, body)
    curvature = 0.5 * (block.mass * (dx * dx + dy * dy) + block.inertia * turn * turn)
    most = abs(gain) * min(LARGEST_CORRECTION, 0.1 * abs(gain) / max(curvature, 1e-300))
    paid = min(max(audit[PENDING], -most), most)
    if paid == 0.0:
        return
    share = -paid / gain
    share = -paid / (gain + curvature * share)
    paid = -share * (gain + curvature * share)
    q1[VX], q1[VY], q1[OMEGA] = q1[VX] + share * dx, q1[VY] + share * dy, q1[OMEGA] + share * turn
    audit[CORRECTED] += abs(paid)
    audit[PENDING] -= paid


@kernel(forceinline=True)
def _turned(c, s, angle):
    """(cos, sin) of a direction rotated by an angle in rad; below 0.1 rad by a series that is exact to rounding."""
    if abs(angle) > 0.1:
        ca, sa = np.cos(angle), np.sin(angle)
    else:
        u = angle * angle
        ca = 1.0 - u * (1.0 / 2 - u * (1.0 / 24 - u * (1.0 / 720 - u / 40320.0)))
        sa = angle * (1.0 - u * (1.0 / 6 - u * (1.0 / 120 - u * (1.0 / 5040 - u / 362880.0))))
    return c * ca - s * sa, s * ca + c * sa


@kernel
def _oscillation(q, h, body, rows):
    """Depth in m of a ball on one facet after half a step of h (s) and at its end, and its rate in m/s at the end.

    On one branch of the law, m δ'' = m g n_y - F(δ) is a harmonic oscillation, independent of the motion along the
    facet. The exact solution avoids the numerical damping of a Runge-Kutta step."""
    block, gravity = body
    depth, nx, ny, _, _ = placed(rows, 0, (q[X], q[Y], 1.0, 0.0))
    rate, pull = -(q[VX] * nx + q[VY] * ny), gravity * ny
    stiffness, bottom = rows[0, L_LAW + K_UL], rows[0, L_BOTTOM]
    pressed, k_l = depth - rows[0, L_OFFSET], rows[0, L_LAW + K_L]
    at_peak = pressed + LEAST_EVENT * h * rate >= rows[0, L_PEAK]
    # first loading, unless the ball unloads at once
    if at_peak and rate > LEAST_EVENT * h * (k_l * pressed / block.mass - pull):
        stiffness, bottom = k_l, 0.0
    rest = rows[0, L_OFFSET] + bottom + block.mass * pull / stiffness
    omega = np.sqrt(stiffness / block.mass)
    c, s = np.cos(0.5 * omega * h), np.sin(0.5 * omega * h)
    a, b = depth - rest, rate / omega
    half = rest + a * c + b * s
    c, s = c * c - s * s, 2.0 * c * s
    return half, rest + a * c + b * s, omega * (b * c - a * s)


@kernel(forceinline=True)
def runge_kutta(q, direction, h, body, contacts, q1, effects, audit):
    """Step of h (s) of a block at state q, whose direction is (cos θ, sin θ); fills q1.

    contacts : (number of active contacts, rows and rates of `LoadedContacts`), of which UNLIMITED_DISPLACEMENT and
        UNLIMITED_ROTATION are filled
    effects : whether effects of the catalogue may act; compiled twice, because their code slows the plain law down
    audit : see `step_to_event`

    Returns (work in J on the tangential springs, on the rolling springs and of effects; velocity in m/s that recoiling
    ground added). Without contacts the step is a free flight."""
    if effects:
        return _with_effects(q, direction, h, body, contacts, q1, audit)
    return _plain(q, direction, h, body, contacts, q1)


@kernel
def _plain(q, direction, h, body, contacts, q1):
    return _four_stages(q, direction, h, body, contacts, q1, False, (0.0, 0.0))


@kernel
def _with_effects(q, direction, h, body, contacts, q1, audit):
    if contacts[0] == 0:
        copy(q, q1)
        return 0.0, 0.0, fly(q1, h, body.gravity, body.block), 0.0
    ground = audit[RECOIL_SHIFT], -audit[RECOIL]
    return _four_stages(q, direction, h, body, contacts, q1, True, ground)


@kernel(forceinline=True)
def _four_stages(q, direction, h, body, contacts, q1, effects, ground):
    """`runge_kutta` for both values of `effects`; `ground`: displacement in m in this impact, and velocity in m/s, of
    recoiling ground."""
    block, gravity = body
    active, rows, rates = contacts
    c0, s0 = direction
    x, y, vx, vy, omega = q[X], q[Y], q[VX], q[VY], q[OMEGA]
    if active == 0:
        q1[X], q1[Y], q1[THETA] = x + h * vx, y + h * (vy - 0.5 * gravity * h), q[THETA] + h * omega
        q1[VX], q1[VY], q1[OMEGA] = vx, vy - h * gravity, omega
        return 0.0, 0.0, 0.0, 0.0
    ax = ay = alpha = 0.0
    per_mass, per_inertia = 1.0 / block.mass, 1.0 / block.inertia
    for a in range(active):
        for i in range(4):
            rates[a, i] = 0.0
    dx = dy = dtheta = dvx = dvy = domega = 0.0
    work_t = work_r = work_e = push = pushed = 0.0
    shift, shift_speed = ground
    c, s = c0, s0
    turning = not is_ball(block)
    oscillates = not effects and not turning and active == 1
    oscillates = oscillates and rows[0, L_KIND] == SMOOTH_FACET and rows[0, L_PRESSED] != 0.0
    half = end = rate = 0.0
    if oscillates:
        half, end, rate = _oscillation(q, h, body, rows)
    for k in range(4):
        weight = 1.0 / 6.0 if k % 3 == 0 else 1.0 / 3.0
        ahead = 0.0 if k == 0 else (0.5 * h if k < 3 else h)
        if k > 0:  # the next stage, from the rates of the stage before
            x, y = q[X] + ahead * vx, q[Y] + ahead * vy
            if turning:
                c, s = _turned(c0, s0, ahead * omega)
            vx, vy, omega = q[VX] + ahead * ax, q[VY] + ahead * ay, q[OMEGA] + ahead * alpha
            if oscillates:
                depth, nx, ny, _, _ = placed(rows, 0, (x, y, c, s))
                up = depth - (half if k < 3 else end)
                x, y = x + up * nx, y + up * ny
            if effects:
                shift, shift_speed = ground[0] + ahead * shift_speed, ground[1] - ahead * push
        fx = fy = moment = on_ground = 0.0
        recoiling = -1
        for a in range(active):
            f, g, m, slip, spin, power_t, power_r, power_e = contact_rates(
                rows, a, (x, y, c, s), (vx, vy, omega),
                rows[a, L_DISPLACEMENT] + ahead * rates[a, SLIP_RATE],
                rows[a, L_ROTATION] + ahead * rates[a, SPIN_RATE], effects,
            )  # fmt: skip
            fx, fy, moment = fx + f, fy + g, moment + m
            rates[a, UNLIMITED_DISPLACEMENT] += weight * slip
            rates[a, UNLIMITED_ROTATION] += weight * spin
            rates[a, SLIP_RATE], rates[a, SPIN_RATE] = slip, spin
            work_t += weight * power_t
            work_r += weight * power_r
            if effects:
                work_e += weight * power_e
                if rows[a, L_ACTS] != 0.0 and rows[a, L_EFFECTS + RECOIL_COLUMN] != 0.0:
                    on_ground += f
                    recoiling = a
        ax, ay, alpha = fx * per_mass, fy * per_mass - gravity, moment * per_inertia
        if effects:
            bx = by = beta = 0.0
            if air_acts(block):
                bx, by, beta = flight(block.air, vx, vy, omega, block.mass, block.inertia)
            push = recoil(rows[recoiling], L_EFFECTS, on_ground, shift, shift_speed) if recoiling >= 0 else 0.0
            bx += push
            pushed += weight * push
            ax, ay, alpha = ax + bx, ay + by, alpha + beta
            work_e -= weight * (block.mass * (bx * vx + by * vy) + block.inertia * beta * omega)
        dx, dy, dtheta = dx + weight * vx, dy + weight * vy, dtheta + weight * omega
        dvx, dvy, domega = dvx + weight * ax, dvy + weight * ay, domega + weight * alpha
    q1[X], q1[Y], q1[THETA] = q[X] + h * dx, q[Y] + h * dy, q[THETA] + h * dtheta
    q1[VX], q1[VY], q1[OMEGA] = q[VX] + h * dvx, q[VY] + h * dvy, q[OMEGA] + h * domega
    if oscillates:
        depth, nx, ny, _, _ = placed(rows, 0, (q1[X], q1[Y], c, s))
        up, faster = depth - end, -(q1[VX] * nx + q1[VY] * ny) - rate
        q1[X], q1[Y] = q1[X] + up * nx, q1[Y] + up * ny
        q1[VX], q1[VY] = q1[VX] + faster * nx, q1[VY] + faster * ny
    for a in range(active):
        rates[a, UNLIMITED_DISPLACEMENT] = rows[a, L_DISPLACEMENT] + h * rates[a, UNLIMITED_DISPLACEMENT]
        rates[a, UNLIMITED_ROTATION] = rows[a, L_ROTATION] + h * rates[a, UNLIMITED_ROTATION]
    return h * work_t, h * work_r, h * work_e, h * pushed
