"""Levers: the few numbers of a model that a learnt change may change, and the response of all residuals to them.

The levers of an impact are the parameters of the law, the slope of the ground, its profile (its height, and with it
its slope), the state before it, its outcome, and the frame: what camera or ground add equally to the motion before and
after it. The lever of a flight is its acceleration. Each may be a function on a basis (`quantities.Basis`). The
responses to all coefficients follow from a few simulations by the chain rule.

A *dependence* is a lever that follows measured quantities in the residuals of a model; no effect need explain it. A
regression without mechanics (`residual_regression`) needs many impacts to find a pattern in six channels; levers change
all channels together. For each pair of lever and basis, one Newton step with free parameters of the model gives the
gain on held-out releases."""

from collections import Counter
from collections.abc import Collection
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from rock2d.arrays import Array
from rock2d.diagnosis.data import Data, FilmData, Residuals, as_rows_of_flights
from rock2d.diagnosis.fitting import Fit
from rock2d.diagnosis.flight_response import FlightPaths, flight_paths, flight_response
from rock2d.diagnosis.linear_model import LinearModel
from rock2d.diagnosis.model import BASE_WIDTH, LeverDerivatives, LeverResponse, state_units
from rock2d.diagnosis.quantities import (
    CONSTANT,
    FLIGHT_DEPENDENCES,
    FRAME_DEPENDENCES,
    IMPACT_DEPENDENCES,
    PLACE_M,
    PROFILE_DEPENDENCES,
    SLOPE_DEPENDENCES,
    TIME_S,
    Basis,
    bases,
    quantities_of,
    waves,
)
from rock2d.diagnosis.significance import SummedGain
from rock2d.kinematics.rest_poses import ground_below
from rock2d.records.columns import N_POSE, N_STATE, OMEGA, RATES, THETA, VX, VY, X, Y

LAW, SLOPE, PROFILE, STATE, OUTCOME, FRAME, FLIGHT = LEVERS = (
    "law", "slope", "profile", "incident state", "outcome", "frame", "flight",
)  # fmt: skip
# number of components of each; an outcome has 6 in a film and 3 in an impact table
LEVER_SIZES = {LAW: (5,), SLOPE: (1,), PROFILE: (1,), STATE: (6,), OUTCOME: (6, 3), FRAME: (4,), FLIGHT: (3,)}
# what a change of each may depend on
DEPENDENCES = {
    LAW: IMPACT_DEPENDENCES, SLOPE: SLOPE_DEPENDENCES, PROFILE: PROFILE_DEPENDENCES, STATE: IMPACT_DEPENDENCES,
    OUTCOME: IMPACT_DEPENDENCES, FRAME: FRAME_DEPENDENCES, FLIGHT: FLIGHT_DEPENDENCES,
}  # fmt: skip
# further quantities: the ground may oscillate; older diagnoses hold a slope of the place
FURTHER_QUANTITIES = {FRAME: {TIME_S}, SLOPE: {PLACE_M}}
LEVER_QUANTITIES = {
    lever: quantities_of(own) | FURTHER_QUANTITIES.get(lever, set()) for lever, own in DEPENDENCES.items()
}
FRAME_COLUMNS = (VX, VY, OMEGA, THETA)  # columns of a state that the components of the frame change
# tried standard deviations of the coefficients, in the natural units of `Levers.units`
WIDTHS = {
    LAW: (0.02, 0.1, 0.4),
    STATE: (0.02, 0.1, 0.4),
    OUTCOME: (0.1, 0.4, 1.6),
    SLOPE: (0.01, 0.05, 0.2),
    PROFILE: (0.01, 0.05, 0.2),
    FRAME: (0.01, 0.05, 0.2),
    FLIGHT: (0.003, 0.03, 0.3),
}
CHANCE_PENALTY = 2.0  # log likelihood for each factor of e in the number of bases of the same name


