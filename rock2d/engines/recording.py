"""Recording of line crossings, samples, knots and impacts while a release runs, compiled."""

from typing import NamedTuple

import numpy as np

from rock2d.compiled import copy, kernel
from rock2d.effects.columns import FIRST_EFFECT_COLUMN
from rock2d.effects.forces import departure
from rock2d.engines.contact_state import ACTIVE, ZONE, kinetic_energy
from rock2d.engines.event_detection import hermite_root
from rock2d.engines.free_flight import air_acts, fly
from rock2d.records.columns import (
    AFTER,
    AFTER_INSTANT,
    BEFORE,
    EFFECTS,
    GROUND_SHIFT,
    I_FORCE,
    I_PENETRATION,
    I_TIME,
    I_TIME_AFTER,
    I_ZONE,
    INSTANT_STATE,
    INSTANT_X,
    KNOT_FLIGHT,
    N_POSE,
    N_STATE,
    OMEGA,
    RECOIL,
    RECOIL_SHIFT,
    THETA,
    TIME,
    VX,
    VY,
    X,
    Y,
)

# share of the largest force of an impact, below which the block has lifted off
LEAST_PRESSURE = 1e-6
# columns of a measure line: its two ends
LINE_X, LINE_Y, LINE_END_X, LINE_END_Y = range(4)


class LineRecord(NamedTuple):
    """Measure lines and their crossings."""

    ends: np.ndarray  # (lines, 4) end points of measure lines, NaN where there are fewer
    crossings: np.ndarray  # (lines, N_INSTANT), NaN where a line was not crossed


class SampleRecord(NamedTuple):
    """Poses at given instants."""

    times: np.ndarray  # (times,) s, in order
    poses: np.ndarray  # (times, 3)


class Recorder(NamedTuple):
    """The arrays into which a release writes its results."""

    lines: LineRecord
    samples: SampleRecord
    impacts: np.ndarray  # (room, N_IMPACT)
    audit: np.ndarray  # (N_AUDIT,)
    knots: np.ndarray  # (room, N_KNOT); with room 0 none are written


@kernel
def note_crossings(interval, q0, q1, flight, body, record):
    """Note the first crossing of each measure line between q0 and q1; returns the number of new ones.

    interval : (time in s at q0, time in s from there to q1)"""
    t, tau = interval
    block, gravity = body
    lines, crossings = record
    new = 0
    for k in range(lines.shape[0]):
        if crossings[k, TIME] == crossings[k, TIME] or lines[k, LINE_X] != lines[k, LINE_X]:
            continue
        ax, ay = lines[k, LINE_END_X] - lines[k, LINE_X], lines[k, LINE_END_Y] - lines[k, LINE_Y]
        side0 = (q0[Y] - lines[k, LINE_Y]) * ax - (q0[X] - lines[k, LINE_X]) * ay
        side1 = (q1[Y] - lines[k, LINE_Y]) * ax - (q1[X] - lines[k, LINE_X]) * ay
        when = -1.0
        if flight and air_acts(block):
            if side0 * side1 >= 0.0:
                continue
            rate0, rate1 = q0[VY] * ax - q0[VX] * ay, q1[VY] * ax - q1[VX] * ay
            when = hermite_root(side0, rate0, side1, rate1, tau)
        elif flight:
            # a s² + b s + c = 0, the side of the line along the parabola
            a, b = -0.5 * gravity * ax, q0[VY] * ax - q0[VX] * ay
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
                    x, y = q0[X] + q0[VX] * low, q0[Y] + q0[VY] * low - 0.5 * gravity * low * low
                    when = low if low > 0.0 and _on_line(x, y, lines[k], ax, ay) else high
            if not 0.0 < when <= tau:
                continue
        elif side0 * side1 < 0.0:
            when = tau * side0 / (side0 - side1)
        else:
            continue
        found = crossings[k, INSTANT_STATE]
        copy(q0, found)
        if flight:
            fly(found, when, gravity, block)
        else:
            s = when / tau
            for i in range(N_STATE):
                found[i] = q0[i] + s * (q1[i] - q0[i])
        if not _on_line(found[X], found[Y], lines[k], ax, ay):
            found[:] = np.nan
            continue
        crossings[k, TIME] = t + when
        new += 1
    return new


@kernel
def near_line(q, reach, record):
    """Whether the centroid is within `reach` (m) of a measure line that it has not crossed."""
    lines, crossings = record
    for k in range(lines.shape[0]):
        if crossings[k, TIME] == crossings[k, TIME] or lines[k, LINE_X] != lines[k, LINE_X]:
            continue
        ax, ay = lines[k, LINE_END_X] - lines[k, LINE_X], lines[k, LINE_END_Y] - lines[k, LINE_Y]
        dx, dy = q[X] - lines[k, LINE_X], q[Y] - lines[k, LINE_Y]
        along = min(max((dx * ax + dy * ay) / (ax * ax + ay * ay), 0.0), 1.0)
        dx, dy = dx - along * ax, dy - along * ay
        if dx * dx + dy * dy < reach * reach:
            return True
    return False


