"""All contacts of a block together, compiled: which begin and end, and what forces they exert."""

from __future__ import annotations

import numba
import numpy as np

from rock2d.blind.reality import parameters
from rock2d.blind.reality.contact_detection import DEPTH, FACET, NX, NY, PX, PY
from rock2d.blind.reality.data_model import Array
from rock2d.blind.reality.forces import DEEPEST, K_L, K_UL, N_MEMORY, ON, SOFT, START, ZONE, press

# sums over the contacts: force, moment, horizontal force on the embankment, last outward unit vector, way in m to the
# next contact that may press, how many are on, how many press, how many of them enter first-loading soil
FX, FY, MOMENT, EMBANKMENT, OUT_X, OUT_Y, WAY, COUNT, PRESSING, VIRGIN = range(10)
N_SUMS = 10


@numba.njit
def begin(i: int, theta: float, late: float, zone: Array, found: Array, memory: Array, dial: Array) -> None:
    """Contact i begins; one that is found deeper than `late` in m was covered until now: it begins without force."""
    for k in range(N_MEMORY):
        memory[i, k] = 0.0
    memory[i, ON] = 1.0
    memory[i, ZONE] = zone[int(found[i, FACET])]
    memory[i, START] = found[i, DEPTH] if found[i, DEPTH] > late else 0.0
    soft = 1.0
    if dial[parameters.STRIP_FACTOR] > 0.0:
        into = (found[i, PX] - dial[parameters.STRIP_LEFT]) % dial[parameters.STRIP_PERIOD]
        soft = dial[parameters.STRIP_FACTOR] if into < dial[parameters.STRIP_WIDTH] else 1.0
    if dial[parameters.SIDE] > 0.0:
        facing = np.arctan2(-found[i, NY], -found[i, NX]) - theta - dial[parameters.SIDE_ANGLE]
        soft *= np.exp(-0.5 * dial[parameters.SIDE] * (1.0 + np.cos(facing)))
    memory[i, SOFT] = soft


@numba.njit
def settle(
    low: int, high: int, corners: int, theta: float, late: float, zone: Array, found: Array, memory: Array,
    dial: Array,
) -> int:  # fmt: skip
    """Let contacts begin and end: of the corners (0 to `corners`) and of `low` to `high`. Returns how many are on."""
    on = 0
    for i in range(corners + high - low):
        j = i if i < corners else low + i - corners
        if found[j, DEPTH] <= 0.0:
            memory[j, ON] = 0.0
            continue
        if memory[j, ON] == 0.0:
            begin(j, theta, late, zone, found, memory, dial)
        on += 1
    return on


@numba.njit
def add_up(
    low: int, high: int, corners: int, x: float, y: float, velocity: Array, going: Array, span: float, ground_vx: float,
    ground_vy: float, yielding: Array, soil: Array, indentation: bool, dial: Array, found: Array, memory: Array,
    sums: Array,
) -> None:  # fmt: skip
    """Fill `sums` with the forces of all contacts on a block at (x, y).

    velocity : of the block now (m/s, m/s, rad/s), for what depends on speeds; going : on the way of the last `span` s
    ground_vx : of the embankment's facets (`yielding`), ground_vy : of all ground, m/s; soil : (zones, 5)
    """
    for k in range(N_SUMS):
        sums[k] = 0.0
    sums[WAY] = 1e9
    for i in range(corners + high - low):
        j = i if i < corners else low + i - corners
        if memory[j, ON] == 0.0:
            sums[WAY] = min(sums[WAY], -found[j, DEPTH])
            continue
        nx, ny = found[j, NX], found[j, NY]
        rx, ry = found[j, PX] - x, found[j, PY] - y
        facet = int(found[j, FACET])
        gx = ground_vx if yielding[facet] > 0.0 else 0.0
        ux, uy = velocity[0] - velocity[2] * ry - gx, velocity[1] + velocity[2] * rx - ground_vy
        wx, wy = going[0] - going[2] * ry - gx, going[1] + going[2] * rx - ground_vy
        rate, slip = -(ux * nx + uy * ny), ux * ny - uy * nx
        slid = span * (wx * ny - wy * nx)
        zone = int(memory[j, ZONE])
        before = memory[j, DEEPEST]
        force, along, moment, pressing = press(
            found[j, DEPTH], rate, slip, slid, span * going[2], soil[zone], indentation, dial, memory[j]
        )
        fx, fy = force * nx + along * ny, force * ny - along * nx
        sums[FX] += fx
        sums[FY] += fy
        sums[MOMENT] += rx * fy - ry * fx + moment
        sums[OUT_X], sums[OUT_Y] = nx, ny
        sums[COUNT] += 1.0
        if yielding[facet] > 0.0:
            sums[EMBANKMENT] -= fx
        if pressing:
            sums[PRESSING] += 1.0
            if memory[j, DEEPEST] > before and rate > 0.0:
                sums[VIRGIN] += 1.0
        else:
            floor = memory[j, DEEPEST] * (1.0 - soil[zone, K_L] / soil[zone, K_UL])
            sums[WAY] = min(sums[WAY], floor - (found[j, DEPTH] - memory[j, START]))
