"""JSON Schemas of the files that rock2d reads and writes, by the name of their kind."""

from importlib import import_module
from typing import Any

# kind -> module and class that describe the keys, title
SCHEMAS = {
    "scenario": ("rock2d.files.scenario", "Scenario", "rock2d scenario"),
    "experiment": ("rock2d.files.experiment", "ExperimentKeys", "rock2d experiment"),
    "setup": ("rock2d_tracking.setup_file", "SetupKeys", "rock2d set-up file"),
    "diagnosis": ("rock2d.files.diagnosis_keys", "DiagnosisFile", "rock2d diagnosis"),
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
        For any other kind."""
    module, model, title = SCHEMAS[kind]
    keys = getattr(import_module(module), model).model_json_schema()
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", **keys, "title": title}
