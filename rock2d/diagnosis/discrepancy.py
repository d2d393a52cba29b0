"""Discrepancies: dependences in the residuals of a model that no effect of the catalogue may explain.

A regression without mechanics (`residual_regression`) needs many impacts to find a pattern in six channels. Here the
search uses *levers*, a few numbers that move all channels together: the five parameters of the law, the six of the
incident state, and the outcomes themselves. Each lever may be a linear function of one *group* of measured quantities
(place, orientation, number of the impact, ...). One Newton step gives for each pair of lever and group the gain on
held-out releases. The model's own parameters stay free in it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rock2d.diagnosis.cross_validation import FOLDS, folds
from rock2d.diagnosis.data import Data, model_residuals
from rock2d.diagnosis.features import CONSTANT
from rock2d.diagnosis.fitting import Fit
from rock2d.diagnosis.likelihood import FLIGHT_STUDENT_DF, IMPACT_STUDENT_DF, chi_square
from rock2d.diagnosis.model import BASE_WIDTH
from rock2d.diagnosis.significance import standard_error
from rock2d.kinematics.film_segments import POSE_SIZE, STATE_SIZE

Array = np.ndarray

COEFFICIENT_WIDTHS = (0.02, 0.1, 0.4)  # standard deviations of the coefficients, to be tried
FLIGHT_COEFFICIENT_WIDTHS = (0.1, 1.0, 10.0)  # in standard deviations of a flight's bend
OWN_PARAMETER_WIDTH = 10.0  # of the model's own parameters
LARGEST_RESIDUAL_Z = 8.0  # standard deviations
FLIGHT_LEVER = "flight"  # the accelerations of flights
STATE_STEP = 0.003  # in units of the block's size and √(gravity × size)


@dataclass
class Discrepancy:
    """A dependence of a lever on a group of quantities, and its gain in log likelihood on held-out releases
    (releases,)."""

    lever: str
    group: str
    gain: Array

    @property
    def name(self) -> str:
        return f"{self.lever} of {self.group}"

    @property
    def total(self) -> float:
        return float(self.gain.sum())

    @property
    def error(self) -> float:
        """Standard error of the total gain, over releases."""
        return standard_error(self.gain)


def discrepancies(fit: Fit, data: Data) -> list[Discrepancy]:
    """Every dependence that was tried, the one that gains most first."""
    found = _of_impacts(fit, data) + _of_flights(fit, data)
    return sorted(found, key=lambda d: -d.total)


def _of_impacts(fit: Fit, data: Data) -> list[Discrepancy]:
    covariance = fit.covariance()
    known = np.isfinite(fit.residuals.impacts).all(axis=1)
    r = np.nan_to_num(fit.residuals.impacts)
    weight = known * (IMPACT_STUDENT_DF + r.shape[1]) / (IMPACT_STUDENT_DF + chi_square(r, covariance))
    whiten = np.linalg.inv(np.linalg.cholesky(covariance))
    z = np.clip(np.einsum("nij,nj->ni", whiten, r), -LARGEST_RESIDUAL_Z, LARGEST_RESIDUAL_Z)
    own = whiten @ fit.slope.impacts
    sd = np.sqrt(np.median(np.diagonal(covariance, axis1=1, axis2=2), axis=0))
    levers = {
        "law": own[..., : len(BASE_WIDTH)],
        "incident state": whiten @ _by_state(fit, data),
        "outcome": whiten * sd,
    }
    fold = folds(data)[data.impact_release]
    world = fit.model.world(fit.p, data.impact_order)
    found = []
    for group, features in data.impact_groups(world).items():
        for lever, slope in levers.items():
            if group == CONSTANT and lever != "incident state":
                # the law is fitted, and impacts on the other side of an edge shift all outcomes to one side
                continue
            x = (slope[..., None] * features[:, None, None, :]).reshape(*r.shape, -1)
            gain = known * _best_gain(z, own, x, weight, fold)
            found.append(Discrepancy(lever, group, _by_release(data.impact_release, gain, data)))
    return found


def _by_state(fit: Fit, data: Data) -> Array:
    """(n, d, 6) derivatives of the residuals by the states before, in units of size and √(gravity × size)."""
    world = fit.model.world(fit.p, data.impact_order)
    size = np.array([b.radius_m for b in world.blocks.values()])[data.impact_block]
    pace = np.sqrt(world.gravity_m_s2 * size)
    units = STATE_STEP * np.column_stack([size, size, np.ones_like(size), pace, pace, pace / size])
    columns = []
    for k in range(STATE_SIZE):
        shift = units * (np.arange(STATE_SIZE) == k)
        ahead, behind = (
            model_residuals(fit.model, fit.p, data, shift),
            model_residuals(fit.model, fit.p, data, -shift),
        )
        columns.append((ahead.impacts - behind.impacts) / (2 * STATE_STEP))
    return np.nan_to_num(np.stack(columns, axis=-1))


def _best_gain(z: Array, own: Array, x: Array, weight: Array, fold: Array) -> Array:
    """(n,) held-out gain in log likelihood of the columns `x` (n, d, k) beside `own` (n, d, p), with the best width."""
    both = np.concatenate([own, x], axis=2)
    free = own.shape[2]
    moments = [_moments(z[fold == k], both[fold == k], weight[fold == k]) for k in range(FOLDS)]
    curve, grad = (sum(m[i] for m in moments) for i in (0, 1))
    gains = np.zeros((len(COEFFICIENT_WIDTHS), len(z)))
    for k, (own_curve, own_grad) in enumerate(moments):
        a, b = curve - own_curve, grad - own_grad
        tight = np.full(free, OWN_PARAMETER_WIDTH**-2)
        without = np.linalg.solve(a[:free, :free] + np.diag(tight), b[:free])
        test = fold == k
        before = _log_likelihood(z[test] - own[test] @ without)
        for i, width in enumerate(COEFFICIENT_WIDTHS):
            full = np.concatenate([tight, np.full(x.shape[2], width**-2)])
            step = np.linalg.solve(a + np.diag(full), b)
            gains[i, test] = _log_likelihood(z[test] - both[test] @ step) - before
    return np.asarray(gains[gains.sum(axis=1).argmax()])


def _moments(z: Array, x: Array, weight: Array) -> tuple[Array, Array]:
    flat = x.reshape(-1, x.shape[2])
    heavy = np.repeat(weight, z.shape[1])[:, None] * flat
    return heavy.T @ flat, heavy.T @ z.ravel()


def _log_likelihood(z: Array) -> Array:
    return -0.5 * (IMPACT_STUDENT_DF + z.shape[1]) * np.log1p((z**2).sum(axis=1) / IMPACT_STUDENT_DF)


def _of_flights(fit: Fit, data: Data) -> list[Discrepancy]:
    """Accelerations along x, y and theta, each a linear function of one group of measured quantities."""
    if not len(data.flight_release):
        return []
    z = np.clip(np.nan_to_num(fit.residuals.flights[:, :, 0]), -LARGEST_RESIDUAL_Z, LARGEST_RESIDUAL_Z)
    weight = (FLIGHT_STUDENT_DF + 1) / (FLIGHT_STUDENT_DF + z**2)
    fold = folds(data)[data.flight_release]
    lever, groups = data.flight_groups(fit.model.world(fit.p, data.impact_order))
    found = []
    for group, features in groups.items():
        x = lever[:, None] * features
        gains = np.zeros((len(FLIGHT_COEFFICIENT_WIDTHS), len(z)))
        for k in range(FOLDS):
            train, test = fold != k, fold == k
            for c in range(POSE_SIZE):
                heavy = weight[train, c, None] * x[train]
                curve, grad = heavy.T @ x[train], heavy.T @ z[train, c]
                before = np.log1p(z[test, c] ** 2 / FLIGHT_STUDENT_DF)
                for i, width in enumerate(FLIGHT_COEFFICIENT_WIDTHS):
                    step = np.linalg.solve(curve + np.eye(x.shape[1]) * width**-2, grad)
                    after = np.log1p((z[test, c] - x[test] @ step) ** 2 / FLIGHT_STUDENT_DF)
                    gains[i, test] += 0.5 * (FLIGHT_STUDENT_DF + 1) * (before - after)
        best = gains[gains.sum(axis=1).argmax()]
        found.append(Discrepancy(FLIGHT_LEVER, group, _by_release(data.flight_release, best, data)))
    return found


def _by_release(release: Array, gain: Array, data: Data) -> Array:
    return np.bincount(release, gain, len(data.order))
