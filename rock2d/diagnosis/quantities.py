"""What an impact or a flight may depend on: measured quantities, and smooth functions of few coefficients of them. And
the features of impacts for the regression of the residuals.

A *basis* is additive over its quantities. Splines follow any smooth curve, harmonics an angle, a line passes through
zero; kinds, for example blocks or zones, have one value each."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from rock2d.arrays import Array
from rock2d.kinematics.impacts import ground_axes
from rock2d.records.columns import LINEAR_VELOCITY, OMEGA, RATES, THETA, X, Y
from rock2d.scene.world import World

CONSTANT = "nothing"  # name of the dependence of a constant
SPLINE, HARMONICS, KINDS, LINE, WAVES = "spline", "harmonics", "kinds", "line", "waves"
FINE, FINEST = "fine", "finest"
SPLINE_DEGREE = 2
# number of pieces between quantiles of the measured values
SPLINE_PIECES = {SPLINE: 5, FINE: 16, FINEST: 32}
SLOPE_STEP = 1e-5  # for differences, as a share of the measured range
PARTS_OF_PIECE = 4  # straight parts by which a piece is drawn as ground
COARSER = {FINE: SPLINE, FINEST: FINE}
LEAST_VALUES_PER_PIECE = 6  # measured values
SLOWEST_WAVE, FASTEST_WAVE = 0.1, 3.5  # oscillations in √(size / g)
WAVES_PER_PHASE = 2.0  # frequencies for each further oscillation over the measured times
FADE = 0.5  # share of the measured range over which a change fades to nothing beyond its ends
ABSENT = -1  # number of a kind that a world does not have
LEAST_SPREAD = 1e-9  # least range of a quantity that varies, as a share of 1 + its largest magnitude

BLOCK, ZONE, SERIES, HISTORY = "block", "zone", "release of the block", "impact of the release"
PLACE_M, HEIGHT_M, CLEARANCE_M = "x_m", "y_m", "height_above_ground_m"
LEAN_RAD, THETA_RAD = "orientation_to_ground_rad", "theta_rad"
NORMAL_SPEED_M_S, TANGENTIAL_SPEED_M_S = "normal_speed_m_s", "tangential_speed_m_s"
SLIDING_SPEED_M_S, SPIN_M_S = "sliding_speed_m_s", "spin_times_radius_m_s"
VX_M_S, VY_M_S, OMEGA_RAD_S, TIME_S = "vx_m_s", "vy_m_s", "omega_rad_s", "time_s"
DRAG_X_M2_S2, DRAG_Y_M2_S2 = "speed_times_vx_m2_s2", "speed_times_vy_m2_s2"
SPIN_VX_M_S2, SPIN_VY_M_S2 = "omega_times_vx_m_s2", "omega_times_vy_m_s2"

MOST_COUNTED_IMPACTS = 2  # later impacts of a release count as one kind
# the orientation at the touch is extrapolated over TOUCH_RADII over the normal velocity, at least SLOWEST_TOUCH_M_S
TOUCH_RADII, SLOWEST_TOUCH_M_S = 0.3, 0.1

# name of a dependence -> (quantity, kind of curve) of each of its quantities
Dependences = Mapping[str, tuple[tuple[str, str], ...]]
IMPACT_DEPENDENCES: Dependences = {
    CONSTANT: (),
    "block": ((BLOCK, KINDS),),
    "zone": ((ZONE, KINDS),),
    "place": ((PLACE_M, SPLINE),),
    "place in detail": ((PLACE_M, FINE),),
    "orientation to the ground": ((LEAN_RAD, HARMONICS),),
    "orientation": ((THETA_RAD, HARMONICS),),
    "normal speed": ((NORMAL_SPEED_M_S, SPLINE),),
    "tangential speed": ((TANGENTIAL_SPEED_M_S, SPLINE),),
    "sliding speed": ((SLIDING_SPEED_M_S, SPLINE),),
    "spin": ((SPIN_M_S, SPLINE),),
    "series": ((SERIES, SPLINE),),
    "history": ((HISTORY, KINDS),),
}
FLIGHT_DEPENDENCES: Dependences = {
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
# dependences of what the camera or the ground adds equally to the motion before and after an impact
FRAME_DEPENDENCES: Dependences = {
    CONSTANT: (),
    "spin": ((OMEGA_RAD_S, LINE),),
    "velocity": ((VX_M_S, LINE), (VY_M_S, LINE)),
    "series": ((SERIES, LINE),),
}
# dependences of a slope of the ground that the survey missed, and of the height of a ground that is not as surveyed
SLOPE_DEPENDENCES: Dependences = {"zone": ((ZONE, KINDS),), "series": ((SERIES, SPLINE),)}
PROFILE_DEPENDENCES: Dependences = {"place": ((PLACE_M, FINE),), "place in detail": ((PLACE_M, FINEST),)}
HARMONIC_NUMBERS = (1.0, 2.0, 4.0)  # a square looks the same after a quarter of a turn


@dataclass(frozen=True)
class Curve:
    """Functions of one quantity, with the name `quantity`; `kind`: SPLINE, HARMONICS, KINDS, LINE or WAVES.

    Attributes
    ----------
    numbers : breakpoints of a spline, orders of harmonics, the kinds, unit of a line, or angular frequencies of
        waves
    measured : lowest and highest measured value of a line or waves; those of a spline are its ends"""

    quantity: str
    kind: str
    numbers: tuple[float, ...]
    measured: tuple[float, float] | None = None

    def fade(self, values: Array) -> Array:
        """(n,) weights: 1 within the range of measured values, falling to 0 at `FADE` times the range beyond its
        ends."""
        ends = (self.numbers[0], self.numbers[-1]) if self.kind == SPLINE else self.measured
        if ends is None:
            return np.ones(len(values))
        beyond = np.maximum(np.maximum(ends[0] - values, values - ends[1]), 0.0)
        return np.clip(1.0 - beyond / (FADE * (ends[1] - ends[0])), 0.0, 1.0)

    def grid(self) -> Array:
        """Values of a spline's quantity between which its functions are nearly linear, to where they have faded."""
        ends = np.array(self.numbers)
        parts = np.linspace(ends[:-1], ends[1:], PARTS_OF_PIECE, endpoint=False, axis=1).ravel()
        beyond = FADE * (ends[-1] - ends[0]) * np.arange(1, PARTS_OF_PIECE + 1) / PARTS_OF_PIECE
        return np.concatenate([ends[0] - beyond[::-1], parts, ends[-1:], ends[-1] + beyond])

    def features(self, values: Array) -> Array:
        """(n, k) functions of values (n,): for a spline a line and B-splines, which keep their last value beyond its
        breakpoints."""
        if self.kind in (HARMONICS, WAVES):
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
        # the line has a coefficient of its own: a linear trend then needs only one coefficient
        return np.column_stack([(inside - ends.mean()) / ends.std(), parts])


