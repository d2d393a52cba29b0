"""Energy and forces of a block in contact, and the growth of contact steps, compiled."""

from __future__ import annotations

import numpy as np

from rock2d.compiled import kernel
from rock2d.effects.forces import ANY_EFFECT_ACTS
from rock2d.engines.contact_state import (
    ACTING,
    ACTIVE,
    DEPTH,
    DISPLACEMENT,
    OFFSET,
    PEAK,
    RATE,
    ROTATION,
    ZONE,
)
from rock2d.laws.contact import (
    K_L,
    K_T,
    K_UL,
    MU,
    elastic_energy,
    normal_force,
    rolling_energy,
    tangential_force,
)
from rock2d.records.columns import OMEGA, VX, VY

LARGEST_STEP_GROWTH = 5.0  # largest factor on contact steps while the motion decays


@kernel
def kinetic_energy(q, block):
    """Kinetic energy in J."""
    return 0.5 * (block.mass * (q[VX] * q[VX] + q[VY] * q[VY]) + block.inertia * q[OMEGA] * q[OMEGA])


@kernel
def stored_energy(memory, law):
    """Energy in J stored in the springs of all contacts; `law`: rows (zones, columns)."""
    ints, reals = memory.ints, memory.reals
    total = 0.0
    for j in range(ints.shape[0]):
        if ints[j, ACTIVE]:
            p = law[ints[j, ZONE]]
            force_n = normal_force(reals[j, DEPTH] - reals[j, OFFSET], reals[j, PEAK], p[K_L], p[K_UL])
            force_t = tangential_force(reals[j, DISPLACEMENT], force_n, p[K_T], p[MU])
            if p[ANY_EFFECT_ACTS] != 0.0:
                force_t = p[K_T] * reals[j, DISPLACEMENT]  # the step before has limited it to friction
            total += elastic_energy(force_n, force_t, p) + rolling_energy(reals[j, ROTATION], p)
    return total


@kernel
def pressure(memory, law):
    """(sum of normal forces in N, forces of effects included; largest penetration in m; number of active contacts)."""
    ints, reals = memory.ints, memory.reals
    force, deepest, active = 0.0, 0.0, 0
    for j in range(ints.shape[0]):
        if ints[j, ACTIVE]:
            p = law[ints[j, ZONE]]
            if p[ANY_EFFECT_ACTS] != 0.0:
                force += reals[j, ACTING]
            else:
                force += normal_force(reals[j, DEPTH] - reals[j, OFFSET], reals[j, PEAK], p[K_L], p[K_UL])
            deepest = max(deepest, reals[j, DEPTH])
            active += 1
    return force, deepest, active


@kernel
def step_growth(reference_energy, block, memory, law):
    """Factor (1 to LARGEST_STEP_GROWTH) by which a contact step may grow while the oscillation in the contacts decays.

    The energy error of a step is of order energy × step⁵. With a step ∝ 1/√energy, below a sixteenth of the reference
    energy, it still decreases. Steady rolling and sliding do not count as oscillation.
    """
    ints, reals = memory.ints, memory.reals
    energy, touching = stored_energy(memory, law), False
    for j in range(ints.shape[0]):
        if ints[j, ACTIVE]:
            energy += 0.5 * block.mass * reals[j, RATE] * reals[j, RATE]
            touching = True
    if not touching:
        return 1.0
    if energy <= 0.0:
        return LARGEST_STEP_GROWTH
    return min(LARGEST_STEP_GROWTH, max(1.0, 0.25 * np.sqrt(reference_energy / energy)))
