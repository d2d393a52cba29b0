"""`rock2d run` of a scenario with a field test: the study, or the forecast of a list of releases."""

import json
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from rock2d.errors import InputError
from rock2d.field_tests.candidates import candidate_table
from rock2d.field_tests.forecasts import (
    ALL,
    PartForecast,
    by_block,
    passing_table,
    prediction_table,
    runout_table,
    score_table,
)
from rock2d.field_tests.study import (
    REBOUND_PLACES,
    Effort,
    all_soils,
    calibrate,
    naive_forecasts,
    posterior_table,
    shape_forecasts,
    shape_table,
    shapes_of,
    step_counter,
    study_forecasts,
)
from rock2d.files.field_releases import read_releases
from rock2d.files.folders import atomic_folder, check_output_folder, user_cache, write_whole
from rock2d.files.scenario import Scenario

KIND = "field test"  # of a folder of results
REPORT_STREAM = 11  # first number of a spawn key
DENSITY_KG_M3 = 2700.0  # density of the shapes that are compared
SHAPE_SOILS = 32  # draws of the posterior with which they are simulated


def run_field_test(
    scenario: Scenario, folder: Path, *, seed: int | None = None, overwrite: bool = False, progress: bool = True,
    effort: Effort | None = None, report: Callable[[str], Any] = print,
) -> dict[str, pd.DataFrame]:  # fmt: skip
    """Calibrate, predict and compare; write tables and figures into `folder`, and return the tables.

    Simulated soils are kept in the cache of the user, so that an interrupted study continues, and forecasts reuse them.
    Raises InputError if the folder already holds results."""
    check_output_folder(folder, overwrite, KIND)
    seed = scenario.seed if seed is None else seed
    assert scenario.terrain is not None
    known = scenario.terrain.known
    rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(REPORT_STREAM,)))
    kept = user_cache("soils")
    with bars(progress) as show:
        blocks = calibrate(scenario, "batch", seed, kept, effort, show)
        found = study_forecasts(scenario, blocks, show)
        if any(place.startswith(REBOUND_PLACES) for place in scenario.unknown()):
            points = calibrate(scenario, "point_mass", seed, kept, effort, show)
            found |= study_forecasts(scenario, points, show)
        found |= naive_forecasts(scenario, seed)
        soils = all_soils(blocks)
        mass = float(np.median([block.mass_kg for block in scenario.make_blocks().values()]))
        shapes = shape_forecasts(
            blocks.unknowns, soils[:SHAPE_SOILS], shapes_of(mass, DENSITY_KG_M3), seed,
            step_counter(show, "shapes", SHAPE_SOILS),
        )  # fmt: skip
        candidates = candidate_table(scenario, blocks, kept, show)
    lines = scenario.terrain.lines_m
    tables = {
        "runout": runout_table(known, found, rng), "passing": passing_table(known, found, lines, rng),
        "scores": score_table(known, found, lines, rng), "posterior": posterior_table(blocks, soils),
        "shapes": shape_table(shapes), "candidates": candidates,
    }  # fmt: skip
    report(study_text(tables, mass))
    facts = {"scenario": scenario.name, "seed": seed, "releases": len(known), "lateral_sd_deg": round(
        float(np.degrees(scenario.terrain.lateral_sd_rad)), 3)}  # fmt: skip
    with atomic_folder(folder, KIND) as partial:
        for name, table in tables.items():
            table.to_csv(partial / f"{name}.csv", index=False, lineterminator="\n")
        write_whole(partial / "field_test.json", json.dumps(facts, indent=2) + "\n")
        _write_figures(partial, scenario, found, tables)
    report(f"written: {folder}")
    return tables


