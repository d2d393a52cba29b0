"""Free flight, compiled: the exact parabola, or fourth-order steps if air acts on the block."""

from __future__ import annotations

import numpy as np

from rock2d.compiled import kernel
from rock2d.effects.forces import flight
from rock2d.records.columns import OMEGA, THETA, VX, VY, X, Y

# step of a flight through air, as a share of the time in which air or gravity change the motion by its own size
STRIDE_SHARE = 0.1


@kernel(forceinline=True)
def in_air(block):
    """Whether air acts on the block."""
    return block.air.size > 0


@kernel
def fly(q, tau, gravity, block):
    """Advance q by tau (s) in place; returns the energy in J that air has dissipated.

    With air this is one classical Runge-Kutta step, and tau must be below `air_stride`.
    """
    if not in_air(block):
        q[X] += q[VX] * tau
        q[Y] += q[VY] * tau - 0.5 * gravity * tau * tau
        q[THETA] += q[OMEGA] * tau
        q[VY] -= gravity * tau
        return 0.0
    mass, inertia = block.mass, block.inertia
    vx, vy, omega = q[VX], q[VY], q[OMEGA]
    ax = ay = alpha = 0.0
    dx = dy = dtheta = dvx = dvy = domega = work = 0.0
    for k in range(4):
        weight = 1.0 / 6.0 if k % 3 == 0 else 1.0 / 3.0
        if k > 0:
            ahead = 0.5 * tau if k < 3 else tau
            vx, vy, omega = q[VX] + ahead * ax, q[VY] + ahead * ay, q[OMEGA] + ahead * alpha
        ax, ay, alpha = flight(block.air, vx, vy, omega, mass, inertia)
        work -= weight * (mass * (ax * vx + ay * vy) + inertia * alpha * omega)
        ay -= gravity
        dx, dy, dtheta = dx + weight * vx, dy + weight * vy, dtheta + weight * omega
        dvx, dvy, domega = dvx + weight * ax, dvy + weight * ay, domega + weight * alpha
    q[X], q[Y], q[THETA] = q[X] + tau * dx, q[Y] + tau * dy, q[THETA] + tau * dtheta
    q[VX], q[VY], q[OMEGA] = q[VX] + tau * dvx, q[VY] + tau * dvy, q[OMEGA] + tau * domega
    return tau * work


@kernel
def air_stride(q, gravity, block):
    """(longest step in s, bound of the acceleration in m/s² that air adds meanwhile at any point of the block)."""
    if not in_air(block):
        return np.inf, 0.0
    speed = np.sqrt(q[VX] * q[VX] + q[VY] * q[VY] + gravity * block.radius)
    spin = max(abs(q[OMEGA]), speed / block.radius)
    ax, ay, alpha = flight(block.air, q[VX], q[VY], q[OMEGA], block.mass, block.inertia)
    now = np.sqrt(ax * ax + ay * ay)
    stride = STRIDE_SHARE / max((now + gravity) / max(speed, 1e-300) + abs(alpha) / max(spin, 1e-300), 1e-12)
    bx, by, beta = flight(block.air, q[VX], q[VY] - gravity * stride, q[OMEGA], block.mass, block.inertia)
    then = np.sqrt(bx * bx + by * by)
    return stride, 2.0 * (max(now, then) + max(abs(alpha), abs(beta)) * block.radius)
