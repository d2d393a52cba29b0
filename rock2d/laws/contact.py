"""The deterministic contact law: elasto-plastic normal force, regularised Coulomb friction, rolling resistance.

Source: section "DEM modelling" and Table 4 of the paper. Pure functions of one contact point, which all engines call.
SI units. δ is the penetration, δmax the peak penetration since the contact began, s the tangential displacement of the
tangential spring, ρ the rotation of the rolling spring."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from rock2d.compiled import kernel
from rock2d.errors import ParameterError
from rock2d.scene.cross_section import by_zone

# columns of a parameter row
CONTACT_LAW_COLUMNS = (
    "k_l_N_m", "k_ul_N_m", "k_t_N_m", "tan_phi", "k_r_Nm_rad", "rolling_cap", "rolling_in_indentation",
)  # fmt: skip
K_L, K_UL, K_T, MU, K_R, ROLLING_CAP, ROLLING_IN_INDENTATION = range(len(CONTACT_LAW_COLUMNS))


@dataclass(frozen=True)
class ContactParameters:
    """Parameters of the law in one zone (defaults: the paper's Table 4).

    `friction_angle_deg` may be 90 (never slips). `rolling_cap` limits the rolling moment to (arm) × F_n, which the
    paper does not. With `rolling_in_indentation`, the rolling spring acts until the block is clear of the original
    surface, otherwise only while the ground presses on it; the "rotation since this contact began" of the paper allows
    both readings. Raises ParameterError, a ValueError, on values for which the law makes no sense."""

    k_l_N_m: float = 1.0e4
    k_ul_N_m: float = 6.0e4
    k_t_N_m: float = 2.5e3
    friction_angle_deg: float = 30.0
    k_r_Nm_rad: float = 0.025
    rolling_cap: bool = False
    rolling_in_indentation: bool = False

    def __post_init__(self) -> None:
        if not 0 < self.k_l_N_m <= self.k_ul_N_m < np.inf:
            raise ParameterError(
                "k_l_N_m",
                f"need 0 < k_l_N_m <= k_ul_N_m, got {self.k_l_N_m:g} and {self.k_ul_N_m:g} "
                "(unloading cannot be softer than loading: it would create energy)",
            )
        for name, holds, bounds in (
            ("k_t_N_m", 0 <= self.k_t_N_m < np.inf, "not be negative"),
            ("friction_angle_deg", 0 <= self.friction_angle_deg <= 90, "lie in [0, 90]"),
            ("k_r_Nm_rad", 0 <= self.k_r_Nm_rad < np.inf, "not be negative"),
        ):
            if not holds:
                raise ParameterError(name, f"{name} must {bounds}, got {getattr(self, name):g}")

    def row(self) -> np.ndarray:
        """The columns CONTACT_LAW_COLUMNS, which the compiled law reads: tan φ is inf at 90°, switches are 0 or 1."""
        return np.array([float(getattr(self, name)) for name in CONTACT_LAW_COLUMNS])

    @property
    def tan_phi(self) -> float:
        """Friction coefficient tan φ; inf at 90°."""
        angle = self.friction_angle_deg
        return float(np.inf if angle == 90 else np.tan(np.deg2rad(angle)))


def contact_table(
    parameters: Mapping[str, ContactParameters] | ContactParameters, zone_names: tuple[str, ...]
) -> np.ndarray:
    """(zones, columns) rows in the order of `zone_names`; the key "default" holds for zones that are not named.

    Raises ValueError if a zone has neither its own parameters nor a default."""
    if isinstance(parameters, ContactParameters):
        parameters = {"default": parameters}
    return np.array([zone.row() for zone in by_zone(parameters, zone_names, "contact")])


def contact_time_s(p: ContactParameters, mass_kg: float) -> float:
    """Duration of a normal impact t_c = (π/2) (1/ω_l + 1/ω_u), ω_l = √(k_l/m), ω_u = √(k_ul/m)."""
    return float(np.pi / 2 * (np.sqrt(mass_kg / p.k_l_N_m) + np.sqrt(mass_kg / p.k_ul_N_m)))


def penetration_m(p: ContactParameters, mass_kg: float, speed_m_s: float) -> float:
    """Peak penetration of a normal impact δmax = v/ω_l, ω_l = √(k_l/m)."""
    return float(speed_m_s * np.sqrt(mass_kg / p.k_l_N_m))


@kernel(forceinline=True)
def normal_force(delta, delta_max, k_l, k_ul):
    """F_n in N. First loading k_l δ; else max(0, min(k_l δ, k_ul (δ - δp))), δp = δmax (1 - k_l/k_ul)."""
    return normal_force_from_bottom(delta, delta_max, residual_indentation(delta_max, k_l, k_ul), k_l, k_ul)


@kernel(forceinline=True)
def normal_force_from_bottom(delta, delta_max, bottom, k_l, k_ul):
    """`normal_force` in N with a known residual indentation δp = `bottom`."""
    if delta <= 0.0:
        return 0.0
    if delta >= delta_max:
        return k_l * delta
    return max(0.0, min(k_l * delta, k_ul * (delta - bottom)))


@kernel(forceinline=True)
def residual_indentation(delta_max, k_l, k_ul):
    """δp = δmax (1 - k_l/k_ul) in m: the depth at which the unloading force vanishes."""
    return delta_max * (1.0 - k_l / k_ul)


@kernel(forceinline=True)
def tangential_force(displacement, force_n, k_t, mu):
    """Force of the tangential spring in N, along the tangential displacement s: k_t s, at most tan φ F_n."""
    force = k_t * displacement
    if force_n <= 0.0:
        return 0.0
    if mu == np.inf:
        return force
    limit = mu * force_n
    return min(max(force, -limit), limit)


@kernel(forceinline=True)
def rolling_moment(rotation, force_n, arm, k_r, cap, indentation):
    """Moment of the rolling spring along +rotation in N m: k_r ρ while pressed (with `indentation` as long as the
    contact lasts); with `cap` at most arm × F_n."""
    if force_n <= 0.0 and indentation == 0.0:
        return 0.0
    moment = k_r * rotation
    if cap > 0.0:
        limit = arm * force_n
        moment = min(max(moment, -limit), limit)
    return moment


@kernel
def plastic_work(delta_max, k_l, k_ul):
    """Energy in J dissipated by plasticity since the contact began: ½ k_l δmax² (1 - k_l/k_ul)."""
    return 0.5 * k_l * delta_max * delta_max * (1.0 - k_l / k_ul)


@kernel
def elastic_energy(force_n, force_t, p):
    """Energy in J stored by the normal and tangential springs at these forces; `p` is a parameter row."""
    energy = 0.5 * force_n * force_n / p[K_UL]
    if p[K_T] > 0.0:
        energy += 0.5 * force_t * force_t / p[K_T]
    return energy


@kernel
def rolling_energy(rotation, p):
    """Energy in J stored by the rolling spring: ½ k_r ρ²."""
    return 0.5 * p[K_R] * rotation * rotation


@kernel
def cross_zone(force_n, force_t, rotation, depth, old, new):
    """Memory (δmax, s, ρ) of a loaded contact that slides into a new zone, at `depth` (m) below the surface. The new
    δmax is the penetration of first loading to the acting force; δ starts there.

    The contact keeps its forces, with two limits. In a softer zone they are reduced so that the stored energy does not
    increase: no change of zone creates energy. The normal force is at most that of first loading to `depth`. The energy
    lost counts as plastic work."""
    force = min(force_n * min(1.0, np.sqrt(new[K_UL] / old[K_UL])), new[K_L] * max(depth, 0.0))
    displacement = 0.0
    if new[K_T] > 0.0 and old[K_T] > 0.0:
        kept = force_t * min(1.0, np.sqrt(new[K_T] / old[K_T]))
        displacement = tangential_force(kept / new[K_T], force, new[K_T], new[MU]) / new[K_T]
    turned = 0.0
    if new[K_R] > 0.0:
        turned = rotation * min(old[K_R] / new[K_R], np.sqrt(old[K_R] / new[K_R]))
    return force / new[K_L], displacement, turned


@kernel
def change_feature(p, depth, jump, memory, forces):
    """Continue a contact with parameters `p` at another feature, at `depth` there, `jump` deeper than at the old one.

    memory : (offset, peak penetration) in m; forces : (normal force of the law, tangential force) in N before

    The jump exceeds rounding only in the middle of a narrow ridge, or far below the surface. If the new feature is
    deeper, the contact keeps its penetration, as if the ground began deeper, so that no energy is created. Otherwise it
    unloads. Returns (new offset in m, new normal force, new tangential force in N, lost elastic energy in J)."""
    offset, peak = memory
    force_n, force_t = forces
    if offset + jump >= 0.0:
        return offset + jump, force_n, force_t, 0.0
    new_n = normal_force(depth, peak, p[K_L], p[K_UL])
    new_t = tangential_force(force_t / p[K_T] if p[K_T] > 0.0 else 0.0, new_n, p[K_T], p[MU])
    return 0.0, new_n, new_t, elastic_energy(force_n, force_t, p) - elastic_energy(new_n, new_t, p)
