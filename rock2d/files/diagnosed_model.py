"""The contact law that a scenario takes from a diagnosis: the fitted soil and the effects that were found.

- the file has a joint model of the named causes: all of these act, with the soil of the joint fit, as in predictions. A
  single one that is less likely than not, and shares its name with others, is an alternative as below
- a file without a joint model: all causes act that are more likely than not
- else the verdict decides. One effect: this effect and those found beside it act. None or unknown: the refitted soil
  alone. A group that the data cannot tell apart: each effect of the group is an alternative with its probability;
  outside an assessment, releases use the refitted soil alone"""

from __future__ import annotations

import hashlib
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from rock2d.arrays import Array
from rock2d.files.diagnosis import NOT_EFFECTS, read_fitted_diagnosis
from rock2d.files.diagnosis_keys import BlockScale, DiagnosisFile
from rock2d.files.fitted_keys import FittedLaw, FittedParameter, JointFit
from rock2d.files.scenario_keys import ContactKeys

if TYPE_CHECKING:
    from rock2d.effects.effect import Parameter

DIAGNOSIS_PLACE = "diagnosis"  # first key of the places of values that a diagnosis leaves uncertain
CAUSE = f"{DIAGNOSIS_PLACE}.cause"
LEAST_INCLUSION = 0.5  # inclusion probability of a cause that acts in a file without a joint model
NOT_FITTED = "the paper's soil, scaled to the blocks of the film and not fitted, as no impact was judged"
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
        deviation (split normal distribution)."""
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
    effects : effect -> parameter, or parameter.block where a block has its own -> value; empty for the base law
    p : its probability among the alternatives"""

    name: str
    soil: ContactKeys
    effects: Mapping[str, Mapping[str, FittedValue]]
    p: float = 1.0

    def values(self, effect: str, block: str = "") -> tuple[float, ...]:
        """Values of an effect's parameters in the order of the catalogue; a block's own, where it has its own."""
        from rock2d.effects import catalogue

        known = self.effects[effect]
        return tuple(known.get(f"{q.name}.{block}", known[q.name]).value for q in catalogue()[effect].parameters)


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
    before : the base law
    alternatives : one model for each effect of a group that the data cannot tell apart; else a single one
    model : the model that a run uses
    blocks : blocks of the experiment; empty if the file does not name them
    learnt : the learnt changes in words, with the share of the gap that they close; empty if there are none
    unused : possible causes that no model has, in words
    fitted : whether impacts determined the law; else it is the paper's, scaled to the blocks"""

    given: str
    file: Path
    fingerprint: str
    schema: int
    experiment: str
    verdict: str
    before: FittedModel
    alternatives: tuple[FittedModel, ...]
    model: FittedModel
    blocks: Mapping[str, BlockScale] = field(default_factory=dict)
    learnt: str = ""
    unused: tuple[str, ...] = ()
    fitted: bool = True

    @property
    def note(self) -> str:
        """Note for every table of a run: it leaves out the learnt changes, its law was not fitted. May be empty."""
        learnt = f"without the learnt changes of {self.given}" if self.learnt else ""
        soil = "" if self.fitted else f"with the unfitted soil of {self.given} where the scenario states none"
        return "; ".join(part for part in (learnt, soil) if part)

    @property
    def soil_in_words(self) -> str:
        """Where the soil comes from."""
        return "the refitted soil" if self.fitted else NOT_FITTED

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
                    out |= {f"{DIAGNOSIS_PLACE}.{effect}.{name}": v for name, v in values.items() if not v.known}
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
                name: replace(own, value=values.get(f"{DIAGNOSIS_PLACE}.{effect}.{name}", own.value))
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


def diagnosed_model(given: str, file: Path, blocks: Collection[str]) -> DiagnosedModel:
    """The models of a diagnosis for blocks of these names. Raises InputError with file, line and column of the first
    mistake."""
    _, keys = read_fitted_diagnosis(file)
    assert keys.fitted_law is not None
    read = _Reader(keys, blocks)
    soil = read.soil(keys.fitted_law)
    before = FittedModel("before", soil, {})
    alternatives = read.alternatives(soil)
    without_effects = before._replace(name="after")
    return DiagnosedModel(
        given, file, hashlib.sha256(file.read_bytes()).hexdigest(), keys.schema_, keys.experiment, keys.verdict,
        before, alternatives, alternatives[0] if len(alternatives) == 1 else without_effects,
        keys.blocks, _learnt_in_words(keys), _unused_in_words(keys, alternatives), keys.law.fitted,
    )  # fmt: skip


def _learnt_in_words(keys: DiagnosisFile) -> str:
    learnt = keys.outside.learnt if keys.outside is not None else None
    if learnt is None:
        return ""
    changes = ", ".join(learnt.changes) or "changes without a name"
    return f"{changes} (closes {100 * learnt.closes:.0f} % of the gap in the film)"


