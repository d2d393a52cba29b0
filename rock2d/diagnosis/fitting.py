"""Models fitted to the segments of an experiment: maximum likelihood over flights and impacts at once."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from rock2d.diagnosis.data import Data, Residuals, model_residuals
from rock2d.diagnosis.derivatives import Slopes, slopes, spread
from rock2d.diagnosis.likelihood import (
    fit_scatter,
    flight_log_likelihood,
    log_likelihood,
    normal_equations,
    prior,
)
from rock2d.diagnosis.model import BASE_WIDTH, Model, discrete, scatters, to_scale

Array = np.ndarray

MOST_ITERATIONS = 15
MOST_DAMPINGS = 5  # of a step that gains nothing
START_SCATTER, SMALLEST_START_SCATTER = 0.05, 3e-3
EXPLORING_ITERATIONS = 5  # iterations of fits that only explore
WIDE_SCAN = 10.0  # factor on the variance of the second scan
SCAN_VALUES = 9  # values of a parameter that a scan tries
MOST_RESCANS = 3
RESCAN_GAIN = 1.0  # log likelihood that a further scan must gain
CONVERGED_GAIN = 0.2  # gain in log likelihood of a step below which a fit has converged
COARSE_CONVERGED_GAIN = 2.0  # the same for an effect that gained nothing on some of the releases
EXPLORED_GAIN = (
    1.0  # log likelihood that an effect must gain on some releases for the fit to start from there
)
REFIT_GAIN = 15.0  # log likelihood that an effect must gain before its parameters are searched again
NOISE_UPDATE_CHANGE = 0.1  # change of a parameter after which the noise is computed again
DERIVATIVES_REUSE_CHANGE = (
    0.03  # largest change of the parameters for which the derivatives at the start are used
)
EXPLORED_IMPACTS = 100  # impacts with which parameters are explored
LARGEST_BASE_STEP = 0.5  # largest change of a parameter of the base law that follows a step of the scan


@dataclass
class Fit:
    """A fitted model.

    Attributes
    ----------
    p, p_covariance : (P,) parameters on the scale of `Model`, (P, P) their covariance
    scatter : (k,) standard deviations of the soil
    slope : derivatives of the residuals at p
    residuals : at p
    free : whether the parameters were fitted to this model; False where they were taken from another one
    """

    model: Model
    p: Array
    p_covariance: Array
    scatter: Array
    slope: Slopes
    residuals: Residuals
    free: bool = True

    def covariance(self) -> Array:
        return spread(self.slope, self.scatter)

    def scores(self) -> tuple[Array, Array]:
        """Log likelihoods of impacts (n,) and flights (m,)."""
        return log_likelihood(self.residuals.impacts, self.covariance()), flight_log_likelihood(
            self.residuals.flights
        )

    def total(self) -> float:
        """Log likelihood of everything."""
        impacts, flights = self.scores()
        return float(impacts.sum() + flights.sum())

    def only(self, impacts: Array, flights: Array) -> Fit:
        """The fit as it is on some impacts and flights, given as masks."""
        s = self.slope
        slope = Slopes(s.impacts[impacts], s.flights[flights], s.scatter[impacts], s.covariance[impacts])
        return replace(
            self,
            slope=slope,
            residuals=Residuals(self.residuals.impacts[impacts], self.residuals.flights[flights]),
        )


def some_releases(data: Data) -> Array:
    """(releases,) mask of some releases, evenly from every series, with about EXPLORED_IMPACTS impacts in all."""
    return data.order % max(1, len(data.impact_release) // EXPLORED_IMPACTS) == 0


def newton_step(curve: Array, grad: Array, p: Array, low: Array, high: Array) -> Array:
    """(P,) step to subtract from `p`. A parameter at its bound that would pass it stays; the others step without it."""
    free = ~(((p <= low) & (grad > 0.0)) | ((p >= high) & (grad < 0.0)))
    step = np.zeros_like(p)
    step[free] = np.linalg.solve(curve[np.ix_(free, free)], grad[free])
    return step


def scan(model: Model, data: Data, p: Array, covariance: Array, slope: Slopes | None) -> Array:
    """Best parameters of a grid search over the effects' parameters, one after another.

    An effect can be so strong that the residuals of the base law have no useful slope towards it. With the `slope` of a
    fit nearby, the parameters of the base law follow each step of the grid.
    """
    low, high = model.bounds()
    parameters = [q for own in model.parameters for q in own]
    n_base = len(BASE_WIDTH)
    centre, tight = prior(model)
    everything = np.ones(len(data.impact_release), bool), np.ones(len(data.flight_release), bool)

    def value(q: Array) -> tuple[float, Residuals]:
        residuals = model_residuals(model, q, data)
        impacts = log_likelihood(residuals.impacts, covariance).sum()
        return float(impacts + flight_log_likelihood(residuals.flights).sum()), residuals

    best, _ = value(p)
    for i, parameter in enumerate(parameters):
        k = n_base + i
        if k in scatters(model):
            continue
        grid = [to_scale(parameter, v) for v in parameter.choices] or np.linspace(
            low[k], high[k], SCAN_VALUES
        )
        start = p.copy()
        for z in grid:
            trial = start.copy()
            trial[k] = z
            own, residuals = value(trial)
            if own > best:
                best, p = own, trial
            if slope is None:
                continue
            base = Slopes(slope.impacts[..., :n_base], slope.flights[..., :n_base], slope.scatter, covariance)
            curve, grad = normal_equations(residuals, base, covariance, everything)
            grad += tight[:n_base] * (trial[:n_base] - centre[:n_base])
            step = np.linalg.solve(curve + np.diag(tight[:n_base]), grad)
            followed = trial.copy()
            followed[:n_base] = np.clip(
                trial[:n_base] - np.clip(step, -LARGEST_BASE_STEP, LARGEST_BASE_STEP),
                low[:n_base],
                high[:n_base],
            )
            after, _ = value(followed)
            if after > best:
                best, p = after, followed
    return p


def fit_effects(model: Model, data: Data, base: Fit) -> Fit:
    """Fit a model with more effects than `base` has (which come first).

    Parameters are explored on some releases first (`explore`); the fit to all of them starts there. For an effect that
    gains enough, the covariance of the noise is computed again: that of a base far from the truth is wrong, too.
    """
    start = _extended(base, model)
    some = some_releases(data)
    if some.all():
        found = explore(model, data, base)
    else:
        part = base.only(some[data.impact_release], some[data.flight_release])
        explored = explore(model, data.only(some), part)
        useful = explored.total() > part.total() + EXPLORED_GAIN
        found = fit(
            model,
            data,
            explored.p if useful else start,
            old=base,
            enough=CONVERGED_GAIN if useful else COARSE_CONVERGED_GAIN,
        )
    if found.total() > base.total() + REFIT_GAIN:
        found = fit(model, data, found.p)
    if found.total() < base.total():
        # what fits some releases need not fit the others; a fit that starts at the base cannot end below it
        found = max((found, fit(model, data, start, old=base, enough=COARSE_CONVERGED_GAIN)), key=Fit.total)
    return found


def explore(model: Model, data: Data, base: Fit) -> Fit:
    """The best of several short fits: from `base`, and from two scans around it. One scan has a larger variance, which
    reacts to large residuals. If the best fit gains enough, scans around it follow."""
    start = _extended(base, model)
    starts = [start]
    for wide, slope in ((1.0, base.slope), (WIDE_SCAN, None)):
        found = scan(model, data, start, wide * base.covariance(), slope)
        if not any(np.allclose(found, p) for p in starts):
            starts.append(found)
    best = max((fit(model, data, p, old=base, rounds=EXPLORING_ITERATIONS) for p in starts), key=Fit.total)
    for _ in range(MOST_RESCANS if best.total() > base.total() + REFIT_GAIN else 0):
        again = scan(model, data, best.p, best.covariance(), best.slope)
        if np.allclose(again, best.p):
            break
        other = fit(model, data, again, old=best, rounds=EXPLORING_ITERATIONS)
        if other.total() < best.total() + RESCAN_GAIN:
            break
        best = other
    return best


def fit(
    model: Model,
    data: Data,
    start: Array | None = None,
    old: Fit | None = None,
    rounds: int = MOST_ITERATIONS,
    enough: float = CONVERGED_GAIN,
) -> Fit:
    """Fit a model by damped Newton steps; alternates between the parameters and the soil's scatter.

    Parameters
    ----------
    start : parameters to start from; default: the base law without effects
    old : a fit whose noise covariance and scatter are the start, and whose slopes are used near its parameters
    rounds : most iterations
    enough : gain in log likelihood of an iteration below which the fit has converged
    """
    low, high = model.bounds()
    posterior = _Posterior(model, data, *prior(model))
    p = np.clip(model.start() if start is None else start, low, high)
    begin, at = p, _Point(p, model_residuals(model, p, data))
    scatter = _start_scatter(model, data, old)
    everything = np.ones(len(data.impact_release), bool), np.ones(len(data.flight_release), bool)
    slope: Slopes | None = old.slope if old is not None else None
    known_at = _extended(old, model) if old is not None else np.full(model.size, np.inf)
    damping, curve = 1e-3, np.eye(model.size)
    for round in range(rounds):
        # the noise is computed again when the fit has moved far from its start
        moved = round == 2 and np.abs(at.p - begin).max() > NOISE_UPDATE_CHANGE
        noise = None if slope is None or (old is None and (round == 0 or moved)) else slope.covariance
        near = old is not None and np.abs(at.p - known_at).max() < DERIVATIVES_REUSE_CHANGE
        slope = slopes(
            model, at.p, data, at.residuals, scatter, noise, old.slope if old is not None and near else None
        )
        scatter = fit_scatter(at.residuals.impacts, slope, np.maximum(scatter, SMALLEST_START_SCATTER))
        covariance = spread(slope, scatter)
        curve, grad = normal_equations(at.residuals, slope, covariance, everything)
        grad = grad + posterior.tight * (at.p - posterior.centre)
        grad[discrete(model)] = 0.0  # a scan chooses them
        at, damping, gain = _advance(posterior, at, covariance, curve, grad, damping, enough)
        if gain < enough:
            break
    assert slope is not None
    for i, k in enumerate(scatters(model)):
        at.p[k] = scatter[len(BASE_WIDTH) + i]
    p_covariance = np.linalg.inv(curve + np.diag(posterior.tight))
    return Fit(model, at.p, p_covariance, scatter, slope, at.residuals)


class _Point(NamedTuple):
    """Parameters and the residuals there."""

    p: Array
    residuals: Residuals


class _Posterior(NamedTuple):
    """Model, data, and the prior of the parameters: its centre and 1 / variance."""

    model: Model
    data: Data
    centre: Array
    tight: Array

    def cost(self, at: _Point, covariance: Array) -> float:
        """Minus the log posterior, to a constant."""
        return float(
            -log_likelihood(at.residuals.impacts, covariance).sum()
            - flight_log_likelihood(at.residuals.flights).sum()
            + 0.5 * (self.tight * (at.p - self.centre) ** 2).sum()
        )


def _advance(
    posterior: _Posterior,
    at: _Point,
    covariance: Array,
    curve: Array,
    grad: Array,
    damping: float,
    enough: float,
) -> tuple[_Point, float, float]:
    """One damped Newton step: (point, damping, gain). The damping grows until the step gains; the gain is not positive
    where none does."""
    model, data, _, tight = posterior
    low, high = model.bounds()
    now, gain = posterior.cost(at, covariance), 0.0
    for _ in range(MOST_DAMPINGS):
        regular = curve + np.diag(tight + damping * np.diag(curve))
        ahead = np.clip(at.p - newton_step(regular, grad, at.p, low, high), low, high)
        if grad @ (at.p - ahead) < 0.2 * enough:  # the gain of a parabola is half of it
            break
        trial = _Point(ahead, model_residuals(model, ahead, data))
        gain = now - posterior.cost(trial, covariance)
        if gain > 0.0:
            return trial, max(damping / 10, 1e-6), gain
        damping *= 10
    return at, damping, gain


def _start_scatter(model: Model, data: Data, old: Fit | None) -> Array:
    """Scatter of the soil, of the effects that scatter, and of the noise that is fitted, from which a fit starts."""
    own, extra = len(BASE_WIDTH) + len(model.scatter_effects), data.extra_scatter().shape[-1]
    scatter = np.full(own + extra, START_SCATTER)
    if old is not None:
        known = len(old.scatter) - extra
        scatter[: min(known, own)] = old.scatter[: min(known, own)]
        scatter[own:] = old.scatter[known:]
    return scatter


def _extended(fit: Fit, model: Model) -> Array:
    """Parameters of a model with more effects than `fit` has (which come first): the further ones are neutral."""
    return np.concatenate([fit.p, model.start()[len(fit.p) :]])
