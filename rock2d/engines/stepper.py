"""One block in contact, advanced in time: fourth-order steps that land on the kinks of the law.

The state is q = (x, y, θ, vx, vy, ω). Each contact point of the block has a *slot* that carries its memory.
Within a step features are frozen and the law is evaluated at four Runge-Kutta stages; a step in which a contact
begins, ends, reloads, meets its former peak or passes its deepest point is repeated so that it ends right
there, which keeps the order of the scheme and the energy audit. Outside contacts a step is exact.
"""

from __future__ import annotations

import numpy as np

from rock2d.blocks import Block
from rock2d.compiled import njit
from rock2d.contact import (
    CAP,
    K_L,
    K_R,
    K_T,
    K_UL,
    MU,
    cross_zone,
    elastic_energy,
    normal_force,
    plastic_work,
    residual,
    rolling_energy,
    rolling_moment,
    tangential_force,
)
from rock2d.geometry import (
    CORNER_FACET,
    CORNER_VERTEX,
    SMOOTH_FACET,
    SMOOTH_VERTEX,
    VERTEX_FACE,
    contact_point,
    point_depth,
    polygon_depth,
)

# memory of a slot: integers, then reals
ACTIVE, KIND, INDEX, PART, ZONE, KEY = range(6)
DEPTH, RATE, DEPTH_MAX, STRETCH, ROTATION, OFFSET = range(6)
# audit: energy in J that each mechanism has taken
PLASTIC, FRICTION, ROLLING = range(3)

VERTEX_SLOTS = 8  # convex terrain corners under one polygon at a time
SMOOTH_SLOTS = 6  # patches and corners under one circle or ellipse at a time
NOWHERE = -1.0e300  # depth of a slot that has no feature

STEP_FRACTION = 0.05  # phase in rad of the stiffest contact oscillation that one step may cover


def slot_count(block: Block) -> int:
    """Number of contact slots that a block needs."""
    return SMOOTH_SLOTS if block.smooth else len(block.corners_m) + VERTEX_SLOTS


def contact_step_s(block: Block, table: np.ndarray, fraction: float = STEP_FRACTION) -> float:
    """Contact step in s: `fraction` of a radian of the stiffest oscillation, ω² = k (1/m + R²/I)."""
    mobility = 1 / block.mass_kg + block.radius_m**2 / block.inertia_kg_m2
    stiffness = max(table[:, K_UL].max() * mobility, table[:, K_T].max() * mobility)
    return float(fraction / np.sqrt(max(stiffness, table[:, K_R].max() / block.inertia_kg_m2)))


def new_slots(block: Block) -> tuple[np.ndarray, np.ndarray]:
    """Empty memory: (slots, 6) integers and (slots, 6) reals."""
    n = slot_count(block)
    ints, reals = np.zeros((n, 6), np.int64), np.zeros((n, 6))
    ints[:, KEY] = -1
    reals[:, DEPTH] = NOWHERE
    return ints, reals


@njit
def find_features(q, reach, f0, f1, terrain, block, ints, found_i, found_r):
    """Fill `found_*` with each slot's nearest feature and depth at pose q; slots keep the feature they follow.

    Only facets f0 to f1 - 1 are looked at; of vertices and smooth profiles, features farther above the ground
    than `reach` are left out (depth NOWHERE).
    """
    x, y, c, s = q[0], q[1], np.cos(q[2]), np.sin(q[2])
    found_i[:, :] = ints
    found_r[:, DEPTH] = NOWHERE
    n = block.corners.shape[0]
    if n > 0:
        for i in range(n):
            px = x + c * block.corners[i, 0] - s * block.corners[i, 1]
            py = y + s * block.corners[i, 0] + c * block.corners[i, 1]
            depth, kind, index = point_depth(px, py, terrain, f0, f1)
            _set(found_i, found_r, i, kind, index, i, depth, i)
        for v in range(max(f0, 1), f1):
            if terrain.convex[v]:
                px, py = terrain.points[v, 0], terrain.points[v, 1]
                depth, face = polygon_depth(px, py, x, y, c, s, block)
                if depth > -reach:
                    slot = _slot_for(ints, found_r, n, v)
                    if slot >= 0:
                        _set(found_i, found_r, slot, VERTEX_FACE, v, face, depth, v)
    else:
        _smooth_features(x, y, c, s, f0, f1, reach, terrain, block, ints, found_i, found_r)
    for j in range(found_i.shape[0]):
        if found_r[j, DEPTH] != NOWHERE:
            depth, nx, ny, rx, ry = contact_point(
                found_i[j, KIND], found_i[j, INDEX], found_i[j, PART], x, y, c, s, block, terrain
            )
            if found_i[j, KIND] == CORNER_VERTEX and found_r[j, DEPTH] < 0.0:
                nx, ny = -nx, -ny  # outside, the nearest vertex lies the other way
            found_r[j, RATE] = -((q[3] - q[5] * ry) * nx + (q[4] + q[5] * rx) * ny)


