"""JSON Schemas of the files that rock2d reads and writes, by the name of their kind."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any


def _scenario() -> dict[str, Any]:
    from rock2d.files.scenario import scenario_json_schema

    return scenario_json_schema()


def _experiment() -> dict[str, Any]:
    from rock2d.files.experiment import experiment_json_schema

    return experiment_json_schema()


def _setup() -> dict[str, Any]:
    from rock2d_tracking.setup_file import setup_json_schema

    return setup_json_schema()


def _diagnosis() -> dict[str, Any]:
    from rock2d.files.diagnosis_keys import diagnosis_json_schema

    return diagnosis_json_schema()


SCHEMAS: dict[str, Callable[[], dict[str, Any]]] = {
    "scenario": _scenario,
    "experiment": _experiment,
    "setup": _setup,
    "diagnosis": _diagnosis,
}


def file_schema(kind: str) -> dict[str, Any]:
    """The JSON Schema (draft 2020-12) of a kind of file.

    Parameters
    ----------
    kind : one of `SCHEMAS`: "scenario" (scenario YAML), "experiment" (`experiment.yaml`), "setup" (`setup.yaml`) or
        "diagnosis" (`diagnosis.json`)

    Raises
    ------
    KeyError
        For any other kind.
    """
    return SCHEMAS[kind]()
