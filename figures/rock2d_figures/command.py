"""`rock2d reproduce`: the paper's tables and figures from the scenario of its set-up, in one command."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path

from rock2d.files.folders import atomic_folder
from rock2d.reproduction.computation import FinishedStages, compute_results, reproduction_bars
from rock2d.reproduction.results import Results
from rock2d.reproduction.saving import write_results
from rock2d.reproduction.stages import Effort
from rock2d_figures.all_figures import write_figures
from rock2d_figures.report import report_text

Report = Callable[[str], None]


def reproduce(
    out: Path, *, seed: int, effort: Effort, candidates: bool = False, progress: bool, report: Report
) -> Results:
    """Calibrate both models, write every table and figure into the folder `out`, and report how well they agree.

    With `candidates` also test candidate effects of the deterministic model on held-out blocks.

    A call with the same seed and effort continues after an interruption: finished calibrations are kept in a hidden
    folder beside `out` until everything is written.
    """
    begin = time.perf_counter()
    with atomic_folder(out) as folder:
        final = out.absolute()
        key = {"seed": seed, **vars(effort)}
        bars = reproduction_bars(progress, effort, candidates)
        finished = FinishedStages(final.with_name(f".{final.name}.stages"), key, bars)
        results = compute_results(finished, bars, seed=seed, effort=effort, candidates=candidates)
        tables = write_results(results, folder)
        write_figures(results, tables, folder, bars)
        (folder / "report.md").write_text(report_text(results, tables), encoding="utf-8")
    finished.clear()
    for line in results.conclusions:
        report(line)
    report(f"written: {out} in {time.perf_counter() - begin:.0f} s; open {out / 'report.md'}")
    return results
