"""The files of a reproduction that hold its numbers: tables, paper_setup.yaml and reproduction.json."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import TYPE_CHECKING

from rock2d.reproduction.results import Results
from rock2d.reproduction.scenario_file import SCENARIO_FILE, scenario_text
from rock2d.reproduction.tables import result_tables

if TYPE_CHECKING:
    import pandas as pd


def write_results(results: Results, folder: Path) -> dict[str, pd.DataFrame]:
    """Write tables (CSV), the scenario paper_setup.yaml and reproduction.json into `folder`; returns the tables."""
    tables = result_tables(results)
    for name, table in tables.items():
        table.to_csv(folder / f"{name}.csv", index=False, float_format="%.6g", lineterminator="\n")
    text = scenario_text(results.known, results.arrivals.values, results.arrivals.found, results.seed)
    (folder / SCENARIO_FILE).write_text(text, encoding="utf-8")
    content = {
        "seed": results.seed,
        "rmse_points": {name: None if math.isnan(value) else value for name, value in results.errors.items()},
        "log_evidence": {model: sample.log_evidence for model, sample in results.samples.items()},
        "conclusions": results.conclusions,
    }
    (folder / "reproduction.json").write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8")
    return tables
