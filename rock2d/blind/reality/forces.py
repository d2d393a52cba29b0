"""The contact law of the soil with the causes that may be hidden in it, compiled: which contacts of a block begin and
end, and the forces that they exert."""

import numba
import numpy as np

from rock2d.blind.reality import parameters
from rock2d.blind.reality.compiled_records import (
    K_L,
    K_R,
    K_T,
    K_UL,
    MU,
    OMEGA,
    RISE_SPEED,
    SHIFT_SPEED,
    THETA,
    VX,
    VY,
    BlockMotion,
    ContactMotion,
    ContactRows,
    Contacts,
    Ground,
    SoilLaw,
    X,
    Y,
)
from rock2d.blind.reality.contact_detection import DEPTH, FACET, NX, NY, PX, PY
from rock2d.blind.reality.data_model import Array

# memory of a contact: whether it is active, peak penetration, tangential displacement, rolling rotation, depth at which
# it began (it begins without force), zone, factors on its stiffness, on its unloading stiffness and on its friction
(
    ACTIVE, PEAK_PENETRATION, TANGENTIAL_DISPLACEMENT, ROLLING_ROTATION, START_DEPTH, ZONE, STIFFNESS_FACTOR,
    UNLOADING_FACTOR, START_FRICTION_FACTOR,
) = range(9)  # fmt: skip
N_MEMORY = START_FRICTION_FACTOR + 1
# sums over the contacts: force, moment, horizontal force on the embankment, outward unit vector of the last one,
# distance in m to the next contact that may press, number of active and of pressing contacts, number of those in first
# loading
(
    FORCE_X, FORCE_Y, MOMENT, EMBANKMENT_FORCE, NORMAL_X, NORMAL_Y, NEXT_DISTANCE, N_ACTIVE, N_PRESSING,
    N_FIRST_LOADING,
) = range(10)  # fmt: skip
N_SUMS = N_FIRST_LOADING + 1
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

    `soil`: the row of the zone; `indentation`: the rolling spring acts until the contact ends."""
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
        coefficient = values[parameters.PLOUGHING] + values[parameters.PLOUGHING_SQUARE] * abs(motion.slip_velocity)
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


@numba.njit
def row_of(i: int, rows: ContactRows) -> int:
    """Row of the i-th contact of `rows`."""
    return i if i < rows.corners else rows.low + i - rows.corners


@numba.njit
def begin_contact(j: int, state: Array, late_depth: float, ground: Ground, contacts: Contacts, values: Array) -> None:
    """Begin contact j. One that is found deeper than `late_depth` in m was covered by another one before: it begins
    without force."""
    found, memory = contacts.found, contacts.memory
    for k in range(N_MEMORY):
        memory[j, k] = 0.0
    memory[j, ACTIVE] = 1.0
    memory[j, ZONE] = ground.zone[int(found[j, FACET])]
    memory[j, START_DEPTH] = found[j, DEPTH] if found[j, DEPTH] > late_depth else 0.0
    factor = 1.0
    if values[parameters.STRIP_FACTOR] > 0.0:
        into = (found[j, PX] - values[parameters.STRIP_LEFT]) % values[parameters.STRIP_PERIOD]
        factor = values[parameters.STRIP_FACTOR] if into < values[parameters.STRIP_WIDTH] else 1.0
    if values[parameters.SIDE_LOG_RATIO] > 0.0:
        facing = np.arctan2(-found[j, NY], -found[j, NX]) - state[THETA] - values[parameters.SIDE_ANGLE]
        factor *= np.exp(-0.5 * values[parameters.SIDE_LOG_RATIO] * (1.0 + np.cos(facing)))
    memory[j, STIFFNESS_FACTOR] = factor
    wave = np.sin(values[parameters.WAVE_NUMBER] * found[j, PX] + values[parameters.WAVE_PHASE])
    memory[j, UNLOADING_FACTOR] = np.exp(values[parameters.WAVE_LOG_FACTOR] * wave)
    vx = state[VX] - state[OMEGA] * (found[j, PY] - state[Y])
    vy = state[VY] + state[OMEGA] * (found[j, PX] - state[X])
    speed = max(0.0, -(vx * found[j, NX] + vy * found[j, NY]))
    memory[j, START_FRICTION_FACTOR] = 1.0 / (1.0 + values[parameters.FRICTION_FALL] * speed)


@numba.njit
def update_contacts(
    rows: ContactRows, state: Array, late_depth: float, ground: Ground, contacts: Contacts, values: Array
) -> int:
    """Begin and end contacts; `late_depth`: see `begin_contact`. Returns the number of active contacts."""
    active = 0
    for i in range(rows.corners + rows.high - rows.low):
        j = row_of(i, rows)
        if contacts.found[j, DEPTH] <= 0.0:
            contacts.memory[j, ACTIVE] = 0.0
            continue
        if contacts.memory[j, ACTIVE] == 0.0:
            begin_contact(j, state, late_depth, ground, contacts, values)
        active += 1
    return active


@numba.njit
def sum_forces(
    rows: ContactRows, block: BlockMotion, ground: Ground, ground_motion: Array, law: SoilLaw, contacts: Contacts
) -> None:
    """Fill `contacts.sums` with the forces of all contacts on a block; `ground_motion`: see its columns."""
    found, memory, sums = contacts.found, contacts.memory, contacts.sums
    x, y = block.state[X], block.state[Y]
    velocity, path_velocity, span = block.velocity, block.path_velocity, block.span_s
    shift_speed, rise_speed = ground_motion[SHIFT_SPEED], ground_motion[RISE_SPEED]
    for k in range(N_SUMS):
        sums[k] = 0.0
    sums[NEXT_DISTANCE] = 1e9
    for i in range(rows.corners + rows.high - rows.low):
        j = row_of(i, rows)
        if memory[j, ACTIVE] == 0.0:
            sums[NEXT_DISTANCE] = min(sums[NEXT_DISTANCE], -found[j, DEPTH])
            continue
        nx, ny = found[j, NX], found[j, NY]
        rx, ry = found[j, PX] - x, found[j, PY] - y
        facet = int(found[j, FACET])
        gx = shift_speed if ground.yielding[facet] > 0.0 else 0.0
        ux, uy = velocity[0] - velocity[2] * ry - gx, velocity[1] + velocity[2] * rx - rise_speed
        wx, wy = (path_velocity[0] - path_velocity[2] * ry - gx, path_velocity[1] + path_velocity[2] * rx - rise_speed)
        rate, slip_velocity = -(ux * nx + uy * ny), ux * ny - uy * nx
        slip = span * (wx * ny - wy * nx)
        zone = int(memory[j, ZONE])
        before = memory[j, PEAK_PENETRATION]
        motion = ContactMotion(found[j, DEPTH], rate, slip_velocity, slip, span * path_velocity[2])
        force, tangential, moment, pressing = contact_force(
            motion, law.soil[zone], law.indentation, law.values, memory[j]
        )
        fx, fy = force * nx + tangential * ny, force * ny - tangential * nx
        sums[FORCE_X] += fx
        sums[FORCE_Y] += fy
        sums[MOMENT] += rx * fy - ry * fx + moment
        sums[NORMAL_X], sums[NORMAL_Y] = nx, ny
        sums[N_ACTIVE] += 1.0
        if ground.yielding[facet] > 0.0:
            sums[EMBANKMENT_FORCE] -= fx
        if pressing:
            sums[N_PRESSING] += 1.0
            if memory[j, PEAK_PENETRATION] > before and rate > 0.0:
                sums[N_FIRST_LOADING] += 1.0
        else:
            k_l, k_ul = stiffnesses(law.soil[zone], memory[j])
            indentation = memory[j, PEAK_PENETRATION] * (1.0 - k_l / k_ul)
            sums[NEXT_DISTANCE] = min(sums[NEXT_DISTANCE], indentation - (found[j, DEPTH] - memory[j, START_DEPTH]))
