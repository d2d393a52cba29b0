"""Fits of models to the segments of an experiment: maximum likelihood over flights and impacts together."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from rock2d.arrays import Array
from rock2d.diagnosis.data import Data, Residuals
from rock2d.diagnosis.derivatives import (
    DIFFERENCE_STEP,
    START_SCATTER,
    Jacobian,
    Noise,
    Point,
    jacobian_by_differences,
    residual_covariance,
)
from rock2d.diagnosis.likelihood import (
    clustered_covariance,
    fit_scatter,
    newton_step,
    normal_equations,
    posterior_cost,
    prior,
    scatter_errors,
    total_log_likelihood,
)
from rock2d.diagnosis.model import BASE_WIDTH, Model, choice_positions, scatter_positions

MOST_ITERATIONS = 30
START_DAMPING = 1e-3
MOST_DAMPINGS = 5  # tried dampings of a step
SMALLEST_START_SCATTER = 3e-3
MOST_UPDATES = 4  # updates of the derivatives before they are computed again
CONVERGED_GAIN = 0.2  # gain in log likelihood of a step below which a fit has converged
CONVERGED_LEAD_SHARE = 0.02  # the same for a fit behind a rival, as a share of the rival's lead
NOISE_UPDATE_CHANGE = 0.1  # change of a parameter after which the noise is computed again
# largest change of the parameters for which the derivatives at the start are used
DERIVATIVES_REUSE_CHANGE = 0.03
# largest change of the logarithm of a standard deviation up to which the derivatives by its effect are kept
SCATTER_REUSE_CHANGE = 0.2
EXPLORED_IMPACTS = 100  # impacts with which parameters are explored


@dataclass
class Fit:
    """A fitted model.

    Attributes
    ----------
    p, p_covariance : (P,) parameters on the scale of `Model`, (P, P) their covariance
    scatter : (k,) standard deviations of the soil, of effects that widen the scatter, of fitted noise, and of
        `Noise.beyond`
    jacobian : derivatives of the residuals at p
    residuals : residuals at p
    free : whether the parameters were fitted to this model; False where they were taken from another one"""

    model: Model
    p: Array
    p_covariance: Array
    scatter: Array
    jacobian: Jacobian
    residuals: Residuals
    free: bool = True

    def covariance(self) -> Array:
        """(n, d, d) covariances of the residuals of impacts, from noise and the soil's scatter."""
        return residual_covariance(self.jacobian, self.scatter)

    def total(self) -> float:
        """Log likelihood of all impacts and flights."""
        return total_log_likelihood(self.residuals, self.covariance())

    def only(self, releases: Array, data: Data) -> Fit:
        """The fit restricted to some of the releases of its data, given as a mask."""
        impacts, flights = releases[data.impact_release], releases[data.flight_release]
        s = self.jacobian
        jacobian = Jacobian(
            s.impacts[impacts],
            s.flights[flights],
            s.scatter[impacts],
            s.later[impacts],
            s.bend[impacts],
            Noise(*(part[impacts] for part in s.noise)),
        )
        residuals = Residuals(self.residuals.impacts[impacts], self.residuals.flights[flights])
        return replace(self, jacobian=jacobian, residuals=residuals)


