"""Write and read diagnosis.json. Its keys stand in `diagnosis_keys`."""

import json
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from rock2d.files.checked_yaml import Document, JsonDocument, did_you_mean, shown
from rock2d.files.diagnosis_keys import DiagnosisFile
from rock2d.files.fitted_keys import FittedParameter
from rock2d.files.places import DataPath

DIAGNOSIS = "diagnosis.json"
NOT_EFFECTS = ("none", "unknown")
KNOWN_SCHEMAS = (1, 2, 3)  # all their keys are known; unknown keys of a later schema are ignored
IDENTIFYING_KEYS = {"schema", "verdict", "probabilities"}


def diagnosis_text(content: Mapping[str, Any]) -> str:
    """The text of diagnosis.json.

    Raises ValueError for content that the readers of the file would refuse, or that its schema does not describe."""
    text = json.dumps(content, indent=1, allow_nan=False) + "\n"
    if DiagnosisFile.model_validate_json(text).content() != json.loads(text):
        raise ValueError("diagnosis.json: a key that its schema does not describe")
    return text


def is_diagnosis(content: Any) -> bool:
    """Whether the content of a JSON file is that of a diagnosis."""
    return isinstance(content, dict) and content.keys() >= IDENTIFYING_KEYS


def read_diagnosis(file: str | Path) -> tuple[Document, DiagnosisFile]:
    """Read a diagnosis of any schema; raises `InputError` with file, line and column of the first mistake."""
    document = JsonDocument(file)
    if not is_diagnosis(document.data):
        message = "expected a diagnosis.json: an object with schema, verdict and probabilities"
        raise document.error(message, code="wrong_kind")
    return document, document.check(DiagnosisFile)


def read_fitted_diagnosis(file: str | Path) -> tuple[Document, DiagnosisFile]:
    """Read a diagnosis that a simulation can use: it has a fitted law, and all its effects are in the catalogue.

    Raises `InputError` with file, line and column of the first mistake."""
    document, read = read_diagnosis(file)
    if read.schema_ not in KNOWN_SCHEMAS:
        message = f"expected a diagnosis of schema 1 to {KNOWN_SCHEMAS[-1]}, found {read.schema_}"
        raise document.error(message, "schema", code="wrong_kind")
    if read.fitted_law is None:
        raise document.error(no_fitted_law(read.sanity.faults), "base", code="missing_key", key="base")
    _check_effects(document, read)
    return document, read


def no_fitted_law(faults: Sequence[str]) -> str:
    """Message: a diagnosis without a fitted law cannot be simulated, because its experiment has these faults."""
    return f"this diagnosis has no fitted law: {'; '.join(faults) or 'its experiment was not diagnosed'}"


def _check_effects(document: Document, read: DiagnosisFile) -> None:
    """Refuse effects that are not in the catalogue or lack parameters."""
    from rock2d.effects import catalogue

    known = catalogue()

    def check_known(name: str, place: DataPath, at: str = "value") -> None:
        if name not in known:
            message = f"no effect {shown(name)} in the catalogue{did_you_mean(name, known)}"
            raise document.error(message, *place, at=at, code="unknown_name", name=name)

    for name, place in _named_effects(read):
        check_known(name, place)
        if place[0] in ("verdict", "group") and name not in read.effects:
            message = f"the effect {name} of the verdict is missing"
            raise document.error(message, "effects", at="key", code="missing_key", key=name)
    for name, parameters, place in _fitted_effects(read):
        check_known(name, place, at="key")
        for parameter in known[name].parameters:
            if parameter.name not in parameters and not parameter.may_be_missing:
                message = f"{name}: missing parameter {parameter.name!r}"
                raise document.error(message, *place, at="key", code="missing_key", key=parameter.name)


def _named_effects(read: DiagnosisFile) -> Iterator[tuple[str, DataPath]]:
    """Effects that the verdict, the group or the causes name, and their paths in the file."""
    if read.verdict not in NOT_EFFECTS:
        yield read.verdict, ("verdict",)
    for i, name in enumerate(read.group):
        yield name, ("group", i)
    for i, cause in enumerate(read.causes):
        yield cause.effect, ("causes", i, "effect")


def _fitted_effects(read: DiagnosisFile) -> Iterator[tuple[str, Mapping[str, FittedParameter], DataPath]]:
    """Fitted effects with their parameters, and their paths in the file."""
    for name in dict.fromkeys([*([] if read.verdict in NOT_EFFECTS else [read.verdict]), *read.group]):
        yield name, read.effects[name].parameters, ("effects", name, "parameters")
    for i, cause in enumerate(read.causes):
        yield cause.effect, cause.parameters, ("causes", i, "parameters")
    fits: list[tuple[Any, DataPath]] = [(fit, ("beside", i)) for i, fit in enumerate(read.beside)]
    if read.model is not None:
        fits.append((read.model, ("model",)))
        if read.model.learnt is not None:
            fits.append((read.model.learnt, ("model", "learnt")))
    for fit, place in fits:
        for name, parameters in fit.parameters.items():
            yield name, parameters, (*place, "parameters", name)
