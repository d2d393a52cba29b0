"""The contact law of the soil with the causes that may be hidden in it, compiled: force on a block at one contact."""

from __future__ import annotations

import numba
import numpy as np

from rock2d.blind.reality import parameters
from rock2d.blind.reality.compiled_records import K_L, K_R, K_T, K_UL, MU, ContactMotion
from rock2d.blind.reality.data_model import Array

# memory of a contact: whether it is active, peak penetration, tangential displacement, rolling rotation, depth at which
# it began (it begins without force), zone, factors on its stiffness, on its unloading stiffness and on its friction
(
    ACTIVE, PEAK_PENETRATION, TANGENTIAL_DISPLACEMENT, ROLLING_ROTATION, START_DEPTH, ZONE, STIFFNESS_FACTOR,
    UNLOADING_FACTOR, START_FRICTION_FACTOR,
) = range(9)  # fmt: skip
N_MEMORY = START_FRICTION_FACTOR + 1
TENSION_ONSET = 0.1  # share of the rise from the indentation over which a tension grows to its full value


@numba.njit
def stiffnesses(soil: Array, memory: Array) -> tuple[float, float]:
    """Loading and unloading stiffness in N/m at a contact on this row of soil."""
    k_l = soil[K_L] * memory[STIFFNESS_FACTOR]
    return k_l, max(k_l, soil[K_UL] * memory[STIFFNESS_FACTOR] * memory[UNLOADING_FACTOR])


@numba.njit
def spring_force(depth: float, peak: float, k_l: float, k_ul: float) -> float:
    """Force in N of the elasto-plastic spring; `peak` includes the present depth."""
    unloading = k_ul * (depth - peak * (1.0 - k_l / k_ul))
    return max(0.0, min(k_l * depth, unloading))


@numba.njit
def friction_factor(slip_velocity: float, values: Array) -> float:
    """Friction at this slip velocity in m/s over friction at rest."""
    change = values[parameters.SLIP_CHANGE]
    if change == 0.0:
        return 1.0
    ratio = abs(slip_velocity) / values[parameters.SLIP_SPEED]
    grown = ratio / (1.0 + ratio) if values[parameters.SLIP_HYPERBOLIC] > 0.0 else 1.0 - np.exp(-ratio)
    return max(0.05, 1.0 + change * grown)


@numba.njit
def tension(depth: float, indentation: float, rate: float, values: Array) -> float:
    """Tension in N of wet soil on a block at `depth` that rises from an `indentation` (both in m)."""
    pull = values[parameters.TENSION]
    if pull == 0.0 or rate >= 0.0 or depth >= indentation or depth <= 0.0:
        return 0.0
    risen = (indentation - depth) / indentation
    if values[parameters.TENSION_FADES] > 0.0:
        pull *= 1.0 - risen
    return pull * min(1.0, risen / TENSION_ONSET) * np.tanh(-rate / values[parameters.TENSION_SPEED])


@numba.njit
def contact_force(
    motion: ContactMotion, soil: Array, indentation: bool, values: Array, memory: Array
) -> tuple[float, float, float, bool]:
    """(normal force N, force along the tangent N, moment N m, whether the ground presses); updates `memory`.

    `soil`: the row of the zone; `indentation`: the rolling spring acts until the contact ends.
    """
    k_l, k_ul = stiffnesses(soil, memory)
    k_t = soil[K_T]
    depth = motion.depth - memory[START_DEPTH]
    memory[PEAK_PENETRATION] = max(memory[PEAK_PENETRATION], depth)
    force = spring_force(depth, memory[PEAK_PENETRATION], k_l, k_ul)
    pressing = force > 0.0
    if pressing:
        dashpot = values[parameters.DASHPOT] + values[parameters.DEPTH_DASHPOT] * depth
        force = max(0.0, force + dashpot * motion.rate)
    friction = soil[MU] * memory[START_FRICTION_FACTOR] * friction_factor(motion.slip_velocity, values)
    limit = friction * force
    ploughing = 0.0
    if pressing:
        coefficient = values[parameters.PLOUGHING] + values[parameters.PLOUGHING_SQUARE] * abs(
            motion.slip_velocity
        )
        ploughing = coefficient * depth * motion.slip_velocity
    tangential = 0.0
    if k_t > 0.0:
        tangential = min(max(k_t * (memory[TANGENTIAL_DISPLACEMENT] + motion.slip), -limit), limit)
        memory[TANGENTIAL_DISPLACEMENT] = tangential / k_t
    if pressing or indentation:
        memory[ROLLING_ROTATION] += motion.rotation
    moment = soil[K_R] * memory[ROLLING_ROTATION] if force > 0.0 or indentation else 0.0
    if not pressing:
        force -= tension(depth, memory[PEAK_PENETRATION] * (1.0 - k_l / k_ul), motion.rate, values)
    return force, -tangential - ploughing, -moment, pressing


@numba.njit
def air_acceleration(state: Array, velocity: Array, gap: float, values: Array) -> tuple[float, float, float]:
    """Accelerations (m/s², m/s², rad/s²), in addition to gravity, of a block at a clearance `gap` in m from the
    ground."""
    x, y, vx, vy, omega = state[0], state[1], velocity[0], velocity[1], velocity[2]
    speed = np.sqrt(vx * vx + vy * vy)
    decay = values[parameters.VELOCITY_DECAY]
    if values[parameters.DRAG] > 0.0 and speed > 0.0:
        decay += values[parameters.DRAG] * speed ** (values[parameters.DRAG_POWER] - 1.0)
    turn = values[parameters.LIFT] * omega
    if values[parameters.LIFT_ARM] > 0.0:
        turn *= speed / (speed + values[parameters.LIFT_ARM] * abs(omega) + 1e-12)
    ax, ay = -decay * vx - turn * vy, -decay * vy + turn * vx
    if values[parameters.WIND_LOW] < y < values[parameters.WIND_HIGH]:
        ax += values[parameters.WIND]
    if values[parameters.UPDRAUGHT_LEFT] < x < values[parameters.UPDRAUGHT_RIGHT]:
        ay += values[parameters.UPDRAUGHT]
    if 0.0 < gap < values[parameters.ATTRACTION_RANGE]:
        ay -= values[parameters.ATTRACTION]
    return ax, ay, -values[parameters.SPIN_DECAY] * omega


@numba.njit
def acts_in_flight(values: Array) -> bool:
    """Whether any force other than gravity acts in flight."""
    return (
        values[parameters.DRAG] != 0.0
        or values[parameters.VELOCITY_DECAY] != 0.0
        or values[parameters.SPIN_DECAY] != 0.0
        or values[parameters.LIFT] != 0.0
        or values[parameters.WIND] != 0.0
        or values[parameters.UPDRAUGHT] != 0.0
        or values[parameters.ATTRACTION] != 0.0
    )
