"""The final energy balance of releases: it compares the dissipation in the audit of an engine with the energy lost."""

from typing import NamedTuple

import numpy as np

from rock2d.arrays import Array
from rock2d.records.columns import (
    AUDIT_NAMES,
    CORRECTED,
    E_CORRECTED,
    E_DISSIPATED,
    E_ELASTIC,
    E_INITIAL,
    E_KINETIC,
    E_POTENTIAL,
    E_RESIDUAL,
    EFFECTS,
    ELASTIC,
    ENERGY_NAMES,
    OMEGA,
    VX,
    VY,
    Y,
)
from rock2d.scene.blocks import Block
from rock2d.scene.cross_section import CrossSection

AUDIT_TOLERANCE = 1e-6  # largest residual of a balance that closes, as a share of the initial energy
# the same with effects: their work is known only as well as the motion, so contact steps are not corrected
AUDIT_TOLERANCE_WITH_EFFECTS = 1e-3


class Masses(NamedTuple):
    """Masses, gravity and reference height for the energy of n states, each a number or (n,)."""

    mass_kg: Array | float
    inertia_kg_m2: Array | float
    gravity_m_s2: float
    lowest_m: Array | float  # lowest point of the cross-section, where potential energy is 0


def energy_balances(masses: Masses, starts: Array, ends: Array, audit: Array) -> Array:
    """(n, columns of ENERGY_NAMES) in J, from states (n, 6) at start and end and the audit (n, N_AUDIT) of the engine.

    At the start springs hold no energy: a block that starts inside the ground starts in an indentation. residual =
    energy at the end + dissipated energy - energy at the start; corrected: see `trial_step.correct_energy`."""
    out = np.empty((len(starts), len(ENERGY_NAMES)))
    out[:, E_KINETIC], out[:, E_POTENTIAL] = mechanical_energy(masses, ends)
    out[:, E_ELASTIC], out[:, E_DISSIPATED] = audit[:, ELASTIC], audit[:, : len(AUDIT_NAMES)]
    out[:, E_INITIAL] = sum(mechanical_energy(masses, starts))
    out[:, E_CORRECTED] = audit[:, CORRECTED]
    out[:, E_RESIDUAL] = out[:, :E_INITIAL].sum(axis=1) - out[:, E_INITIAL]
    return out


def energy_balance(
    block: Block, cross_section: CrossSection, gravity_m_s2: float, start: Array, end: Array, audit: Array
) -> dict[str, float]:
    """The final balance in J of one release, by ENERGY_NAMES; states (6,) and audit (N_AUDIT,)."""
    masses = Masses(block.mass_kg, block.inertia_kg_m2, float(gravity_m_s2), float(cross_section.points_m[:, 1].min()))
    balance = energy_balances(masses, start[None], end[None], audit[None])[0]
    return dict(zip(ENERGY_NAMES, map(float, balance), strict=True))


def mechanical_energy(masses: Masses, states: Array) -> tuple[Array, Array]:
    """Kinetic and potential energy in J of states (n, 6)."""
    vx, vy, omega = states[:, VX], states[:, VY], states[:, OMEGA]
    kinetic = 0.5 * (masses.mass_kg * (vx * vx + vy * vy) + masses.inertia_kg_m2 * omega * omega)
    return kinetic, masses.mass_kg * masses.gravity_m_s2 * (states[:, Y] - masses.lowest_m)


def audit_tolerance(effects_J: Array) -> Array:
    """(n,) largest residual of a balance that closes, as a share of the initial energy; effects dissipated `effects_J`
    (n,)."""
    return np.where(np.asarray(effects_J) != 0.0, AUDIT_TOLERANCE_WITH_EFFECTS, AUDIT_TOLERANCE)


def unclosed(balances: Array) -> Array:
    """(n,) bool: whether the residual of a balance exceeds `audit_tolerance`."""
    allowed = audit_tolerance(balances[:, E_DISSIPATED][:, EFFECTS])
    return np.abs(balances[:, E_RESIDUAL]) > allowed * np.abs(balances[:, E_INITIAL])
