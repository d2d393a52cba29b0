"""The linear model around a fit: the expected gain of further parameters on held-out releases.

A column is the derivative of all residuals by a further parameter. The expected gain is the difference between one
Newton step with these columns and one without; the parameters of the fit are free in both. No simulation is needed.

`Screening` finds the effects that are worth a fit: those of which the linear model promises most, also far from no
effect. Each adds one column for each of its parameters. That takes a few simulations, where a fit takes a hundred. An
effect that is strong, or whose first small step does nothing, has a second column: the change of the residuals between
no effect and its size as a single effect."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from rock2d.arrays import Array
from rock2d.diagnosis.cross_validation import FOLDS, folds
from rock2d.diagnosis.data import Data, Residuals
from rock2d.diagnosis.derivatives import DIFFERENCE_STEP, Jacobian
from rock2d.diagnosis.fitting import SMALLEST_START_SCATTER, Fit, extended
from rock2d.diagnosis.likelihood import (
    IMPACT_STUDENT_DF,
    chi_square,
    fit_scatter,
    flight_log_likelihood,
    flight_weight,
    impact_weight,
    newton_step,
    normal_equations,
    prior,
)
from rock2d.diagnosis.model import BASE_WIDTH, Model, choice_positions, scatter_positions, to_scale
from rock2d.diagnosis.significance import Gain, SummedGain
from rock2d.effects.effect import Effect, Parameter

CHANCE_DRAWS, CHANCE_SEED = 100, 0
GRID_SIZES, NEWTON_STEPS = 17, 2  # tried sizes of a column, and Newton steps from the best of them
LARGEST_MULTIPLE = 1.5  # largest size of an effect, as a multiple of its size as a single effect


class LinearModel:
    """A fit, its whitened residuals and their derivatives by its own parameters."""

    def __init__(self, fit: Fit, data: Data) -> None:
        self._fit, self._data = fit, data
        self._covariance = covariance = fit.covariance()
        r = np.nan_to_num(fit.residuals.impacts)
        self._known = np.isfinite(fit.residuals.impacts).all(axis=1)
        self._whiten = np.linalg.inv(np.linalg.cholesky(covariance))
        self._weight = self._known * impact_weight(chi_square(r, covariance), r.shape[1])
        self._z = np.einsum("nij,nj->ni", self._whiten, r)
        self._flights = fit.residuals.flights
        self._flight_weight = flight_weight(self._flights)
        self._own = self._whiten @ fit.jacobian.impacts
        self._total = fit.total()
        fold = folds(data)
        self._fold, self._flight_fold = fold[data.impact_release], fold[data.flight_release]

    def best_gain(self, columns: Residuals, widths: Sequence[float] = (1.0,)) -> tuple[Array, float]:
        """Gain (releases,) in log likelihood on held-out releases by one Newton step with columns (n, d, k) of impacts
        and (m, 3, degrees, k) of flights, and that of the `widths` with which it is largest: standard deviations of the
        prior of the further parameters."""
        impacts = np.concatenate([self._own, self._whiten @ columns.impacts], axis=-1)
        flights = self._fit.jacobian.flights
        if columns.flights.any():  # most levers do not change flights
            flights = np.concatenate([flights, columns.flights], axis=-1)
        parts = [self._moments(impacts, flights, k) for k in range(FOLDS)]
        gains = [(self._held_out(impacts, flights, parts, width) - self._score_before, width) for width in widths]
        return max(gains, key=lambda one: float(one[0].sum()))

    def gain_of_own_values_in_flights(self, name: str) -> SummedGain:
        """Gain on held-out releases if an effect of the fit has other values in flights than in impacts. A camera
        changes both alike, so a true effect of the camera gains nothing by it."""
        fit = self._fit
        flights = fit.jacobian.flights[..., fit.model.positions[name]].copy()
        flights[self._data.flown :] = 0.0  # rests
        columns = Residuals(np.zeros((*fit.residuals.impacts.shape, flights.shape[-1])), flights)
        return Gain(self.best_gain(columns)[0])

    def promise(self, columns: Residuals, low: Array, high: Array) -> tuple[float, Array]:
        """Largest gain in log likelihood with steps of the columns between `low` and `high` (k,), and these steps (k,),
        to add. The parameters of the fit are free.

        Impacts that a strong cause changes much count little in a robust likelihood without the cause, so a Newton step
        from there is far too short. So a second start is the most likely place of one column. The scatter of the soil
        is fitted again: it may have grown with what the columns explain."""
        fit = self._fit
        (least, most), (centre, precision) = fit.model.bounds(), prior(fit.model)
        size, count = len(fit.p), len(low)
        jacobian = fit.jacobian.beside(columns.impacts, columns.flights)
        least, most = np.concatenate([least - fit.p, low]), np.concatenate([most - fit.p, high])
        to_centre = np.concatenate([fit.p - centre, np.zeros(count)])
        precision = np.concatenate([precision, np.ones(count)])
        best = -np.inf, np.zeros(count)
        for x in (np.zeros(size + count), np.concatenate([np.zeros(size), self._likely_place(columns, low, high)])):
            x = np.clip(x, least, most)
            for _ in range(NEWTON_STEPS):
                curvature, grad = normal_equations(self._after(jacobian, x), jacobian, self._covariance)
                grad += precision * (to_centre + x)
                grad[[*choice_positions(fit.model), *scatter_positions(fit.model)]] = 0.0  # not fitted by steps
                x = np.clip(x - newton_step(curvature + np.diag(precision), grad, x, least, most), least, most)
            after = self._after(jacobian, x)
            scatter = fit_scatter(after.impacts, fit.jacobian, np.maximum(fit.scatter, SMALLEST_START_SCATTER))
            gain = replace(fit, residuals=after, scatter=scatter).total() - self._total
            best = max(best, (gain, x[size:]), key=lambda one: one[0])
        return best

    def _after(self, jacobian: Jacobian, x: Array) -> Residuals:
        """Residuals that the linear model expects after these steps."""
        own = self._fit.residuals
        return Residuals(own.impacts + jacobian.impacts @ x, own.flights + jacobian.flights @ x)

    def _likely_place(self, columns: Residuals, low: Array, high: Array) -> Array:
        """(k,) step of one of the columns, between `low` and `high` (k,), that is most likely on a grid."""
        shares = np.linspace(low, high, GRID_SIZES)  # (s, k)
        white = self._whiten @ columns.impacts
        along, square = np.einsum("nd,ndk->nk", self._z, white), (white**2).sum(axis=1)
        chi2 = (self._z**2).sum(axis=1)[:, None] + shares[:, None] * (2.0 * along + shares[:, None] * square)
        df = IMPACT_STUDENT_DF + self._z.shape[1]
        total = -0.5 * df * (self._known[:, None] * np.log1p(np.maximum(chi2, 0.0) / IMPACT_STUDENT_DF)).sum(axis=1)
        if columns.flights.any():
            for s, k in np.ndindex(total.shape):
                total[s, k] += flight_log_likelihood(self._flights + shares[s, k] * columns.flights[..., k]).sum()
        s, k = np.unravel_index(total.argmax(), total.shape)
        return np.asarray(shares[s] * (np.arange(len(low)) == k))

    def chance_gains(self, columns: Residuals) -> Array:
        """(CHANCE_DRAWS,) gains of the columns by chance on held-out releases: the residuals of each release get a
        random sign. That keeps their sizes and correlations within a release, and removes what is common to many
        releases. Of the columns only that counts which no parameter of the fit can do."""
        data, own_size, count = self._data, self._own.shape[-1], columns.impacts.shape[-1]
        impacts = np.concatenate([self._own, self._whiten @ columns.impacts], axis=-1)
        flights = np.concatenate([self._fit.jacobian.flights, columns.flights], axis=-1)
        pulls = np.zeros((len(data.order), own_size + count))
        np.add.at(pulls, data.impact_release, np.einsum("ndk,nd->nk", impacts, self._weight[:, None] * self._z))
        steady = self._flight_weight * self._flights
        np.add.at(pulls, data.flight_release, np.einsum("mcdk,mcd->mk", flights, steady))
        parts = np.array([self._moments(impacts, flights, k)[0] for k in range(FOLDS)])
        whole = parts.sum(axis=0)
        own_curvature = whole[:own_size, :own_size] + np.diag(prior(self._fit.model)[1])
        beyond_own = np.concatenate([-np.linalg.solve(own_curvature, whole[:own_size, own_size:]), np.eye(count)])
        parts, pulls = beyond_own.T @ parts @ beyond_own, pulls @ beyond_own
        signs = np.random.default_rng(CHANCE_SEED).choice([-1.0, 1.0], (CHANCE_DRAWS, len(pulls)))
        fold, total = folds(data), np.zeros(CHANCE_DRAWS)
        for k, curvature in enumerate(parts):
            own, others = (signs[:, part] @ pulls[part] for part in (fold == k, fold != k))
            step = np.linalg.solve(parts.sum(axis=0) - curvature + np.eye(count), others.T).T
            total += (step * own).sum(axis=1) - 0.5 * np.einsum("rp,pq,rq->r", step, curvature, step)
        return total

    @cached_property
    def _score_before(self) -> Array:
        """(releases,) log likelihood on held-out releases without further columns."""
        own, flights = self._own, self._fit.jacobian.flights
        return self._held_out(own, flights, [self._moments(own, flights, k) for k in range(FOLDS)])

    def _newton(self, curvature: Array, grad: Array, width: float) -> Array:
        """Newton step, to subtract: of the parameters and then of the further ones."""
        model, p = self._fit.model, self._fit.p
        centre, prior_precision = prior(model)
        precision = np.concatenate([prior_precision, np.full(len(grad) - len(p), width) ** -2.0])
        pull = np.concatenate([grad[: len(p)] + prior_precision * (p - centre), grad[len(p) :]])
        pull[choice_positions(model)] = 0.0  # a scan chooses them
        return np.linalg.solve(curvature + np.diag(precision), pull)

    def _moments(self, impacts: Array, flights: Array, k: int) -> tuple[Array, Array]:
        """Curvature and gradient of minus the log likelihood of one fold. `flights` may lack the further columns."""
        rows = self._fold == k
        x, w = impacts[rows].reshape(-1, impacts.shape[-1]), np.repeat(self._weight[rows], impacts.shape[1])
        heavy = w[:, None] * x
        curvature, grad = heavy.T @ x, heavy.T @ self._z[rows].ravel()
        rows, size = self._flight_fold == k, flights.shape[-1]
        x, w = flights[rows].reshape(-1, size), self._flight_weight[rows].ravel()
        steady = w[:, None] * x
        curvature[:size, :size] += steady.T @ x
        grad[:size] += steady.T @ self._flights[rows].ravel()
        return curvature, grad

    def _held_out(
        self, impacts: Array, flights: Array, parts: Sequence[tuple[Array, Array]], width: float = 1.0
    ) -> Array:
        """(releases,) log likelihood up to a constant, each fold after the step from the moments `parts` of the other
        folds."""
        curvature, grad = (np.sum([part[i] for part in parts], axis=0) for i in (0, 1))
        z, after = np.empty_like(self._z), np.empty_like(self._flights)
        for k, (c, g) in enumerate(parts):
            step = self._newton(curvature - c, grad - g, width)
            impact_rows, flight_rows = self._fold == k, self._flight_fold == k
            z[impact_rows] = self._z[impact_rows] - impacts[impact_rows] @ step
            after[flight_rows] = self._flights[flight_rows] - flights[flight_rows] @ step[: flights.shape[-1]]
        d, n = z.shape[1], len(self._data.order)
        score = -0.5 * (IMPACT_STUDENT_DF + d) * np.log1p((z**2).sum(axis=1) / IMPACT_STUDENT_DF)
        return np.bincount(self._data.impact_release, score * self._known, n) + np.bincount(
            self._data.flight_release, flight_log_likelihood(after), n
        )


@dataclass
class Expected(SummedGain):
    """Gain that a linear model expects of one more effect in a fit.

    Attributes
    ----------
    gain : (releases,) log likelihood on held-out releases
    promise : see `LinearModel.promise`; says which effects are worth a fit
    p : start parameters for a fit of the model with the effect
    chance_gains : (draws,) gains by chance, see `LinearModel.chance_gains`"""

    gain: Array
    promise: float
    p: Array
    chance_gains: Array


class Screening:
    """Expected gains of effects in addition to a fit."""

    def __init__(self, fit: Fit, data: Data) -> None:
        self._fit, self._data, self._linear = fit, data, LinearModel(fit, data)

    def expected(self, effect: Effect, alone: Array) -> Expected:
        """Expected gain of an effect; `alone`: parameters of the fit of the base law with it."""
        fit = self._fit
        model = replace(fit.model, effects=[*fit.model.effects, effect], known_p=fit.p)
        start, first, parameters = extended(fit, model), len(fit.p), model.parameters[-1]
        low, high = model.bounds()
        must_choose = any(q.must_choose for q in parameters)
        free = [first + k for k, q in enumerate(parameters) if not q.choices]
        trials, steps, chance = list[tuple[float, Array, Array]](), np.eye(model.size), []
        for at in _starts(start, first, parameters):
            if not free or must_choose:
                break
            columns = _stacked([self._change(model, at, DIFFERENCE_STEP * steps[k]) for k in free])
            columns.impacts *= 1.0 / DIFFERENCE_STEP
            columns.flights *= 1.0 / DIFFERENCE_STEP
            gain, _ = self._linear.best_gain(columns)
            promise, step = self._linear.promise(columns, low[free] - at[free], high[free] - at[free])
            trials.append((promise, gain, at + step @ steps[free]))
            chance.append(self._linear.chance_gains(columns))
        base = len(BASE_WIDTH)
        at, full_step = start.copy(), np.zeros(model.size)
        full_step[first:] = alone[base:] - start[first:]
        if must_choose:  # the law was fitted with the choice
            full_step[:base] = alone[:base] - start[:base]
        for k, q in enumerate(parameters, first):
            if q.has_neutral_choice:
                at[k], full_step[k] = start[k] + full_step[k], 0.0
        if np.abs(full_step).max(initial=0.0) > DIFFERENCE_STEP:
            columns = _stacked([self._change(model, at, full_step)])
            gain, _ = self._linear.best_gain(columns)
            least, most = (1.0, 1.0) if must_choose else (0.0, LARGEST_MULTIPLE)
            promise, share = self._linear.promise(columns, np.array([least]), np.array([most]))
            trials.append((promise, gain, at + share * full_step))
            chance.append(self._linear.chance_gains(columns))
        if not trials:
            return Expected(np.zeros(len(self._data.order)), 0.0, start, np.zeros(CHANCE_DRAWS))
        promise, _, p = max(trials, key=lambda one: one[0])
        gain = max((own for _, own, _ in trials), key=lambda own: float(own.sum()))
        return Expected(gain, promise, np.clip(p, low, high), np.max(chance, axis=0))

    def all(self, effects: Mapping[str, Effect], alone: Mapping[str, Array]) -> dict[str, Expected]:
        """Expected gain of every effect that is not in the model and does not only widen the scatter."""
        present = {effect.name for effect in self._fit.model.effects}
        return {
            name: self.expected(effect, alone[name])
            for name, effect in effects.items()
            if name not in present and not effect.scatter
        }

    def _change(self, model: Model, start: Array, step: Array) -> Residuals:
        """Change of the residuals with a step of the parameters."""
        return model.residuals(start + step, self._data).minus(self._fit.residuals)


def _starts(start: Array, first: int, parameters: Sequence[Parameter]) -> list[Array]:
    """`start` with each combination of the choices of parameters, from position `first` on, that have a neutral
    choice."""
    places = [start]
    for k, parameter in enumerate(parameters, first):
        if parameter.has_neutral_choice:
            values = [to_scale(parameter, v) for v in parameter.choices]
            places = [np.where(np.arange(len(at)) == k, v, at) for at in places for v in values]
    return places


def _stacked(changes: list[Residuals]) -> Residuals:
    """Changes as columns along a new last axis."""
    return Residuals(np.stack([c.impacts for c in changes], axis=-1), np.stack([c.flights for c in changes], axis=-1))