@njit
def _set(found_i, found_r, slot, kind, index, part, depth, key):
    found_i[slot, KIND], found_i[slot, INDEX], found_i[slot, PART] = kind, index, part
    found_i[slot, KEY] = key
    found_r[slot, DEPTH] = depth


@njit
def _slot_for(ints, found_r, start, key):
    """The slot that follows `key`, else a free one, else -1."""
    free, stale = -1, -1
    for j in range(start, ints.shape[0]):
        empty = not ints[j, ACTIVE] and found_r[j, DEPTH] == NOWHERE
        if ints[j, KEY] == key and (ints[j, ACTIVE] or empty):
            return j
        if empty and ints[j, KEY] < 0:
            free = j
        elif empty:
            stale = j
    return free if free >= 0 else stale


@njit
def _smooth_features(x, y, c, s, f0, f1, reach, terrain, block, ints, found_i, found_r):
    """Deepest feature of each smooth patch (key 2p) and of each convex corner (key 2p + 1)."""
    for f in range(f0, f1):
        depth, nx, ny, rx, ry = contact_point(SMOOTH_FACET, f, 0, x, y, c, s, block, terrain)
        along = (x + rx - terrain.points[f, 0]) * terrain.tangents[f, 0]
        along += (y + ry - terrain.points[f, 1]) * terrain.tangents[f, 1]
        if 0.0 <= along <= terrain.lengths[f]:
            if depth > -reach and depth < 2.0 * block.radius:
                _offer(ints, found_i, found_r, SMOOTH_FACET, f, depth, 2 * terrain.patches[f])
        elif along > terrain.lengths[f] and f + 1 < terrain.lengths.size:
            # between this facet's end and the next one's begin: the vertex, if the ground is convex there
            v = f + 1
            depth, nx, ny, rx, ry = contact_point(SMOOTH_VERTEX, v, 0, x, y, c, s, block, terrain)
            turn_out = nx * terrain.tangents[f, 0] + ny * terrain.tangents[f, 1]
            turn_in = nx * terrain.tangents[v, 0] + ny * terrain.tangents[v, 1]
            up = nx * (terrain.normals[f, 0] + terrain.normals[v, 0])
            up += ny * (terrain.normals[f, 1] + terrain.normals[v, 1])
            if depth > -reach and turn_out >= 0.0 >= turn_in and up > 0.0:
                key = 2 * terrain.patches[f] + (1 if terrain.convex[v] else 0)
                _offer(ints, found_i, found_r, SMOOTH_VERTEX, v, depth, key)
    for j in range(ints.shape[0]):
        # an active slot whose feature is gone has handed over to the neighbouring one
        if ints[j, ACTIVE] and found_r[j, DEPTH] == NOWHERE:
            for k in range(ints.shape[0]):
                if (
                    not ints[k, ACTIVE]
                    and found_r[k, DEPTH] != NOWHERE
                    and abs(found_i[k, KEY] - ints[j, KEY]) == 1
                ):
                    _set(
                        found_i, found_r, j, found_i[k, KIND], found_i[k, INDEX], 0, found_r[k, DEPTH],
                        found_i[k, KEY],
                    )  # fmt: skip
                    found_r[k, DEPTH] = NOWHERE
                    break


@njit
def _offer(ints, found_i, found_r, kind, index, depth, key):
    """Give a feature to the slot of its key, keeping the deepest of that key."""
    for j in range(ints.shape[0]):
        if found_r[j, DEPTH] != NOWHERE and found_i[j, KEY] == key:
            if depth > found_r[j, DEPTH]:
                _set(found_i, found_r, j, kind, index, 0, depth, key)
            return
    slot = _slot_for(ints, found_r, 0, key)
    if slot >= 0:
        _set(found_i, found_r, slot, kind, index, 0, depth, key)