def predict_releases(
    scenario: Scenario, table: Path, out: Path, *, seed: int | None = None, overwrite: bool = False,
    progress: bool = True, effort: Effort | None = None,
) -> str:  # fmt: skip
    """Forecast the releases of a table without stops, calibrated on all known releases, and write one row for each to
    `out`. Returns in words what was written.

    Raises InputError for a mistake in the table, or if `out` exists and `overwrite` is not set."""
    if scenario.field_test is None:
        raise scenario.error("--predict needs the key field_test", "field_test", code="missing_key", key="field_test")
    if out.suffix.lower() != ".csv":
        raise InputError("--predict writes a table: --out predictions.csv", out, code="wrong_kind", option="out")
    if out.exists() and not overwrite:
        raise InputError("exists; --overwrite replaces it", out, code="results_exist")
    seed = scenario.seed if seed is None else seed
    releases = read_releases(table, scenario.field_test.block_ids, stops=False)
    with bars(progress) as show:
        calibration = calibrate(scenario, "batch", seed, user_cache("soils"), effort, show)
        found = calibration.forecast(releases, all_soils(calibration), "forecast", show)
    rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(REPORT_STREAM, 1)))
    predicted = prediction_table(releases, found, rng)
    write_whole(out, predicted.to_csv(index=False, lineterminator="\n", float_format="%.3f"))
    cut = f"{100 * found.unresolved:.2g} % of the descents were cut short or buried: counted as stopped there\n"
    text = f"{len(predicted)} releases, calibrated on {calibration.soils.log_density.shape[1]}; written: {out}"
    return cut + text if found.unresolved > 0.0 else text


def study_text(tables: Mapping[str, pd.DataFrame], mass_kg: float) -> str:
    """The main tables as text."""
    runout, scores, shapes = tables["runout"], tables["scores"], tables["shapes"]
    lines = [
        "distance from start to stop in m: 10, 50, 90 %; error of the median; share within the central 80 and 90 %;",
        "log score per release; RMSE of passing frequencies (floor of a perfect model)",
    ]
    for (_, a), (_, s) in zip(runout.iterrows(), scores.iterrows(), strict=True):
        measured, expected = (
            "/".join(f"{a[f'{kind}_q{p}_m']:.0f}" for p in (10, 50, 90)) for kind in ("measured", "forecast")
        )
        lines.append(
            f"  {a['forecast']:36s} {a['block']:8s} n {a['releases']:2d}  measured {measured:12s} "
            f"forecast {expected:12s}"
            f" {s['median_error_m']:+6.1f}  {100 * s['inside80']:3.0f} {100 * s['inside90']:3.0f} %  "
            f"{s['log_score']:6.2f} ± {s['log_score_se']:.2f}  {s['passing_rmse']:.3f} ({s['rmse_floor']:.3f})"
        )
    worst = scores["unresolved"].max()
    if worst > 0.0:
        lines.append(f"up to {100 * worst:.2g} % of a forecast's descents were cut short or buried: counted as stopped")
    lines.append(f"effect of shape: {mass_kg:.0f} kg, same soils, 10, 50, 90 % in m")
    lines += [
        f"  {row['shape']:8s} {row['q10_m']:4.0f} {row['q50_m']:4.0f} {row['q90_m']:4.0f}"
        for _, row in shapes.iterrows()
    ]
    lines.append("changes of the model: gain in log score per held-out release over the unchanged model")
    lines += [
        f"  {row['change']:32s} {row['gain']:+z.3f} ± {row['gain_se']:.3f}"
        for _, row in tables["candidates"].iterrows()
    ]
    return "\n".join(lines)


@contextmanager
def bars(progress: bool) -> Iterator[Callable[[str, int, int], None]]:
    """Give a function (what, done, total) that shows a progress bar for each `what`."""
    from rock2d.progress import Bar, Bars

    shown = dict[str, Bar]()
    with ExitStack() as open_bars:

        def show(what: str, done: int, of: int) -> None:
            if what not in shown:
                open_bars.close()
                shown[what] = open_bars.enter_context(Bars(progress).stage(what, of, "soils"))
            shown[what].reach(done, of)

        yield show


def _write_figures(
    folder: Path, scenario: Scenario, found: Mapping[str, PartForecast], tables: Mapping[str, pd.DataFrame]
) -> None:
    from rock2d.graphics.field_test_figures import forecasts_figure, passing_figure
    from rock2d.graphics.figure_style import save_figure

    assert scenario.terrain is not None
    known = scenario.terrain.known
    measured = {block: known.distances_m[known.of_blocks(block)] for block in dict.fromkeys(known.blocks)}
    expected: dict[str, dict[str, Any]] = {block: {} for block in measured}
    for name, own in found.items():
        if "held out" in name:
            draws = own.forecast.draws_m(np.random.default_rng(0))
            for block, rows in by_block(known, own).items():
                if block != ALL:
                    expected[block][name] = draws[rows]
    save_figure(forecasts_figure(scenario.make_cross_section(), measured, expected), folder / "stops.png")
    from_one = {name: name for name in found if "held out" not in name}
    save_figure(passing_figure(tables["passing"], from_one), folder / "passing.png")
