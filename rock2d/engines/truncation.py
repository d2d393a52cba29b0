"""The energy that a contact step makes or loses by truncation, and its correction, compiled.

A Runge-Kutta step keeps the balance of energy only to its order. The balance is known exactly, so the error is too: it
says when a step is too long, and what is left is taken out of the impulse. Projection onto an invariant keeps the
order of a scheme (Hairer, Lubich, Wanner: Geometric Numerical Integration, IV.4).
"""

from __future__ import annotations

from rock2d.compiled import kernel
from rock2d.engines.contact_energy import kinetic_energy
from rock2d.engines.loaded_contacts import (
    L_LAW,
    L_ROTATION,
    MOMENT_1,
    NORMAL_0,
    NORMAL_1,
    PLASTIC_WORK,
    TAKEN_DISPLACEMENT,
    TAKEN_ROTATION,
    TANGENTIAL_0,
    TANGENTIAL_1,
)
from rock2d.laws.contact import K_R, K_T, K_UL
from rock2d.records.columns import CORRECTED, OMEGA, PENDING, THETA, VX, VY, X, Y

LARGEST_STEP_ERROR = 0.0005  # share of the energy that a step may err by; beyond it the step is too long
MOST_HALVINGS = 12  # halvings of a step that errs too much
LARGEST_CORRECTION = 0.01  # largest correction, as a share of a step's impulse; the rest waits
LEAST_ERROR = 1e-7  # share of the kinetic energy: a smaller error may always wait
POSE_ROUNDING = 2e-15  # relative rounding of positions, and of arms times angles: several machine epsilons


@kernel(forceinline=True)
def step_error(q, q1, h, works, body, active, loaded):
    """(energy in J that a step of h (s) from q to q1 has made, energy in J that it should be small against, whether the
    step is too long, work in J that tangential springs took, and rolling springs).

    works : what these springs took by the quadrature of the step. Springs that do not slip took what they store, to the
        last bit, and those that slip no less: friction gives nothing back.

    The step is too long if its error is no small part of the energy, or more than a correction of the impulse can take.
    What the step leaves of each contact is in the rows of `loaded.trial`, see `contact_update.note_outcome`.
    """
    block, rows, trial, rates = body.block, loaded.rows, loaded.trial, loaded.rates
    work_t, work_r = works
    kinetic = kinetic_energy(q1, block)
    error = kinetic - kinetic_energy(q, block) + block.mass * body.gravity * (q1[Y] - q[Y])
    scale = kinetic + abs(work_t + work_r)
    stored_t, stored_r, slips, turns, pressing = 0.0, 0.0, False, False, 0.0
    for a in range(active):
        k_ul, k_t, k_r = rows[a, L_LAW + K_UL], rows[a, L_LAW + K_T], rows[a, L_LAW + K_R]
        old, new = trial[a, NORMAL_0], trial[a, NORMAL_1]
        error += trial[a, PLASTIC_WORK] + 0.5 * (new * new - old * old) / k_ul
        scale += 0.5 * max(new * new, old * old) / k_ul
        pressing += new
        if k_t > 0.0:
            old, new = trial[a, TANGENTIAL_0], trial[a, TANGENTIAL_1]
            slips = slips or new != k_t * rates[a, TAKEN_DISPLACEMENT]
            stored_t += 0.5 * (new * new - old * old) / k_t
        if k_r > 0.0:
            moment, rotation = trial[a, MOMENT_1], rows[a, L_ROTATION]
            turns = turns or moment != k_r * rates[a, TAKEN_ROTATION]
            stored_r += 0.5 * (moment * moment / k_r - k_r * rotation * rotation)
    work_t = max(work_t, stored_t) if slips else stored_t
    work_r = max(work_r, stored_r) if turns else stored_r
    error += work_t + work_r
    # what rounding of the pose makes of the work of the forces is no fault of the step
    size = abs(q1[X]) + abs(q1[Y]) + block.radius * (1.0 + abs(q1[THETA]))
    rounding = POSE_ROUNDING * size * (block.mass * body.gravity + pressing)
    allowed = min(LARGEST_STEP_ERROR * scale, LARGEST_CORRECTION * abs(_gain(q, q1, h, body)))
    return error, scale, abs(error) > max(allowed, LEAST_ERROR * kinetic, rounding), work_t, work_r


@kernel(forceinline=True)
def _gain(q, q1, h, body):
    """Energy in J per share that is added to the impulse of a step of h (s) from q to q1, to first order."""
    block = body.block
    dx, dy, turn = q1[VX] - q[VX], q1[VY] - q[VY] + body.gravity * h, q1[OMEGA] - q[OMEGA]
    return block.mass * (q1[VX] * dx + q1[VY] * dy) + block.inertia * q1[OMEGA] * turn


@kernel(forceinline=True)
def keep_energy(q, q1, h, error, scale, body, audit):
    """Take the error of a step of h (s) from q to q1 out of the impulse that the contacts gave: what they leave alone,
    as the momentum along a smooth plane, stays as it is.

    An error beyond LARGEST_STEP_ERROR is left in the balance, where it shows; what LARGEST_CORRECTION does not allow
    waits in audit[PENDING]. audit[CORRECTED] sums what was corrected, without sign.
    """
    if abs(error) <= LARGEST_STEP_ERROR * scale:
        audit[PENDING] += error
    block = body.block
    dx, dy, turn = q1[VX] - q[VX], q1[VY] - q[VY] + body.gravity * h, q1[OMEGA] - q[OMEGA]
    gain = _gain(q, q1, h, body)
    curvature = 0.5 * (block.mass * (dx * dx + dy * dy) + block.inertia * turn * turn)
    most = abs(gain) * min(LARGEST_CORRECTION, 0.1 * abs(gain) / max(curvature, 1e-300))
    paid = min(max(audit[PENDING], -most), most)
    if paid == 0.0:
        return
    share = -paid / gain
    share = -paid / (gain + curvature * share)
    paid = -share * (gain + curvature * share)
    q1[VX], q1[VY], q1[OMEGA] = q1[VX] + share * dx, q1[VY] + share * dy, q1[OMEGA] + share * turn
    audit[CORRECTED] += abs(paid)
    audit[PENDING] -= paid