@njit
def _slot_forces(j, depth, arm, stretch, rotation, ints, reals, p):
    """(F_n, F_t along +stretch, M along +rotation) of slot j at a depth and spring states."""
    force_n = normal_force(depth - reals[j, OFFSET], reals[j, DEPTH_MAX], p[K_L], p[K_UL])
    force_t = tangential_force(stretch, force_n, p[K_T], p[MU])
    return force_n, force_t, rolling_moment(rotation, force_n, arm, p[K_R], p[CAP])


@njit
def _rates(q, gravity, stretch, rotation, terrain, block, params, ints, reals, out, slip, spin, power):
    """Accelerations into out[0:3]; per slot the slip velocity and, while pressed, the spin that winds the
    rolling spring; power of tangential and rolling springs."""
    x, y, c, s = q[0], q[1], np.cos(q[2]), np.sin(q[2])
    fx, fy, moment = 0.0, 0.0, 0.0
    power[0], power[1] = 0.0, 0.0
    for j in range(ints.shape[0]):
        if not ints[j, ACTIVE]:
            continue
        depth, nx, ny, rx, ry = contact_point(
            ints[j, KIND], ints[j, INDEX], ints[j, PART], x, y, c, s, block, terrain
        )
        vx, vy = q[3] - q[5] * ry, q[4] + q[5] * rx
        u = vx * ny - vy * nx
        slip[j] = u
        arm = np.sqrt(rx * rx + ry * ry)
        force_n, force_t, rolling = _slot_forces(
            j, depth, arm, stretch[j], rotation[j], ints, reals, params[ints[j, ZONE]]
        )
        p = params[ints[j, ZONE]]
        pressed = depth - reals[j, OFFSET] >= residual(reals[j, DEPTH_MAX], p[K_L], p[K_UL])
        spin[j] = q[5] if pressed else 0.0
        gx, gy = force_n * nx - force_t * ny, force_n * ny + force_t * nx
        fx, fy = fx + gx, fy + gy
        moment += rx * gy - ry * gx - rolling
        power[0] += force_t * u
        power[1] += rolling * q[5]
    out[0], out[1], out[2] = fx / block.mass, fy / block.mass - gravity, moment / block.inertia


@njit
def _runge_kutta(q, h, gravity, terrain, block, params, ints, reals, work):
    """Classical fourth-order step. Returns q1, stretches, rotations and work of the two springs.

    `work` is scratch (see `scratch`); all returned arrays are views of it.
    """
    n = ints.shape[0]
    q1, stage, acc, vel, slip, slip_sum, stretch, rotation, energy, power, spin, spin_sum = work
    q1[:] = 0.0
    slip_sum[:], spin_sum[:], energy[:] = 0.0, 0.0, 0.0
    stage[:] = q
    for j in range(n):
        stretch[j], rotation[j] = reals[j, STRETCH], reals[j, ROTATION]
        slip[j], spin[j] = 0.0, 0.0
    for k in range(4):
        weight = 1.0 / 6.0 if k == 0 or k == 3 else 1.0 / 3.0  # noqa: PLR1714
        _rates(stage, gravity, stretch, rotation, terrain, block, params, ints, reals, acc, slip, spin, power)
        vel[:] = stage[3:6]
        for i in range(3):
            q1[i] += weight * vel[i]
            q1[i + 3] += weight * acc[i]
        slip_sum += weight * slip
        spin_sum += weight * spin
        energy += weight * power
        if k < 3:
            ahead = 0.5 * h if k < 2 else h
            for i in range(3):
                stage[i] = q[i] + ahead * vel[i]
                stage[i + 3] = q[i + 3] + ahead * acc[i]
            for j in range(n):
                stretch[j] = reals[j, STRETCH] + ahead * slip[j]
                rotation[j] = reals[j, ROTATION] + ahead * spin[j]
    for i in range(6):
        q1[i] = q[i] + h * q1[i]
    for j in range(n):
        stretch[j] = reals[j, STRETCH] + h * slip_sum[j]
        rotation[j] = reals[j, ROTATION] + h * spin_sum[j]
    energy *= h


