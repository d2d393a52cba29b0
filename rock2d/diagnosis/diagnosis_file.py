"""diagnosis.json as a prediction reads it: checked for what a prediction needs."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from rock2d.diagnosis.learnt_prediction import read_changes
from rock2d.diagnosis.levers import FLIGHT, LEVER_SIZES
from rock2d.diagnosis.model import BASE_NAMES
from rock2d.diagnosis.quantities import FLIGHT_QUANTITIES, IMPACT_QUANTITIES
from rock2d.effects import catalogue
from rock2d.errors import InputError
from rock2d.files.checked_yaml import in_words, key_shown
from rock2d.files.text_files import read_json

OLD_LAW_KEYS = {"rolling_in_crater": "rolling_in_indentation"}


class _Part(BaseModel):
    """Keys that a prediction needs; other keys are not its concern."""

    model_config = ConfigDict(strict=True, allow_inf_nan=False)


class _Base(_Part):
    k_l_N_m: float = Field(gt=0, le=1.0e15)
    k_ul_N_m: float = Field(gt=0, le=1.0e15)
    k_t_N_m: float = Field(gt=0, le=1.0e15)
    friction_angle_deg: float = Field(gt=0, lt=90)
    k_r_Nm_rad: float = Field(gt=0, le=1.0e15)


class _Value(_Part):
    value: float = Field(ge=-1.0e15, le=1.0e15)


class _Effect(_Part):
    base: _Base
    parameters: dict[str, _Value]


class _Fitted(_Part):
    base: _Base
    parameters: dict[str, dict[str, _Value]]


class _Curve(_Part):
    quantity: str
    kind: Literal["spline", "harmonics", "kinds", "line", "waves"]
    numbers: list[float] = Field(min_length=1)


class _Change(_Part):
    lever: Literal["law", "slope", "incident state", "outcome", "frame", "flight"]
    depends_on: str
    curves: list[_Curve]
    coefficients: list[list[float]] = Field(min_length=1)


class _Learnt(_Fitted):
    changes: list[_Change]


class _Model(_Fitted):
    learnt: _Learnt | None = None


class _Beside(_Fitted):
    effect: str


class _Law(_Part):
    rolling_in_indentation: bool = False


class _Diagnosis(_Part):
    schema_: Literal[1, 2] = Field(alias="schema")
    base: _Base
    verdict: str
    effects: dict[str, _Effect] = {}
    beside: list[_Beside] = []
    model: _Model | None = None
    law: _Law = _Law()
    series: dict[str, int] = {}


def read_model(path: str | Path) -> dict[str, Any]:
    """Content of diagnosis.json, checked for what a prediction needs.

    Raises InputError if it cannot be used; warns if it has keys with old names.
    """
    path = Path(path)
    content = read_json(path)
    if not isinstance(content, dict) or content.get("schema") not in (1, 2):
        raise InputError('expected a diagnosis with "schema": 1 or 2', path, code="wrong_kind")
    if content.get("base") == {}:
        message = f"expected base parameters {', '.join(BASE_NAMES)}; this diagnosis has none to predict with"
        raise InputError(message, path, code="missing_key", key="base")
    content = _with_current_keys(content, path)
    try:
        checked = _Diagnosis.model_validate(content)
    except ValidationError as error:
        raise first_mistake(error, path) from None
    _check_effects(checked, path)
    return content


def _check_effects(checked: _Diagnosis, path: Path) -> None:
    """Refuse effects that act and lack parameters."""
    known = catalogue()
    if checked.verdict not in (*known, "none", "unknown"):
        message = f"verdict: expected none, unknown or an effect, found {key_shown(checked.verdict)}"
        raise InputError(message, path, code="unknown_name", name=checked.verdict)
    model = checked.model
    given = {"model": model.parameters if model else {}}
    if model and model.learnt:
        given["model.learnt"] = model.learnt.parameters
        _check_changes(model.learnt.changes, path)
    if checked.verdict in known:
        if checked.verdict not in checked.effects:
            message = f"effects: the effect of the verdict, {checked.verdict}, is missing"
            raise InputError(message, path, code="missing_key", key=checked.verdict)
        given["effects"] = {checked.verdict: checked.effects[checked.verdict].parameters}
        given["beside"] = checked.beside[-1].parameters if checked.beside else {}
    for key, effects in given.items():
        for name, parameters in effects.items():
            if name not in known:
                message = f"{key}: no effect {key_shown(name)} in the catalogue"
                raise InputError(message, path, code="unknown_name", name=name)
            for parameter in known[name].parameters:
                if parameter.name not in parameters and not parameter.implied:
                    message = f"{name}: missing parameter {parameter.name!r}"
                    raise InputError(message, path, code="missing_key", key=parameter.name)


def _check_changes(changes: Sequence[_Change], path: Path) -> None:
    """Refuse learnt changes whose coefficients do not fit their curves, or whose quantities do not exist."""
    for i, change in enumerate(changes):
        where = f"model.learnt.changes.{i}"
        given = read_changes([change.model_dump()])[0]
        names = FLIGHT_QUANTITIES if change.lever == FLIGHT else IMPACT_QUANTITIES
        for curve in change.curves:
            if curve.quantity not in names:
                message = f"{where}: no quantity {key_shown(curve.quantity)}"
                raise InputError(message, path, code="unknown_name", name=curve.quantity)
        try:
            functions = given.basis.features(
                {c.quantity: np.zeros(1) for c in change.curves} or {"": np.zeros(1)}
            )
        except ValueError:
            raise InputError(f"{where}: breakpoints of a spline must rise", path) from None
        widths = {len(row) for row in change.coefficients}
        if widths != {functions.shape[1]} or len(change.coefficients) not in LEVER_SIZES[change.lever]:
            raise InputError(f"{where}: coefficients do not fit the curves", path)


def first_mistake(error: ValidationError, path: Path) -> InputError:
    """The first thing that is wrong in a JSON file, with its place in the object."""
    item = error.errors(include_url=False)[0]
    where = ".".join(map(key_shown, item["loc"]))
    if item["type"] == "missing":
        return InputError(f"missing key {where!r}", path, code="missing_key", key=item["loc"][-1])
    said = in_words(item["type"], item["msg"], item.get("ctx", {}), item["input"])
    return InputError(f"{where}: {said}", path)


def _with_current_keys(content: dict[str, Any], path: Path) -> dict[str, Any]:
    """The content with the current name of each key that had another one."""
    law = content.get("law", {})
    for old, key in OLD_LAW_KEYS.items():
        if isinstance(law, dict) and old in law:
            warnings.warn(f"{path}: law.{old} is an old name of law.{key}", stacklevel=3)
            law = {key: law[old]} | {name: value for name, value in law.items() if name != old}
    return {**content, "law": law}
