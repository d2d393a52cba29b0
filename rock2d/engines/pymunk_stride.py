"""One step of the pymunk engine near the ground in a single compiled call."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from rock2d.compiled import copy, njit
from rock2d.engines import contact_energy, contact_step
from rock2d.engines.geometry import Body, facet_range, point_depth
from rock2d.engines.recording import close_impact, end_impact, note_pressure, open_impact
from rock2d.engines.rest import forget_rest, watch_rest
from rock2d.records.columns import I_ZONE, INSTANT_STATE, N_INSTANT, TIME, X, Y

ROOM = 64  # rows for the knots and the impacts of one call
# columns of a knot: instant and state, number of active contacts, sum of forces in N, largest depth in m, whether the
# block flew freely since the knot before
K_ACTIVE, K_FORCE, K_DEPTH, K_FLEW = range(N_INSTANT, N_INSTANT + 4)
N_ROW = K_FLEW + 1


class Impacts(NamedTuple):
    """The open impact, and those that a call has closed."""

    current: np.ndarray  # (N_IMPACT,)
    closed: np.ndarray  # (ROOM, N_IMPACT)
    flags: np.ndarray  # (2,) whether an impact is open, whether the block has lifted off in it


OPEN, LIFTED = range(2)


class Stride(NamedTuple):
    """A step of pymunk, and the facets near the block."""

    start: float  # s
    length: float  # s
    gone: float  # s, part of it that earlier calls have computed
    first: int  # index of the first facet near
    last: int  # one past the last


@njit
def advance(q, stride, world, contacts, audit, impacts, rows):
    """Advance q through a stride with the contact law, with a knot at every event.

    impacts : Impacts; rows : (ROOM, N_ROW) for the knots

    Returns (number of knots, number of closed impacts, computed time of the stride in s). If the rows are full, the
    stride is not complete.
    """
    memory, found, _ = contacts
    current, closed, flags = impacts
    near = (stride.first, stride.last)
    used, count, gone, dt = 0, 0, stride.gone, stride.length
    while dt - gone > 1e-12 * dt and used + 2 <= len(rows):
        gone += contact_step.step(q, dt - gone, near, world, contacts, audit, False)
        t, (force, depth, active) = stride.start + gone, contact_energy.pressure(memory, world.law)
        _knot(rows[used], t, q)
        row = rows[used]
        row[K_ACTIVE], row[K_FORCE], row[K_DEPTH] = active, force, depth
        row[K_FLEW] = 1.0 if active == 0 and flags[OPEN] == 0 else 0.0
        used += 1
        if flags[OPEN] == 0:
            open_if_touching(t, q, active, memory, impacts)
            continue
        flags[LIFTED] = note_pressure(current, flags[LIFTED] != 0, force, depth, t, q)
        if active == 0:
            if end_impact(q, current, world.law[int(current[I_ZONE])], world.block, audit):
                contact_step.refresh_depths(q, near, world, memory, found)
            count, flags[OPEN] = close_impact(current, flags[LIFTED] != 0, closed, count), 0
            if not _same(q, row[INSTANT_STATE]):  # an effect has changed the velocities at this instant
                _knot(rows[used], t, q)
                rows[used, K_FLEW] = 1.0
                used += 1
    return used, count, gone


@njit
def open_if_touching(t, q, active, memory, impacts):
    """Begin an impact at time t (s) if there are active contacts."""
    if active > 0:
        open_impact(impacts.current, t, q, memory)
        impacts.flags[OPEN], impacts.flags[LIFTED] = 1, 0


@njit
def _knot(row, t, q):
    """Write a knot without contacts."""
    for i in range(N_ROW):
        row[i] = 0.0
    row[TIME] = t
    copy(q, row[INSTANT_STATE])


@njit
def depth_and_rest(q, t, touching, world, reach, watch):
    """After a stride: (depth of the centroid below the surface nearby in m, whether the block has come to rest).

    touching : whether an impact is open; reach : of the block, in m
    """
    first, last = facet_range(world.ground, q[X] - 2.0 * reach, q[X] + 2.0 * reach)
    depth, _, _ = point_depth(q[X], q[Y], world.ground.facets, first, last)
    if touching:
        return depth, watch_rest(watch, t, q, Body(world.block, world.gravity))
    forget_rest(watch)
    return depth, False


@njit
def _same(q, other):
    same = True
    for i in range(q.size):
        same = same and q[i] == other[i]
    return same
