"""The models that a scenario takes from diagnosis.json.

- verdict is one effect: this effect and those found beside it act, with the soil that was fitted together with them
- verdict is none or unknown: the refitted soil alone
- verdict is a group that the data cannot tell apart: each effect of the group is an alternative with its probability;
  outside an assessment, releases use the refitted soil alone
- some causes are more likely than not (schema 2): all of these act, with the soil that was fitted together with them
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from rock2d.files.checked_yaml import shown
from rock2d.files.diagnosed_model import DiagnosedModel, FittedModel, FittedValue, Scale
from rock2d.files.diagnosis import NOT_EFFECTS, read_fitted_diagnosis
from rock2d.files.diagnosis_keys import DiagnosisFile
from rock2d.files.fitted_keys import FittedLaw, FittedParameter
from rock2d.files.folders import OutsideFolderError, path_inside
from rock2d.files.scenario_keys import ContactKeys

if TYPE_CHECKING:
    from rock2d.effects.effect import Parameter
    from rock2d.files.scenario import Scenario

LEAST_INCLUSION = 0.5  # inclusion probability of a cause that acts (schema 2)


def found_diagnosis(scenario: Scenario, given: str, data_root: str | Path | None) -> DiagnosedModel:
    """The diagnosis beside the scenario file, or under the data root.

    Raises InputError with the place in the scenario, or in the diagnosis.
    """
    assert scenario.document is not None
    where = ("model", "diagnosis")
    roots = [scenario.document.file.absolute().parent, *([Path(data_root)] if data_root else [])]
    for root in roots:
        try:
            file = path_inside(root, given)
        except OutsideFolderError as error:
            raise scenario.error(error.message, *where, code="outside_folder") from None
        if _exists(file):
            return _diagnosed_model(given, file)
    message = f"no file {shown(given)} beside the scenario or under the data root"
    raise scenario.error(message, *where, code="missing_file", name=given)


def _exists(file: Path) -> bool:
    try:
        return file.exists()
    except OSError:  # a name that no file can have
        return False


def _diagnosed_model(given: str, file: Path) -> DiagnosedModel:
    """The models of a diagnosis. Raises InputError with file, line and column of the first mistake."""
    _, keys = read_fitted_diagnosis(file)
    assert keys.fitted_law is not None
    read = _Reader(keys)
    soil = read.soil(keys.fitted_law)
    before = FittedModel("before", soil, {})
    alternatives = read.alternatives(soil)
    without_effects = before._replace(name="after")
    return DiagnosedModel(
        given, file, hashlib.sha256(file.read_bytes()).hexdigest(), keys.schema_, keys.experiment, keys.verdict,
        before, alternatives, alternatives[0] if len(alternatives) == 1 else without_effects,
        {name: Scale(block.mass_kg, block.size_m) for name, block in keys.blocks.items()}, _learnt_in_words(keys),
    )  # fmt: skip


def _learnt_in_words(keys: DiagnosisFile) -> str:
    learnt = keys.outside.learnt if keys.outside is not None else None
    if learnt is None:
        return ""
    changes = ", ".join(learnt.changes) or "changes without a name"
    return f"{changes} (closes {100 * learnt.closes:.0f} % of the gap in the film)"


class _Reader:
    """Models from the keys of a diagnosis."""

    def __init__(self, keys: DiagnosisFile) -> None:
        self.keys = keys

    def alternatives(self, soil: ContactKeys) -> tuple[FittedModel, ...]:
        """The models that are possible by the verdict: one for each effect of a group, else one."""
        keys = self.keys
        if any(cause.p >= LEAST_INCLUSION for cause in keys.causes):
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
            last = keys.beside[-1]
            effects = {name: self._values(name, parameters) for name, parameters in last.parameters.items()}
            return (FittedModel("after", self.soil(last.base), effects),)
        return (self._one_effect(keys.verdict, soil, "after"),)

    def _one_effect(self, name: str, soil: ContactKeys, model_name: str) -> FittedModel:
        """One effect with the soil that was fitted together with it."""
        effect = self.keys.effects[name]
        base = self.soil(effect.base) if effect.base else soil
        return FittedModel(model_name, base, {name: self._values(name, effect.parameters)})

    def _causes(self, soil: ContactKeys) -> FittedModel:
        """All causes that are more likely than not (schema 2), with the soil that was fitted together with them."""
        effects = {
            cause.effect: self._values(cause.effect, cause.parameters)
            for cause in self.keys.causes
            if cause.p >= LEAST_INCLUSION
        }
        joint = [
            fit for fit in (self.keys.model, *self.keys.beside) if fit and set(fit.parameters) == set(effects)
        ]
        alone = self.keys.effects.get(next(iter(effects))) if len(effects) == 1 else None
        base = joint[0].base if joint else alone.base if alone else None
        return FittedModel("after", self.soil(base) if base else soil, effects)

    def soil(self, law: FittedLaw) -> ContactKeys:
        switch = self.keys.law.rolling_in_indentation
        return ContactKeys(**law.model_dump(), rolling_in_indentation=switch)

    def _values(self, effect: str, given: Mapping[str, FittedParameter]) -> dict[str, FittedValue]:
        from rock2d.effects import catalogue

        out = {}
        for parameter in catalogue()[effect].parameters:
            fitted = given.get(parameter.name)
            value = fitted.value if fitted else parameter.neutral
            low, high = fitted.ci95 if fitted else (value, value)
            out[parameter.name] = FittedValue(value, low, high, *self._bounds(parameter, value))
        return out

    def _bounds(self, parameter: Parameter, value: float) -> tuple[float, float]:
        """The plausible range of a parameter at the scale of the experiment; its sign only, if that is not known."""
        scaled = bool(parameter.length or parameter.time)
        if scaled and (not self.keys.blocks or self.keys.gravity_m_s2 is None):
            low, high = (
                0.0 if bound == 0.0 else np.copysign(np.inf, bound)
                for bound in (parameter.low, parameter.high)
            )
        else:
            if scaled:
                mean_size_m = float(np.mean([block.size_m for block in self.keys.blocks.values()]))
                parameter = parameter.at(mean_size_m, self.keys.gravity_m_s2 or 0.0)
            low, high = parameter.low, parameter.high
        return min(float(low), value), max(float(high), value)
