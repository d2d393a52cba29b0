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

from rock2d.diagnosis.data import Data, Residuals
from rock2d.diagnosis.derivatives import DIFFERENCE_STEP
from rock2d.diagnosis.fitting import Fit, extended
from rock2d.diagnosis.linear_model import LinearModel
from rock2d.diagnosis.model import Model, discrete
from rock2d.diagnosis.significance import OverReleases
from rock2d.effects.effect import Effect

Array = np.ndarray

LARGEST_STEP = 1.0  # of an effect's parameter, on the scale of `Model`
LARGEST_MULTIPLE = 1.5  # of the size that an effect has alone


@dataclass
class Expected(OverReleases):
    """What a linear model expects of an effect beside a fit.

    Attributes
    ----------
    gain : (releases,) log likelihood on held-out releases
    p : parameters of the model with the effect from which its fit may start
    """

    gain: Array
    p: Array


class Screening:
    """Expected gains beside one fit."""

    def __init__(self, fit: Fit, data: Data) -> None:
        self._fit, self._data, self._linear = fit, data, LinearModel(fit, data)

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
            found = self._linear.expected(columns, [np.ones(len(free))])
            step = np.clip(found.step, -LARGEST_STEP, LARGEST_STEP)
            tries.append(Expected(found.gain, start - np.concatenate([np.zeros(first), step])))
        size = alone - start[first:]
        if np.abs(size).max(initial=0.0) > DIFFERENCE_STEP:
            whole = np.concatenate([np.zeros(first), size])
            found = self._linear.expected(_stacked([self._change(model, start, whole)]), [np.ones(1)])
            share = 1.0 if chosen else float(np.clip(-found.step[0], 0.0, LARGEST_MULTIPLE))
            tries.append(Expected(found.gain, start + share * whole))
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
        found = model.residuals(start + step, self._data)
        own = self._fit.residuals
        return Residuals(np.nan_to_num(found.impacts - own.impacts), found.flights - own.flights)


def _scaled(change: Residuals, factor: float) -> Residuals:
    return Residuals(factor * change.impacts, factor * change.flights)


def _stacked(changes: list[Residuals]) -> Residuals:
    """Columns along a last axis."""
    return Residuals(
        np.stack([c.impacts for c in changes], axis=-1), np.stack([c.flights for c in changes], axis=-1)
    )
