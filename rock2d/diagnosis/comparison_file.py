"""diagnosis.json as a comparison reads it: checked for what is compared; other keys are ignored."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from rock2d.diagnosis.diagnosis_file import first_mistake
from rock2d.errors import InputError
from rock2d.files.checked_yaml import key_shown
from rock2d.files.text_files import read_json

DIAGNOSIS = "diagnosis.json"
KNOWN_SCHEMAS = (1, 2)  # whose keys are known; a later one is read for the keys of these

Number = Annotated[float, Field(ge=-1.0e300, le=1.0e300)]
Share = Annotated[float, Field(ge=0, le=1)]
Interval = Annotated[list[Number], Field(min_length=2, max_length=2)]


class _Part(BaseModel):
    model_config = ConfigDict(strict=True, allow_inf_nan=False, frozen=True)


class FittedValue(_Part):
    """A fitted parameter with its 95 % interval."""

    value: Number
    ci95: Interval
    unit: str


class TriedEffect(_Part):
    """An effect that was tried."""

    parameters: dict[str, FittedValue]
    closure: Number
    closure_ci95: Interval


class Place(_Part):
    """A share of the gap."""

    phase: str
    zone: str
    block: str
    channel: str
    share: Share


class GapNumbers(_Part):
    """The gap; None where nothing could be tried."""

    unit: str
    base: Number | None
    augmented: Number | None
    noise_floor: Number | None
    closure: Number | None
    closure_ci95: Interval | None


class SanityFindings(_Part):
    """Why an experiment could not be diagnosed."""

    faults: list[str] = []


class FoundBeside(_Part):
    """An effect beside the verdict."""

    effect: str


class DiagnosisFile(_Part):
    """What is compared of a diagnosis.json."""

    schema_: int = Field(alias="schema", ge=1)
    experiment: str
    base: dict[str, Number]
    verdict: str
    group: list[str]
    probabilities: dict[str, Share]
    effects: dict[str, TriedEffect]
    where: list[Place]
    gap: GapNumbers
    next_release: str = ""
    beside: list[FoundBeside] = []
    sanity: SanityFindings = SanityFindings()


def read_diagnosis(path: str | Path) -> tuple[Path, DiagnosisFile]:
    """The file that `path` names, itself or as the folder of a diagnosis, and its content.

    Raises `InputError` with the file if it cannot be compared.
    """
    path = Path(path)
    if path.is_dir():
        path = path / DIAGNOSIS
    content = read_json(path)
    if not isinstance(content, dict) or not {"schema", "verdict", "probabilities"} <= content.keys():
        message = "expected a diagnosis.json: an object with schema, verdict and probabilities"
        raise InputError(message, path, code="wrong_kind")
    try:
        read = DiagnosisFile.model_validate(content)
    except ValidationError as error:
        raise first_mistake(error, path) from None
    if read.verdict not in read.probabilities:
        message = f"probabilities: that of the verdict, {key_shown(read.verdict)}, is missing"
        raise InputError(message, path, code="missing_key", key=read.verdict)
    return path, read
