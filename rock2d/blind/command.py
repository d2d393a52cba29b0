"""The commands `rock2d blind make | run | score | inject`."""

from __future__ import annotations

import json
import os
import shutil
from collections.abc import Callable, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rock2d.cluster import Workers
from rock2d.errors import InputError
from rock2d.files.folders import check_folder, write_whole
from rock2d.files.text_files import read_json
from rock2d.progress import Bars

if TYPE_CHECKING:
    from rock2d.blind.recovery import Plan

Report = Callable[[str], None]


def make(
    count: int, seed: int, out: Path, bases: Sequence[Path], *, workers: int | None, progress: bool, report: Report
) -> None:
    """Write a sealed trial; `bases`: experiments on which a share of its cases is based."""
    from rock2d.blind.case_files import KIND, make_trial
    from rock2d.blind.record_cases import read_record
    from rock2d.blind.trial_diagnoses import RESULTS

    check_folder(out, KIND)
    if any((out / RESULTS).glob("*")):
        raise InputError("holds diagnoses of its cases; choose another output folder", out, code="results_exist")
    processes = workers or os.cpu_count() or 1
    records = [read_record(folder, processes, progress) for folder in bases]
    with Bars(progress).stage("filming", count, "cases") as bar:
        digest = make_trial(count, seed, out, records=records, workers=processes, on_case=bar.update)
    report(f"written: {out} ({count} cases); SHA-256 of the labels {digest}")


def run(folder: Path, *, workers: Workers, progress: bool, report: Report) -> None:
    """Diagnose all cases of a trial."""
    from rock2d.blind.case_files import read_index
    from rock2d.blind.trial_diagnoses import diagnose_trial_case, run_cases

    with Bars(progress).stage("diagnosing", 0, "cases") as bar:
        out = run_cases(folder, int(read_index(folder)["count"]), diagnose_trial_case, workers, bar.reach)
    report(f"written: {out}")


def score(folder: Path, *, report: Report) -> dict[str, Any]:
    """Open the labels and write score.json, score.csv and score.html into the trial's folder."""
    from rock2d.blind.case_files import read_index
    from rock2d.blind.page import write_page
    from rock2d.blind.scoring import case_table, scored_cases, summary

    cases = scored_cases(folder)
    numbers = summary(cases)
    text = case_table(cases).to_csv(index=False, float_format="%.6g", lineterminator="\n")
    write_whole(folder / "score.csv", text)
    plain = json.loads(json.dumps(numbers), parse_constant=lambda _: None)  # JSON has no NaN
    write_whole(folder / "score.json", json.dumps(plain, indent=1, allow_nan=False) + "\n")
    write_page(cases, numbers, read_index(folder)["labels_sha256"], folder / "score.html")
    for key, value in plain.items():
        report(f"{key}: {json.dumps(value)}".replace("null", "-"))  # no case tells
    report(f"written: {folder / 'score.html'}")
    return numbers


def inject(
    experiment: Path, out: Path, effects: str, plan: Plan, *, workers: Workers, progress: bool, report: Report
) -> None:
    """Add known causes to a film, diagnose it again, and write limits.json. An interrupted study continues."""
    from rock2d.blind.record_cases import diagnosed_film
    from rock2d.blind.recovery import case_lines, diagnose_case, make_cases, recovered
    from rock2d.blind.trial_diagnoses import run_cases
    from rock2d.diagnosis.command import FITS
    from rock2d.diagnosis.detection import LIMITS, TRUTH
    from rock2d.diagnosis.known_causes import effects_of_size
    from rock2d.diagnosis.report.sections import limit_lines
    from rock2d.files.experiment import digest, load_experiment

    read, names = load_experiment(experiment), effects_of_size(effects)
    film = {"experiment": read.name, "film": digest(read)}
    options = json.loads(json.dumps({**film, "effects": names, "plan": asdict(plan)}))
    if not (out / TRUTH).is_file():
        if out.is_dir() and any(out.iterdir()) and not (out / FITS).is_dir():
            raise InputError("exists and is not a study; choose another folder", out, code="not_a_result")
        result = diagnosed_film(read, experiment, workers.processes or os.cpu_count() or 1, progress, out / FITS)
        with Bars(progress).stage("known causes", 0, "cases") as bar:
            make_cases(result, names, plan, out, options, bar.update)
        shutil.rmtree(out / FITS, ignore_errors=True)
    truth = read_json(out / TRUTH)
    older = {} if "film" in truth else {"film": film["film"]}  # studies that name the experiment only
    if {key: {**older, **truth}.get(key) for key in options} != options:
        raise InputError("holds a study of another film, or with other options", out, code="not_a_result")
    with Bars(progress).stage("diagnosing", 0, "cases") as bar:
        count = len(truth["cases"]) + bool(truth.get("without_cause"))
        run_cases(out, count, diagnose_case, workers, bar.reach)
    cases, limits = recovered(out)
    write_whole(out / LIMITS, json.dumps(limits, indent=1, allow_nan=False) + "\n")
    for line in [*case_lines(cases, limits, names), *limit_lines(limits)]:
        report(line)
    report(f"written: {out / LIMITS}")
