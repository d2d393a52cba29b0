"""diagnosis.json as a scenario reads it, and which of its answers the scenario uses.

- one effect (and those found beside it): it acts, on the soil that was fitted together with it
- none or unknown: the refitted soil alone; of what acts nothing is known
- a group that the data cannot tell apart: each of its effects is an alternative with its probability; releases outside
  of an assessment meet the refitted soil alone
- causes that are more likely than not (schema 2): all of them, on the soil that was fitted together with them
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from rock2d.files.checked_yaml import shown
from rock2d.files.diagnosed_model import DiagnosedModel, FittedModel, FittedValue, Scale
from rock2d.files.diagnosis import NOT_EFFECTS, read_model
from rock2d.files.diagnosis_keys import DiagnosisFile
from rock2d.files.fitted_keys import FittedLaw, FittedParameter
from rock2d.files.folders import OutsideFolderError, path_inside

if TYPE_CHECKING:
    from rock2d.effects.effect import Parameter
    from rock2d.files.scenario import Scenario

LEAST_INCLUSION = 0.5  # inclusion probability from which on a cause acts (schema 2)


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
        if _is_there(file):
            return used_diagnosis(given, file)
    message = f"no file {shown(given)} beside the scenario or under the data root"
    raise scenario.error(message, *where, code="missing_file", name=given)


def _is_there(file: Path) -> bool:
    try:
        return file.exists()
    except OSError:  # a name that no file can have
        return False


def used_diagnosis(given: str, file: Path) -> DiagnosedModel:
    """The models of a diagnosis. Raises InputError with file, line and column of the first mistake."""
    _, keys = read_model(file)
    assert keys.fitted_law is not None
    read = _Reader(keys)
    soil = read.soil(keys.fitted_law)
    before = FittedModel("before", soil, {})
    alternatives = read.alternatives(soil)
    plain = before._replace(name="after")
    return DiagnosedModel(
        given, file, hashlib.sha256(file.read_bytes()).hexdigest(), keys.schema_, keys.experiment, keys.verdict,
        before, alternatives, alternatives[0] if len(alternatives) == 1 else plain,
        {name: Scale(own.mass_kg, own.size_m) for name, own in keys.blocks.items()}, _learnt(keys),
    )  # fmt: skip


def _learnt(keys: DiagnosisFile) -> str:
    """The learnt changes in words."""
    own = keys.outside.learnt if keys.outside is not None else None
    if own is None:
        return ""
    changes = ", ".join(own.changes) or "changes without a name"
    return f"{changes} (closes {100 * own.closes:.0f} % of the gap in the film)"


class _Reader:
    """Models from the keys of a diagnosis."""

    def __init__(self, keys: DiagnosisFile) -> None:
        self.keys = keys

    def alternatives(self, soil: Mapping[str, Any]) -> tuple[FittedModel, ...]:
        """The models that the verdict leaves: one for each effect of a group, else one."""
        keys = self.keys
        if any(own.p >= LEAST_INCLUSION for own in keys.causes):
            return (self._causes(soil),)
        if keys.verdict in NOT_EFFECTS:
            return (FittedModel("after", soil, {}),)
        if len(keys.group) > 1:
            members = [self._alone(name, soil, f"after, {name}") for name in keys.group]
            total = sum(keys.probabilities.get(name, 0.0) for name in keys.group)
            even = 1.0 / len(members)
            return tuple(
                own._replace(p=keys.probabilities.get(name, 0.0) / total if total > 0.0 else even)
                for name, own in zip(keys.group, members, strict=True)
            )
        if keys.beside:
            last = keys.beside[-1]
            effects = {name: self._values(name, own) for name, own in last.parameters.items()}
            return (FittedModel("after", self.soil(last.base), effects),)
        return (self._alone(keys.verdict, soil, "after"),)

    def _alone(self, name: str, soil: Mapping[str, Any], called: str) -> FittedModel:
        """An effect that was fitted alone, with the soil that was fitted together with it."""
        own = self.keys.effects[name]
        base = self.soil(own.base) if own.base else soil
        return FittedModel(called, base, {name: self._values(name, own.parameters)})

    def _causes(self, soil: Mapping[str, Any]) -> FittedModel:
        """All causes that are more likely than not (schema 2), on the soil that was fitted together with them."""
        effects = {
            own.effect: self._values(own.effect, own.parameters)
            for own in self.keys.causes
            if own.p >= LEAST_INCLUSION
        }
        joint = [
            fit for fit in (self.keys.model, *self.keys.beside) if fit and set(fit.parameters) == set(effects)
        ]
        alone = self.keys.effects.get(next(iter(effects))) if len(effects) == 1 else None
        base = joint[0].base if joint else alone.base if alone else None
        return FittedModel("after", self.soil(base) if base else soil, effects)

    def soil(self, law: FittedLaw) -> dict[str, float | bool]:
        return {**law.model_dump(), "rolling_in_indentation": self.keys.law.rolling_in_indentation}

    def _values(self, effect: str, given: Mapping[str, FittedParameter]) -> dict[str, FittedValue]:
        from rock2d.effects import catalogue

        out = {}
        for parameter in catalogue()[effect].parameters:
            own = given.get(parameter.name)
            value = own.value if own else parameter.neutral  # one that may be missing
            low, high = own.ci95 if own else (value, value)
            out[parameter.name] = FittedValue(value, low, high, *self._bounds(parameter, value))
        return out

    def _bounds(self, parameter: Parameter, value: float) -> tuple[float, float]:
        """The effect's plausible range at the scale of the experiment; where that is not known, its sign only."""
        scaled = bool(parameter.length or parameter.time)
        if scaled and (not self.keys.blocks or self.keys.gravity_m_s2 is None):
            low, high = (
                0.0 if bound == 0.0 else np.copysign(np.inf, bound)
                for bound in (parameter.low, parameter.high)
            )
        else:
            sizes = [own.size_m for own in self.keys.blocks.values()]
            own = parameter.at(_mean(sizes), self.keys.gravity_m_s2 or 0.0) if scaled else parameter
            low, high = own.low, own.high
        return min(float(low), value), max(float(high), value)


def _mean(values: Sequence[float]) -> float:
    return float(np.mean(values))