@njit
def scratch(n):
    """Work arrays for n slots."""
    return (
        np.empty(6), np.empty(6), np.empty(3), np.empty(3), np.empty(n), np.empty(n), np.empty(n),
        np.empty(n), np.empty(2), np.empty(2), np.empty(n), np.empty(n),
    )  # fmt: skip


@njit
def _hermite_root(g0, r0, g1, r1, h):
    """Time in (0, h) at which the cubic through (g0, rate r0) and (g1, rate r1) changes sign."""
    low, high = 0.0, 1.0
    for _ in range(50):
        s = 0.5 * (low + high)
        value = g0 * (1 + 2 * s) * (1 - s) ** 2 + g1 * s * s * (3 - 2 * s)
        value += h * s * (1 - s) * (r0 * (1 - s) - r1 * s)
        if (value > 0.0) == (g1 > 0.0):
            high = s
        else:
            low = s
    return high * h


@njit
def _gap_to_found(j, q, ints, found_i, block, terrain):
    """What changes sign where slot j passes from its feature to the one found for it, and its rate.

    Two facets or faces: the difference of the depths. A facet and its re-entrant vertex: how far the point's
    foot lies from the facet's end (their depths touch there without crossing).
    """
    c, s = np.cos(q[2]), np.sin(q[2])
    d0, nx, ny, rx, ry = contact_point(
        ints[j, KIND], ints[j, INDEX], ints[j, PART], q[0], q[1], c, s, block, terrain
    )
    vx, vy = q[3] - q[5] * ry, q[4] + q[5] * rx
    if ints[j, KIND] <= CORNER_VERTEX and ints[j, KIND] != found_i[j, KIND]:
        facet, vertex = ints[j, INDEX], found_i[j, INDEX]
        if ints[j, KIND] == CORNER_VERTEX:
            facet, vertex = vertex, facet
        tx, ty = terrain.tangents[facet, 0], terrain.tangents[facet, 1]
        dx, dy = q[0] + rx - terrain.points[vertex, 0], q[1] + ry - terrain.points[vertex, 1]
        return dx * tx + dy * ty, vx * tx + vy * ty
    r0 = vx * nx + vy * ny
    d1, nx, ny, rx, ry = contact_point(
        found_i[j, KIND], found_i[j, INDEX], found_i[j, PART], q[0], q[1], c, s, block, terrain
    )
    r1 = (q[3] - q[5] * ry) * nx + (q[4] + q[5] * rx) * ny
    return d0 - d1, r1 - r0


@njit
def _first_kink(h, q0, q1, terrain, block, params, ints, reals, found_i, found_r):
    """Time in (0, h] of the first kink of the law within a trial step; h if there is none."""
    first = h
    for j in range(ints.shape[0]):
        d1, r1 = found_r[j, DEPTH], found_r[j, RATE]
        d0, r0 = reals[j, DEPTH], reals[j, RATE]
        if d0 == NOWHERE or d1 == NOWHERE:
            continue
        t = h
        if not ints[j, ACTIVE]:
            if d0 < 0.0 < d1 and ints[j, KEY] == found_i[j, KEY]:
                t = _hermite_root(d0, r0, d1, r1, h)
        else:
            p = params[ints[j, ZONE]]
            d0, d1 = d0 - reals[j, OFFSET], d1 - reals[j, OFFSET]
            peak = reals[j, DEPTH_MAX]
            gone = residual(peak, p[K_L], p[K_UL])
            if d0 >= peak and r0 > 0.0 and r1 < 0.0:
                t = h * r0 / (r0 - r1)
            elif (d0 > gone) != (d1 > gone):
                t = _hermite_root(d0 - gone, r0, d1 - gone, r1, h)
            elif d0 < peak < d1:
                t = _hermite_root(d0 - peak, r0, d1 - peak, r1, h)
            if (
                ints[j, INDEX] != found_i[j, INDEX]
                or ints[j, PART] != found_i[j, PART]
                or ints[j, KIND] != found_i[j, KIND]
            ):
                # another feature has become the nearest: land just behind the change
                g0, s0 = _gap_to_found(j, q0, ints, found_i, block, terrain)
                g1, s1 = _gap_to_found(j, q1, ints, found_i, block, terrain)
                if (g0 > 0.0) != (g1 > 0.0):
                    t = min(t, _hermite_root(g0, s0, g1, s1, h) + 1e-5 * h)
        if 1e-3 * h < t < first:
            first = t
    return first


