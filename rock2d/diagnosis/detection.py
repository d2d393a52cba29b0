"""Detection limits: the sizes of an effect that a record can show, from the linear model around its diagnosis.

An effect of known size, added to a record, changes the residuals by a known amount: the change that the effect makes in
a model, with the opposite sign. One Newton step with the effect, fitted to other releases, gives its gain on each
release. A bootstrap over the releases gives the probability that the gain, beyond that in the original record,
suffices to name the effect. This probability is a logistic curve over the logarithm of the size. It needs no fit. Full
diagnoses of records with an added effect correct it: `blind.recovery`."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import TypeAdapter, ValidationError
from scipy.special import expit
from threadpoolctl import threadpool_limits

from rock2d.arrays import Array
from rock2d.diagnosis.cross_validation import by_release
from rock2d.diagnosis.data import Data, Residuals
from rock2d.diagnosis.derivatives import (
    START_SCATTER,
    Jacobian,
    Point,
    by_scatter,
    jacobian_by_differences,
    residual_covariance,
)
from rock2d.diagnosis.diagnose import Diagnosis
from rock2d.diagnosis.evidence import EFFECT_FORM_SHARE
from rock2d.diagnosis.fitting import Fit, start_scatter
from rock2d.diagnosis.known_causes import (
    distance_from_neutral,
    largest_size,
    size_parameter,
    two_sided,
    values_of_size,
    with_cause,
)
from rock2d.diagnosis.likelihood import (
    SCATTER_BOUNDS,
    clustered_covariance,
    fit_scatter,
    log_likelihood,
    normal_equations,
    prior,
)
from rock2d.diagnosis.linear_model import LinearModel
from rock2d.diagnosis.model import BASE_WIDTH, choice_positions, from_scale
from rock2d.diagnosis.significance import LARGEST_GAIN, LEAST_GAIN, SMALLEST_ERROR
from rock2d.diagnosis.visibility import LEAST_SIZE
from rock2d.effects import catalogue
from rock2d.effects.effect import Effect
from rock2d.errors import InputError
from rock2d.files.checked_yaml import shown
from rock2d.files.diagnosis_keys import Limit
from rock2d.files.experiment import Experiment, digest
from rock2d.files.text_files import read_json
from rock2d.scene.world import World

LIMITS, TRUTH = "limits.json", "truth.json"  # files in the folder of a study
EXPECTED = (
    "The limits of the effects are those that a linear model expects, corrected by results of other films. They were "
    "not tested with known causes in this film (see `rock2d blind inject`)."
)
SEEN_Z = 3.0  # standard errors that the gain of an effect must have to be named
BOOTSTRAPS = 400
TRIED_SIZES, ZOOMS = 7, 2  # sizes of a search; searches, each between two sizes of the previous one
SMALLEST_TRIED = 1e-3  # smallest tried size, as a share of the largest plausible one
LEAST_STEEPNESS = 1.0  # smallest steepness of a curve
ODDS_90, ODDS_95 = np.log(9.0), np.log(19.0)
# Prior of the shifts of curves, in the logarithm of the size: full diagnoses of 48 films with 16 added effects (two
# thirds of the real squares) needed 1.3 times the size that the linear model expects (1.6 and 1.05).
SHARED_SHIFT, SHARED_SD, OWN_SD = np.log(1.3), 0.3, 0.4
ONE_SIDED_Z = 1.645  # standard errors of a one-sided 95 % limit
SCANNED_SIZES = 60  # tried sizes of a scatter, to find the largest possible one


@dataclass(frozen=True)
class Curve:
    """The probability that an effect of a size is named: 1 / (1 + (seen50 / size)^steepness).

    seen50, steepness : size that is named with probability 0.5, and steepness of the curve
    unit : unit of the size
    compatible : largest size that is compatible with the original record
    value : most probable value of the first parameter in the original record
    found : whether the effect was named in the original record
    largest : largest plausible size"""

    seen50: float
    steepness: float
    unit: str
    compatible: float
    value: float
    found: bool
    largest: float

    def size(self, odds: float) -> float:
        """The size that is named with these logarithmic odds."""
        return float(self.seen50 * np.exp(odds / self.steepness))

    def limit(self) -> dict[str, Any]:
        """As in the key `limits` of diagnosis.json."""
        upper = None if self.found else max(self.size(ODDS_95), self.compatible)
        return {"seen50": self.seen50, "seen90": self.size(ODDS_90), "upper95": upper, "unit": self.unit}


@threadpool_limits.wrap(limits=1)  # the matrices are small
def detection_curves(result: Diagnosis, names: Iterable[str]) -> dict[str, Curve]:
    """Effect -> its curve, for effects with a size. Left out are effects that these data cannot show, and effects that
    no plausible size would show."""
    attribution, data = result.found, result.data
    assert attribution is not None and data is not None
    # gain that may remain because the forms of the laws in the model are not exact
    others = [attribution.evidence[name].own_gain.total for name in attribution.named if not catalogue()[name].camera]
    least = max(LEAST_GAIN, EFFECT_FORM_SHARE * sum(others))
    curves = {}
    for name in names:
        if name in (result.unseen or {}):
            continue
        effect = catalogue()[name]
        parameter = size_parameter(effect, result.setup)
        added = _AddedEffect(attribution.settled, data, effect, result.setup, least)
        low, high = SMALLEST_TRIED * largest_size(parameter), largest_size(parameter)
        for _ in range(ZOOMS):
            sizes = np.geomspace(low, high, TRIED_SIZES)
            probability = np.maximum.accumulate([added.probability_named(s) for s in sizes])
            low = sizes[max(int(np.searchsorted(probability, 0.1)) - 1, 0)]
            high = sizes[min(int(np.searchsorted(probability, 0.9)), TRIED_SIZES - 1)]
        if probability[-1] < 0.5:
            continue
        log50, log90 = np.interp([0.5, 0.9], probability, np.log(sizes))
        steepness = max(ODDS_90 / max(log90 - log50, 0.1), LEAST_STEEPNESS)
        seen50, found_anyway = float(np.exp(log50)), name in attribution.named
        curves[name] = Curve(
            seen50, float(steepness), parameter.unit, *added.upper_limit(), found_anyway, largest_size(parameter)
        )
    return curves


def corrected(curves: Mapping[str, Curve], cases: Sequence[tuple[str, float, bool]]) -> dict[str, Curve]:
    """The curves corrected by cases (effect, size, whether it was named), without effects that no plausible size shows.

    Each curve is shifted along the logarithm of the size by a common shift and one of its own, both with a normal
    prior. The most probable shifts are used. Their uncertainty makes the curves flatter: D. J. C. MacKay (1992), Neural
    Comput. 4(5), 720-736, eq. 10."""
    from scipy.optimize import minimize

    names = list(curves)
    steepness = np.array([curves[name].steepness for name, _, _ in cases])
    log_size = np.array([np.log(size / curves[name].seen50) for name, size, _ in cases])
    seen = np.array([was for _, _, was in cases], float)
    design = np.zeros((len(cases), 1 + len(names)))
    for row, (name, _, _) in enumerate(cases):
        design[row, [0, 1 + names.index(name)]] = 1.0
    centre = np.array([SHARED_SHIFT] + [0.0] * len(names))
    precision = np.array([SHARED_SD] + [OWN_SD] * len(names)) ** -2.0

    def cost(shift: Array) -> float:
        odds = steepness * (log_size - design @ shift)
        return float(np.sum(np.logaddexp(0.0, odds) - seen * odds) + 0.5 * precision @ (shift - centre) ** 2)

    shift = minimize(cost, centre).x
    chance = expit(steepness * (log_size - design @ shift))
    covariance = np.linalg.inv((design.T * (steepness**2 * chance * (1.0 - chance))) @ design + np.diag(precision))
    result = {}
    for k, (name, curve) in enumerate(curves.items(), 1):
        variance = covariance[0, 0] + 2.0 * covariance[0, k] + covariance[k, k]
        flatter = np.sqrt(1.0 + np.pi / 8.0 * variance * curve.steepness**2)
        seen50 = curve.seen50 * float(np.exp(shift[0] + shift[k]))
        if seen50 <= curve.largest:
            result[name] = replace(curve, seen50=seen50, steepness=float(curve.steepness / flatter))
    return result


def limits_of(curves: Mapping[str, Curve], cases: Sequence[tuple[str, float, bool]] = ()) -> dict[str, dict[str, Any]]:
    """Effect -> limit from the `corrected` curves."""
    return {name: curve.limit() for name, curve in corrected(curves, cases).items()}


def read_limits(folder: Path, experiment: Experiment) -> dict[str, dict[str, Any]]:
    """Effect -> limit of the study in a folder. Raises InputError if there is none, or if it is of another
    film."""
    truth = read_json(folder / TRUTH)
    try:
        limits = TypeAdapter(dict[str, Limit]).validate_python(read_json(folder / LIMITS))
    except ValidationError:
        raise InputError("expected limits of effects", folder / LIMITS, code="not_a_result") from None
    if not limits.keys() <= catalogue().keys() or not isinstance(truth, dict):
        raise InputError("expected a study of rock2d blind inject", folder, code="not_a_result")
    same = truth["film"] == digest(experiment) if "film" in truth else truth.get("experiment") == experiment.name
    if not same:
        raise InputError(
            f"these limits are those of another film, of experiment {shown(truth.get('experiment'))}; they say nothing "
            "about this one: `rock2d blind inject` makes its own",
            folder,
            code="wrong_kind",
        )
    return {name: limit.model_dump() for name, limit in limits.items()}


class _AddedEffect:
    """An effect that is added to the record of a fit, by the linear model."""

    def __init__(self, fit: Fit, data: Data, effect: Effect, world: World, least: float) -> None:
        self._least_gain = least  # gain that is needed to name the effect
        self._fit, self._data, self._effect, self._world = fit, data, effect, world
        self._model, self._p, _ = with_cause(fit.model, fit.p, effect, {})
        own, soil = fit.jacobian, start_scatter(self._model, data, fit)
        point = Point(self._p, fit.residuals)
        self._jacobian = jacobian_by_differences(self._model, point, data, soil, own.noise, own.later, own)
        place, self._others = self._model.positions[effect.name], np.ones(self._model.size, bool)
        self._others[place] = False
        # the parameter that is its size; for an effect with parameters for each block, those of all blocks
        step = len(effect.parameters) if self._model.has_own_parameters(effect) else place.stop - place.start
        self._sizes = np.arange(place.start, place.stop, step)
        scatters = [e.name == effect.name for e in self._model.scatter_effects]
        further = self._jacobian.scatter.shape[-1] - len(BASE_WIDTH) - len(scatters)
        self._wide = np.array([False] * len(BASE_WIDTH) + scatters + [False] * further)
        self._size = size_parameter(effect, world)
        self._unit = 0.5 * (self._size.high - self._size.low)
        rng = np.random.default_rng(np.random.SeedSequence(0))
        n = len(data.order)
        self._weights = rng.multinomial(n, np.full(n, 1.0 / n), size=BOOTSTRAPS)
        self._drawn = rng.normal(size=(len(data.impact_release), 1))

    def probability_named(self, size: float) -> float:
        """Probability that the effect is named at this size, averaged over both signs if both are possible."""
        if size < LEAST_SIZE * largest_size(self._size):
            return 0.0
        gains = [self._gain_of_scatter(size)] if self._effect.scatter else self._gains(size)
        return float(np.mean([self._naming_probability(gain) for gain in gains]))

    def _naming_probability(self, gain: Array) -> float:
        """Probability over bootstrap draws of the releases that a gain (releases,) suffices to name the effect."""
        clipped = np.clip(gain, -LARGEST_GAIN, LARGEST_GAIN)
        total = self._weights @ clipped
        square = self._weights @ clipped**2 - total**2 / len(gain)
        z = total / np.maximum(np.sqrt(np.maximum(square, 0.0)), SMALLEST_ERROR)
        return float(np.mean((z > SEEN_Z) & (self._weights @ gain > self._least_gain)))

    def _gains(self, size: float) -> list[Array]:
        """For each sign (releases,): held-out gain that the linear model expects, minus that in the original record."""
        fit, data = self._fit, self._data
        values = values_of_size(self._effect, size, self._world)
        model, p, moved = with_cause(fit.model, fit.p, self._effect, values)
        residuals = fit.residuals
        change = model.residuals(moved, data).minus(residuals)
        unit = np.abs(moved - p)[self._sizes]
        further = Residuals(change.impacts[..., None] / unit, change.flights[..., None] / unit)
        if model.has_own_parameters(self._effect):  # there are no impacts
            blocks = [list(model.setup.blocks).index(name) for name in model.flown]
            further.flights *= np.equal.outer(data.flight_block, blocks)[:, None, None]

        def gain(share: float) -> Array:
            left = Residuals(residuals.impacts - share * change.impacts, residuals.flights - share * change.flights)
            return LinearModel(self._fit_without_effect(left), data).best_gain(further)[0]

        return [gain(sign) - gain(0.0) for sign in ((1.0, -1.0) if two_sided(self._size) else (1.0,))]

    def _gain_of_scatter(self, size: float) -> Array:
        """(releases,) the same for an effect that widens the scatter, with drawn amounts of the effect."""
        own, jacobian, sigma = self._fit.residuals, self._jacobian_at(size), size / self._unit
        slope, bend = (part[..., self._wide][..., 0] for part in (jacobian.scatter, jacobian.bend))
        amount = slope * self._drawn * sigma + bend * (self._drawn * sigma) ** 2 / np.sqrt(2.0)
        changed, start = Residuals(own.impacts + amount, own.flights), np.full(len(self._wide), START_SCATTER)
        gain = np.zeros(len(self._data.order))
        for residuals, sign in ((changed, 1.0), (own, -1.0)):
            for keep, side in ((np.ones_like(self._wide), sign), (~self._wide, -sign)):
                kept = jacobian.scattered_by(keep)
                scatter = fit_scatter(residuals.impacts, kept, start[keep])
                gain += side * by_release(self._data, residuals, residual_covariance(kept, scatter))
        return gain

    def _jacobian_at(self, size: float) -> Jacobian:
        """The derivatives for an effect that widens the scatter, at this size."""
        sigma, known = size / self._unit, self._jacobian
        parts = by_scatter(self._model, self._p, self._data, self._fit.residuals, self._effect, sigma)
        scatter, bend = (
            np.where(self._wide, own, old) for own, old in zip(parts, (known.scatter, known.bend), strict=True)
        )
        return replace(known, scatter=np.nan_to_num(scatter), bend=np.nan_to_num(bend))

    def _fit_without_effect(self, residuals: Residuals) -> Fit:
        """The fit without the parameters of the effect, with these residuals."""
        keep, others = self._others, [e for e in self._model.effects if e.name != self._effect.name]
        return replace(
            self._fit, model=replace(self._model, effects=others), p=self._p[keep],
            jacobian=self._jacobian.only(keep), residuals=residuals,
        )  # fmt: skip

    def upper_limit(self) -> tuple[float, float]:
        """The largest size compatible with the original record (one-sided 95 %), and the most probable value.

        From one Newton step and `clustered_covariance`; for a scatter, from its likelihood."""
        fit, data, jacobian = self._fit, self._data, self._jacobian
        if self._effect.scatter:
            scatter = fit_scatter(fit.residuals.impacts, jacobian, np.full(len(self._wide), START_SCATTER))
            largest = min(largest_size(self._size), SCATTER_BOUNDS[1] * self._unit)
            sizes = np.geomspace(SMALLEST_TRIED, 1.0, SCANNED_SIZES) * largest
            tried = [
                residual_covariance(self._jacobian_at(s), np.where(self._wide, s / self._unit, scatter)) for s in sizes
            ]
            total = np.array([log_likelihood(fit.residuals.impacts, own).sum() for own in tried])
            return float(sizes[total >= total.max() - 0.5 * ONE_SIDED_Z**2].max()), float(sizes[total.argmax()])
        covariance, (centre, precision) = fit.covariance(), prior(self._model)
        curvature, grad = normal_equations(fit.residuals, jacobian, covariance)
        curvature, grad = curvature + np.diag(precision), grad + precision * (self._p - centre)
        grad[choice_positions(self._model)] = 0.0
        p_covariance = clustered_covariance(
            fit.residuals, jacobian, covariance, curvature, (data.impact_release, data.flight_release), len(data.order)
        )
        z = self._p - np.linalg.solve(curvature, grad)
        half = ONE_SIDED_Z * np.sqrt(np.diag(p_covariance))
        parameters = self._model.parameters_of(self._effect.name)[:: len(self._effect.parameters)]
        ends = np.array([
            [from_scale(q, z[at] + s * half[at]) for s in (-1, 0, 1)]
            for at, q in zip(self._sizes, parameters, strict=True)
        ])  # fmt: skip
        farthest = max(distance_from_neutral(self._size, low, high) for low, _, high in ends)
        return min(farthest, largest_size(self._size)), float(ends[:, 1].mean())
