"""What a release leaves behind: line crossings, samples, knots and impacts, noted while it runs, compiled."""

from __future__ import annotations

import numpy as np

from rock2d.compiled import copy, kernel
from rock2d.effects.forces import FIRST, departure
from rock2d.engines.contact_energy import kinetic_energy
from rock2d.engines.contact_state import ACTIVE, ZONE
from rock2d.engines.contact_step import EFFECTS, PRESSED, RECOIL
from rock2d.engines.event_detection import hermite_root
from rock2d.engines.free_flight import fly, in_air

# one impact: zone id, t, state before (6), t after, state after (6), penetration, force
N_IMPACT = 17


@kernel
def cross(t, q0, tau, q1, flight, gravity, block, lines, crossings):
    """Note the first crossing of each measure line on the way from q0 to q1; returns how many are new."""
    new = 0
    for k in range(lines.shape[0]):
        if crossings[k, 0] == crossings[k, 0] or lines[k, 0] != lines[k, 0]:
            continue
        ax, ay = lines[k, 2] - lines[k, 0], lines[k, 3] - lines[k, 1]
        side0 = (q0[1] - lines[k, 1]) * ax - (q0[0] - lines[k, 0]) * ay
        side1 = (q1[1] - lines[k, 1]) * ax - (q1[0] - lines[k, 0]) * ay
        when = -1.0
        if flight and in_air(block):
            if side0 * side1 >= 0.0:
                continue
            rate0, rate1 = q0[4] * ax - q0[3] * ay, q1[4] * ax - q1[3] * ay
            when = hermite_root(side0, rate0, side1, rate1, tau)
        elif flight:
            # a s² + b s + c = 0, the side of the line along the parabola
            a, b = -0.5 * gravity * ax, q0[4] * ax - q0[3] * ay
            if a == 0.0:
                if b != 0.0:
                    when = -side0 / b
            else:
                disc = b * b - 4.0 * a * side0
                if disc > 0.0:
                    root = -0.5 * (b + np.copysign(np.sqrt(disc), b))
                    low, high = root / a, side0 / root if root != 0.0 else 0.0
                    if low > high:
                        low, high = high, low
                    x, y = q0[0] + q0[3] * low, q0[1] + q0[4] * low - 0.5 * gravity * low * low
                    when = low if low > 0.0 and _on_line(x, y, lines[k], ax, ay) else high
            if not 0.0 < when <= tau:
                continue
        elif side0 * side1 < 0.0:
            when = tau * side0 / (side0 - side1)
        else:
            continue
        found = crossings[k, 1:]
        copy(q0, found)
        if flight:
            fly(found, when, gravity, block)
        else:
            s = when / tau
            for i in range(6):
                found[i] = q0[i] + s * (q1[i] - q0[i])
        if not _on_line(found[0], found[1], lines[k], ax, ay):
            found[:] = np.nan
            continue
        crossings[k, 0] = t + when
        new += 1
    return new


@kernel
def near_line(q, reach, lines, crossings):
    """True if the centroid is within `reach` of a measure line that it has not crossed."""
    for k in range(lines.shape[0]):
        if crossings[k, 0] == crossings[k, 0] or lines[k, 0] != lines[k, 0]:
            continue
        ax, ay = lines[k, 2] - lines[k, 0], lines[k, 3] - lines[k, 1]
        dx, dy = q[0] - lines[k, 0], q[1] - lines[k, 1]
        along = min(max((dx * ax + dy * ay) / (ax * ax + ay * ay), 0.0), 1.0)
        dx, dy = dx - along * ax, dy - along * ay
        if dx * dx + dy * dy < reach * reach:
            return True
    return False


@kernel
def _on_line(x, y, line, ax, ay):
    at = ((x - line[0]) * ax + (y - line[1]) * ay) / (ax * ax + ay * ay)
    return 0.0 <= at <= 1.0


@kernel
def is_spent(q, stored, gravity, block, lines, crossings):
    """True if no measure line that was not crossed begins low enough for the energy that is left."""
    highest = q[1] + (kinetic_energy(q, block) + stored) / (block.mass * gravity)
    for k in range(lines.shape[0]):
        if crossings[k, 0] != crossings[k, 0] and min(lines[k, 1], lines[k, 3]) <= highest:
            return False
    return True


@kernel
def sample(t, q0, tau, q1, parabola, gravity, times, at, samples):
    """Fill the samples that lie in (t, t + tau]; returns the index of the next one."""
    while at < times.size and times[at] <= t + tau:
        s = times[at] - t
        if parabola:
            samples[at, 0] = q0[0] + q0[3] * s
            samples[at, 1] = q0[1] + q0[4] * s - 0.5 * gravity * s * s
            samples[at, 2] = q0[2] + q0[5] * s
        else:
            u = s / tau
            for i in range(3):
                samples[at, i] = (
                    q0[i] * (1 + 2 * u) * (1 - u) ** 2
                    + q0[i + 3] * tau * u * (1 - u) ** 2
                    + q1[i] * u * u * (3 - 2 * u)
                    + q1[i + 3] * tau * u * u * (u - 1)
                )
        at += 1
    return at


@kernel
def knot(knots, used, t, q, flight):
    if used < len(knots):
        knots[used, 0] = t
        copy(q, knots[used, 1:7])
        knots[used, 7] = flight
    return used + 1


@kernel
def open_impact(current, t, q, ints):
    current[0] = -1.0
    for j in range(ints.shape[0]):
        if ints[j, ACTIVE]:
            current[0] = ints[j, ZONE]
            break
    current[1] = t
    copy(q, current[2:8])
    current[8:15] = np.nan
    current[15], current[16] = 0.0, 0.0


@kernel
def note_pressure(current, left, force, depth, t, q):
    """Take the sum of forces and the largest depth at time t into the open impact.

    Returns whether the ground has ceased to press; the state is noted where it last did.
    """
    current[15] = max(current[15], depth)
    current[16] = max(current[16], force)
    if force > PRESSED * current[16]:
        return False
    if not left:
        current[8] = t
        copy(q, current[9:15])
    return True


@kernel
def depart(state, row, recoil):
    """What effects make of a block's velocities at the end of an impact in the zone of `row`: back from the frame of
    recoiling ground, and whatever laws of departure say."""
    state[3], state[4], state[5] = departure(row, FIRST, state[3] - recoil, state[4], state[5])


@kernel
def end_impact(q, current, row, block, audit):
    """Let the block depart from the open impact, and take what that takes into the audit. Returns whether it did."""
    before = kinetic_energy(q, block)
    depart(q, row, audit[RECOIL])
    depart(current[9:15], row, audit[RECOIL])
    audit[RECOIL] = 0.0
    taken = before - kinetic_energy(q, block)
    audit[EFFECTS] += taken
    return taken != 0.0


@kernel
def close_impact(current, left, impacts, count):
    """Record an impact if there is room; one that still presses has no state after."""
    if count < len(impacts):
        copy(current, impacts[count])
        if not left:
            impacts[count, 8:15] = np.nan
    return count + 1
