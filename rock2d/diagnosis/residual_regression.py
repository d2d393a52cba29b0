"""A flexible regression of the residuals on all measured quantities: what any model could still explain.

The residuals of the right model cannot be predicted. A ridge regression on the terms that forces would cause, and then
extremely randomised trees on its residuals, are fitted on some releases and tested on others. They contain no
mechanics, so the share of the gap that they close is a lower bound for what a cause would close."""

from dataclasses import dataclass

import numpy as np

from rock2d.arrays import Array
from rock2d.diagnosis.cross_validation import FOLDS, folds
from rock2d.diagnosis.data import Data, FilmData, Residuals
from rock2d.diagnosis.likelihood import standard_deviations
from rock2d.scene.world import World

TREES = 60
LARGEST_RESIDUAL_SD = 5.0  # limit of residuals in units of their standard deviation
FLIGHT_DEGREES = 2  # degrees 2 and 3 of a flight, the effect of accelerations and of their change


@dataclass
class RegressedResiduals:
    """Whitened residuals before and after the regression, on releases that it was not fitted to.

    Attributes
    ----------
    impacts, flights : (n, d) and (m, 3 × FLIGHT_DEGREES) residuals in standard deviations, clipped
    impacts_remaining, flights_remaining : the same minus the prediction"""

    impacts: Array
    impacts_remaining: Array
    flights: Array
    flights_remaining: Array


def regress(data: Data, world: World, residuals: Residuals, covariance: Array) -> RegressedResiduals:
    """Predict residuals of impacts and flights from their features in a world."""
    impacts = clipped(residuals.impacts / standard_deviations(covariance))
    flights = clipped(residuals.flights[: data.flown, :, :FLIGHT_DEGREES]).reshape(data.flown, 3 * FLIGHT_DEGREES)
    fold = folds(data)
    impacts_remaining, flights_remaining = impacts.copy(), flights.copy()
    if len(impacts):
        impacts_remaining -= _cross_predict(data.impact_features(world), impacts, fold[data.impact_release])
    if isinstance(data, FilmData) and len(flights):
        flights_remaining -= _cross_predict(
            data.flight_features(world), flights, fold[data.flight_release[: data.flown]]
        )
    return RegressedResiduals(impacts, impacts_remaining, flights, flights_remaining)


def clipped(z: Array) -> Array:
    """Residuals in standard deviations, clipped to LARGEST_RESIDUAL_SD; NaN counts as that."""
    return np.clip(np.nan_to_num(z, nan=LARGEST_RESIDUAL_SD), -LARGEST_RESIDUAL_SD, LARGEST_RESIDUAL_SD)


def _cross_predict(features: Array, target: Array, fold: Array) -> Array:
    from sklearn.ensemble import ExtraTreesRegressor
    from sklearn.linear_model import RidgeCV
    from sklearn.preprocessing import StandardScaler

    predicted = np.zeros_like(target)
    for k in range(FOLDS):
        train, test = fold != k, fold == k
        if train.sum() < 20 or not test.any():
            continue
        scaler = StandardScaler().fit(features[train])
        x, own = scaler.transform(features[train]), scaler.transform(features[test])
        ridge = RidgeCV(np.logspace(0, 5, 11)).fit(x, target[train])
        trees = ExtraTreesRegressor(TREES, min_samples_leaf=4, max_features=0.6, random_state=0, n_jobs=1).fit(
            x, target[train] - ridge.predict(x)
        )
        predicted[test] = ridge.predict(own) + trees.predict(own)
    return predicted