@njit
def _commit(q, stretch, rotation, spring_work, terrain, block, params, ints, reals, found_i, found_r, audit):
    """Take a finished step into the memory and the audit; returns the number of active slots."""
    active = 0
    before_t, before_r, after_t, after_r = 0.0, 0.0, 0.0, 0.0
    for j in range(ints.shape[0]):
        depth = found_r[j, DEPTH]
        reals[j, DEPTH], was = depth, reals[j, DEPTH]
        if ints[j, ACTIVE]:
            p = params[ints[j, ZONE]]
            arm = _arm(ints, j, q, block, terrain)
            old_n = normal_force(was - reals[j, OFFSET], reals[j, DEPTH_MAX], p[K_L], p[K_UL])
            old_t = tangential_force(reals[j, STRETCH], old_n, p[K_T], p[MU])
            before_t += elastic_energy(0.0, old_t, p)
            before_r += rolling_energy(reals[j, ROTATION], p)
            pressed = depth - reals[j, OFFSET]
            peak = reals[j, DEPTH_MAX]
            if pressed > peak:
                audit[PLASTIC] += plastic_work(pressed, p[K_L], p[K_UL]) - plastic_work(peak, p[K_L], p[K_UL])
                reals[j, DEPTH_MAX] = peak = pressed
            ints[j, KIND], ints[j, INDEX] = found_i[j, KIND], found_i[j, INDEX]
            ints[j, PART], ints[j, KEY] = found_i[j, PART], found_i[j, KEY]
            force_n = normal_force(pressed, peak, p[K_L], p[K_UL])
            force_t = tangential_force(stretch[j], force_n, p[K_T], p[MU])
            moment = rolling_moment(rotation[j], force_n, arm, p[K_R], p[CAP])
            after_t += elastic_energy(0.0, force_t, p)
            # springs slip with their limits; the soil bank of the rolling spring outlasts a lift in the crater
            reals[j, STRETCH] = force_t / p[K_T] if p[K_T] > 0.0 else 0.0
            reals[j, ROTATION] = moment / p[K_R] if p[CAP] > 0.0 and p[K_R] > 0.0 else rotation[j]
            if depth > 0.0:
                after_r += rolling_energy(reals[j, ROTATION], p)
            zone = _zone(ints, j, terrain)
            if zone != ints[j, ZONE] and force_n > 0.0:
                new = params[zone]
                kept = reals[j, ROTATION]
                stored = elastic_energy(force_n, force_t, p) + rolling_energy(kept, p)
                peak, reals[j, STRETCH], reals[j, ROTATION] = cross_zone(force_n, force_t, kept, p, new)
                reals[j, DEPTH_MAX], reals[j, OFFSET] = peak, depth - peak
                stored -= elastic_energy(new[K_L] * peak, new[K_T] * reals[j, STRETCH], new)
                audit[PLASTIC] += stored - rolling_energy(reals[j, ROTATION], new)
            ints[j, ZONE] = zone
            if depth <= 0.0:
                if depth == NOWHERE:  # slid off its feature: what was stored is lost
                    audit[PLASTIC] += elastic_energy(old_n, 0.0, p)
                _release(ints, reals, j)
        elif depth > -1e-10 * block.radius and found_r[j, RATE] >= 0.0 or depth > 0.0:
            ints[j, ACTIVE] = 1
            ints[j, KIND], ints[j, INDEX] = found_i[j, KIND], found_i[j, INDEX]
            ints[j, PART], ints[j, KEY] = found_i[j, PART], found_i[j, KEY]
            ints[j, ZONE] = _zone(ints, j, terrain)
            reals[j, DEPTH_MAX], reals[j, STRETCH], reals[j, ROTATION] = 0.0, 0.0, 0.0
            reals[j, OFFSET] = depth  # contacts begin without force, at the surface to rounding
        reals[j, RATE] = found_r[j, RATE]
        if ints[j, ACTIVE]:
            active += 1
        else:
            ints[j, KEY] = found_i[j, KEY] if depth != NOWHERE else -1
    audit[FRICTION] += spring_work[0] - (after_t - before_t)
    audit[ROLLING] += spring_work[1] - (after_r - before_r)
    return active


