"""The classical fourth-order Runge-Kutta step of a block on its contacts, compiled."""

from __future__ import annotations

import numpy as np

from rock2d.compiled import copy, kernel
from rock2d.effects.forces import flight
from rock2d.engines.free_flight import fly, in_air
from rock2d.engines.geometry import SMOOTH_FACET, is_ball
from rock2d.engines.loaded_contacts import (
    L_BOTTOM,
    L_DISPLACEMENT,
    L_KIND,
    L_LAW,
    L_OFFSET,
    L_PEAK,
    L_PRESSED,
    L_ROTATION,
    LEAST_EVENT,
    SLIP_RATE,
    SPIN_RATE,
    TAKEN_DISPLACEMENT,
    TAKEN_ROTATION,
    contact_rates,
    placed,
)
from rock2d.laws.contact import K_L, K_UL
from rock2d.records.columns import OMEGA, THETA, VX, VY, X, Y


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
    facet. The exact solution avoids the numerical damping of a Runge-Kutta step.
    """
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
def runge_kutta(q, direction, h, body, contacts, q1, effects):
    """Step of h (s) of a block at state q, whose direction is (cos θ, sin θ); fills q1.

    contacts : (number of active contacts, rows and rates of `LoadedContacts`); at the end TAKEN_DISPLACEMENT and
        TAKEN_ROTATION of the rates hold the springs' new tangential displacement and rotation
    effects : whether effects of the catalogue may act; compiled twice, because their code slows the plain law down

    Returns (work in J on the tangential springs, on the rolling springs and of effects; velocity in m/s that recoiling
    ground added). Without contacts the step is a free flight.
    """
    if effects:
        return _with_effects(q, direction, h, body, contacts, q1)
    return _plain(q, direction, h, body, contacts, q1)


@kernel
def _plain(q, direction, h, body, contacts, q1):
    return _four_stages(q, direction, h, body, contacts, q1, False)


@kernel
def _with_effects(q, direction, h, body, contacts, q1):
    if contacts[0] == 0:
        copy(q, q1)
        return 0.0, 0.0, fly(q1, h, body.gravity, body.block), 0.0
    return _four_stages(q, direction, h, body, contacts, q1, True)


@kernel(forceinline=True)
def _four_stages(q, direction, h, body, contacts, q1, effects):
    """`runge_kutta` for both values of `effects`."""
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
    work_t = work_r = work_e = pushed = 0.0
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
        fx = fy = moment = push = 0.0
        for a in range(active):
            f, g, m, slip, spin, power_t, power_r, power_e, recoiled = contact_rates(
                rows, a, (x, y, c, s), (vx, vy, omega),
                rows[a, L_DISPLACEMENT] + ahead * rates[a, SLIP_RATE],
                rows[a, L_ROTATION] + ahead * rates[a, SPIN_RATE], effects,
            )  # fmt: skip
            fx, fy, moment = fx + f, fy + g, moment + m
            rates[a, TAKEN_DISPLACEMENT] += weight * slip
            rates[a, TAKEN_ROTATION] += weight * spin
            rates[a, SLIP_RATE], rates[a, SPIN_RATE] = slip, spin
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
    q1[X], q1[Y], q1[THETA] = q[X] + h * dx, q[Y] + h * dy, q[THETA] + h * dtheta
    q1[VX], q1[VY], q1[OMEGA] = q[VX] + h * dvx, q[VY] + h * dvy, q[OMEGA] + h * domega
    if oscillates:
        depth, nx, ny, _, _ = placed(rows, 0, (q1[X], q1[Y], c, s))
        up, faster = depth - end, -(q1[VX] * nx + q1[VY] * ny) - rate
        q1[X], q1[Y] = q1[X] + up * nx, q1[Y] + up * ny
        q1[VX], q1[VY] = q1[VX] + faster * nx, q1[VY] + faster * ny
    for a in range(active):
        rates[a, TAKEN_DISPLACEMENT] = rows[a, L_DISPLACEMENT] + h * rates[a, TAKEN_DISPLACEMENT]
        rates[a, TAKEN_ROTATION] = rows[a, L_ROTATION] + h * rates[a, TAKEN_ROTATION]
    return h * work_t, h * work_r, h * work_e, h * pushed