def some_releases(data: Data) -> Array:
    """(releases,) mask of some releases, evenly from every series, with about EXPLORED_IMPACTS impacts in all."""
    return data.order % max(1, len(data.impact_release) // EXPLORED_IMPACTS) == 0


class Convergence(NamedTuple):
    """When a fit ends: after `rounds` iterations, or if an iteration gains less log likelihood than `gain`. A fit far
    behind the log likelihood `rival_total` ends at a larger gain, because its exact value does not matter."""

    gain: float = CONVERGED_GAIN
    rival_total: float = -np.inf
    rounds: int = MOST_ITERATIONS

    def at(self, total: float) -> float:
        """Gain at which a fit with this log likelihood has converged."""
        return max(self.gain, CONVERGED_LEAD_SHARE * (self.rival_total - total))


FEW_ROUNDS = Convergence(rounds=5)  # of fits that only explore


def fit(
    model: Model,
    data: Data,
    start: Array | None = None,
    old: Fit | None = None,
    convergence: Convergence = Convergence(),  # noqa: B008 (cannot be changed)
    keep_jacobian: bool = False,
    renew_noise: bool = False,
    residuals: Residuals | None = None,
) -> Fit:
    """Fit a model by damped Newton steps; alternates between the parameters and the soil's scatter.

    Between steps the derivatives are updated by Broyden's (1965) formula, which needs no simulation. They are computed
    again when a step gains nothing, so a fit ends where it would end with exact derivatives.

    Parameters
    ----------
    start : parameters to start from; default: the base law without effects
    old : a fit whose scatter is the start, whose derivatives are used near its parameters, and whose noise covariance
        and derivatives by the soil of later strikes are kept
    convergence : when the fit ends
    keep_jacobian : use the derivatives of `old` everywhere
    renew_noise : compute both anew, instead of taking those of `old`
    residuals : residuals at the start, if known"""
    low, high = model.bounds()
    centre, prior_precision = prior(model)
    p = np.clip(model.start() if start is None else start, low, high)
    begin, at = p, Point(p, residuals or model.residuals(p, data))
    scatter, noise_known = start_scatter(model, data, old), old is not None
    own_noise = old is None or renew_noise
    jacobian: Jacobian | None = old.jacobian if old is not None else None
    known_at = extended(old, model) if old is not None else np.full(model.size, np.inf)
    damping, curvature, derived_at = START_DAMPING, np.eye(model.size), scatter
    updates: int | None = None  # updates of the derivatives since they were computed; None: compute them
    for round in range(convergence.rounds):
        if updates is None:
            # the noise is computed again when the fit has moved far from its start
            moved = round > 0 and not noise_known and np.abs(at.p - begin).max() > NOISE_UPDATE_CHANGE
            renew = (old is None and (round == 0 or moved)) or (renew_noise and round == 0)
            noise = None if renew or jacobian is None else jacobian.noise
            later = None if own_noise or jacobian is None else jacobian.later
            noise_known = noise_known or moved
            near = keep_jacobian or np.abs(at.p - known_at).max() < DERIVATIVES_REUSE_CHANGE
            known = old.jacobian if old is not None and near else None
            jacobian = jacobian_by_differences(model, at, data, scatter, noise, later, known)
            updates, derived_at = 0, scatter
        assert jacobian is not None
        scatter = fit_scatter(at.residuals.impacts, jacobian, np.maximum(scatter, SMALLEST_START_SCATTER))
        covariance = residual_covariance(jacobian, scatter)
        curvature, grad = normal_equations(at.residuals, jacobian, covariance)
        grad = grad + prior_precision * (at.p - centre)
        grad[choice_positions(model)] = 0.0  # a scan chooses them
        before = at
        at, damping, gains = _advance(model, data, at, covariance, curvature, grad, damping, convergence)
        if gains and updates < MOST_UPDATES:
            jacobian, updates = _broyden_update(jacobian, before, at), updates + 1
        elif gains or updates > 0:
            updates, damping = None, START_DAMPING
        elif not (keep_jacobian or _near(model, scatter, derived_at)):
            noise, later = jacobian.noise, jacobian.later
            jacobian = jacobian_by_differences(model, at, data, scatter, noise, later, jacobian)
            damping, derived_at = START_DAMPING, scatter
        else:
            break
    assert jacobian is not None
    if updates is None and not keep_jacobian:
        noise, later = jacobian.noise, None if own_noise else jacobian.later
        jacobian = jacobian_by_differences(model, at, data, scatter, noise, later)
        if model.scatter_effects:
            scatter = fit_scatter(at.residuals.impacts, jacobian, np.maximum(scatter, SMALLEST_START_SCATTER))
    p_covariance = clustered_covariance(
        at.residuals, jacobian, residual_covariance(jacobian, scatter), curvature + np.diag(prior_precision),
        (data.impact_release, data.flight_release), len(data.order),
    )  # fmt: skip
    errors = scatter_errors(at.residuals.impacts, jacobian, scatter)
    for i, k in enumerate(scatter_positions(model), len(BASE_WIDTH)):
        at.p[k], p_covariance[k, k] = scatter[i], (errors[i] * scatter[i]) ** 2
    return Fit(model, at.p, p_covariance, scatter, jacobian, at.residuals)


def _advance(
    model: Model,
    data: Data,
    at: Point,
    covariance: Array,
    curvature: Array,
    grad: Array,
    damping: float,
    convergence: Convergence,
) -> tuple[Point, float, bool]:
    """One damped Newton step: the point after it, the damping, and whether it gains so much that the fit has not yet
    converged. The damping grows until the step gains."""
    (low, high), (_, prior_precision) = model.bounds(), prior(model)
    now = posterior_cost(model, at.p, at.residuals, covariance)
    least_gain = convergence.at(-now)
    for _ in range(MOST_DAMPINGS):
        regular = curvature + np.diag(prior_precision + damping * np.diag(curvature))
        candidate = np.clip(at.p - newton_step(regular, grad, at.p, low, high), low, high)
        if grad @ (at.p - candidate) < 0.2 * least_gain:  # the gain of a parabola is half of it
            break
        trial = Point(candidate, model.residuals(candidate, data))
        gain = now - posterior_cost(model, trial.p, trial.residuals, covariance)
        if gain > 0.0:
            return trial, max(damping / 10, 1e-6), gain >= least_gain
        damping *= 10
    return at, damping, False


def _broyden_update(jacobian: Jacobian, before: Point, after: Point) -> Jacobian:
    """Derivatives updated so that they reproduce the change of the residuals by a step: Broyden (1965, Math. Comput.
    19(92), 577-593)."""
    step = after.p - before.p
    along = step / (step @ step)
    impacts, flights = (
        slope + np.nan_to_num(now - then - slope @ step)[..., None] * along
        for now, then, slope in (
            (after.residuals.impacts, before.residuals.impacts, jacobian.impacts),
            (after.residuals.flights, before.residuals.flights, jacobian.flights),
        )
    )
    return replace(jacobian, impacts=impacts, flights=flights)


def _near(model: Model, scatter: Array, derived_at: Array) -> bool:
    """Whether derivatives by effects that widen the scatter, for the standard deviations `derived_at`, hold for
    `scatter`."""
    own = slice(len(BASE_WIDTH), len(BASE_WIDTH) + len(model.scatter_effects))
    now, then = (np.maximum(s[own], DIFFERENCE_STEP) for s in (scatter, derived_at))  # the smallest step
    return bool((np.abs(np.log(now / then)) < SCATTER_REUSE_CHANGE).all())


def start_scatter(model: Model, data: Data, old: Fit | None) -> Array:
    """Scatter at the start of a fit: of the soil, of effects that widen the scatter, of fitted noise, and of
    `Noise.beyond`."""
    count, extra = len(BASE_WIDTH) + len(model.scatter_effects), data.extra_scatter().shape[-1] + 1
    scatter = np.full(count + extra, START_SCATTER)
    if old is not None:
        known = len(old.scatter) - extra
        scatter[: min(known, count)] = old.scatter[: min(known, count)]
        scatter[count:] = old.scatter[known:]
    return scatter


def extended(fit: Fit, model: Model) -> Array:
    """Parameters of a model with more effects than `fit` has (which come first), with the further effects neutral."""
    return np.concatenate([fit.p, model.start()[len(fit.p) :]])