def _unused_in_words(keys: DiagnosisFile, alternatives: Sequence[FittedModel]) -> tuple[str, ...]:
    """Causes that no model has, with their probabilities and what the data cannot tell them from."""
    used = {name for model in alternatives for name in model.effects}
    rivals = {other: cause.effect for cause in keys.causes if cause.effect in used for other in cause.group}
    words: dict[str, list[str]] = {cause.effect: [f"probability {cause.p:.2f}"] for cause in keys.causes}
    for name, other in rivals.items():
        words.setdefault(name, []).append(f"the data cannot tell it from {other}")
    return tuple(f"{name} ({', '.join(own)})" for name, own in words.items() if name not in used)


class _Reader:
    """Models from the keys of a diagnosis, for blocks of these names."""

    def __init__(self, keys: DiagnosisFile, blocks: Collection[str]) -> None:
        self.keys, self.blocks = keys, blocks

    def alternatives(self, soil: ContactKeys) -> tuple[FittedModel, ...]:
        """The models that are possible by the verdict: one for each effect of a group, else one."""
        keys = self.keys
        likely = any(cause.p >= LEAST_INCLUSION for cause in keys.causes)
        joint = keys.model
        if joint and joint.parameters and (likely or len(joint.parameters) > 1 or len(keys.group) < 2):
            return (self._joint(joint),)
        if likely:
            return (self._causes(soil),)
        if keys.verdict in NOT_EFFECTS:
            return (FittedModel("after", soil, {}),)
        if len(keys.group) > 1:
            models = [self._one_effect(name, soil, f"after, {name}") for name in keys.group]
            total = sum(keys.probabilities.get(name, 0.0) for name in keys.group)
            even = 1.0 / len(models)
            return tuple(
                model._replace(p=keys.probabilities.get(name, 0.0) / total if total > 0.0 else even)
                for name, model in zip(keys.group, models, strict=True)
            )
        if keys.beside:
            return (self._joint(keys.beside[-1]),)
        return (self._one_effect(keys.verdict, soil, "after"),)

    def _one_effect(self, name: str, soil: ContactKeys, model_name: str) -> FittedModel:
        """One effect with the soil that was fitted together with it."""
        effect = self.keys.effects[name]
        base = self.soil(effect.base) if effect.base else soil
        return FittedModel(model_name, base, {name: self._values(name, effect.parameters)})

    def _joint(self, fit: JointFit) -> FittedModel:
        """All effects of a joint fit with its soil, the most probable causes first."""
        names = [cause.effect for cause in self.keys.causes if cause.effect in fit.parameters]
        effects = {name: self._values(name, fit.parameters[name]) for name in dict.fromkeys([*names, *fit.parameters])}
        return FittedModel("after", self.soil(fit.base), effects)

    def _causes(self, soil: ContactKeys) -> FittedModel:
        """All causes that are more likely than not, with the soil that was fitted together with them."""
        effects = {
            cause.effect: self._values(cause.effect, cause.parameters)
            for cause in self.keys.causes
            if cause.p >= LEAST_INCLUSION
        }
        joint = [fit for fit in self.keys.beside if set(fit.parameters) == set(effects)]
        alone = self.keys.effects.get(next(iter(effects))) if len(effects) == 1 else None
        base = joint[0].base if joint else alone.base if alone else None
        return FittedModel("after", self.soil(base) if base else soil, effects)

    def soil(self, law: FittedLaw) -> ContactKeys:
        switch = self.keys.law.rolling_in_indentation
        return ContactKeys(**law.model_dump(), rolling_in_indentation=switch)

    def _values(self, effect: str, given: Mapping[str, FittedParameter]) -> dict[str, FittedValue]:
        from rock2d.effects import catalogue

        out = {}
        sizes_m = {name: block.size_m for name, block in self.keys.blocks.items()}
        mean_size_m = float(np.mean(list(sizes_m.values()))) if sizes_m else None
        for parameter in catalogue()[effect].parameters:
            fitted = given.get(parameter.name)
            value = fitted.value if fitted else parameter.neutral
            low, high = fitted.ci95 if fitted else (value, value)
            each = fitted.by_block or {} if fitted else {}
            own = {name: each[name] for name in self.blocks if name in each}
            if own and len(own) == len(self.blocks):
                low = high = value  # no block has the mean: it is not drawn
            out[parameter.name] = FittedValue(value, low, high, *self._bounds(parameter, value, mean_size_m))
            for name, q in own.items():
                low, high = q.ci95
                bounds = self._bounds(parameter, q.value, sizes_m.get(name))
                out[f"{parameter.name}.{name}"] = FittedValue(q.value, low, high, *bounds)
        return out

    def _bounds(self, parameter: Parameter, value: float, size_m: float | None) -> tuple[float, float]:
        """The plausible range of a parameter for blocks of this size; its sign only, if the scale is not known."""
        gravity = self.keys.gravity_m_s2
        if not (parameter.length or parameter.time):
            low, high = parameter.low, parameter.high
        elif size_m is None or gravity is None:
            low, high = (
                0.0 if bound == 0.0 else np.copysign(np.inf, bound) for bound in (parameter.low, parameter.high)
            )
        else:
            parameter = parameter.at(size_m, gravity)
            low, high = parameter.low, parameter.high
        return min(float(low), value), max(float(high), value)
