"""Cross-validation: the score of a model on held-out releases.

The releases are split into folds. For each fold, one Newton step takes the model from its fit to all releases to the
fit without that fold. The parameters change little, so one step is accurate enough. The model is then simulated on the
fold. Where the releases determine the parameters poorly and the step is too long, it is shortened until its cost on
the other folds is small.

`save_fit` keeps a fit and its scores in a file, so that an interrupted diagnosis can continue."""

from dataclasses import dataclass
from pathlib import Path
from typing import Self

import numpy as np

from rock2d.arrays import Array
from rock2d.diagnosis.data import Data, Residuals
from rock2d.diagnosis.derivatives import Jacobian, Noise
from rock2d.diagnosis.fitting import Fit
from rock2d.diagnosis.likelihood import (
    chi_square,
    flight_log_likelihood,
    impact_weight,
    log_likelihood,
    newton_step,
    normal_equations,
    posterior_cost,
    prior,
)
from rock2d.diagnosis.model import Model, choice_positions
from rock2d.diagnosis.significance import Gain
from rock2d.files.saved_arrays import load_arrays, save_arrays

Names = frozenset[str]

FOLDS = 4
ACCEPTED_COST = 1.0  # log likelihood that a step may cost the folds that it is fitted to
MOST_SHORTENED = 3  # lengths of a step that are tried; if none succeeds, no step is taken
SHORTENED = 0.25  # factor from one length to the next


@dataclass
class HeldOut:
    """Residuals and scores of a model on held-out releases.

    Attributes
    ----------
    residuals : residuals of all impacts and flights, each predicted by the fit without its fold
    score : (releases,) log likelihood of each release
    parameters : (FOLDS, P) parameters of the fits without each fold"""

    residuals: Residuals
    score: Array
    parameters: Array


@dataclass
class Validated:
    """A fit, and its residuals and scores on held-out releases."""

    fit: Fit
    held_out: HeldOut

    @classmethod
    def of(cls, fit: Fit, data: Data) -> Self:
        """The fit, cross-validated."""
        return cls(fit, cross_validate(fit, data))

    @property
    def names(self) -> Names:
        """Names of its effects."""
        return frozenset(self.fit.model.positions)


def held_out_gain(data: Data, model: Validated, reference: Validated) -> Gain:
    """Gain in log likelihood of a `model` over a `reference` on held-out releases.

    `Gain.by_means` is the mean of two gains: with the covariances of the model for both, and with those of the
    reference for both. It is None if only one of them has an effect that widens the scatter: the means do not show it.
    """
    scored = model.held_out, reference.held_out
    gain, shared = scored[0].score - scored[1].score, _shared_error(data, model, reference)
    if [e.name for e in model.fit.model.scatter_effects] != [e.name for e in reference.fit.model.scatter_effects]:
        return Gain(gain, None, shared)
    crossed = [
        by_release(data, held_out.residuals, fit.covariance())
        for held_out, fit in zip(scored, (reference.fit, model.fit), strict=True)
    ]
    return Gain(gain, 0.5 * (gain + crossed[0] - crossed[1]), shared)


def _shared_error(data: Data, model: Validated, reference: Validated) -> float:
    """Standard deviation of a gain by slow errors of the track: all releases may share them, so that held-out releases
    do not show them. What is lost where an impact cannot be simulated does not depend on them."""
    slow = data.slow_outcomes()
    if not slow.shape[-1]:
        return 0.0
    covariance, other = reference.fit.covariance(), model.held_out.residuals.impacts
    residuals = reference.held_out.residuals.impacts
    weight = impact_weight(chi_square(residuals, covariance), residuals.shape[1])
    differ = np.linalg.solve(covariance, np.nan_to_num(residuals - other)[..., None])[..., 0]
    return float(np.linalg.norm(np.einsum("n,nds,nd->s", weight, slow, differ)))


def rests_z(data: Data, model: Validated, other: Validated) -> float:
    """Standard errors by which held-out rests prefer a model to another one. Rests follow from no law of contact, so
    what laws miss excuses no model."""
    score, other_score = (
        float(flight_log_likelihood(own.held_out.residuals.flights[data.flown :]).sum()) for own in (model, other)
    )
    return float(np.sign(score - other_score) * np.sqrt(2.0 * abs(score - other_score)))