@dataclass(frozen=True)
class Basis:
    """Functions of the quantities on which a change depends; without curves a constant."""

    name: str
    curves: tuple[Curve, ...]

    def features(self, quantities: Mapping[str, Array]) -> Array:
        """(n, k) functions of quantities, name -> (n,); they fade to 0 outside the measured range."""
        if not self.curves:
            return np.ones((len(next(iter(quantities.values()))), 1))
        each = [quantities[curve.quantity] for curve in self.curves]
        known = np.prod([c.fade(values) for c, values in zip(self.curves, each, strict=True)], axis=0)
        parts = [c.features(values) for c, values in zip(self.curves, each, strict=True)]
        return np.concatenate(parts, axis=1) * known[:, None]

    def slopes(self, values: Array) -> Array:
        """(n, k) derivatives of the functions by their only quantity."""
        (curve,) = self.curves
        step = SLOPE_STEP * np.ptp(curve.numbers)
        higher, lower = (self.features({curve.quantity: values + side}) for side in (step, -step))
        return np.asarray((higher - lower) / (2.0 * step))

    def content(self, world: World | None = None) -> dict[str, Any]:
        """The basis as in the key `changes` of diagnosis.json; blocks and zones of a `world` with their names."""
        curves = [asdict(curve) for curve in self.curves]
        names = {} if world is None else kind_names(world)
        for curve in curves:
            if known := names.get(curve["quantity"]):
                curve["names"] = [known[int(i)] for i in curve["numbers"]]
        return {"depends_on": self.name, "curves": curves}


def quantities_of(dependences: Dependences) -> frozenset[str]:
    """All quantities of dependences."""
    return frozenset(quantity for parts in dependences.values() for quantity, _ in parts)


def kind_names(world: World) -> dict[str, list[str]]:
    """Quantity -> names of its kinds, in the order of their numbers."""
    return {BLOCK: list(world.blocks), ZONE: list(world.cross_section.zone_names)}


def read_basis(content: Mapping[str, Any], world: World | None = None) -> Basis:
    """The inverse of `Basis.content`, for blocks and zones of the same names in a `world`, whatever their numbers."""
    curves = []
    for c in content["curves"]:
        ends, numbers = c.get("measured"), c["numbers"]
        if world is not None and c.get("names"):
            known = kind_names(world)[c["quantity"]]
            numbers = [known.index(name) if name in known else ABSENT for name in c["names"]]
        measured = None if ends is None else (float(ends[0]), float(ends[1]))
        curves.append(Curve(c["quantity"], c["kind"], tuple(map(float, numbers)), measured))
    return Basis(content["depends_on"], tuple(curves))


