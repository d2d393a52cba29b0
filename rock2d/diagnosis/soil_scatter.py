"""The soil's scatter: the variation of each parameter of the law from impact to impact, fitted to residuals."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from rock2d.diagnosis.derivatives import Jacobian
from rock2d.diagnosis.likelihood import IMPACT_STUDENT_DF, newton_step

Array = np.ndarray

PRIOR_SCATTER = 0.3  # width of the half-normal prior of the soil's logarithmic standard deviations
BOUNDS = 1e-4, 1.0  # limits of the logarithmic standard deviations
CONVERGED_GAIN = 1e-3  # gain in log likelihood of a step below which the fit has converged
MOST_STEPS = 30
LARGEST_STEP, SMALLEST_STEP = 3.0, 1e-4  # in the logarithms of the standard deviations


def fit_scatter(r: Array, jacobian: Jacobian, start: Array) -> Array:
    """(k,) standard deviations of the soil with the largest posterior probability, from residuals r (n, d).

    Damped steps of Fisher scoring in their logarithms.
    """
    cost = _Cost.of(r, jacobian)
    low, high = np.log(BOUNDS)
    at = cost.at(np.clip(np.log(start), low, high))
    for _ in range(MOST_STEPS):
        candidate = at
        step = newton_step(at.curvature, at.grad, at.logs, low, high)
        step /= max(1.0, np.abs(step).max() / LARGEST_STEP)
        for _ in range(MOST_STEPS):
            candidate = cost.at(np.clip(at.logs - step, low, high))
            if candidate.value < at.value or np.abs(step).max() < SMALLEST_STEP:
                break
            step /= 4.0
        if candidate.value >= at.value:
            break
        gain, at = at.value - candidate.value, candidate
        if gain < CONVERGED_GAIN:
            break
    return np.exp(at.logs)


def scatter_errors(r: Array, jacobian: Jacobian, scatter: Array) -> Array:
    """(k,) relative standard errors of fitted standard deviations."""
    at = _Cost.of(r, jacobian).at(np.log(scatter))
    return np.sqrt(np.diag(np.linalg.inv(at.curvature)))


class _Point(NamedTuple):
    """Logarithms of standard deviations (k,), minus the log posterior, its gradient and expected curvature."""

    logs: Array
    value: float
    grad: Array
    curvature: Array


class _Cost(NamedTuple):
    """Residuals (n, d), their derivatives by the soil (n, d, k), and their covariance without it (n, d, d)."""

    r: Array
    scatter: Array
    covariance: Array

    @classmethod
    def of(cls, r: Array, jacobian: Jacobian) -> _Cost:
        """Cost of the impacts that could be simulated."""
        good = np.isfinite(r).all(axis=1)
        return cls(r[good], jacobian.scatter[good], jacobian.covariance[good])

    def at(self, logs: Array) -> _Point:
        """Cost at logarithms (k,) of the standard deviations."""
        square = np.exp(2.0 * logs)
        covariance = self.covariance + (self.scatter * square) @ self.scatter.transpose(0, 2, 1)
        both = np.concatenate([self.scatter, self.r[..., None]], axis=-1)
        inner = both.transpose(0, 2, 1) @ np.linalg.solve(covariance, both)
        trace, pull, chi2 = inner[:, :-1, :-1], inner[:, :-1, -1], inner[:, -1, -1]
        df = IMPACT_STUDENT_DF + self.r.shape[1]
        value = 0.5 * np.linalg.slogdet(covariance)[1] + 0.5 * df * np.log1p(chi2 / IMPACT_STUDENT_DF)
        weight = df / (IMPACT_STUDENT_DF + chi2)
        own = square / PRIOR_SCATTER**2
        grad = ((np.diagonal(trace, axis1=1, axis2=2) - weight[:, None] * pull**2) * square).sum(axis=0) + own
        curvature = 2.0 * df / (df + 2.0) * square[:, None] * square * (trace**2).sum(axis=0)
        return _Point(logs, float(value.sum() + 0.5 * own.sum()), grad, curvature + 2.0 * np.diag(own))
