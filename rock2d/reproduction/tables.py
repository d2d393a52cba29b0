"""The data files of a reproduction: tables (the paper's Tables 2 to 4, assumptions, candidate effects),
paper_setup.yaml and reproduction.json."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from rock2d.reproduction import published, summary
from rock2d.reproduction.hypotheses import (
    ARRIVAL_QUANTITIES,
    CONTACT_QUANTITIES,
    DETERMINISTIC_SPACE,
    PROBABILISTIC_SPACE,
    REBOUND_QUANTITIES,
    SETUP_QUANTITIES,
)
from rock2d.reproduction.paper_setup import SCENARIO_FILE, scenario_text
from rock2d.reproduction.results import SPACES, Results
from rock2d.reproduction.stages import SLOPE_REDUCTIONS_DEG

if TYPE_CHECKING:
    import pandas as pd


def write_results(results: Results, folder: Path) -> dict[str, pd.DataFrame]:
    """Write tables (CSV), the scenario paper_setup.yaml and reproduction.json into `folder`; returns the tables."""
    tables = result_tables(results)
    for name, table in tables.items():
        table.to_csv(folder / f"{name}.csv", index=False, float_format="%.6g", lineterminator="\n")
    text = scenario_text(results.arrivals.values, results.arrivals.found, results.seed)
    (folder / SCENARIO_FILE).write_text(text, encoding="utf-8")
    content = {
        "seed": results.seed,
        "rmse_points": {name: None if math.isnan(value) else value for name, value in results.errors.items()},
        "log_evidence": {model: sample.log_evidence for model, sample in results.samples.items()},
        "conclusions": results.conclusions,
    }
    (folder / "reproduction.json").write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8")
    return tables


def result_tables(results: Results) -> dict[str, pd.DataFrame]:
    """Tables by file name; "candidates" and "cells" exist if candidate effects were calibrated."""
    import pandas as pd

    assumptions = [
        summary.identified_table(SPACES[model], sample.u, (*SETUP_QUANTITIES, *ARRIVAL_QUANTITIES)).assign(
            model=model
        )
        for model, sample in results.samples.items()
    ]
    tables = {
        "table_2": results.passing,
        "table_3": probabilistic_parameters(results),
        "table_4": deterministic_parameters(results),
        "assumptions": pd.concat(assumptions, ignore_index=True),
        "paper_column": results.arrivals.paper_column,
        "predicted_with_arrivals": results.arrivals.passing,
        "missing_effects": results.arrivals.missing_effects,
        "table_3_readings": results.arrivals.table_3_readings,
    }
    if results.held_out:
        tables |= {"candidates": results.candidates, "cells": results.cells}
    return tables


def probabilistic_parameters(results: Results) -> pd.DataFrame:
    """Table 3: the paper's value and the posterior of each parameter of the probabilistic model."""
    import pandas as pd

    sample = results.samples["probabilistic"]
    found = summary.identified_table(PROBABILISTIC_SPACE, sample.u, REBOUND_QUANTITIES)
    found.insert(1, "paper", [published.REBOUND_PARAMETERS[name] for name in found["quantity"]])
    rows = []
    for block, reduction in results.slope_reduction_deg.items():
        if block == "sphere":
            continue
        low, middle, high = np.percentile(reduction, [2.5, 50.0, 97.5])
        spread = float(np.std(SLOPE_REDUCTIONS_DEG))
        rows.append(
            {
                "quantity": f"{block}.slope_reduction_deg", "paper": published.SLOPE_REDUCTION_DEG[block],
                "prior_low": SLOPE_REDUCTIONS_DEG[0], "prior_high": SLOPE_REDUCTIONS_DEG[-1], "low95": low,
                "median": middle, "high95": high, "sd_over_prior_sd": float(reduction.std() / spread),
                "prior": "from the block's own cells alone",
            }
        )  # fmt: skip
    return pd.concat([found, pd.DataFrame(rows)], ignore_index=True)


def deterministic_parameters(results: Results) -> pd.DataFrame:
    """Table 4: the paper's value and the posterior of each parameter of the contact law.

    k_ul is computed from k_l and the restitution.
    """
    import pandas as pd

    sample = results.samples["deterministic"]
    found = summary.identified_table(DETERMINISTIC_SPACE, sample.u, CONTACT_QUANTITIES)
    paper = published.CONTACT_PARAMETERS
    paper_values = {**paper, "restitution": float(np.sqrt(paper["k_l_N_m"] / paper["k_ul_N_m"]))}
    found.insert(1, "paper", [paper_values[name] for name in found["quantity"]])
    values = results.values("deterministic")
    low, middle, high = np.percentile(values["k_l_N_m"] / values["restitution"] ** 2, [2.5, 50.0, 97.5])
    row = {
        "quantity": "k_ul_N_m", "paper": paper_values["k_ul_N_m"], "low95": low, "median": middle, "high95": high,
        "prior": "k_l over the restitution squared",
    }  # fmt: skip
    return pd.concat([found, pd.DataFrame([row])], ignore_index=True)
