"""What the pymunk engine computes in one of its steps near the ground, compiled: one call instead of ten."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from rock2d.compiled import copy, njit
from rock2d.engines import contact_energy, contact_step
from rock2d.engines.contact_state import ACTIVE, ZONE
from rock2d.engines.geometry import Body, facet_range, point_depth
from rock2d.engines.recording import end_impact
from rock2d.engines.rest import forget_rest, watch_rest
from rock2d.records.columns import INSTANT_STATE, N_IMPACT, N_INSTANT, RECOIL, TIME, X, Y

ROOM = 64  # rows for the knots of one call
# columns of a knot: instant and state, number of active contacts, sum of forces in N, largest depth in m, zone of the
# impact that has just ended (-1: none), velocity in m/s that recoiling ground gave the block in it
K_ACTIVE, K_FORCE, K_DEPTH, K_ZONE, K_RECOIL = range(N_INSTANT, N_INSTANT + 5)
N_ROW = K_RECOIL + 1


class Stride(NamedTuple):
    """What a stride is of."""

    start: float  # s
    length: float  # s
    gone: float  # s of it that earlier calls have done
    first: int  # index of the first facet near
    last: int  # one past the last


@njit
def advance(q, stride, world, contacts, audit, zone, rows):
    """Advance q through a stride in the contact law, with every event of it as a knot.

    zone : of the open impact, -1 if none; rows : (ROOM, N_ROW) for the knots

    Returns (number of knots, time gone in s, zone of the open impact); the stride is not over if rows are full.
    """
    memory, found, _ = contacts
    near = (stride.first, stride.last)
    used, gone, dt = 0, stride.gone, stride.length
    while dt - gone > 1e-12 * dt and used + 2 <= len(rows):
        gone += contact_step.step(q, dt - gone, near, world, contacts, audit, False)
        force, depth, active = contact_energy.pressure(memory, world.law)
        row = rows[used]
        row[TIME] = stride.start + gone
        copy(q, row[INSTANT_STATE])
        row[K_ACTIVE], row[K_FORCE], row[K_DEPTH], row[K_ZONE], row[K_RECOIL] = (
            active,
            force,
            depth,
            -1.0,
            0.0,
        )
        used += 1
        if active > 0 and zone < 0:
            zone = first_zone(memory)
        elif active == 0 and zone >= 0:
            row[K_ZONE], row[K_RECOIL] = zone, audit[RECOIL]
            if end_impact(q, np.zeros(N_IMPACT), world.law[zone], world.block, audit):
                contact_step.refresh_depths(q, near, world, memory, found)
            zone = np.int64(-1)
            if not _same(q, row[INSTANT_STATE]):  # velocities that change at once
                after = rows[used]
                after[TIME], after[K_ZONE] = row[TIME], -1.0
                after[K_ACTIVE] = after[K_FORCE] = after[K_DEPTH] = after[K_RECOIL] = 0.0
                copy(q, after[INSTANT_STATE])
                used += 1
    return used, gone, zone


@njit
def first_zone(memory):
    """Zone of the first active contact; -1 if there is none."""
    for j in range(memory.ints.shape[0]):
        if memory.ints[j, ACTIVE]:
            return memory.ints[j, ZONE]
    return np.int64(-1)


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
