"""Models tried against each other on releases that their fits did not see.

The releases are split into folds. A model fitted to all of them is moved, for each fold, by one Newton step to what it
would be without that fold (its parameters hardly move, so one step is exact enough), and then simulated on the fold.
Where the releases say too little and the step becomes a leap, it is halved until it costs the other folds next to
nothing.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rock2d.diagnosis.fitting import (
    Data,
    Fit,
    Residuals,
    flight_log_likelihood,
    log_likelihood,
    newton_step,
    normal_equations,
    prior,
    residuals,
)
from rock2d.diagnosis.model import discrete

Array = np.ndarray

FOLDS = 4
SLACK = 1.0  # log likelihood that a step may cost the folds that it is fitted to: curvature that it knows nothing of
HALVINGS = 6  # of a step that leads nowhere; then none is taken


@dataclass
class HeldOut:
    """What a model leaves unexplained on releases that it was not fitted to.

    Attributes
    ----------
    left : residuals of all impacts and flights, each predicted by the fit without its fold
    score : (releases,) log likelihood of each release
    """

    left: Residuals
    score: Array


def folds(data: Data) -> Array:
    """(releases,) fold of each release: in turn within each block's series."""
    return data.order.astype(np.int64) % FOLDS


def hold_out(fit: Fit, data: Data) -> HeldOut:
    """Predict every release by the model fitted to the other folds."""
    fold = folds(data)
    impact_fold, flight_fold = fold[data.impact_release], fold[data.flight_release]
    covariance = fit.covariance()
    low, high = fit.model.bounds()
    centre, tight = prior(fit.model)
    left = Residuals(fit.left.impacts.copy(), fit.left.flights.copy())
    for k in range(FOLDS if fit.free else 0):
        keep = impact_fold != k, flight_fold != k
        curve, grad = normal_equations(fit.left, fit.slope, covariance, keep)
        grad += tight * (fit.p - centre)
        grad[discrete(fit.model)] = 0.0  # chosen, not fitted
        step = newton_step(curve + np.diag(tight), grad, fit.p, low, high)
        before = _cost(fit.left, covariance, keep, fit.p - centre, tight)
        for _ in range(HALVINGS):
            p = np.clip(fit.p - step, low, high)
            own = residuals(fit.model, p, data)
            if _cost(own, covariance, keep, p - centre, tight) < before + SLACK:
                break
            step = step / 2
        else:
            own = fit.left
        left.impacts[~keep[0]] = own.impacts[~keep[0]]
        left.flights[~keep[1]] = own.flights[~keep[1]]
    return HeldOut(left, by_release(data, left, covariance))


def _cost(left: Residuals, covariance: Array, keep: tuple[Array, Array], off: Array, tight: Array) -> float:
    """Minus the log posterior of the impacts and flights in `keep`, of parameters `off` the prior's centre."""
    impacts, flights = log_likelihood(left.impacts, covariance), flight_log_likelihood(left.flights)
    return float(0.5 * (tight * off**2).sum() - impacts[keep[0]].sum() - flights[keep[1]].sum())


def by_release(data: Data, left: Residuals, covariance: Array) -> Array:
    """(releases,) log likelihood of each release."""
    n = len(data.order)
    score = np.bincount(data.impact_release, log_likelihood(left.impacts, covariance), n)
    return score + np.bincount(data.flight_release, flight_log_likelihood(left.flights), n)
