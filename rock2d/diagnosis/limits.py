"""The limits of a study of known causes (`rock2d blind inject`), read."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from pydantic import TypeAdapter, ValidationError

from rock2d.effects import catalogue
from rock2d.errors import InputError
from rock2d.files.diagnosis_keys import Limit
from rock2d.files.text_files import read_json

LIMITS, TRUTH = "limits.json", "truth.json"  # files in the folder of a study
EXPECTED = (
    "The limits of the effects are what a linear model expects; no film with a known cause was diagnosed for them "
    "(see `rock2d blind inject`)."
)


def read_limits(folder: Path, experiment: str) -> dict[str, dict[str, Any]]:
    """Effect -> limit, of the study in a folder. Raises InputError if it holds none, or one of another experiment."""
    truth = read_json(folder / TRUTH)
    try:
        found = TypeAdapter(dict[str, Limit]).validate_python(read_json(folder / LIMITS))
    except ValidationError:
        raise InputError("these are no limits", folder / LIMITS, code="not_a_result") from None
    known = found.keys() <= catalogue().keys()
    if not known or not isinstance(truth, dict) or truth.get("experiment") != experiment:
        raise InputError(f"expected limits of {experiment}", folder, code="not_a_result")
    return {name: limit.model_dump() for name, limit in found.items()}