def bases(dependences: Dependences, quantities: Mapping[str, Array]) -> dict[str, Basis]:
    """Name of a dependence -> basis for measured quantities (n,). Quantities that do not vary are left out."""
    basis_of = {}
    for name, parts in dependences.items():
        curves = [c for quantity, kind in parts if (c := _curve(quantity, kind, quantities[quantity])) is not None]
        if curves or not parts:
            basis_of[name] = Basis(name, tuple(curves))
    return basis_of


def waves(times_s: Array, unit_s: float) -> list[Basis]:
    """Bases of an oscillation in time, one for each frequency that the times (n,) can resolve; `unit_s`: √(size /
    g)."""
    step = 1.0 / (WAVES_PER_PHASE * max(float(np.ptp(times_s)), unit_s))
    rates = 2.0 * np.pi * np.arange(SLOWEST_WAVE / unit_s, FASTEST_WAVE / unit_s, step)
    ends = float(times_s.min()), float(times_s.max())
    return [Basis("time", (Curve(TIME_S, WAVES, (float(rate),), ends),)) for rate in rates]


def _curve(quantity: str, kind: str, values: Array) -> Curve | None:
    """The curve for measured values; None if they do not vary."""
    if np.ptp(values) <= LEAST_SPREAD * (1.0 + np.abs(values).max()):
        return None
    if kind == HARMONICS:
        return Curve(quantity, kind, HARMONIC_NUMBERS)
    if kind == KINDS:
        return Curve(quantity, kind, tuple(map(float, np.unique(values))))
    if kind == LINE:
        unit = float(np.sqrt(np.mean(values**2)))
        return Curve(quantity, kind, (unit,), (float(values.min()), float(values.max())))
    pieces = min(SPLINE_PIECES[kind], len(values) // LEAST_VALUES_PER_PIECE)
    if kind in COARSER and pieces <= SPLINE_PIECES[COARSER[kind]]:
        return None
    ends = np.unique(np.quantile(values, np.linspace(0.0, 1.0, max(pieces, 1) + 1)))
    return Curve(quantity, SPLINE, tuple(map(float, ends)))


# --- measured quantities --------------------------------------------------------------------------------


def incident_features(world: World, block: Array, zone: Array, tangent: Array, before: Array) -> Array:
    """(n, features) of impacts, from the states `before` them (n, 6)."""
    q = incident_quantities(world, block, zone, tangent, before)
    along, across = q[TANGENTIAL_SPEED_M_S], -q[NORMAL_SPEED_M_S]
    angles = [f(k * q[LEAN_RAD]) for k in HARMONIC_NUMBERS for f in (np.sin, np.cos)]
    kinds = [block == b for b in range(len(world.blocks))] + [zone == z for z in np.unique(zone)]
    return np.column_stack(
        [along, across, q[SPIN_M_S], q[SLIDING_SPEED_M_S], before[:, X], before[:, Y], along * across, *angles,
         *kinds, *[k * across for k in kinds], *[k * along for k in kinds]]
    )  # fmt: skip


def incident_quantities(world: World, block: Array, zone: Array, tangent: Array, before: Array) -> dict[str, Array]:
    """Name -> (n,): quantities of impacts from the states `before` them (n, 6)."""
    radius = world.radii_m[block]
    along, across = ground_axes(tangent, before[:, LINEAR_VELOCITY])
    spin = before[:, OMEGA] * radius
    # of the block to the ground at the touch
    closing = np.maximum(np.abs(across), SLOWEST_TOUCH_M_S)
    slope = np.arctan2(tangent[:, Y], tangent[:, X])
    lean = before[:, THETA] + before[:, OMEGA] * TOUCH_RADII * radius / closing - slope
    return {
        BLOCK: block.astype(float),
        ZONE: zone.astype(float),
        PLACE_M: before[:, X],
        LEAN_RAD: lean,
        THETA_RAD: before[:, THETA],
        NORMAL_SPEED_M_S: -across,
        TANGENTIAL_SPEED_M_S: along,
        SLIDING_SPEED_M_S: along + spin,
        SPIN_M_S: spin,
        **moving_quantities(before[:, RATES]),
    }


def moving_quantities(rates: Array) -> dict[str, Array]:
    """Name -> (n,): velocities in the image (n, 3), before or after an impact."""
    return {VX_M_S: rates[:, 0], VY_M_S: rates[:, 1], OMEGA_RAD_S: rates[:, 2]}


def history_quantities(release: Array, order: Array, began: Array) -> dict[str, Array]:
    """Name -> (n,): position `order` of the release in its series, and number of the impact in its release, from the
    instants at which the impacts `began`."""
    number = np.zeros(len(release))
    for r in np.unique(release):
        rows = release == r
        number[rows] = np.argsort(np.argsort(began[rows]))
    return {SERIES: order.astype(float), HISTORY: np.minimum(number, MOST_COUNTED_IMPACTS)}
