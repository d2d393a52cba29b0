"""The energy that a contact step makes or loses by truncation, and its correction, compiled.

A Runge-Kutta step keeps the balance of energy only to its order. The balance is known exactly, so the error is too: it
says when a step is too long, and what is left is taken out of the velocities. Projection onto an invariant keeps the
order of a scheme (Hairer, Lubich, Wanner: Geometric Numerical Integration, IV.4).
"""

from __future__ import annotations

import numpy as np

from rock2d.compiled import kernel
from rock2d.engines.contact_energy import kinetic_energy
from rock2d.engines.loaded_contacts import DEPTH_0, DEPTH_1, L_LAW, L_OFFSET, L_PEAK
from rock2d.laws.contact import K_L, K_UL, normal_force, plastic_work
from rock2d.records.columns import CORRECTED, OMEGA, PENDING, VX, VY, Y

LARGEST_STEP_ERROR = 0.005  # of the energy of a step: beyond it the step is too long
LARGEST_CORRECTION = 0.01  # of the kinetic energy: what is more waits for the next step


@kernel(inline="always")
def step_error(q, q1, works, body, active, loaded):
    """(energy in J that a step from q to q1 has made, energy in J that it should be small against).

    works : what tangential springs, rolling springs and effects took in the step, in J; the depths of the active
        contacts before and after it are in the rows of `loaded.trial`
    """
    block, rows, trial = body.block, loaded.rows, loaded.trial
    kinetic = kinetic_energy(q1, block)
    error = kinetic - kinetic_energy(q, block) + block.mass * body.gravity * (q1[Y] - q[Y]) + works
    scale = kinetic + abs(works)
    for a in range(active):
        k_l, k_ul, peak = rows[a, L_LAW + K_L], rows[a, L_LAW + K_UL], rows[a, L_PEAK]
        before, after = trial[a, DEPTH_0] - rows[a, L_OFFSET], trial[a, DEPTH_1] - rows[a, L_OFFSET]
        old = normal_force(before, peak, k_l, k_ul)
        if after > peak:
            error += plastic_work(after, k_l, k_ul) - plastic_work(peak, k_l, k_ul)
            peak = after
        new = normal_force(after, peak, k_l, k_ul)
        error += 0.5 * (new * new - old * old) / k_ul
        scale += 0.5 * max(new * new, old * old) / k_ul
    return error, scale


@kernel(inline="always")
def keep_energy(q, error, scale, block, audit):
    """Scale the velocities of q so that the step's error leaves its energy; returns the factor.

    An error beyond LARGEST_STEP_ERROR is left in the balance, where it shows. audit[CORRECTED] sums what was corrected,
    without sign.
    """
    if abs(error) <= LARGEST_STEP_ERROR * scale:
        audit[PENDING] += error
    kinetic = kinetic_energy(q, block)
    most = LARGEST_CORRECTION * kinetic
    paid = min(max(audit[PENDING], -most), most)
    if paid == 0.0:
        return 1.0
    factor = np.sqrt(1.0 - paid / kinetic)
    q[VX], q[VY], q[OMEGA] = factor * q[VX], factor * q[VY], factor * q[OMEGA]
    audit[CORRECTED] += abs(paid)
    audit[PENDING] -= paid
    return factor