class Levers:
    """The levers of a fitted model on its data."""

    def __init__(self, fit: Fit, data: Data) -> None:
        self._fit, self._data = fit, data
        self.world = fit.model.world(fit.p, data.impact_order)

    @cached_property
    def bases(self) -> dict[str, list[Basis]]:
        """Lever -> bases that it may follow."""
        impacts, bases_of_lever = bool(len(self._data.impact_release)), dict[str, list[Basis]]()
        quantities = self.impact_quantities if impacts else {}
        for lever in (LAW, STATE, OUTCOME, FRAME) if impacts else ():
            bases_of_lever[lever] = list(bases(DEPENDENCES[lever], quantities).values())
        if impacts and self._paths is not None:
            unit_s = float(np.sqrt(self.world.mean_size_m / max(self.world.gravity_m_s2, 1e-3)))
            bases_of_lever[FRAME] += waves(quantities[TIME_S], unit_s)
            for lever in (SLOPE, PROFILE):
                bases_of_lever[lever] = list(bases(DEPENDENCES[lever], quantities).values())
        if self._paths is not None:
            bases_of_lever[FLIGHT] = list(bases(DEPENDENCES[FLIGHT], self._paths.quantities).values())
        return bases_of_lever

    @cached_property
    def impact_quantities(self) -> dict[str, Array]:
        """Quantities of the impacts, name -> (n,)."""
        return self._data.impact_quantities(self.world)

    @cached_property
    def _outcome_quantities(self) -> dict[str, Array]:
        return self._data.outcome_quantities(self.world)

    @cached_property
    def _paths(self) -> FlightPaths | None:
        return flight_paths(self._data, self.world) if isinstance(self._data, FilmData) else None

    @cached_property
    def units(self) -> dict[str, Array]:
        """Natural units of each component of a lever: 1 for a logarithm, `state_units` for states, the spread of the
        noise for outcomes, gravity for accelerations."""
        gravity, state = self.world.gravity_m_s2, state_units(self.world)
        variance = np.diagonal(self._fit.covariance(), axis1=1, axis2=2)
        spread = np.sqrt(np.median(variance, axis=0)) if len(variance) else np.ones(variance.shape[1])
        return {
            LAW: np.ones(len(BASE_WIDTH)),
            STATE: state,
            OUTCOME: spread,
            SLOPE: np.ones(1),
            PROFILE: state[[Y]],
            FRAME: state[list(FRAME_COLUMNS)],
            FLIGHT: np.array([gravity, gravity, gravity / state[Y]]),
        }

    def response(self, lever: str, basis: Basis) -> LeverResponse:
        """Response of the data to a lever on a basis, with coefficients in natural units."""
        if lever == FLIGHT:
            return self._flight_response(basis)
        units = self.units[lever]
        each = _coefficient_columns(basis.features(self.impact_quantities), units)
        size = each.shape[-1]
        if lever == LAW:
            return LeverResponse(size, law=each)
        if lever == SLOPE:
            return LeverResponse(size, slope=each[:, 0])
        if lever == PROFILE:
            return self._profile_response(each[:, 0], basis)
        if lever == FRAME:
            return self._frame_response(each, _coefficient_columns(basis.features(self._outcome_quantities), units))
        return LeverResponse(size, shift=each) if lever == STATE else LeverResponse(size, impacts=each)

    def _frame_response(self, before: Array, after: Array) -> LeverResponse:
        """Response to what is added to the motion `before` and `after` the impacts (n, 4, c)."""
        n, _, c = before.shape
        shift, measured = np.zeros((2, n, N_STATE, c))
        shift[:, FRAME_COLUMNS], measured[:, FRAME_COLUMNS] = before, after
        along = _along_ground(self._data.tangent, measured)
        return LeverResponse(c, shift=shift, impacts=-along[:, -self._fit.residuals.impacts.shape[1] :])

    def moved(self, shift: Array) -> LeverResponse:
        """Response to a `shift` (n, 6, c) of the states before and after the impacts of a film."""
        return LeverResponse(shift.shape[-1], shift=shift, impacts=-_along_ground(self._data.tangent, shift))

    def _profile_response(self, heights: Array, basis: Basis) -> LeverResponse:
        """Response to heights (n, c) of the ground above the stated one: the block is lower above the ground, before
        and after the impact and at rest, and the ground is steeper."""
        (n, c), tangent = heights.shape, self._data.tangent
        shift = np.zeros((n, N_STATE, c))
        shift[:, Y] = -heights
        steeper = basis.slopes(self.impact_quantities[PLACE_M]) * self.units[PROFILE]
        return replace(self.moved(shift), slope=steeper * tangent[:, X, None] ** 2, flights=self._raised_rests(basis))

    def _raised_rests(self, basis: Basis) -> Array | None:
        """(m, 3, degrees, c) response of the rests to a profile of the ground; None without rests."""
        data, unit_m = self._data, self.units[PROFILE]
        assert isinstance(data, FilmData)
        if not len(data.rests):
            return None
        true = self.world.view.true(data.rests.pose)
        level = ground_below(self.world, true)[0][:, X, None]  # cosine of the slope
        higher, steeper = basis.features({PLACE_M: true[:, X]}) * level, basis.slopes(true[:, X]) * level**2
        smooth = np.array([block.smooth for block in self.world.blocks.values()])
        steeper[smooth[data.rests.block]] = 0.0  # no side lies on the ground
        lower = -unit_m * np.stack([higher, steeper], axis=1)
        rests = as_rows_of_flights(data.rests.standardised(lower, self.world))
        return np.concatenate([np.zeros((data.flown, *rests.shape[1:])), rests])

    def columns(self, response: LeverResponse) -> Residuals:
        """Derivatives of all residuals by the coefficients."""
        return self._derivatives.by_coefficients(response)

    @cached_property
    def _derivatives(self) -> LeverDerivatives:
        own = self._fit
        return LeverDerivatives(
            own.model, own.p, self._data, own.residuals, own.jacobian.impacts[..., : len(BASE_WIDTH)]
        )

    def _flight_response(self, basis: Basis) -> LeverResponse:
        data, units = self._data, self.units[FLIGHT]
        assert isinstance(data, FilmData) and self._paths is not None
        response, impacts = flight_response(data, self.world, self._paths, basis), data.impacts
        (m, degrees, k), scale = response.residuals.shape, self.world.view.time_scale
        before = response.state_change(impacts.before, impacts.start_s * scale)
        after = response.state_change(impacts.after, impacts.begin_s * scale)
        noise = data.flight_noise(self.world)
        flights = np.zeros((len(data.flight_release), N_POSE, degrees, N_POSE * k))
        shift = np.zeros((len(impacts), N_STATE, N_POSE * k))
        measured = np.zeros_like(shift)
        for c in range(N_POSE):
            columns = slice(c * k, (c + 1) * k)
            flights[:m, c, :, columns] = -units[c] * response.residuals / noise[:, c, None, None]
            for state, (place, rate) in ((shift, before), (measured, after)):
                state[:, c, columns], state[:, N_POSE + c, columns] = units[c] * place, units[c] * rate
        outcome = -_along_ground(data.tangent, measured)
        return LeverResponse(N_POSE * k, shift=shift, impacts=outcome, flights=flights)


