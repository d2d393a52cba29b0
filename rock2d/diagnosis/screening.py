"""Which effect is worth a fit beside a model: the gain on held-out releases that a linear model expects.

Around a fit, each effect adds one column for each of its parameters: how the residuals change. One Newton step in all
parameters, fitted to the other folds, gives the expected gain of a fold. That takes a few simulations for each effect,
where a fit takes a hundred. An effect that is strong, or whose first small step does nothing, has a second column: the
change of the residuals from no effect to the size that it has alone.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from rock2d.diagnosis.cross_validation import FOLDS, folds
from rock2d.diagnosis.data import Data, Residuals, model_residuals
from rock2d.diagnosis.derivatives import DIFFERENCE_STEP
from rock2d.diagnosis.fitting import Fit, extended
from rock2d.diagnosis.likelihood import (
    FLIGHT_STUDENT_DF,
    IMPACT_STUDENT_DF,
    chi_square,
    flight_log_likelihood,
    prior,
)
from rock2d.diagnosis.model import Model, discrete
from rock2d.effects.effect import Effect

Array = np.ndarray

LARGEST_STEP = 1.0  # of an effect's parameter, on the scale of `Model`
LARGEST_MULTIPLE = 1.5  # of the size that an effect has alone


@dataclass
class Expected:
    """What a linear model expects of an effect beside a fit.

    Attributes
    ----------
    gain : (releases,) log likelihood on held-out releases
    p : parameters of the model with the effect from which its fit may start
    """

    gain: Array
    p: Array

    @property
    def total(self) -> float:
        """Gain over all releases."""
        return float(self.gain.sum())


class Screening:
    """Expected gains beside one fit."""

    def __init__(self, fit: Fit, data: Data) -> None:
        self._fit, self._data = fit, data
        covariance = fit.covariance()
        r = np.nan_to_num(fit.residuals.impacts)
        self._known = np.isfinite(fit.residuals.impacts).all(axis=1)
        self._whiten = np.linalg.inv(np.linalg.cholesky(covariance))
        heavy = (IMPACT_STUDENT_DF + r.shape[1]) / (IMPACT_STUDENT_DF + chi_square(r, covariance))
        self._weight = self._known * heavy
        self._z = np.einsum("nij,nj->ni", self._whiten, r)
        self._flights = fit.residuals.flights
        self._flight_weight = (FLIGHT_STUDENT_DF + 1) / (FLIGHT_STUDENT_DF + self._flights**2)
        self._own = self._whiten @ fit.slope.impacts
        fold = folds(data)
        self._fold, self._flight_fold = fold[data.impact_release], fold[data.flight_release]

    def expected(self, effect: Effect, alone: Array) -> Expected:
        """Of an effect; `alone`: its parameters, on the scale of `Model`, in the fit of the base law with it."""
        own = self._fit
        model = Model(own.model.setup, own.model.base, [*own.model.effects, effect], own.p)
        start, first = extended(own, model), len(own.p)
        chosen = {k - first for k in discrete(model) if k >= first}
        steps = np.eye(model.size)[first:]
        free = [k for k in range(len(alone)) if k not in chosen]
        tries = []
        if free and not chosen:
            changes = [self._change(model, start, DIFFERENCE_STEP * steps[k]) for k in free]
            columns = _stacked([_scaled(c, 1.0 / DIFFERENCE_STEP) for c in changes])
            gain, step = self._gain(columns, np.full(len(free), 1.0))
            step = np.clip(step, -LARGEST_STEP, LARGEST_STEP)
            tries.append(Expected(gain, start - np.concatenate([np.zeros(first), step])))
        size = alone - start[first:]
        if np.abs(size).max(initial=0.0) > DIFFERENCE_STEP:
            whole = np.concatenate([np.zeros(first), size])
            gain, multiple = self._gain(_stacked([self._change(model, start, whole)]), np.ones(1))
            share = 1.0 if chosen else float(np.clip(-multiple[0], 0.0, LARGEST_MULTIPLE))
            tries.append(Expected(gain, start + share * whole))
        if not tries:
            return Expected(np.zeros(len(self._data.order)), start)
        best = max(tries, key=lambda e: e.total)
        low, high = model.bounds()
        return Expected(best.gain, np.clip(best.p, low, high))

    def all(self, effects: Mapping[str, Effect], alone: Mapping[str, Array]) -> dict[str, Expected]:
        """Of every effect that shifts means and is not in the model."""
        present = {effect.name for effect in self._fit.model.effects}
        return {
            name: self.expected(effect, alone[name])
            for name, effect in effects.items()
            if name not in present and not effect.scatter
        }

    def _change(self, model: Model, start: Array, step: Array) -> Residuals:
        """How the residuals change with a step of the parameters."""
        found = model_residuals(model, start + step, self._data)
        own = self._fit.residuals
        return Residuals(np.nan_to_num(found.impacts - own.impacts), found.flights - own.flights)

    def _gain(self, columns: Residuals, width: Array) -> tuple[Array, Array]:
        """(releases,) gain on held-out releases with columns (n, d, k), (m, 3, degrees, k); (k,) step to subtract.

        `width` (k,): standard deviations of the prior of the coefficients.
        """
        own = self._fit
        n_own = len(own.p)
        impacts = np.concatenate([self._own, self._whiten @ columns.impacts], axis=-1)
        flights = np.concatenate([own.slope.flights, columns.flights], axis=-1)
        centre, tight = prior(own.model)
        pull = np.concatenate([tight * (own.p - centre), np.zeros(len(width))])
        precision = np.concatenate([tight, width**-2.0])
        parts = [self._moments(impacts, flights, k) for k in range(FOLDS)]
        curve, grad = (sum(part[i] for part in parts) for i in (0, 1))
        fixed = discrete(own.model)
        gain = np.zeros(len(self._data.order))
        for k, (own_curve, own_grad) in enumerate(parts):
            a = curve - own_curve + np.diag(precision)
            b = grad - own_grad + pull
            b[fixed] = 0.0
            without = np.linalg.solve(a[:n_own, :n_own], b[:n_own])
            step = np.linalg.solve(a, b)
            gain += self._held_out(impacts, flights, k, step) - self._held_out(
                impacts[..., :n_own], flights[..., :n_own], k, without
            )
        whole = grad + pull
        whole[fixed] = 0.0
        return gain, np.linalg.solve(curve + np.diag(precision), whole)[n_own:]

    def _moments(self, impacts: Array, flights: Array, k: int) -> tuple[Array, Array]:
        """Curvature and slope of minus the log likelihood of one fold."""
        own, fly = self._fold == k, self._flight_fold == k
        x, w = impacts[own].reshape(-1, impacts.shape[-1]), np.repeat(self._weight[own], impacts.shape[1])
        f, v = flights[fly].reshape(-1, flights.shape[-1]), self._flight_weight[fly].ravel()
        heavy, steady = w[:, None] * x, v[:, None] * f
        return (
            heavy.T @ x + steady.T @ f,
            heavy.T @ self._z[own].ravel() + steady.T @ self._flights[fly].ravel(),
        )

    def _held_out(self, impacts: Array, flights: Array, k: int, step: Array) -> Array:
        """(releases,) log likelihood of a fold, to a constant, after a step."""
        own, fly = self._fold == k, self._flight_fold == k
        z = self._z[own] - impacts[own] @ step
        d = z.shape[1]
        chi2 = (z**2).sum(axis=1)
        score = -0.5 * (IMPACT_STUDENT_DF + d) * np.log1p(chi2 / IMPACT_STUDENT_DF) * self._known[own]
        n = len(self._data.order)
        of_flights = flight_log_likelihood(self._flights[fly] - flights[fly] @ step)
        return np.bincount(self._data.impact_release[own], score, n) + np.bincount(
            self._data.flight_release[fly], of_flights, n
        )


def _scaled(change: Residuals, factor: float) -> Residuals:
    return Residuals(factor * change.impacts, factor * change.flights)


def _stacked(changes: list[Residuals]) -> Residuals:
    """Columns along a last axis."""
    return Residuals(
        np.stack([c.impacts for c in changes], axis=-1), np.stack([c.flights for c in changes], axis=-1)
    )
