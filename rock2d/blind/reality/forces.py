"""The soil's law with what may be hidden in it, compiled: force on a block at one contact.

Memory of a contact: whether it is on, greatest depth, stretch of the tangential spring, turn of the rolling spring,
depth at which it began (it begins without force), zone, factor on its stiffness.
"""

from __future__ import annotations

import numba
import numpy as np

from rock2d.blind.reality import parameters
from rock2d.blind.reality.data_model import Array

ON, DEEPEST, STRETCH, TURN, START, ZONE, SOFT = range(7)
N_MEMORY = 7
K_L, K_UL, K_T, MU, K_R = range(5)
SET_IN = 0.1  # of the way out of the indentation over which a tension sets in


@numba.njit
def spring(depth: float, deepest: float, k_l: float, k_ul: float) -> float:
    """Force in N of the elasto-plastic spring; `deepest` includes the present depth."""
    unloading = k_ul * (depth - deepest * (1.0 - k_l / k_ul))
    return max(0.0, min(k_l * depth, unloading))


@numba.njit
def slip_factor(slip: float, dial: Array) -> float:
    """Friction at this slip in m/s over friction at rest."""
    change = dial[parameters.SLIP_CHANGE]
    if change == 0.0:
        return 1.0
    ratio = abs(slip) / dial[parameters.SLIP_SPEED]
    grown = ratio / (1.0 + ratio) if dial[parameters.SLIP_FORM] > 0.0 else 1.0 - np.exp(-ratio)
    return max(0.05, 1.0 + change * grown)


@numba.njit
def tension(depth: float, bottom: float, rate: float, dial: Array) -> float:
    """Pull in N of wet soil on a block that rises from its indentation, at `depth` above its `bottom` (m)."""
    pull = dial[parameters.TENSION]
    if pull == 0.0 or rate >= 0.0 or depth >= bottom or depth <= 0.0:
        return 0.0
    risen = (bottom - depth) / bottom
    if dial[parameters.TENSION_FADES] > 0.0:
        pull *= 1.0 - risen
    return pull * min(1.0, risen / SET_IN) * np.tanh(-rate / dial[parameters.TENSION_SPEED])


@numba.njit
def press(
    depth: float, rate: float, slip: float, slid: float, turned: float, soil: Array, indentation: bool, dial: Array,
    memory: Array,
) -> tuple[float, float, float, bool]:  # fmt: skip
    """(normal force N, force along the tangent N, moment N m, whether the ground presses); updates `memory`.

    depth : m; rate : of the depth, m/s; slip : of the contact point along the tangent, m/s
    slid, turned : way in m and angle in rad that the contact point and the block went since the last call
    """
    soft = memory[SOFT]
    k_l, k_ul, k_t = soil[K_L] * soft, soil[K_UL] * soft, soil[K_T]
    depth -= memory[START]
    memory[DEEPEST] = max(memory[DEEPEST], depth)
    force = spring(depth, memory[DEEPEST], k_l, k_ul)
    pressing = force > 0.0
    if pressing:
        resisting = dial[parameters.VISCOUS] + dial[parameters.HUNT] * depth
        force = max(0.0, force + resisting * rate)
    limit = soil[MU] * slip_factor(slip, dial) * force
    drag = 0.0
    if pressing:
        drag = (dial[parameters.PLOUGH] + dial[parameters.PLOUGH_SQUARE] * abs(slip)) * depth * slip
    along = 0.0
    if k_t > 0.0:
        along = min(max(k_t * (memory[STRETCH] + slid), -limit), limit)
        memory[STRETCH] = along / k_t
    if pressing or indentation:
        memory[TURN] += turned
    moment = soil[K_R] * memory[TURN] if force > 0.0 or indentation else 0.0
    if not pressing:
        force -= tension(depth, memory[DEEPEST] * (1.0 - k_l / k_ul), rate, dial)
    return force, -along - drag, -moment, pressing


@numba.njit
def air(
    x: float, y: float, vx: float, vy: float, omega: float, gap: float, dial: Array
) -> tuple[float, float, float]:
    """Accelerations (m/s², m/s², rad/s²) beside gravity of a block at a clearance `gap` in m from the ground."""
    speed = np.sqrt(vx * vx + vy * vy)
    slow = dial[parameters.DAMP_V]
    if dial[parameters.DRAG] > 0.0 and speed > 0.0:
        slow += dial[parameters.DRAG] * speed ** (dial[parameters.POWER] - 1.0)
    turn = dial[parameters.LIFT] * omega
    if dial[parameters.LIFT_ARM] > 0.0:
        turn *= speed / (speed + dial[parameters.LIFT_ARM] * abs(omega) + 1e-12)
    ax, ay = -slow * vx - turn * vy, -slow * vy + turn * vx
    if dial[parameters.PUSH_LOW] < y < dial[parameters.PUSH_HIGH]:
        ax += dial[parameters.PUSH]
    if dial[parameters.DRAUGHT_LEFT] < x < dial[parameters.DRAUGHT_RIGHT]:
        ay += dial[parameters.DRAUGHT]
    if 0.0 < gap < dial[parameters.PULL_RANGE]:
        ay -= dial[parameters.PULL]
    return ax, ay, -dial[parameters.DAMP_W] * omega


@numba.njit
def blows(dial: Array) -> bool:
    """Whether any force of the air acts."""
    return (
        dial[parameters.DRAG] != 0.0
        or dial[parameters.DAMP_V] != 0.0
        or dial[parameters.DAMP_W] != 0.0
        or dial[parameters.LIFT] != 0.0
        or dial[parameters.PUSH] != 0.0
        or dial[parameters.DRAUGHT] != 0.0
        or dial[parameters.PULL] != 0.0
    )
