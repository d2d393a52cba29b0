"""Learnt changes: what depends on something, but has no name, becomes a part of the model.

Where a dependence is found in the residuals (`discrepancy`), its lever follows a smooth function of few coefficients.
They are fitted together with all parameters of the model, and kept only if held-out releases gain.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from rock2d.diagnosis.cross_validation import HeldOut, Validated, cross_validate, held_out_gain
from rock2d.diagnosis.data import Data, Residuals
from rock2d.diagnosis.derivatives import Jacobian
from rock2d.diagnosis.discrepancy import Discrepancy, discrepancies
from rock2d.diagnosis.fitting import Convergence, Fit, fit
from rock2d.diagnosis.learnt_prediction import KnownChange
from rock2d.diagnosis.levers import LEVERS, LeverDerivatives, LeverResponse, Levers, by_coefficients
from rock2d.diagnosis.model import Model, with_changed_law
from rock2d.diagnosis.significance import Gain, OverReleases
from rock2d.kinematics.film_segments import STATE_SIZE

Array = np.ndarray

MOST_LEARNT = 3  # changes
TRIED_AT_ONCE = 2  # dependences that are fitted before the best is kept
# log likelihood that the linear model must expect; it expects too little where the scatter has swallowed a dependence
LEAST_EXPECTED_GAIN = 3.0
LEAST_GAIN, LEAST_GAIN_Z = 5.0, 3.0  # log likelihood, and standard errors, that a change must gain
CONVERGED_GAIN = 1.0  # log likelihood of a step below which a fit has converged
LARGEST_COEFFICIENT = 10.0  # in units of its prior's standard deviation


@dataclass(frozen=True)
class LearntModel(Model):
    """A model with learnt changes. Their coefficients follow its parameters, in units of `widths` (c,)."""

    responses: Sequence[LeverResponse] = ()
    widths: Array = field(default_factory=lambda: np.empty(0))

    @property
    def size(self) -> int:
        return super().size + len(self.widths)

    def start(self) -> Array:
        """Parameters of `base`, with neutral effects and no change."""
        return np.concatenate([super().start(), np.zeros(len(self.widths))])

    def bounds(self) -> tuple[Array, Array]:
        """Lowest and highest parameters."""
        low, high = super().bounds()
        most = np.full(len(self.widths), LARGEST_COEFFICIENT)
        return np.concatenate([low, -most]), np.concatenate([high, most])

    def residuals(
        self,
        p: Array,
        data: Data,
        shift: Array | None = None,
        amounts: Sequence[Sequence[float]] | None = None,
    ) -> Residuals:
        """See `Model.residuals`."""
        world = self.world(p, data.impact_order, amounts)
        moved = np.zeros((len(data.impact_release), STATE_SIZE)) if shift is None else shift
        coefficients = self.coefficients(p)
        for response, own in zip(self.responses, coefficients, strict=True):
            if response.law is not None:
                world = with_changed_law(world, response.law @ own)
            if response.slope is not None:
                world = replace(world, slope_rad=world.slope_rad + response.slope @ own)
            if response.shift is not None:
                moved = moved + response.shift @ own
        found = data.residuals(world, moved)
        for response, own in zip(self.responses, coefficients, strict=True):
            if response.impacts is not None:
                found.impacts = found.impacts + response.impacts @ own
            if response.flights is not None:
                found.flights = found.flights + response.flights @ own
        return found

    def coefficients(self, p: Array) -> list[Array]:
        """Coefficients of each response."""
        ends = np.cumsum([response.size for response in self.responses])[:-1]
        return np.split(p[self.named_size :] * self.widths, ends) if self.responses else []

    def further_derivatives(self, p: Array, data: Data, at: Residuals, by_law: Array) -> Residuals:
        """See `Model.further_derivatives`. By the chain rule: a change of many coefficients moves few numbers."""
        derivatives = LeverDerivatives(self, p, data, at, by_law)
        found = [by_coefficients(response, derivatives) for response in self.responses]
        return Residuals(
            np.concatenate([own.impacts for own in found], axis=-1) * self.widths,
            np.concatenate([own.flights for own in found], axis=-1) * self.widths,
        )


@dataclass
class Change(KnownChange, OverReleases):
    """A learnt change, with its coefficients in SI, or for the law of the logarithm.

    Attributes
    ----------
    gain : (releases,) log likelihood on held-out releases that it adds
    units : (numbers of the lever,) natural units, in which its coefficients are fitted
    """

    gain: Array
    units: Array


@dataclass
class Learnt:
    """A fit with all changes that were kept, and its residuals and scores on held-out releases; `before`: the same
    without the last change, if there is one."""

    fit: Fit
    held_out: HeldOut
    changes: list[Change]
    before: Learnt | None = None

    def changes_at(self, p: Array) -> list[Change]:
        """The changes at other parameters p of the fit."""
        if not isinstance(self.fit.model, LearntModel):
            return []
        parts = self.fit.model.coefficients(p)
        return [
            replace(change, coefficients=own.reshape(len(change.units), -1) * change.units[:, None])
            for change, own in zip(self.changes, parts, strict=True)
        ]


def learn(start: Validated, data: Data, only: Collection[str] = LEVERS) -> Learnt:
    """Learn what a model leaves unexplained, beside what it has learnt already, as changes of some levers."""
    state = start if isinstance(start, Learnt) else Learnt(start.fit, start.held_out, [])
    for _ in range(MOST_LEARNT if start.fit.free else 0):
        found = discrepancies(state.fit, data, only)
        levers, tried = Levers(state.fit, data), list[tuple[Discrepancy, Learnt, Gain]]()
        for dependence in [d for d in found if d.total > LEAST_EXPECTED_GAIN][:TRIED_AT_ONCE]:
            response = levers.response(dependence.lever, dependence.basis)
            convergence = Convergence(
                CONVERGED_GAIN, max((one.fit.total() for _, one, _ in tried), default=-np.inf)
            )
            columns = levers.columns(response)
            fitted = _fitted(state.fit, data, response, columns, dependence.width, convergence)
            out = cross_validate(fitted, data)
            own = Learnt(fitted, out, [])
            tried.append((dependence, own, held_out_gain(data, own, state)))
        if not tried:
            break
        dependence, own, best = max(tried, key=lambda one: one[-1].total)
        if best.total < LEAST_GAIN or best.significance < LEAST_GAIN_Z:
            break
        new = Change(
            dependence.lever, dependence.basis, np.empty(0), best.gain, levers.units[dependence.lever]
        )
        state = Learnt(own.fit, own.held_out, [*state.changes, new], state)
        state.changes = state.changes_at(own.fit.p)
    return state


def best_predicting(data: Data, learnt: Learnt, other: Learnt) -> Learnt:
    """What was learnt, or another with changes if that predicts held-out releases significantly better."""
    return other if other.changes and held_out_gain(data, other, learnt).significant else learnt


def residuals_on(data: Data, learnt: Learnt) -> Residuals:
    """Residuals that the model with its learnt changes leaves in other data of the same set-up."""
    found, changes = learnt.fit, learnt.changes
    if not changes:
        return found.model.residuals(found.p, data)
    own = found.model
    assert isinstance(own, LearntModel)
    p = found.p[: len(found.p) - len(own.widths)]
    named = Model(own.setup, own.base, own.effects, own.beside, flown=own.flown)
    levers = Levers(replace(found, model=named, p=p), data)
    responses = [levers.response(c.lever, c.basis, np.ones(len(c.coefficients))) for c in changes]
    coefficients = np.concatenate([c.coefficients.ravel() for c in changes])
    wider = replace(own, responses=responses, widths=np.ones(len(coefficients)))
    return wider.residuals(np.concatenate([p, coefficients]), data)


def _fitted(
    old: Fit, data: Data, response: LeverResponse, columns: Residuals, width: float, convergence: Convergence
) -> Fit:
    """The fit with one more change."""
    widths = np.full(response.size, width)
    model = old.model
    known, before = (model.responses, model.widths) if isinstance(model, LearntModel) else ((), np.empty(0))
    wider = LearntModel(
        model.setup,
        model.base,
        model.effects,
        model.beside,
        [*known, response],
        np.concatenate([before, widths]),
        flown=model.flown,
    )
    jacobian = Jacobian(
        np.concatenate([old.jacobian.impacts, columns.impacts * widths], axis=-1),
        np.concatenate([old.jacobian.flights, columns.flights * widths], axis=-1),
        old.jacobian.scatter,
        old.jacobian.covariance,
    )
    start = np.concatenate([old.p, np.zeros(len(widths))])
    return fit(
        wider, data, start, old=replace(old, model=wider, p=start, jacobian=jacobian), convergence=convergence
    )