@njit
def _release(ints, reals, j):
    ints[j, ACTIVE] = 0
    reals[j, DEPTH_MAX], reals[j, STRETCH], reals[j, ROTATION], reals[j, OFFSET] = 0.0, 0.0, 0.0, 0.0


@njit
def _arm(ints, j, q, block, terrain):
    _, _, _, rx, ry = contact_point(
        ints[j, KIND], ints[j, INDEX], ints[j, PART], q[0], q[1], np.cos(q[2]), np.sin(q[2]), block, terrain
    )
    return np.sqrt(rx * rx + ry * ry)


@njit
def _zone(ints, j, terrain):
    """Zone of a slot's feature; a vertex belongs to the facet before it, unless the slot knows better."""
    index = ints[j, INDEX]
    if ints[j, KIND] == CORNER_FACET or ints[j, KIND] == SMOOTH_FACET:  # noqa: PLR1714
        return terrain.zones[index]
    before = terrain.zones[max(index - 1, 0)]
    after = terrain.zones[min(index, terrain.zones.size - 1)]
    return after if ints[j, ACTIVE] and ints[j, ZONE] == after else before


@njit
def begin(q, f0, f1, terrain, block, ints, reals, found_i, found_r):
    """Look at the ground for the first time: note depths, and seat what already touches."""
    find_features(q, block.radius, f0, f1, terrain, block, ints, found_i, found_r)
    for j in range(ints.shape[0]):
        depth = found_r[j, DEPTH]
        reals[j, DEPTH], reals[j, RATE] = depth, found_r[j, RATE]
        ints[j, KEY] = found_i[j, KEY] if depth != NOWHERE else -1
        if depth > 0.0 or (depth == 0.0 and found_r[j, RATE] > 0.0):
            ints[j, :] = found_i[j, :]
            ints[j, ACTIVE] = 1
            ints[j, ZONE] = _zone(ints, j, terrain)
            reals[j, OFFSET] = depth


@njit
def stored_energy(ints, reals, params):
    """Energy in J that the springs of all contacts hold."""
    total = 0.0
    for j in range(ints.shape[0]):
        if ints[j, ACTIVE]:
            p = params[ints[j, ZONE]]
            force_n = normal_force(reals[j, DEPTH] - reals[j, OFFSET], reals[j, DEPTH_MAX], p[K_L], p[K_UL])
            force_t = tangential_force(reals[j, STRETCH], force_n, p[K_T], p[MU])
            total += elastic_energy(force_n, force_t, p) + rolling_energy(reals[j, ROTATION], p)
    return total


@njit
def pressure(ints, reals, params):
    """(sum of normal forces in N, largest penetration in m, number of active contacts)."""
    force, deepest, active = 0.0, 0.0, 0
    for j in range(ints.shape[0]):
        if ints[j, ACTIVE]:
            p = params[ints[j, ZONE]]
            force += normal_force(reals[j, DEPTH] - reals[j, OFFSET], reals[j, DEPTH_MAX], p[K_L], p[K_UL])
            deepest = max(deepest, reals[j, DEPTH])
            active += 1
    return force, deepest, active


@njit
def step(q, h, f0, f1, gravity, terrain, block, params, ints, reals, found_i, found_r, work, audit):
    """Advance q in place by at most h, to the first kink of the law if that comes before. Returns the time gone.

    (found_i, found_r, work) are scratch of the sizes of `new_slots` and `scratch`.
    """
    reach = 4.0 * h * (np.sqrt(q[3] * q[3] + q[4] * q[4]) + abs(q[5]) * block.radius) + 1e-6 * block.radius
    q1, stretch, rotation, spring_work = work[0], work[6], work[7], work[8]
    _runge_kutta(q, h, gravity, terrain, block, params, ints, reals, work)
    find_features(q1, reach, f0, f1, terrain, block, ints, found_i, found_r)
    kink = _first_kink(h, q, q1, terrain, block, params, ints, reals, found_i, found_r)
    if kink < h:
        _runge_kutta(q, kink, gravity, terrain, block, params, ints, reals, work)
        find_features(q1, reach, f0, f1, terrain, block, ints, found_i, found_r)
    q[:] = q1
    _commit(q, stretch, rotation, spring_work, terrain, block, params, ints, reals, found_i, found_r, audit)
    return kink
