"""Likelihood of the residuals: robust, with a covariance for each impact.

The residual of an impact has three sources: the noise of the measured flights on both sides, the soil, which varies
from strike to strike (each parameter of the law by a fitted standard deviation), and the model's error. The first two
make the covariance of the impact. A Student distribution allows for the few impacts that fall on the other side of an
edge. The coefficients of flights are independent and have unit variance.

The scatter of the soil is fitted to the residuals (`fit_scatter`)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from rock2d.arrays import Array
from rock2d.diagnosis.data import Residuals
from rock2d.diagnosis.derivatives import START_SCATTER, Jacobian, ScatterColumns
from rock2d.diagnosis.model import BASE_WIDTH, Model

IMPACT_STUDENT_DF = 4.0  # degrees of freedom of the Student distribution of an impact
FLIGHT_STUDENT_DF = 8.0  # degrees of freedom for a coefficient of a flight
LARGEST_BEND = 2.0 / 3.0  # largest share by which large residuals reduce the curvature
ROUNDING = 1e-15  # relative addition to the curvature, which is singular if no data tell two parameters apart
LARGEST_CHI_SQUARE = 1e5  # chi-square of an impact; a larger one counts as this
PRIOR_SCATTER = 0.3  # width of the half-normal prior of the soil's logarithmic standard deviations
SCATTER_BOUNDS = 1e-4, 1.0  # limits of the logarithmic standard deviations
CONVERGED_SCATTER_GAIN = 1e-3  # gain in log likelihood of a step below which the fit has converged
MOST_SCATTER_STEPS = 30
LARGEST_SCATTER_STEP, SMALLEST_SCATTER_STEP = 3.0, 1e-4  # in the logarithms of the standard deviations


def log_likelihood(r: Array, covariance: Array) -> Array:
    """(n,) log likelihood of the residuals r (n, d) of impacts, up to a constant: Student with a covariance (n, d, d).

    Rows with NaN count as very improbable."""
    d = r.shape[1]
    chi2 = chi_square(r, covariance)
    return -0.5 * np.linalg.slogdet(covariance)[1] - 0.5 * (IMPACT_STUDENT_DF + d) * np.log1p(chi2 / IMPACT_STUDENT_DF)


def chi_square(r: Array, covariance: Array, largest: float = LARGEST_CHI_SQUARE) -> Array:
    """(n,) chi-square of impacts; LARGEST_CHI_SQUARE if it is not below `largest`, or the impact cannot be
    simulated."""
    tame = np.nan_to_num(r, nan=0.0, posinf=0.0, neginf=0.0)
    chi2 = np.einsum("ni,ni->n", tame, np.linalg.solve(covariance, tame[..., None])[..., 0])
    return np.where(np.isfinite(r).all(axis=1) & (chi2 < largest), chi2, LARGEST_CHI_SQUARE)


def flight_log_likelihood(r: Array) -> Array:
    """(m,) log likelihood of the residuals r (m, 3, degrees) of flights, up to a constant."""
    return -0.5 * (FLIGHT_STUDENT_DF + 1) * np.log1p(r**2 / FLIGHT_STUDENT_DF).sum(axis=(1, 2))


def total_log_likelihood(residuals: Residuals, covariance: Array) -> float:
    """Log likelihood of all impacts and flights, up to a constant."""
    flights = flight_log_likelihood(residuals.flights)
    return float(log_likelihood(residuals.impacts, covariance).sum() + flights.sum())


def newton_step(curvature: Array, grad: Array, p: Array, low: Array | float, high: Array | float) -> Array:
    """(P,) Newton step, to subtract from `p`; the shortest one if no data tell two parameters apart. A parameter at a
    bound that the step would cross stays fixed."""
    free = ~(((p <= low) & (grad > 0.0)) | ((p >= high) & (grad < 0.0)))
    step, own = np.zeros_like(p), curvature[np.ix_(free, free)]
    try:
        step[free] = np.linalg.solve(own, grad[free])
    except np.linalg.LinAlgError:
        step[free] = np.linalg.lstsq(own, grad[free])[0]
    return step


def impact_weight(chi2: Array, d: int) -> Array:
    """(n,) weight of an impact with d residuals in the robust likelihood."""
    return (IMPACT_STUDENT_DF + d) / (IMPACT_STUDENT_DF + chi2)


def flight_weight(r: Array) -> Array:
    """Weight of each residual of a flight in the robust likelihood."""
    return (FLIGHT_STUDENT_DF + 1) / (FLIGHT_STUDENT_DF + r**2)


def standard_deviations(covariance: Array) -> Array:
    """(n, d) standard deviations of covariances (n, d, d), never 0."""
    return np.sqrt(np.maximum(np.diagonal(covariance, axis1=1, axis2=2), 1e-300))


def normal_equations(
    residuals: Residuals, jacobian: Jacobian, covariance: Array, keep: tuple[Array, Array] | None = None
) -> tuple[Array, Array]:
    """Curvature (P, P) and gradient (P,) of minus the log likelihood over the impacts and flights in `keep`, or all."""
    impacts, flights = keep or (np.ones(len(residuals.impacts), bool), np.ones(len(residuals.flights), bool))
    r = np.nan_to_num(residuals.impacts)
    good = impacts & np.isfinite(residuals.impacts).all(axis=1)
    inverse = np.linalg.inv(covariance[good])
    u = np.einsum("nij,nj->ni", inverse, r[good])
    chi2 = np.einsum("ni,ni->n", r[good], u)
    weight = impact_weight(chi2, r.shape[1])
    j = jacobian.impacts[good]
    pull = weight[:, None, None] * (inverse @ j)
    curvature, grad = np.tensordot(j, pull, ((0, 1), (0, 1))), np.tensordot(r[good], pull, 2)
    moved = np.flatnonzero(jacobian.flights.any(axis=(0, 1, 2)))  # most parameters change no flight
    rf, jf = residuals.flights[flights], jacobian.flights[flights][..., moved]
    pull = flight_weight(rf)[..., None] * jf
    curvature[np.ix_(moved, moved)] += np.tensordot(jf, pull, ((0, 1, 2), (0, 1, 2)))
    grad[moved] += np.tensordot(rf, pull, 3)
    return curvature, grad


def clustered_covariance(
    residuals: Residuals,
    jacobian: Jacobian,
    covariance: Array,
    curvature: Array,
    release: tuple[Array, Array],
    count: int,
) -> Array:
    """(P, P) covariance of fitted parameters, valid also if the residuals of a release are correlated or larger than
    the model assumes: the sandwich estimator of White (1982), with releases as clusters (Liang and Zeger 1986,
    Biometrika 73(1), 13-22). No variance is smaller than that of the inverse `curvature` (P, P).

    `curvature`: of `normal_equations` and the prior; `release`: release of each impact and of each flight; `count`:
    number of releases."""
    scores = np.zeros((count, len(curvature)))
    r, good = np.nan_to_num(residuals.impacts), np.isfinite(residuals.impacts).all(axis=1)
    u = np.linalg.solve(covariance, r[..., None])[..., 0]
    df = IMPACT_STUDENT_DF + r.shape[1]
    weight = good * df / (IMPACT_STUDENT_DF + np.einsum("ni,ni->n", r, u))
    pull = np.einsum("nip,ni->np", jacobian.impacts, u)
    np.add.at(scores, release[0], weight[:, None] * pull)
    rf, jf = residuals.flights, jacobian.flights
    wf = flight_weight(rf)
    np.add.at(scores, release[1], np.einsum("mcd,mcd,mcdp->mp", wf, rf, jf))
    # the curvature of the Student distribution itself: `curvature` takes its weights as constant
    bent = np.einsum("n,np,nq->pq", 2.0 / df * weight**2, pull, pull)
    flat = 2.0 / (FLIGHT_STUDENT_DF + 1) * (wf * rf) ** 2
    bent += np.einsum("mcd,mcdp,mcdq->pq", flat, jf, jf, optimize=True)
    unit = np.sqrt(np.diag(curvature))
    plain = np.linalg.inv(curvature / (unit * unit[:, None]) + ROUNDING * np.eye(len(unit))) / (unit * unit[:, None])
    # mean share over all directions: in a single direction a few outliers can cancel the curvature
    bread = plain / (1.0 - min(float(np.trace(plain @ bent)) / len(curvature), LARGEST_BEND))
    spread = bread @ (scores.T @ scores) @ bread * count / max(count - 1, 1)
    wider = np.sqrt(np.maximum(np.diag(spread) / np.diag(plain), 1.0))
    return np.asarray(plain * wider * wider[:, None])


def posterior_cost(
    model: Model, p: Array, residuals: Residuals, covariance: Array, keep: tuple[Array, Array] | None = None
) -> float:
    """Minus the log posterior at p over the impacts and flights in `keep`, or all; up to a constant."""
    impacts, flights = log_likelihood(residuals.impacts, covariance), flight_log_likelihood(residuals.flights)
    if keep is not None:
        impacts, flights = impacts[keep[0]], flights[keep[1]]
    centre, precision = prior(model)
    return float(-impacts.sum() - flights.sum() + 0.5 * (precision * (p - centre) ** 2).sum())


def prior(model: Model) -> tuple[Array, Array]:
    """Weak Gaussian prior: (centre, precision) of the parameters, the precision being 1 / variance."""
    width = np.concatenate([BASE_WIDTH, np.full(model.size - len(BASE_WIDTH), 1.0)])
    return model.start(), width**-2.0


def fit_scatter(r: Array, jacobian: Jacobian, start: Array) -> Array:
    """(k,) standard deviations of the soil with the largest posterior probability, from residuals r (n, d).

    Damped steps of Fisher scoring in their logarithms. What goes beyond first order (`Noise.beyond`) does not become
    less than drawn: the known noise does it already."""
    cost = _Cost.of(r, jacobian)
    low, high = (np.full(len(start), np.log(bound)) for bound in SCATTER_BOUNDS)
    if jacobian.noise.beyond.size:
        low[-1] = np.log(START_SCATTER)
    at = cost.at(np.clip(np.log(start), low, high))
    for _ in range(MOST_SCATTER_STEPS):
        candidate = at
        step = newton_step(at.curvature, at.grad, at.logs, low, high)
        step /= max(1.0, np.abs(step).max() / LARGEST_SCATTER_STEP)
        for _ in range(MOST_SCATTER_STEPS):
            candidate = cost.at(np.clip(at.logs - step, low, high))
            if candidate.value < at.value or np.abs(step).max() < SMALLEST_SCATTER_STEP:
                break
            step /= 4.0
        if candidate.value >= at.value:
            break
        gain, at = at.value - candidate.value, candidate
        if gain < CONVERGED_SCATTER_GAIN:
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
    """Residuals (n, d), `columns` (n, d, c) and `share` (c, k) of their `ScatterColumns`, and their covariance without
    these (n, d, d)."""

    r: Array
    columns: Array
    share: Array
    covariance: Array

    @classmethod
    def of(cls, r: Array, jacobian: Jacobian) -> _Cost:
        """Cost of the impacts that could be simulated."""
        good = np.isfinite(r).all(axis=1)
        own = ScatterColumns.of(jacobian)
        return cls(r[good], own.columns[good], own.share, jacobian.noise.covariance[good])

    def at(self, logs: Array) -> _Point:
        """Cost at logarithms (k,) of the standard deviations."""
        square = np.exp(2.0 * self.share @ logs)
        covariance = self.covariance + (self.columns * square) @ self.columns.transpose(0, 2, 1)
        both = np.concatenate([self.columns, self.r[..., None]], axis=-1)
        inner = both.transpose(0, 2, 1) @ np.linalg.solve(covariance, both)
        trace, pull, chi2 = inner[:, :-1, :-1], inner[:, :-1, -1], inner[:, -1, -1]
        df = IMPACT_STUDENT_DF + self.r.shape[1]
        value = 0.5 * np.linalg.slogdet(covariance)[1] + 0.5 * df * np.log1p(chi2 / IMPACT_STUDENT_DF)
        weight = df / (IMPACT_STUDENT_DF + chi2)
        own = np.exp(2.0 * logs) / PRIOR_SCATTER**2
        grad = ((np.diagonal(trace, axis1=1, axis2=2) - weight[:, None] * pull**2) * square).sum(axis=0)
        curvature = 2.0 * df / (df + 2.0) * square[:, None] * square * (trace**2).sum(axis=0)
        grad, curvature = grad @ self.share + own, self.share.T @ curvature @ self.share + 2.0 * np.diag(own)
        return _Point(logs, float(value.sum() + 0.5 * own.sum()), grad, curvature)