def _coefficient_columns(features: Array, units: Array) -> Array:
    """(n, components, coefficients) change of each component by its own coefficients, from features (n, k)."""
    turns = np.eye(len(units))[:, :, None] * units[:, None, None]
    return np.asarray((turns[None] * features[:, None, None, :]).reshape(len(features), len(units), -1))


def _along_ground(tangent: Array, states: Array) -> Array:
    """(n, 6, c) states in the axes of the residuals of impacts: along the ground, across it, angle, and their rates."""
    out = np.empty_like(states)
    for first in (X, RATES.start):
        x, y = states[:, first], states[:, first + 1]
        tx, ty = tangent[:, X, None], tangent[:, Y, None]
        out[:, first], out[:, first + 1] = tx * x + ty * y, tx * y - ty * x
        out[:, first + 2] = states[:, first + 2]
    return out


@dataclass
class Dependence(SummedGain):
    """A dependence of a lever on measured quantities, and its gain.

    Attributes
    ----------
    gain : (releases,) log likelihood on held-out releases
    width : standard deviation of its coefficients with the largest gain"""

    lever: str
    basis: Basis
    gain: Array
    width: float

    @property
    def name(self) -> str:
        return f"{self.lever} of {self.basis.name}"


def find_dependences(
    fit: Fit, data: Data, only: Collection[str] = LEVERS, levers: Levers | None = None
) -> list[Dependence]:
    """All tried dependences of the levers `only`, the one with the largest gain first.

    `levers`: those of the fit, if they are used further: their derivatives are then computed once."""
    levers, linear = levers or Levers(fit, data), LinearModel(fit, data)
    dependences = []
    for lever, tried in levers.bases.items():
        if lever not in only:
            continue
        bases_of_name = Counter(basis.name for basis in tried)
        for basis in tried:
            if basis.name == CONSTANT and lever in (LAW, OUTCOME):
                # the law is fitted, and impacts on the other side of an edge shift all outcomes to one side
                continue
            gain, width = linear.best_gain(levers.columns(levers.response(lever, basis)), WIDTHS[lever])
            # the best of many bases of the same name has a gain by chance
            penalty = CHANCE_PENALTY * np.log(bases_of_name[basis.name]) / len(data.order)
            dependences.append(Dependence(lever, basis, gain - penalty, width))
    return sorted(dependences, key=lambda d: -d.total)
