"""The probabilistic rebound law: a point mass with the spin of a ball.

Source: section "Probabilistic impact modelling" and Table 3 of the paper; Bourrier & Hungr (2011), with the hyperbolic
normal restitution of PIERRE. Pure functions of one impact: if the slope reduction is random, the caller passes the
random number. SI units. With t along the facet, n out of the ground, v_n < 0 on entry and ω counter-clockwise positive,
the foot of the ball moves at u = v_t + r ω."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from rock2d.compiled import njit
from rock2d.errors import ParameterError
from rock2d.scene.cross_section import by_zone

# columns of a parameter row: tan φ, M½ in kg m/s, r_t, α in rad, and 1 if α is drawn, else 0
TAN_PHI, M_HALF, R_T, ALPHA, SLOPE_REDUCTION_DRAWN = range(5)

BALL_INERTIA_FACTOR = 0.4  # I / (m r²) of the ball


@dataclass(frozen=True)
class ReboundParameters:
    """Parameters of the law in one zone.

    Attributes
    ----------
    friction_angle_deg : φ, in [0, 90]; 0 always slips
    momentum_half_kg_m_s : M½ > 0, the normal momentum at which r_n = 1/2
    tangential_restitution : r_t, in [0, 1]
    slope_reduction_deg : α, in [0, 90)
    slope_reduction : "constant" (α at every impact) or "uniform" (drawn from U(0, α) at every impact). The
        text of the paper allows both.

    Raises ParameterError, a ValueError, on values for which the law makes no sense."""

    friction_angle_deg: float
    momentum_half_kg_m_s: float
    tangential_restitution: float
    slope_reduction_deg: float = 0.0
    slope_reduction: str = "constant"

    def __post_init__(self) -> None:
        for name, holds, bounds in (
            ("friction_angle_deg", 0 <= self.friction_angle_deg <= 90, "lie in [0, 90]"),
            ("momentum_half_kg_m_s", 0 < self.momentum_half_kg_m_s < np.inf, "be positive"),
            ("tangential_restitution", 0 <= self.tangential_restitution <= 1, "lie in [0, 1]"),
            ("slope_reduction_deg", 0 <= self.slope_reduction_deg < 90, "lie in [0, 90)"),
        ):
            if not holds:
                raise ParameterError(name, f"{name} must {bounds}, got {getattr(self, name):g}")
        if self.slope_reduction not in ("constant", "uniform"):
            raise ParameterError(
                "slope_reduction", f"slope_reduction must be constant or uniform, got {self.slope_reduction!r}"
            )

    @property
    def random(self) -> bool:
        """True if an impact needs a random number."""
        return self.slope_reduction == "uniform" and self.slope_reduction_deg > 0

    def row(self) -> np.ndarray:
        """The parameter row that the compiled law reads."""
        return np.array(
            [
                np.tan(np.deg2rad(self.friction_angle_deg)),
                self.momentum_half_kg_m_s,
                self.tangential_restitution,
                np.deg2rad(self.slope_reduction_deg),
                float(self.slope_reduction == "uniform"),
            ]
        )


def rebound_table(parameters: Mapping[str, ReboundParameters], zone_names: tuple[str, ...]) -> np.ndarray:
    """(zones, columns) rows in the order of `zone_names`; the key "default" holds for zones that are not named.

    Raises ValueError if a zone has neither its own parameters nor a default."""
    return np.array([zone.row() for zone in by_zone(parameters, zone_names, "rebound")])


@njit
def normal_restitution(v_n, mass, m_half):
    """r_n = M½ / (M½ + m |v_n|): 1 at vanishing speed, 1/2 at m |v_n| = M½, towards 0 for hard impacts."""
    return m_half / (m_half + mass * abs(v_n))


@njit
def rebound_local(v_t, v_n, omega, mass, radius, p):
    """(v_t', v_n', ω') after an impact at v_n < 0 on a facet without slope reduction; `p` is a parameter row.

    With r_n of `normal_restitution`, J = tan φ (1 + r_n) |v_n| and tan ψ = 2 r_t |u| / (7 (1 + r_n) |v_n|):

    - v_n' = -r_n v_n
    - no slip (ψ < φ): v_t' = r_t (5/7 v_t - 2/7 r ω),  r ω' = -v_t'
    - slip: v_t' = r_t v_t - sgn(u) J,  ω' = r_t ω - sgn(u) (5/2) J / r

    The no-slip formula is the slip formula with J = 2/7 r_t |u|, and ψ < φ means that this J is the smaller one.
    So the code uses the smaller J in both cases. v_t - (2/5) r ω is multiplied by r_t, and |u| by at most r_t:
    the kinetic energy ½ m (v_n² + 2/7 u² + 5/7 (v_t - 2/5 r ω)²) never increases."""
    hit = max(-v_n, 0.0)
    r_n = normal_restitution(hit, mass, p[M_HALF])
    u = v_t + radius * omega
    jump = min(p[TAN_PHI] * (1.0 + r_n) * hit, 2.0 / 7.0 * p[R_T] * abs(u)) * np.sign(u)
    return p[R_T] * v_t - jump, r_n * hit, p[R_T] * omega - 2.5 * jump / radius


@njit
def slope_reduction(p, draw):
    """The α of one impact, in rad: constant, or U(0, α) from `draw` in [0, 1)."""
    return p[ALPHA] * draw if p[SLOPE_REDUCTION_DRAWN] > 0.0 else p[ALPHA]


@njit
def rebound(velocity, tangent, alpha, body, p):
    """(vx', vy', ω') after an impact with `velocity` (vx, vy, ω) on the facet with unit tangent (x, y), reduced by
    `alpha` (rad). body : (mass in kg, radius of the spin in m); p : parameter row.

    α rotates the facet against the direction of travel: counter-clockwise for v_x > 0 and clockwise for v_x < 0 (a
    vertical fall travels down the facet). The paper does not treat two cases; assumed here:

    - the block would not hit the rotated facet (v_n >= 0 in its frame): the law uses the true facet, α = 0;
    - it leaves the rotated facet towards the inside of the true one: a second rebound at once, with α = 0.

    No rebound adds energy."""
    vx, vy, omega = velocity
    tx, ty = tangent
    travel = np.sign(vx)
    if travel == 0.0:
        travel = np.sign(vy * ty * tx)
    c, s = np.cos(alpha), np.sin(alpha) * travel
    ax, ay = c * tx - s * ty, s * tx + c * ty
    if vy * ax - vx * ay >= 0.0:
        ax, ay = tx, ty
    vx, vy, omega = _on_facet((vx, vy, omega), (ax, ay), body, p)
    if alpha != 0.0 and vy * tx - vx * ty < 0.0:
        vx, vy, omega = _on_facet((vx, vy, omega), tangent, body, p)
    return vx, vy, omega


@njit
def _on_facet(velocity, tangent, body, p):
    vx, vy, omega = velocity
    tx, ty = tangent
    mass, radius = body
    v_t, v_n, omega = rebound_local(vx * tx + vy * ty, vy * tx - vx * ty, omega, mass, radius, p)
    return v_t * tx - v_n * ty, v_t * ty + v_n * tx, omega
