"""Closed-form results of the contact law for one smooth contact on a plane without gravity, to compare engines with.

ω_l = √(k_l/m), ω_u = √(k_ul/m), u = v_t + r ω (slip velocity). All inputs and results in SI."""

import numpy as np

from rock2d.laws.contact import ContactParameters, contact_time_s, penetration_m


def restitution(p: ContactParameters) -> float:
    """Normal coefficient of restitution e = √(k_l/k_ul), the same at any speed."""
    return float(np.sqrt(p.k_l_N_m / p.k_ul_N_m))


def residual_indentation_m(p: ContactParameters, mass_kg: float, speed_m_s: float) -> float:
    """Residual indentation δmax (1 - k_l/k_ul)."""
    return penetration_m(p, mass_kg, speed_m_s) * (1 - p.k_l_N_m / p.k_ul_N_m)


def peak_force_N(p: ContactParameters, mass_kg: float, speed_m_s: float) -> float:
    """Largest normal force v √(k_l m)."""
    return float(speed_m_s * np.sqrt(p.k_l_N_m * mass_kg))


def normal_loss_J(p: ContactParameters, mass_kg: float, speed_m_s: float) -> float:
    """Energy dissipated by the normal force, ½ m v² (1 - k_l/k_ul)."""
    return 0.5 * mass_kg * speed_m_s**2 * (1 - p.k_l_N_m / p.k_ul_N_m)


def stick_slip_velocity_m_s(
    p: ContactParameters, mass_kg: float, inertia_kg_m2: float, radius_m: float, u_m_s: float
) -> float:
    """Slip velocity after a contact that never slips: u cos(ω_t t_c), ω_t² = k_t (1/m + r²/I)."""
    omega_t = np.sqrt(p.k_t_N_m * (1 / mass_kg + radius_m**2 / inertia_kg_m2))
    return float(u_m_s * np.cos(omega_t * contact_time_s(p, mass_kg)))


def gross_slip_change_m_s(p: ContactParameters, normal_speed_m_s: float, u_m_s: float) -> float:
    """Change of tangential velocity of a contact that always slips, Δv_t = -tan φ (1 + e) |v_n| sgn u."""
    mu = np.tan(np.deg2rad(p.friction_angle_deg))
    return float(-mu * (1 + restitution(p)) * normal_speed_m_s * np.sign(u_m_s))


def rolling_spin_rad_s(p: ContactParameters, mass_kg: float, inertia_kg_m2: float, omega_rad_s: float) -> float:
    """Spin after a contact without friction: ω cos(√(k_r/I) t_c)."""
    return float(omega_rad_s * np.cos(np.sqrt(p.k_r_Nm_rad / inertia_kg_m2) * contact_time_s(p, mass_kg)))
