"""All contacts of a block together, compiled: which begin and end, and the forces they exert."""

from __future__ import annotations

import numba
import numpy as np

from rock2d.blind.reality import parameters
from rock2d.blind.reality.compiled_records import (
    DRIFT,
    HEAVE,
    OMEGA,
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
from rock2d.blind.reality.forces import (
    ACTIVE,
    N_MEMORY,
    PEAK_PENETRATION,
    START_DEPTH,
    START_FRICTION_FACTOR,
    STIFFNESS_FACTOR,
    UNLOADING_FACTOR,
    ZONE,
    contact_force,
    stiffnesses,
)

# sums over the contacts: force, moment, horizontal force on the embankment, outward unit vector of the last one,
# distance in m to the next contact that may press, number of active and of pressing contacts, number of those in first
# loading
(
    FORCE_X, FORCE_Y, MOMENT, EMBANKMENT_FORCE, NORMAL_X, NORMAL_Y, NEXT_DISTANCE, N_ACTIVE, N_PRESSING,
    N_FIRST_LOADING,
) = range(10)  # fmt: skip
N_SUMS = N_FIRST_LOADING + 1


@numba.njit
def row_of(i: int, rows: ContactRows) -> int:
    """Row of the i-th contact of `rows`."""
    return i if i < rows.corners else rows.low + i - rows.corners


@numba.njit
def begin_contact(
    j: int, state: Array, late_depth: float, ground: Ground, contacts: Contacts, values: Array
) -> None:
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
    rows: ContactRows,
    block: BlockMotion,
    ground: Ground,
    ground_motion: Array,
    law: SoilLaw,
    contacts: Contacts,
) -> None:
    """Fill `contacts.sums` with the forces of all contacts on a block; `ground_motion`: see its columns."""
    found, memory, sums = contacts.found, contacts.memory, contacts.sums
    x, y = block.state[X], block.state[Y]
    velocity, path_velocity, span = block.velocity, block.path_velocity, block.span_s
    drift, heave = ground_motion[DRIFT], ground_motion[HEAVE]
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
        gx = drift if ground.yielding[facet] > 0.0 else 0.0
        ux, uy = velocity[0] - velocity[2] * ry - gx, velocity[1] + velocity[2] * rx - heave
        wx, wy = (
            path_velocity[0] - path_velocity[2] * ry - gx,
            path_velocity[1] + path_velocity[2] * rx - heave,
        )
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
            sums[NEXT_DISTANCE] = min(
                sums[NEXT_DISTANCE], indentation - (found[j, DEPTH] - memory[j, START_DEPTH])
            )
