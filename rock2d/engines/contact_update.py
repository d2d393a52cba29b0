"""What one finished step leaves in the memory of one contact, compiled: the one update of the full and the fast
step."""

from __future__ import annotations

from rock2d.compiled import kernel
from rock2d.effects.forces import ground_forces
from rock2d.laws.contact import (
    CAP,
    INDENTATION,
    K_L,
    K_R,
    K_T,
    K_UL,
    MU,
    normal_force,
    plastic_work,
    residual,
    rolling_moment,
    tangential_force,
)


@kernel(inline="always")
def updated_contact(row, law, effects, before, trial, motion):
    """Memory and forces of a contact after a step.

    row : parameters; the contact law's begin in column `law`, those of effects in column `effects` (-1: none act)
    before : (penetration in m, peak penetration in m, tangential displacement in m) before the step
    trial : (penetration in m, tangential displacement in m, rotation in rad) that the step led to
    motion : (rate of the penetration in m/s, slip velocity in m/s, arm in m) after the step

    Returns (peak penetration, tangential displacement, rotation, normal force of the law in N, force that acts in N,
    tangential force in N after and before the step, energy in J that plasticity took). Springs slip with their limits.
    """
    was, peak, displacement = before
    pressed, new_displacement, new_rotation = trial
    rate, slip, arm = motion
    k_l, k_ul, k_t = row[law + K_L], row[law + K_UL], row[law + K_T]
    mu, k_r, cap = row[law + MU], row[law + K_R], row[law + CAP]
    old_t = tangential_force(displacement, normal_force(was, peak, k_l, k_ul), k_t, mu)
    if effects >= 0:
        old_t = k_t * displacement  # within the friction of the step before
    plastic = 0.0
    if pressed > peak:
        plastic = plastic_work(pressed, k_l, k_ul) - plastic_work(peak, k_l, k_ul)
        peak = pressed
    law_n = normal_force(pressed, peak, k_l, k_ul)
    acting = force_n = law_n
    if effects >= 0:
        bottom = residual(peak, k_l, k_ul)
        force_n, factor, drag = ground_forces(row, effects, (pressed, rate, slip, peak, bottom), law_n)
        mu, acting = mu * factor, abs(force_n) + abs(drag)
    force_t = tangential_force(new_displacement, force_n, k_t, mu)
    kept = force_t / k_t if k_t > 0.0 else 0.0
    rotation = new_rotation
    if cap > 0.0 and k_r > 0.0:
        rotation = rolling_moment(new_rotation, force_n, arm, k_r, cap, row[law + INDENTATION]) / k_r
    return peak, kept, rotation, law_n, acting, force_t, old_t, plastic