def folds(data: Data) -> Array:
    """(releases,) fold of each release: in turn within each block's series."""
    return data.order.astype(np.int64) % FOLDS


def cross_validate(fit: Fit, data: Data) -> HeldOut:
    """Predict every release with the model fitted to the other folds."""
    fold, covariance = folds(data), fit.covariance()
    residuals = Residuals(fit.residuals.impacts.copy(), fit.residuals.flights.copy())
    parameters = list[Array]()
    for k in range(FOLDS):
        impacts, flights = fold[data.impact_release] == k, fold[data.flight_release] == k
        p, found = _fit_without(fit, data, covariance, (~impacts, ~flights))
        residuals.impacts[impacts], residuals.flights[flights] = (found.impacts[impacts], found.flights[flights])
        parameters.append(p)
    return HeldOut(residuals, by_release(data, residuals, covariance), np.array(parameters))


def _fit_without(fit: Fit, data: Data, covariance: Array, keep: tuple[Array, Array]) -> tuple[Array, Residuals]:
    """Parameters of the fit to the impacts and flights in `keep`, and the residuals of all at them."""
    if not fit.free:
        return fit.p, fit.residuals
    low, high = fit.model.bounds()
    centre, prior_precision = prior(fit.model)
    curvature, grad = normal_equations(fit.residuals, fit.jacobian, covariance, keep)
    grad += prior_precision * (fit.p - centre)
    grad[choice_positions(fit.model)] = 0.0  # a scan chose them
    step = newton_step(curvature + np.diag(prior_precision), grad, fit.p, low, high)
    before = posterior_cost(fit.model, fit.p, fit.residuals, covariance, keep)
    for _ in range(MOST_SHORTENED):
        p = np.clip(fit.p - step, low, high)
        residuals = fit.model.residuals(p, data)
        if posterior_cost(fit.model, p, residuals, covariance, keep) < before + ACCEPTED_COST:
            return p, residuals
        step = SHORTENED * step
    return fit.p, fit.residuals


def summed(release: Array, values: Array, releases: int) -> Array:
    """(releases, ...) sums of values (n, ...) over the rows of each release."""
    total = np.zeros((releases, *values.shape[1:]))
    np.add.at(total, release, values)
    return total


def by_release(data: Data, residuals: Residuals, covariance: Array) -> Array:
    """(releases,) log likelihood of each release."""
    n = len(data.order)
    score = np.bincount(data.impact_release, log_likelihood(residuals.impacts, covariance), n)
    return score + np.bincount(data.flight_release, flight_log_likelihood(residuals.flights), n)


def save_fit(path: Path, validated: Validated) -> None:
    """Write a fit and its held-out residuals; whole or not at all."""
    fit, out = validated.fit, validated.held_out
    save_arrays(
        path, p=fit.p, p_covariance=fit.p_covariance, scatter=fit.scatter, slope_impacts=fit.jacobian.impacts,
        slope_flights=fit.jacobian.flights, slope_scatter=fit.jacobian.scatter, later=fit.jacobian.later,
        bend=fit.jacobian.bend, **fit.jacobian.noise._asdict(), impacts=fit.residuals.impacts,
        flights=fit.residuals.flights, out_impacts=out.residuals.impacts, out_flights=out.residuals.flights,
        score=out.score, out_parameters=out.parameters,
    )  # fmt: skip


def load_fit(path: Path, model: Model) -> Validated | None:
    """Read what `save_fit` wrote; None if there is no readable file."""
    if (a := load_arrays(path)) is None:
        return None
    noise = Noise(a["covariance"], a["beyond"])
    jacobian = Jacobian(a["slope_impacts"], a["slope_flights"], a["slope_scatter"], a["later"], a["bend"], noise)
    residuals = Residuals(a["impacts"], a["flights"])
    fit = Fit(model, a["p"], a["p_covariance"], a["scatter"], jacobian, residuals)
    residuals = Residuals(a["out_impacts"], a["out_flights"])
    return Validated(fit, HeldOut(residuals, a["score"], a["out_parameters"]))
