"""Models fitted to the segments of an experiment: maximum likelihood over flights and impacts at once."""

from __future__ import annotations

from dataclasses import dataclass, replace

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
EXPLORING_ITERATIONS = 5  # iterations of fits that only explore
SCAN_VALUES = 9  # values of a parameter that a scan tries
MOST_RESCANS = 3
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
    """A fitted model: parameters, their covariance, the soil's scatter, and what is left; `free` unless its parameters
    were found elsewhere."""

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
    """(releases,) mask of as many releases, evenly from every series, as have about EXPLORED_IMPACTS impacts."""
    return data.order % max(1, len(data.impact_release) // EXPLORED_IMPACTS) == 0


def newton_step(curve: Array, grad: Array, p: Array, low: Array, high: Array) -> Array:
    """(P,) step to subtract from `p`; a parameter at its bound that would pass it stays, and the others go without."""
    free = ~(((p <= low) & (grad > 0.0)) | ((p >= high) & (grad < 0.0)))
    step = np.zeros_like(p)
    step[free] = np.linalg.solve(curve[np.ix_(free, free)], grad[free])
    return step


def scan(model: Model, data: Data, p: Array, covariance: Array, slope: Slopes | None) -> Array:
    """Parameters after a walk over a grid of each of the effects' parameters in turn.

    An effect can be so strong that the base law misses altogether where it acts, and no slope leads there. With the
    `slope` of a fit nearby the base law follows each step.
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

    Some releases show the way (`explore`); from where it leads all of them are fitted. An effect that is worth it has
    its noise worked out anew: where the base is far off, so is the way in which it passes noise on.
    """
    start = np.concatenate([base.p, model.start()[len(base.p) :]])
    some = some_releases(data)
    if some.all():
        found = explore(model, data, base)
    else:
        part = base.only(some[data.impact_release], some[data.flight_release])
        way = explore(model, data.only(some), part)
        worth = way.total() > part.total() + EXPLORED_GAIN
        found = fit(
            model,
            data,
            way.p if worth else start,
            old=base,
            enough=CONVERGED_GAIN if worth else COARSE_CONVERGED_GAIN,
        )
    if found.total() > base.total() + REFIT_GAIN:
        found = fit(model, data, found.p)
    if found.total() < base.total():
        # what some releases liked the others do not: from the base, none can end below it
        found = max((found, fit(model, data, start, old=base, enough=COARSE_CONVERGED_GAIN)), key=Fit.total)
    return found


def explore(model: Model, data: Data, base: Fit) -> Fit:
    """The best of the fits from `base`, and from where `scan` leads with the variance as it is and with ten times as
    much, which sees misses from afar; then again around the best, if it is worth it."""
    start = np.concatenate([base.p, model.start()[len(base.p) :]])
    starts = [start]
    for wide, slope in ((1.0, base.slope), (10.0, None)):
        found = scan(model, data, start, wide * base.covariance(), slope)
        if not any(np.allclose(found, p) for p in starts):
            starts.append(found)
    best = max((fit(model, data, p, old=base, rounds=EXPLORING_ITERATIONS) for p in starts), key=Fit.total)
    for _ in range(MOST_RESCANS if best.total() > base.total() + REFIT_GAIN else 0):
        again = scan(model, data, best.p, best.covariance(), best.slope)
        if np.allclose(again, best.p):
            break
        other = fit(model, data, again, old=best, rounds=EXPLORING_ITERATIONS)
        if other.total() < best.total() + 1.0:
            break
        best = other
    return best


def fit(model: Model, data: Data, start: Array | None = None, keep: tuple[Array, Array] | None = None,
        old: Fit | None = None, rounds: int = MOST_ITERATIONS, enough: float = CONVERGED_GAIN) -> Fit:  # fmt: skip
    """Fit a model to the impacts and flights in `keep` (two boolean arrays; all by default).

    `old`: a fit whose noise covariance and scatter are taken as a start, and its slopes while the fit is near it.
    """
    low, high = model.bounds()
    p = np.clip(model.start() if start is None else start, low, high)
    if keep is None:
        keep = np.ones(len(data.impact_release), bool), np.ones(len(data.flight_release), bool)
    centre, tight = prior(model)
    begin, residuals = p, model_residuals(model, p, data)
    own, extra = len(BASE_WIDTH) + len(model.scatter_effects), data.extra_scatter().shape[-1]
    scatter = np.full(own + extra, 0.05)
    if old is not None:
        known = len(old.scatter) - extra
        scatter[: min(known, own)] = old.scatter[: min(known, own)]
        scatter[own:] = old.scatter[known:]
    slope: Slopes | None = old.slope if old is not None else None
    damping = 1e-3
    near = (
        np.concatenate([old.p, model.start()[len(old.p) :]])
        if old is not None
        else np.full(model.size, np.inf)
    )

    def cost(r: Residuals, q: Array, covariance: Array) -> float:
        return float(
            -log_likelihood(r.impacts, covariance)[keep[0]].sum()
            - flight_log_likelihood(r.flights)[keep[1]].sum()
            + 0.5 * (tight * (q - centre) ** 2).sum()
        )

    curve = np.eye(model.size)
    for round in range(rounds):
        # the noise of a start far away is not that of the end
        stale = old is None and (round == 0 or (round == 2 and np.abs(p - begin).max() > NOISE_UPDATE_CHANGE))
        noise = None if slope is None or stale else slope.covariance
        known = old.slope if old is not None and np.abs(p - near).max() < DERIVATIVES_REUSE_CHANGE else None
        slope = slopes(model, p, data, residuals, scatter, noise, known)
        part = Slopes(
            slope.impacts[keep[0]], slope.flights, slope.scatter[keep[0]], slope.covariance[keep[0]]
        )
        scatter = fit_scatter(residuals.impacts[keep[0]], part, np.maximum(scatter, 3e-3))
        covariance = spread(slope, scatter)
        curve, grad = normal_equations(residuals, slope, covariance, keep)
        grad = grad + tight * (p - centre)
        grad[discrete(model)] = 0.0  # chosen, not fitted
        now = cost(residuals, p, covariance)
        gain = 0.0
        for _ in range(5):
            regular = curve + np.diag(tight + damping * np.diag(curve))
            ahead = np.clip(p - newton_step(regular, grad, p, low, high), low, high)
            if grad @ (p - ahead) < 0.2 * enough:  # a parabola promises half of it
                break
            trial = model_residuals(model, ahead, data)
            gain = now - cost(trial, ahead, covariance)
            if gain > 0.0:
                p, residuals = ahead, trial
                damping = max(damping / 10, 1e-6)
                break
            damping *= 10
        if gain < enough:
            break
    assert slope is not None
    for i, k in enumerate(scatters(model)):
        p[k] = scatter[len(BASE_WIDTH) + i]
    return Fit(model, p, np.linalg.inv(curve + np.diag(tight)), scatter, slope, residuals)
