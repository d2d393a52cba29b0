"""What one finished step leaves in the memory of one contact, compiled: the one update of the full and the fast
step."""

from __future__ import annotations

from rock2d.compiled import kernel
from rock2d.effects.forces import ground_forces
from rock2d.engines.loaded_contacts import (
    ACTING_1,
    ARM,
    DEPTH_0,
    DEPTH_1,
    DISPLACEMENT_1,
    L_ACTS,
    L_BOTTOM,
    L_DISPLACEMENT,
    L_EFFECTS,
    L_LAW,
    L_OFFSET,
    L_PEAK,
    MOMENT_1,
    NORMAL_0,
    NORMAL_1,
    PEAK_1,
    PLASTIC_WORK,
    RATE_1,
    ROTATION_1,
    SLIP,
    TAKEN_DISPLACEMENT,
    TAKEN_ROTATION,
    TANGENTIAL_0,
    TANGENTIAL_1,
)
from rock2d.laws.contact import (
    K_L,
    K_R,
    K_T,
    K_UL,
    MU,
    ROLLING_CAP,
    ROLLING_IN_INDENTATION,
    normal_force_from_bottom,
    plastic_work,
    residual_indentation,
    rolling_moment,
    tangential_force,
)


@kernel(forceinline=True)
def note_outcome(a, loaded, effects):
    """Note in the row of the trial step what that step leaves of the a-th loaded contact, PEAK_1 to PLASTIC_WORK.

    Springs slip with their limits. `effects`: whether effects of the catalogue may act; then the force that acts is
    that of the law and theirs, and the row holds the contact's rates after the step too.
    """
    rows, rates, trial = loaded.rows, loaded.rates, loaded.trial
    k_l, k_ul, k_t = rows[a, L_LAW + K_L], rows[a, L_LAW + K_UL], rows[a, L_LAW + K_T]
    mu, k_r, cap = rows[a, L_LAW + MU], rows[a, L_LAW + K_R], rows[a, L_LAW + ROLLING_CAP]
    peak, bottom, offset = rows[a, L_PEAK], rows[a, L_BOTTOM], rows[a, L_OFFSET]
    before, after = trial[a, DEPTH_0] - offset, trial[a, DEPTH_1] - offset
    normal_0 = normal_force_from_bottom(before, peak, bottom, k_l, k_ul)
    normal_1 = normal_force_from_bottom(after, peak, bottom, k_l, k_ul)
    plastic = 0.0
    if after > peak:
        plastic = plastic_work(after, k_l, k_ul) - plastic_work(peak, k_l, k_ul)
        peak = after
    acting = force_n = normal_1
    if effects and rows[a, L_ACTS] != 0.0:
        trial[a, TANGENTIAL_0] = k_t * rows[a, L_DISPLACEMENT]  # within the friction of the step before
        motion = (after, trial[a, RATE_1], trial[a, SLIP], peak, residual_indentation(peak, k_l, k_ul))
        force_n, factor, drag = ground_forces(rows[a], L_EFFECTS, motion, normal_1)
        mu, acting = mu * factor, abs(force_n) + abs(drag)
    else:
        trial[a, TANGENTIAL_0] = tangential_force(rows[a, L_DISPLACEMENT], normal_0, k_t, mu)
    force_t = tangential_force(rates[a, TAKEN_DISPLACEMENT], force_n, k_t, mu)
    rotation = rates[a, TAKEN_ROTATION]
    moment = k_r * rotation
    if cap > 0.0 and k_r > 0.0:
        moment = rolling_moment(
            rotation, force_n, trial[a, ARM], k_r, cap, rows[a, L_LAW + ROLLING_IN_INDENTATION]
        )
        rotation = moment / k_r
    trial[a, PEAK_1], trial[a, PLASTIC_WORK] = peak, plastic
    trial[a, NORMAL_0], trial[a, NORMAL_1], trial[a, ACTING_1] = normal_0, normal_1, acting
    trial[a, TANGENTIAL_1], trial[a, DISPLACEMENT_1] = force_t, force_t / k_t if k_t > 0.0 else 0.0
    trial[a, MOMENT_1], trial[a, ROTATION_1] = moment, rotation
