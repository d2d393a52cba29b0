"""`rock2d reproduce`: the paper's tables and figures from the scenario of its set-up, in one command."""

import time
from collections.abc import Callable
from pathlib import Path

import pandas as pd

from rock2d.files.folders import atomic_folder
from rock2d.files.scenario_reading import load_scenario
from rock2d.graphics.figure_style import save_figure
from rock2d.progress import Bars
from rock2d.reproduction.calibrations import Effort
from rock2d.reproduction.computation import FIGURES, FinishedStages, compute_results, reproduction_bars
from rock2d.reproduction.hypotheses import SETUP_QUANTITIES
from rock2d.reproduction.paper_setup import ENGINE_OF_MODEL, SCENARIO_FILE
from rock2d.reproduction.results import Results, write_results
from rock2d.runs.run import run
from rock2d_figures.posteriors import arrivals_figure, identified_figure
from rock2d_figures.report import report_text
from rock2d_figures.setup_figures import figure_1, figure_2, figure_3
from rock2d_figures.table_2 import passing_figure

Report = Callable[[str], None]

RELEASES_IN_FIGURE_3 = 25  # per block
FIGURE_DPI = 220


def reproduce(
    out: Path, *, seed: int, effort: Effort, candidates: bool = False, progress: bool, report: Report
) -> Results:
    """Calibrate both models, write every table and figure into the folder `out`, and report how well they agree.

    With `candidates` also test candidate effects of the deterministic model on held-out blocks.

    A call with the same seed and effort continues after an interruption: finished calibrations are kept in a hidden
    folder beside `out` until everything is written."""
    begin = time.perf_counter()
    with atomic_folder(out, "reproduction") as folder:
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


def write_figures(results: Results, tables: dict[str, pd.DataFrame], folder: Path, bars: Bars) -> None:
    """Draw all figures (PNG) into `folder`, which holds the scenario; `tables` as `result_tables` gives."""
    with bars.stage(FIGURES, 6, "figures") as bar:
        scenario = load_scenario(folder / SCENARIO_FILE)
        runs = {
            model: run(scenario, engine=engine, releases=RELEASES_IN_FIGURE_3)
            for model, engine in ENGINE_OF_MODEL.items()
        }
        figures = {
            "figure_1": figure_1(results),
            "figure_2": figure_2(results),
            "figure_3": figure_3(runs),
            "passing": passing_figure(results.passing),
            "arrivals": arrivals_figure(results.arrivals),
            "identified": identified_figure(_identified(tables)),
        }
        for name, figure in figures.items():
            save_figure(figure, folder / f"{name}.png", dpi=FIGURE_DPI)
            bar.step(name)


def _identified(tables: dict[str, pd.DataFrame]) -> pd.DataFrame:
    """Rows of the figure of identified quantities: the set-up under both models, then the laws."""
    setup = tables["assumptions"]
    setup = setup[setup["quantity"].isin([quantity.name for quantity in SETUP_QUANTITIES])]
    deterministic = tables["table_4"].dropna(subset="prior_low").assign(model="deterministic")
    return pd.concat([setup, deterministic, tables["table_3"].assign(model="probabilistic")])
