"""What an impact or a flight may depend on: measured quantities, and smooth functions of few coefficients of them.

A *basis* is additive over its quantities. Splines follow any smooth curve, harmonics an angle, a line
passes through zero; a kind has one value for each of its members.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

Array = np.ndarray

CONSTANT = "nothing"  # what a constant depends on
SPLINE, HARMONICS, KINDS, LINE = "spline", "harmonics", "kinds", "line"
SPLINE_DEGREE = 2
SPLINE_PIECES = 5  # between quantiles of the measured values
LEAST_SPREAD = 1e-9  # of a quantity that varies, relative to its size

BLOCK, ZONE, SERIES, HISTORY = "block", "zone", "release of the block", "impact of the release"
PLACE_M, HEIGHT_M, CLEARANCE_M = "x_m", "y_m", "height_above_ground_m"
LEAN_RAD, THETA_RAD = "orientation_to_ground_rad", "theta_rad"
NORMAL_SPEED_M_S, TANGENTIAL_SPEED_M_S = "normal_speed_m_s", "tangential_speed_m_s"
SLIDING_SPEED_M_S, SPIN_M_S = "sliding_speed_m_s", "spin_times_radius_m_s"
VX_M_S, VY_M_S, OMEGA_RAD_S, TIME_S = "vx_m_s", "vy_m_s", "omega_rad_s", "time_s"
DRAG_X_M2_S2, DRAG_Y_M2_S2 = "speed_times_vx_m2_s2", "speed_times_vy_m2_s2"
SPIN_VX_M_S2, SPIN_VY_M_S2 = "omega_times_vx_m_s2", "omega_times_vy_m_s2"

MOST_COUNTED_IMPACTS = 2  # later impacts of a release count as one kind

# name of a dependence -> its quantities and how they enter
IMPACT_DEPENDENCES: dict[str, tuple[tuple[str, str], ...]] = {
    CONSTANT: (),
    "block": ((BLOCK, KINDS),),
    "zone": ((ZONE, KINDS),),
    "place": ((PLACE_M, SPLINE),),
    "orientation to the ground": ((LEAN_RAD, HARMONICS),),
    "orientation": ((THETA_RAD, HARMONICS),),
    "normal speed": ((NORMAL_SPEED_M_S, SPLINE),),
    "tangential speed": ((TANGENTIAL_SPEED_M_S, SPLINE),),
    "sliding speed": ((SLIDING_SPEED_M_S, SPLINE),),
    "spin": ((SPIN_M_S, SPLINE),),
    "series": ((SERIES, SPLINE),),
    "history": ((HISTORY, KINDS),),
}
FLIGHT_DEPENDENCES: dict[str, tuple[tuple[str, str], ...]] = {
    CONSTANT: (),
    "velocity": ((VX_M_S, LINE), (VY_M_S, LINE), (DRAG_X_M2_S2, LINE), (DRAG_Y_M2_S2, LINE)),
    "spin": ((OMEGA_RAD_S, LINE), (SPIN_VX_M_S2, LINE), (SPIN_VY_M_S2, LINE)),
    "height": ((HEIGHT_M, SPLINE),),
    "height above the ground": ((CLEARANCE_M, SPLINE),),
    "place": ((PLACE_M, SPLINE),),
    "orientation": ((THETA_RAD, HARMONICS),),
    "time": ((TIME_S, SPLINE),),
    "block": ((BLOCK, KINDS),),
    "series": ((SERIES, LINE),),
    "history": ((HISTORY, KINDS),),
}
IMPACT_QUANTITIES, FLIGHT_QUANTITIES = (
    frozenset(quantity for parts in table.values() for quantity, _ in parts)
    for table in (IMPACT_DEPENDENCES, FLIGHT_DEPENDENCES)
)
HARMONIC_NUMBERS = (1.0, 2.0, 4.0)  # a square looks the same after a quarter of a turn


@dataclass(frozen=True)
class Curve:
    """Functions of one quantity.

    Attributes
    ----------
    numbers : of a spline its breakpoints; of harmonics their numbers; of kinds the members; of a line the unit
    """

    quantity: str
    kind: str
    numbers: tuple[float, ...]

    def features(self, values: Array) -> Array:
        """(n, k) functions of the values (n,): of a spline a line and B-splines, which keep their last value beyond its
        breakpoints."""
        if self.kind == HARMONICS:
            return np.column_stack([f(k * values) for k in self.numbers for f in (np.sin, np.cos)])
        if self.kind == KINDS:
            return np.asarray(values[:, None] == np.array(self.numbers), float)
        if self.kind == LINE:
            return (values / self.numbers[0])[:, None]
        from scipy.interpolate import BSpline

        ends = np.array(self.numbers)
        knots = np.concatenate([[ends[0]] * SPLINE_DEGREE, ends, [ends[-1]] * SPLINE_DEGREE])
        inside = np.clip(values, ends[0], ends[-1])
        parts = BSpline.design_matrix(inside, knots, SPLINE_DEGREE).toarray()
        # the line has a coefficient of its own: a plain trend then costs one, not one for each part
        return np.column_stack([(inside - ends.mean()) / ends.std(), parts])


@dataclass(frozen=True)
class Basis:
    """Functions of what a change depends on; without curves it is a constant."""

    name: str
    curves: tuple[Curve, ...]

    def features(self, quantities: Mapping[str, Array]) -> Array:
        """(n, k) functions of quantities (n,)."""
        if not self.curves:
            return np.ones((len(next(iter(quantities.values()))), 1))
        return np.concatenate([curve.features(quantities[curve.quantity]) for curve in self.curves], axis=1)

    def content(self) -> dict[str, Any]:
        """For a JSON file."""
        return {"depends_on": self.name, "curves": [asdict(curve) for curve in self.curves]}


def read_basis(content: Mapping[str, Any]) -> Basis:
    """The inverse of `Basis.content`."""
    curves = (Curve(c["quantity"], c["kind"], tuple(map(float, c["numbers"]))) for c in content["curves"])
    return Basis(content["depends_on"], tuple(curves))


def bases(
    dependences: Mapping[str, tuple[tuple[str, str], ...]], quantities: Mapping[str, Array]
) -> dict[str, Basis]:
    """The bases of dependences for measured quantities (n,), name -> basis. What does not vary is left out."""
    found = {}
    for name, parts in dependences.items():
        curves = [
            c for quantity, kind in parts if (c := _curve(quantity, kind, quantities[quantity])) is not None
        ]
        if curves or not parts:
            found[name] = Basis(name, tuple(curves))
    return found


def _curve(quantity: str, kind: str, values: Array) -> Curve | None:
    """The curve for measured values; None if they do not vary."""
    if np.ptp(values) <= LEAST_SPREAD * (1.0 + np.abs(values).max()):
        return None
    if kind == HARMONICS:
        return Curve(quantity, kind, HARMONIC_NUMBERS)
    if kind == KINDS:
        return Curve(quantity, kind, tuple(map(float, np.unique(values))))
    if kind == LINE:
        return Curve(quantity, kind, (float(np.sqrt(np.mean(values**2))),))
    ends = np.unique(np.quantile(values, np.linspace(0.0, 1.0, SPLINE_PIECES + 1)))
    return Curve(quantity, kind, tuple(map(float, ends)))
