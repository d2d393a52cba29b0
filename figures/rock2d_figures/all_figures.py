"""Every table and figure of a reproduction, and the page that holds them together."""

from __future__ import annotations

import json
import math
from pathlib import Path

import pandas as pd

from rock2d.files.scenario import load_scenario
from rock2d.graphics.plots import save_figure
from rock2d.reproduction import published, summary
from rock2d.reproduction.hypotheses import ARRIVALS, SETUP
from rock2d.reproduction.results import SPACES, Results
from rock2d.reproduction.scenario_file import scenario_text
from rock2d.runs.results import RunResult
from rock2d.runs.run import run
from rock2d_figures import figure_1, figure_2, figure_3, identified, passing, table_2, table_3, table_4
from rock2d_figures.style import spelled

ENGINES = {"deterministic": "batch", "probabilistic": "point_mass"}
SHOWN = 25  # releases of each block in figure 3


def write_all(results: Results, folder: Path, *, progress: bool) -> None:
    """Write tables (CSV), figures (PNG), the calibrated scenarios (YAML), reproduction.json and report.md."""
    assumed = [
        summary.identified_table(SPACES[model], sample.u, (*SETUP, *ARRIVALS)).assign(model=model)
        for model, sample in results.samples.items()
    ]
    tables = {
        "table_2": results.passing,
        "table_3": table_3.table(results),
        "table_4": table_4.table(results),
        "assumptions": pd.concat(assumed, ignore_index=True),
    }
    if results.left_out:
        tables |= {"candidates": results.candidates, "cells": results.cells}
    for name, table in tables.items():
        table.to_csv(folder / f"{name}.csv", index=False, float_format="%.6g", lineterminator="\n")
    runs = {model: _run(results, model, folder, progress) for model in SPACES}
    shown = pd.concat(
        [
            *(own[: len(SETUP)] for own in assumed),
            tables["table_4"].dropna(subset="prior_low").assign(model="deterministic"),
            tables["table_3"].assign(model="probabilistic"),
        ]
    )
    drawn = {
        "figure_1": figure_1.figure(results),
        "figure_2": figure_2.figure(results),
        "figure_3": figure_3.figure(runs),
        "passing": passing.figure(results.passing),
        "identified": identified.figure(shown),
    }
    for name, figure in drawn.items():
        save_figure(figure, folder / f"{name}.png", dpi=220)
    errors = {name: None if math.isnan(value) else value for name, value in results.errors.items()}
    evidence = {model: sample.log_evidence for model, sample in results.samples.items()}
    content = {
        "seed": results.seed,
        "rmse_points": errors,
        "log_evidence": evidence,
        "said": results.said,
    }
    (folder / "reproduction.json").write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8")
    (folder / "report.md").write_text(_report(results, tables), encoding="utf-8")


def _run(results: Results, model: str, folder: Path, progress: bool) -> RunResult:
    """Write the model's likeliest hypothesis as a scenario, and run that."""
    path, best = folder / f"{model}.yaml", results.samples[model].best
    alpha = {block: float(own[best]) for block, own in results.reduction_deg.items()}
    text = scenario_text(results.known, results.values(model), best, alpha, results.seed, model)
    path.write_text(text, encoding="utf-8")
    return run(load_scenario(path), engine=ENGINES[model], releases=SHOWN, progress=progress)


def _report(results: Results, tables: dict[str, pd.DataFrame]) -> str:
    parts = [
        "# The paper's tables and figures, redone",
        "",
        *(f"- {line}" for line in results.said),
        "",
        "## Table 2: passing frequencies in %",
        "",
        table_2.markdown(results.passing),
        "",
        "Experiment: exact 95 % interval of 50 releases. This project's models: mean and 95 % interval over the",
        f"{len(results.samples['deterministic'].u)} hypotheses of each that explain the sphere and the words on first",
        "impacts; the probabilistic model's slope reductions were fitted to the block's own cells, as in the paper.",
        "p: exact; of the filmed number under this project's predictions, of equal frequencies for the paper's",
        "models (Fisher).",
        "",
        "![passing frequencies](passing.png)",
        "",
        "## What the unpublished starts are worth: RMSE in points by what a model was told",
        "",
        "| | RMSE |",
        "|---|---|",
        *(f"| {name} | {value:.1f} |" for name, value in results.errors.items()),
        "",
        *(_candidates(results) if results.left_out else ()),
        "## What is identified",
        "",
        "Grey bars: prior ranges; right: the posterior's standard deviation over the prior's.",
        "",
        "![identified](identified.png)",
        "",
        "### Table 3", "", _markdown(tables["table_3"]), "",
        "### Table 4", "", _markdown(tables["table_4"]), "",
        "### Assumptions: what the paper did not publish", "",
        *(f"- {meaning}" for meaning in published.MEANINGS), "",
        _markdown(tables["assumptions"]), "",
        "## Figures", "",
        "![set-up](figure_1.png)", "",
        "Figure 1. The set-up of the likeliest hypothesis, with zones and measure lines; grey: others as good.", "",
        "![at line 2](figure_2.png)", "",
        "Figure 2. The sphere at line 2; incidence above the horizontal. The paper's curves are not published as",
        "numbers.", "",
        "![trajectories](figure_3.png)", "",
        "Figure 3. Trajectories from deterministic.yaml and probabilistic.yaml, which `rock2d run` takes, too.", "",
    ]  # fmt: skip
    return "\n".join(parts)


def _candidates(results: Results) -> list[str]:
    return [
        "One cell left out, as predicted by hypotheses without a candidate effect that were told the others:",
        "",
        _markdown(results.cells),
        "",
        "## Candidate physics",
        "",
        "Effects of the catalogue that change an impact, each against none, on hypotheses that were not told one",
        "block's cells. *share*: posterior probability; *share told all*, *bayes factor*: once they are told, too.",
        "",
        _markdown(results.candidates),
        "",
    ]


def _markdown(table: pd.DataFrame) -> str:
    rows = [
        "| " + " | ".join(spelled(str(c)) for c in table.columns) + " |",
        "|" + "---|" * len(table.columns),
    ]
    for row in table.itertuples(index=False):
        rows.append("| " + " | ".join(_cell(value) for value in row) + " |")
    return "\n".join(rows)


def _cell(value: object) -> str:
    if not isinstance(value, float):
        return str(value)
    if value != value:
        return ""
    return f"{value:.0f}" if abs(value) >= 1000 else f"{value:.3g}"
