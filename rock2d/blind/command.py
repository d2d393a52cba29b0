"""The commands `rock2d blind make | run | score`."""

from __future__ import annotations

import json
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

from rock2d.cluster import Workers
from rock2d.files.folders import write_whole

Report = Callable[[str], None]


def make(count: int, seed: int, out: Path, *, workers: int | None, progress: bool, report: Report) -> None:
    """Write a sealed trial."""
    from rock2d.blind.case_files import make_trial
    from rock2d.progress import Bars

    with Bars(progress).stage("filming", count, "cases") as bar:
        digest = make_trial(count, seed, out, workers=workers or os.cpu_count() or 1, on_case=bar.update)
    report(f"written: {out} ({count} cases); SHA-256 of the labels {digest}")


def run(folder: Path, *, workers: Workers, progress: bool, report: Report) -> None:
    """Diagnose all cases of a trial."""
    from rock2d.blind.running import run_trial
    from rock2d.progress import Bars

    with Bars(progress).stage("diagnosing", 0, "cases") as bar:
        out = run_trial(
            folder,
            workers=workers.processes or os.cpu_count() or 1,
            scheduler=workers.scheduler,
            on_progress=bar.reach,
        )
    report(f"written: {out}")


def score(folder: Path, *, report: Report) -> dict[str, Any]:
    """Open the labels and write score.json, score.csv and score.html into the trial's folder."""
    from rock2d.blind.case_files import read_index
    from rock2d.blind.page import write_page
    from rock2d.blind.scoring import confused_pairs, score_table, summary
    from rock2d.blind.set_scoring import set_cases, set_summary

    cases = score_table(folder)
    found = summary(cases) | {"confused": confused_pairs(folder, cases)}
    sets = set_cases(folder)
    if sets:
        found["sets"] = set_summary(sets)
    write_whole(folder / "score.csv", cases.to_csv(index=False, float_format="%.6g", lineterminator="\n"))
    write_whole(folder / "score.json", json.dumps(found, indent=1) + "\n")
    write_page(cases, found, read_index(folder)["labels_sha256"], folder / "score.html", sets)
    for key, value in found.items():
        report(f"{key}: {value}")
    report(f"written: {folder / 'score.html'}")
    return found
