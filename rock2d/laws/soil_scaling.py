"""Parameters of both impact laws for a block on a soil class: geometrically similar impacts have similar results.

Two impacts are similar if all lengths have the ratio of the sizes d, all masses that of d³ and all speeds that of
√(g d). Then all forces have the ratio of m g, so that

- k_l = κ m g / d, k_ul = k_l / e², k_t in proportion to k_l, k_r in proportion to k_l d²
- M½ = μ m √(g d)

with κ, e and μ of the class alone. docs/theory/soil-classes.md has the derivation and its limits. SI units."""

import numpy as np

from rock2d.laws.contact import ContactParameters
from rock2d.laws.rebound import ReboundParameters
from rock2d.scene.soils import SoilClass

SOIL_GRAVITY_M_S2 = 9.81  # gravity at which the soil was observed; a scenario may have another one
# v_n / √(g d) of the reference impact, at which both laws have the restitution of the class
REFERENCE_FROUDE = 3.0
TANGENTIAL_SHARE = 0.25  # k_t / k_l: the paper's Table 4


def reference_speed_m_s(size_m: float) -> float:
    """Normal speed in m/s of the reference impact of a block of this size."""
    return float(REFERENCE_FROUDE * np.sqrt(SOIL_GRAVITY_M_S2 * size_m))


def momentum_number(soil: SoilClass) -> float:
    """μ = M½ / (m √(g d)), so that r_n = μ / (μ + Fr) is the class's restitution at the reference impact."""
    return REFERENCE_FROUDE * soil.restitution / (1.0 - soil.restitution)


def soil_contact(soil: SoilClass, mass_kg: float, size_m: float) -> ContactParameters:
    """Parameters of the deterministic law; `size_m` is the diameter of the circle with the area of the profile."""
    k_l = soil.stiffness * mass_kg * SOIL_GRAVITY_M_S2 / size_m
    return ContactParameters(
        k_l_N_m=k_l,
        k_ul_N_m=k_l / soil.restitution**2,
        k_t_N_m=TANGENTIAL_SHARE * k_l,
        friction_angle_deg=soil.friction_angle_deg,
        k_r_Nm_rad=soil.rolling_share * k_l * size_m**2,
        rolling_cap=True,
    )


def soil_rebound(soil: SoilClass, mass_kg: float, size_m: float) -> ReboundParameters:
    """Parameters of the probabilistic law. The slope reduction describes the ground only, not the shape of the
    block."""
    return ReboundParameters(
        friction_angle_deg=soil.friction_angle_deg,
        momentum_half_kg_m_s=momentum_number(soil) * mass_kg * float(np.sqrt(SOIL_GRAVITY_M_S2 * size_m)),
        tangential_restitution=soil.tangential_restitution,
        slope_reduction_deg=soil.slope_reduction_deg,
        slope_reduction="uniform",
    )