@kernel
def _on_line(x, y, line, ax, ay):
    at = ((x - line[LINE_X]) * ax + (y - line[LINE_Y]) * ay) / (ax * ax + ay * ay)
    return 0.0 <= at <= 1.0


@kernel
def is_spent(q, stored, body, record):
    """Whether the remaining energy is too small to reach any measure line that was not crossed.

    stored : energy in J in the springs of contacts"""
    lines, crossings = record
    highest = q[Y] + (kinetic_energy(q, body.block) + stored) / (body.block.mass * body.gravity)
    for k in range(lines.shape[0]):
        if crossings[k, TIME] != crossings[k, TIME] and min(lines[k, LINE_Y], lines[k, LINE_END_Y]) <= highest:
            return False
    return True


@kernel
def note_samples(interval, states, parabola, body, shift, record, at):
    """Fill the samples that lie in (t, t + tau]; returns the index of the next one.

    interval : (t, tau) in s; states: at t and at t + tau; parabola: whether it is a free flight; shift:
    GROUND_SHIFT, by which the ground of the states has moved; at: index of the first sample after t"""
    (t, tau), (q0, q1) = interval, states
    times, samples = record
    while at < times.size and times[at] <= t + tau:
        s = times[at] - t
        if parabola:
            samples[at, X] = q0[X] + q0[VX] * s
            samples[at, Y] = q0[Y] + q0[VY] * s - 0.5 * body.gravity * s * s
            samples[at, THETA] = q0[THETA] + q0[OMEGA] * s
        else:
            u = s / tau
            for i in range(N_POSE):
                samples[at, i] = (
                    q0[i] * (1 + 2 * u) * (1 - u) ** 2
                    + q0[i + VX] * tau * u * (1 - u) ** 2
                    + q1[i] * u * u * (3 - 2 * u)
                    + q1[i + VX] * tau * u * u * (u - 1)
                )
        samples[at, X] += shift
        at += 1
    return at


@kernel
def note_knot(knots, used, t, q, shift, flight):
    """Note a knot if there is room; returns the number of knots, also of those without room. `shift`: GROUND_SHIFT."""
    if used < len(knots):
        knots[used, TIME] = t
        copy(q, knots[used, INSTANT_STATE])
        knots[used, INSTANT_X] += shift
        knots[used, KNOT_FLIGHT] = flight
    return used + 1


@kernel
def _set_nan(values):
    for i in range(values.size):
        values[i] = np.nan


@kernel
def open_impact(current, t, q, memory):
    """Begin the record of an impact at time t, in the zone of the first active contact."""
    ints = memory.ints
    current[I_ZONE] = -1.0
    for j in range(ints.shape[0]):
        if ints[j, ACTIVE]:
            current[I_ZONE] = ints[j, ZONE]
            break
    current[I_TIME] = t
    copy(q, current[BEFORE])
    _set_nan(current[AFTER_INSTANT])
    current[I_PENETRATION], current[I_FORCE] = 0.0, 0.0


@kernel
def note_pressure(current, lifted, force, depth, t, q):
    """Update the open impact with the sum of forces (N) and the largest depth (m) at time t (s).

    Returns whether the block has lifted off, that is the ground no longer presses; notes the state at lift-off."""
    current[I_PENETRATION] = max(current[I_PENETRATION], depth)
    current[I_FORCE] = max(current[I_FORCE], force)
    if force > LEAST_PRESSURE * current[I_FORCE]:
        return False
    if not lifted:
        current[I_TIME_AFTER] = t
        copy(q, current[AFTER])
    return True


@kernel(forceinline=True)
def note_recoil(h, added, audit):
    """Note that the frame of recoiling ground has `added` a velocity in m/s to the block in a step of h (s)."""
    moved = -h * (audit[RECOIL] + 0.5 * added)
    audit[RECOIL_SHIFT] += moved
    audit[GROUND_SHIFT] += moved
    audit[RECOIL] += added


@kernel
def _apply_departure(state, row, recoil):
    """Change the velocities of a block at the end of an impact by the effects of the zone of `row`: transform them back
    from the frame of recoiling ground, and apply the laws of departure."""
    state[VX], state[VY], state[OMEGA] = departure(
        row, FIRST_EFFECT_COLUMN, state[VX] - recoil, state[VY], state[OMEGA]
    )


@kernel
def end_impact(q, current, row, block, audit):
    """End the open impact: apply the laws of departure, and book the energy that they dissipate. Returns whether they
    changed the energy."""
    before = kinetic_energy(q, block)
    _apply_departure(q, row, audit[RECOIL])
    _apply_departure(current[AFTER], row, audit[RECOIL])
    audit[RECOIL] = audit[RECOIL_SHIFT] = 0.0
    dissipated = before - kinetic_energy(q, block)
    audit[EFFECTS] += dissipated
    return dissipated != 0.0


@kernel
def close_impact(current, lifted, impacts, count):
    """Record an impact if there is room; without lift-off, its state after is NaN. Returns the number of impacts."""
    if count < len(impacts):
        copy(current, impacts[count])
        if not lifted:
            _set_nan(impacts[count, AFTER_INSTANT])
    return count + 1
