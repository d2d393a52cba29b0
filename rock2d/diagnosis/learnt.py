"""Learnt changes: dependences without a named cause become a part of the model.

For a dependence of the residuals (`levers.find_dependences`), the lever becomes a smooth function with a few
coefficients. These are fitted together with all parameters of the model, and kept only if held-out releases gain."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, field, replace

import numpy as np

from rock2d.arrays import Array
from rock2d.diagnosis.cross_validation import Validated, held_out_gain
from rock2d.diagnosis.data import Data, Residuals
from rock2d.diagnosis.fitting import Convergence, Fit, fit
from rock2d.diagnosis.learnt_prediction import KnownChange
from rock2d.diagnosis.levers import LEVERS, Dependence, Levers, find_dependences
from rock2d.diagnosis.model import LeverResponse
from rock2d.diagnosis.significance import Gain, SummedGain

MOST_LEARNT = 3  # number of learnt changes
TRIED_AT_ONCE = 2  # dependences that are fitted, of which the best is kept
# log likelihood that the linear model must expect; it expects too little if a dependence was fitted as scatter
LEAST_EXPECTED_GAIN = 3.0
LEAST_GAIN, LEAST_GAIN_Z = 5.0, 3.0  # log likelihood, and standard errors, that a change must gain
# A change that gains what was expected is not compared with a weaker one, of which less than half is expected and a
# quarter of this gain.
WEAKER_EXPECTED, WEAKER_GAIN = 0.5, 0.25
# Factor by which changes may gain more than expected, on average. A single one can gain ten times as much, if it was
# fitted as scatter.
MOST_UNDERESTIMATED = 6.0
CONVERGED_GAIN = 1.0  # log likelihood of a step below which a fit has converged


@dataclass
class Change(KnownChange, SummedGain):
    """A learnt change, with its coefficients in SI; those of the law are logarithmic.

    Attributes
    ----------
    gain : (releases,) gain in log likelihood on held-out releases
    units : (components of the lever,) natural units, in which its coefficients are fitted"""

    gain: Array
    units: Array


@dataclass
class Learnt(Validated):
    """A validated fit with learnt changes.

    `before`: the same without the last change, if there is one; `dependences`: all dependences of its residuals, if
    they are known."""

    changes: list[Change] = field(default_factory=list)
    before: Learnt | None = None
    dependences: list[Dependence] | None = None

    def changes_at(self, p: Array) -> list[Change]:
        """The changes at other parameters p of the fit."""
        parts = self.fit.model.coefficients(p)
        return [
            replace(change, coefficients=coefficients.reshape(len(change.units), -1) * change.units[:, None])
            for change, coefficients in zip(self.changes, parts, strict=True)
        ]


def learn(start: Validated, data: Data, only: Collection[str] = LEVERS, least_total: float = -np.inf) -> Learnt:
    """Add learnt changes of the levers `only` to a model, as long as held-out releases gain significantly.

    Further changes are not learnt if it is clear that all together will gain less than `least_total`."""
    state = start if isinstance(start, Learnt) else Learnt(start.fit, start.held_out)
    for count in range(MOST_LEARNT if start.fit.free else 0):
        levers, tried = Levers(state.fit, data), list[tuple[Dependence, Learnt, Gain]]()
        dependences = find_dependences(state.fit, data, only, levers)
        if only is LEVERS:
            state.dependences = dependences
        if count and dependences:
            further = MOST_UNDERESTIMATED * (MOST_LEARNT - count) * dependences[0].total
            if held_out_gain(data, state, start).total + further < least_total:
                break
        for dependence in [d for d in dependences if d.total > LEAST_EXPECTED_GAIN][:TRIED_AT_ONCE]:
            if any(_surpasses(gain, expected, dependence) for expected, _, gain in tried):
                break
            response = levers.response(dependence.lever, dependence.basis)
            convergence = Convergence(
                CONVERGED_GAIN, max((trial.fit.total() for _, trial, _ in tried), default=-np.inf)
            )
            columns = levers.columns(response)
            fitted = _fit_with_change(state.fit, data, response, columns, dependence.width, convergence)
            candidate = Learnt.of(fitted, data)
            tried.append((dependence, candidate, held_out_gain(data, candidate, state)))
        if not tried:
            break
        dependence, candidate, best = max(tried, key=lambda trial: trial[-1].total)
        if best.total < LEAST_GAIN or best.significance < LEAST_GAIN_Z:
            break
        new = Change(dependence.lever, dependence.basis, np.empty(0), best.gain, levers.units[dependence.lever])
        state = Learnt(candidate.fit, candidate.held_out, [*state.changes, new], state)
        state.changes = state.changes_at(candidate.fit.p)
    return state


def _surpasses(gain: Gain, expected: Dependence, weaker: Dependence) -> bool:
    """Whether a change gained what was `expected` of it, and so much that a weaker one cannot gain more."""
    weak = weaker.total < min(WEAKER_EXPECTED * expected.total, WEAKER_GAIN * gain.total)
    return weak and gain.total > expected.total


def best_predicting(data: Data, learnt: Learnt, other: Learnt) -> Learnt:
    """`other` if it has learnt changes and predicts held-out releases significantly better, else `learnt`."""
    return other if other.changes and held_out_gain(data, other, learnt).significant else learnt


def residuals_on(data: Data, learnt: Learnt) -> Residuals:
    """Residuals of the model with its learnt changes for other data of the same set-up."""
    fitted, changes = learnt.fit, learnt.changes
    if not changes:
        return fitted.model.residuals(fitted.p, data)
    p = fitted.p[: fitted.model.named_size]
    named = replace(fitted.model, responses=(), widths=np.empty(0))
    levers = Levers(replace(fitted, model=named, p=p), data)
    responses = [levers.response(c.lever, c.basis) for c in changes]
    parts = [c.coefficients / levers.units[c.lever][:, None] for c in changes]
    coefficients = np.concatenate([part.ravel() for part in parts])
    wider = replace(named, responses=responses, widths=np.ones(len(coefficients)))
    return wider.residuals(np.concatenate([p, coefficients]), data)


def _fit_with_change(
    old: Fit, data: Data, response: LeverResponse, columns: Residuals, width: float, convergence: Convergence
) -> Fit:
    """The fit with one more change."""
    widths = np.full(response.size, width)
    model = old.model
    wider = replace(model, responses=[*model.responses, response], widths=np.concatenate([model.widths, widths]))
    jacobian = old.jacobian.beside(columns.impacts * widths, columns.flights * widths)
    start = np.concatenate([old.p, np.zeros(len(widths))])
    return fit(wider, data, start, old=replace(old, model=wider, p=start, jacobian=jacobian), convergence=convergence)
