"""The contact law that a scenario takes from a diagnosis: the fitted soil and the effects that were found.

`rock2d.files.diagnosis_reading` chooses what a scenario uses of a diagnosis.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from rock2d.files.scenario_keys import ContactKeys

Array = np.ndarray

PLACE = "diagnosis"  # first key of the places of values that a diagnosis leaves uncertain
CAUSE = f"{PLACE}.cause"
Z95 = 1.959963984540054  # standard normal quantile of 0.975


@dataclass(frozen=True)
class FittedValue:
    """A fitted value, its 95 % interval, and the bounds of the parameter."""

    value: float
    low95: float
    high95: float
    lowest: float = -np.inf
    highest: float = np.inf

    @property
    def known(self) -> bool:
        """Whether the value has no uncertainty: its interval has no width."""
        return self.low95 == self.high95

    def quantiles(self, u: Array | float) -> Array:
        """Quantiles `u` in (0, 1) of a distribution with this median and this 95 % interval, truncated at the bounds.

        The distribution is lognormal if the value lies nearer to the geometric than to the arithmetic mean of a
        positive interval. Otherwise it is normal. If the interval is not symmetric, each side has its own standard
        deviation (split normal distribution).
        """
        from scipy import stats

        if self.known:
            return np.full(np.shape(u), self.value)
        first, last = (self._probability_below(bound) for bound in (self.lowest, self.highest))
        z: Array = np.asarray(stats.norm.ppf(first + (last - first) * np.asarray(u, float)))
        if self._lognormal:
            below, above = float(np.log(self.value / self.low95)), float(np.log(self.high95 / self.value))
            values = self.value * np.exp(_split_normal(z, below, above))
        else:
            values = self.value + _split_normal(z, self.value - self.low95, self.high95 - self.value)
        return np.asarray(np.clip(values, self.lowest, self.highest))

    @property
    def _lognormal(self) -> bool:
        if self.low95 <= 0.0:
            return False
        geometric, arithmetic = np.sqrt(self.low95 * self.high95), 0.5 * (self.low95 + self.high95)
        return bool(abs(self.value - geometric) < abs(self.value - arithmetic))

    def _probability_below(self, bound: float) -> float:
        """Probability of a value below a bound, before truncation."""
        from scipy import stats

        if not np.isfinite(bound):
            return 0.0 if bound < 0 else 1.0
        if self._lognormal:
            if bound <= 0.0:
                return 0.0
            distance, low, high = (np.log(x / self.value) for x in (bound, self.low95, self.high95))
        else:
            distance, low, high = (x - self.value for x in (bound, self.low95, self.high95))
        side = -low if distance < 0 else high
        if side <= 0.0:
            return 0.5
        return float(stats.norm.cdf(Z95 * distance / side))


def _split_normal(z: Array, below: float, above: float) -> Array:
    """Distances from the median at standard normal quantiles z; 95 % lie between -`below` and `above`."""
    return (below * np.minimum(z, 0.0) + above * np.maximum(z, 0.0)) / Z95


class FittedModel(NamedTuple):
    """The contact law of a diagnosis.

    Attributes
    ----------
    name : name in tables
    soil : parameters of the contact law, as a scenario gives them
    effects : effect -> parameter -> value; empty for the paper's law
    p : its probability among the alternatives
    """

    name: str
    soil: ContactKeys
    effects: Mapping[str, Mapping[str, FittedValue]]
    p: float = 1.0

    def values(self, effect: str) -> tuple[float, ...]:
        """Values of an effect's parameters in the order of the catalogue."""
        from rock2d.effects import catalogue

        return tuple(self.effects[effect][q.name].value for q in catalogue()[effect].parameters)


class Scale(NamedTuple):
    """Mass and size of a block of the experiment."""

    mass_kg: float
    size_m: float


@dataclass(frozen=True)
class DiagnosedModel:
    """A diagnosis as a scenario uses it.

    Attributes
    ----------
    given : path as the scenario gives it
    file : path of the diagnosis
    fingerprint : SHA-256 of the file
    schema : version of its format
    experiment, verdict : as the file gives them
    before : the paper's law, refitted
    alternatives : one model for each effect of a group that the data cannot tell apart; else a single one
    model : the model that a run uses
    blocks : blocks of the experiment; empty if the file does not name them
    learnt : the learnt changes in words, with the share of the gap that they close; empty if there are none
    """

    given: str
    file: Path
    fingerprint: str
    schema: int
    experiment: str
    verdict: str
    before: FittedModel
    alternatives: tuple[FittedModel, ...]
    model: FittedModel
    blocks: Mapping[str, Scale] = field(default_factory=dict)
    learnt: str = ""

    @property
    def left_out(self) -> str:
        """Note for every table of a run: the run leaves out the learnt changes. Empty if there are none."""
        return f"without the learnt changes of {self.given}" if self.learnt else ""

    @property
    def undecided(self) -> bool:
        """Whether the data cannot tell which effect acts."""
        return len(self.alternatives) > 1

    def using(self, model: FittedModel) -> DiagnosedModel:
        """The diagnosis with `model` as the model that a run uses."""
        return replace(self, model=model)

    def unknown(self) -> dict[str, FittedValue | CauseDraw]:
        """Place -> distribution, of every uncertain value that influences the motion of a block."""
        from rock2d.effects import catalogue

        out: dict[str, FittedValue | CauseDraw] = {}
        if self.undecided:
            out[CAUSE] = CauseDraw(tuple(model.p for model in self.alternatives))
        for model in self.alternatives:
            for effect, values in model.effects.items():
                if not catalogue()[effect].camera:
                    out |= {f"{PLACE}.{effect}.{name}": v for name, v in values.items() if not v.known}
        return out

    def with_values(self, values: Mapping[str, float]) -> DiagnosedModel:
        """The diagnosis with other numbers at places of `unknown`; KeyError if there is no such place."""
        for place in values:
            if place not in self.unknown():
                raise KeyError(place)
        model = self.model
        if CAUSE in values:
            model = self.alternatives[int(values[CAUSE])]
        effects = {
            effect: {
                name: replace(own, value=values.get(f"{PLACE}.{effect}.{name}", own.value))
                for name, own in parameters.items()
            }
            for effect, parameters in model.effects.items()
        }
        return self.using(model._replace(effects=effects))


class CauseDraw(NamedTuple):
    """Random choice of the alternative that acts, with these probabilities."""

    p: tuple[float, ...]

    def quantiles(self, u: Array | float) -> Array:
        """Indices of alternatives, as floats, at quantiles `u` in (0, 1)."""
        edges = np.cumsum(self.p) / np.sum(self.p)
        return np.minimum(np.searchsorted(edges, u, side="right"), len(self.p) - 1).astype(float)
