"""Screening of the effects that are worth a fit: the gain on held-out releases that a linear model expects.

Around a fit, each effect adds one column for each of its parameters: how the residuals change. One Newton step in all
parameters, fitted to the other folds, gives the expected gain of a fold. That takes a few simulations for each effect,
where a fit takes a hundred. An effect that is strong, or whose first small step does nothing, has a second column: the
change of the residuals between no effect and its size as a single effect.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from rock2d.diagnosis.data import Data, Residuals
from rock2d.diagnosis.derivatives import DIFFERENCE_STEP
from rock2d.diagnosis.fitting import Fit, extended
from rock2d.diagnosis.linear_model import CHANCE_DRAWS, LinearModel
from rock2d.diagnosis.model import BASE_WIDTH, Model, to_scale
from rock2d.diagnosis.significance import SummedGain
from rock2d.effects.effect import Effect, Parameter

Array = np.ndarray

LARGEST_STEP = 1.0  # largest step of an effect's parameter, on the scale of `Model`
LARGEST_MULTIPLE = 1.5  # largest size of an effect, as a multiple of its size as a single effect


@dataclass
class Expected(SummedGain):
    """Gain that a linear model expects of one more effect in a fit.

    Attributes
    ----------
    gain : (releases,) log likelihood on held-out releases
    p : start parameters for a fit of the model with the effect
    chance_gains : (draws,) gains by chance, see `LinearModel.chance_gains`
    """

    gain: Array
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
        must_choose = any(q.must_choose for q in parameters)
        free = [first + k for k, q in enumerate(parameters) if not q.choices]
        trials, steps, chance = list[tuple[Array, Array]](), np.eye(model.size), []
        for at in _starts(start, first, parameters):
            if not free or must_choose:
                break
            changes = [self._change(model, at, DIFFERENCE_STEP * steps[k]) for k in free]
            columns = _stacked([_scaled(c, 1.0 / DIFFERENCE_STEP) for c in changes])
            linear_step = self._linear.expected(columns, [np.ones(len(free))])
            step = np.clip(linear_step.step, -LARGEST_STEP, LARGEST_STEP)
            trials.append((linear_step.gain, at - step @ steps[free]))
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
            linear_step = self._linear.expected(columns, [np.ones(1)])
            share = 1.0 if must_choose else float(np.clip(-linear_step.step[0], 0.0, LARGEST_MULTIPLE))
            trials.append((linear_step.gain, at + share * full_step))
            chance.append(self._linear.chance_gains(columns))
        if not trials:
            return Expected(np.zeros(len(self._data.order)), start, np.zeros(CHANCE_DRAWS))
        gain, p = max(trials, key=lambda one: float(one[0].sum()))
        low, high = model.bounds()
        return Expected(gain, np.clip(p, low, high), np.max(chance, axis=0))

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


def _scaled(change: Residuals, factor: float) -> Residuals:
    return Residuals(factor * change.impacts, factor * change.flights)


def _stacked(changes: list[Residuals]) -> Residuals:
    """Changes as columns along a new last axis."""
    return Residuals(
        np.stack([c.impacts for c in changes], axis=-1), np.stack([c.flights for c in changes], axis=-1)
    )
