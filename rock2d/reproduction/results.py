"""Predictions of each calibration for new releases, their errors and conclusions, and the data files: tables (the
paper's Tables 2 to 4, assumptions, candidate effects), paper_setup.yaml and reproduction.json."""

import json
import math
from collections.abc import Hashable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from rock2d.arrays import Array
from rock2d.calibration.sequential_monte_carlo import Sample
from rock2d.reproduction import published, summary
from rock2d.reproduction.arrival_results import ArrivalResults, ArrivalStages, arrival_results
from rock2d.reproduction.calibrations import (
    CANDIDATE_SPACE,
    SLOPE_REDUCTIONS_DEG,
    candidate_outcome,
    candidate_prior,
    standard_normal_draws,
)
from rock2d.reproduction.hypotheses import (
    ARRIVAL_QUANTITIES,
    CONTACT_QUANTITIES,
    DETERMINISTIC_SPACE,
    PROBABILISTIC_SPACE,
    REBOUND_QUANTITIES,
    SETUP_QUANTITIES,
    Values,
)
from rock2d.reproduction.outcomes import Outcome, deterministic_outcome, probabilistic_outcome
from rock2d.reproduction.paper_setup import SCENARIO_FILE, scenario_text
from rock2d.reproduction.summary import HeldOutBlock

SPACES = {"deterministic": DETERMINISTIC_SPACE, "probabilistic": PROBABILISTIC_SPACE}
PREDICTION_RELEASES = 128  # per block and hypothesis


@dataclass(frozen=True)
class Results:
    """The results that tables and figures show.

    Attributes
    ----------
    samples, outcomes : model -> posterior, and predictions for the three blocks
    slope_reduction_deg : block -> slope reduction of each hypothesis of the probabilistic model
    held_out : for the cube and the parallelepiped, the prediction without its own cells; empty without candidates
    passing, candidates, cells : tables
    arrivals : results with the arrivals of the paper's simulations
    errors : RMSE in points, by model and the data to which it was fitted
    conclusions : sentences"""

    seed: int
    samples: dict[str, Sample]
    outcomes: dict[str, list[Outcome]]
    slope_reduction_deg: dict[str, Array]
    held_out: list[HeldOutBlock]
    passing: pd.DataFrame
    candidates: pd.DataFrame
    cells: pd.DataFrame
    arrivals: ArrivalResults
    errors: dict[str, float]
    conclusions: list[str] = field(default_factory=list)

    def values(self, model: str) -> Values:
        """The hypotheses of a model."""
        return SPACES[model].values(self.samples[model].u)


def evaluate(
    samples: dict[str, Sample], slope_reduction_deg: dict[str, Array],
    without_block: dict[str, Sample], arrivals: ArrivalStages,
    stream: np.random.SeedSequence, seed: int,
) -> Results:  # fmt: skip
    """Predictions of all calibrations with errors and conclusions.

    `without_block`: held-out block -> posterior of the deterministic model with candidate effects."""
    draw_seed, floor_seed = stream.spawn(2)
    draws = standard_normal_draws(PREDICTION_RELEASES, draw_seed)
    values = {model: SPACES[model].values(sample.u) for model, sample in samples.items()}
    outcomes = {
        "deterministic": [
            deterministic_outcome(values["deterministic"], block, draws[block]) for block in published.BLOCKS
        ],
        "probabilistic": [
            probabilistic_outcome(values["probabilistic"], block, draws[block], slope_reduction_deg[block])
            for block in published.BLOCKS
        ],
    }
    held_out = []
    for block, sample in without_block.items():
        own = CANDIDATE_SPACE.values(sample.u)
        predicted = [candidate_outcome(own, b, draws[b]) for b in published.BLOCKS]
        held_out.append(HeldOutBlock(own, predicted, block))
    cells = summary.held_out_cells_table(held_out)
    rng = np.random.default_rng(floor_seed)
    with_arrivals = arrival_results(arrivals, draws, seed)
    results = Results(
        seed, samples, outcomes, slope_reduction_deg, held_out,
        summary.passing_table(outcomes["deterministic"], outcomes["probabilistic"]),
        summary.candidates_table(held_out), cells, with_arrivals,
        _errors(outcomes, held_out, cells, rng) | with_arrivals.errors(),
    )  # fmt: skip
    results.conclusions.extend(_conclusions(results))
    return results


def _errors(
    outcomes: dict[str, list[Outcome]], held_out: list[HeldOutBlock], cells: pd.DataFrame, rng: np.random.Generator
) -> dict[str, float]:
    """RMSE in points over the validation cells and over all nine cells, by model and the data of its fit."""
    validation = summary.VALIDATION_ROWS
    sphere_only = summary.mean_percent(outcomes["deterministic"])
    found = {
        "paper, deterministic: validation cells": summary.rmse(published.DETERMINISTIC, validation),
        "paper, deterministic: all nine": summary.rmse(published.DETERMINISTIC),
        "paper, probabilistic: all nine": summary.rmse(published.PROBABILISTIC),
        "deterministic: validation cells": summary.rmse(sphere_only, validation),
        "deterministic: all nine": summary.rmse(sphere_only),
        "probabilistic: all nine": summary.rmse(summary.mean_percent(outcomes["probabilistic"])),
        "deterministic, the best hypothesis: all nine": summary.best_hypothesis_rmse(outcomes["deterministic"]),
        "probabilistic, the best hypothesis: all nine": summary.best_hypothesis_rmse(outcomes["probabilistic"]),
    }
    if held_out:
        found |= {
            "deterministic, fitted to the sphere and the other angular block: validation cells": summary.rms(
                [summary.rmse_without_candidate(run) for run in held_out]
            ),
            "deterministic, fitted to all cells but the predicted one: validation cells": summary.rms(
                cells["predicted"] - cells["experiment"]
            ),
            "deterministic, fitted to all nine, the best hypothesis: all nine": float(
                np.nanmin([summary.best_hypothesis_rmse(run.without_candidate) for run in held_out])
            ),
        }
    for name, chosen in (("validation cells", validation), ("all nine", np.s_[:])):
        mean, bound = summary.sampling_floor(chosen, rng)
        found |= {f"a perfect model: {name}": mean, f"a perfect model, 95th percentile: {name}": bound}
    return found


def _conclusions(results: Results) -> list[str]:
    """Sentences on the agreement with the experiment."""
    e, rows = results.errors, results.passing.to_dict("records")
    outside = [r for r in rows if not r["experiment_low95"] <= r["deterministic"] <= r["experiment_high95"]]
    misses = [r for r in rows if r["deterministic_p"] < 0.05]
    lines = [
        f"Deterministic model, fitted to the sphere's cells and the statements on first impacts: RMSE "
        f"{e['deterministic: validation cells']:.1f} points over the validation cells (paper "
        f"{e['paper, deterministic: validation cells']:.1f}), {e['deterministic: all nine']:.1f} over all nine (paper "
        f"{e['paper, deterministic: all nine']:.1f}).",
        f"Probabilistic model: {e['probabilistic: all nine']:.1f} over all nine (paper "
        f"{e['paper, probabilistic: all nine']:.1f}).",
        f"A perfect model would show {e['a perfect model: validation cells']:.1f} and "
        f"{e['a perfect model: all nine']:.1f} against {published.RELEASES} releases.",
        f"Mean predictions of the deterministic model outside the experiment's 95 % interval: {_cell_names(outside)}; "
        f"filmed numbers that its predictions exclude (p < 0.05): {_cell_names(misses)}.",
    ]
    for model, own in results.outcomes.items():
        lines.append(
            f"Monte Carlo error of the {model} model's mean predictions: {summary.monte_carlo_error(own):.1f} points."
        )
    lines += results.arrivals.conclusions()
    if not results.held_out:
        return lines
    shares = results.candidates.pivot(index="candidate", columns="held_out", values="share_all_cells")
    mean, range_ = shares.mean(axis=1).sort_values(ascending=False), shares.max(axis=1) - shares.min(axis=1)
    likeliest = [
        f"{name} {mean[name]:.2f} ± {range_[name] / 2:.2f} (prior {candidate_prior(str(name)):.2f})"
        for name in mean.index[:3]
    ]
    return [*lines, f"Candidate physics, once all cells are fitted: {', '.join(likeliest)}."]


def _cell_names(rows: list[dict[Hashable, Any]]) -> str:
    return ", ".join(f"{r['block']} {r['line']}" for r in rows) or "none"


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
    assumptions = [
        summary.identified_table(SPACES[model], sample.u, (*SETUP_QUANTITIES, *ARRIVAL_QUANTITIES)).assign(model=model)
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

    k_ul is computed from k_l and the restitution."""
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
