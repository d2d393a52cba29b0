"""`rock2d demo`: the paper's set-up with both laws: Table 2 side by side, paths and a video, on one page."""

from __future__ import annotations

import time
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rock2d.reproduction import published
from rock2d.reproduction.paper_setup import ENGINE_OF_MODEL, TABLE_2_RELEASES, side_by_side, simulated_passed
from rock2d.wording import aligned, spoken
from rock2d_figures.table_2 import interval_text

if TYPE_CHECKING:
    import pandas as pd

    from rock2d.files.scenario import Scenario
    from rock2d.graphics.pages import Section

VIDEO: dict[str, Any] = {"slow_motion": 8.0, "size_px": (960, 540)}
FILMED_MODEL = "deterministic"
PAGE, TABLE, FIGURE, FILM = "report.html", "table_2.csv", "table_2.png", "trajectories.webm"
TITLE = "The paper's set-up: Table 2 side by side"
HEAD = (
    "block", "line", "experiment", "paper, deterministic", "rock2d, deterministic", "agree", "paper, probabilistic",
    "rock2d, probabilistic", "agree",
)  # fmt: skip
NOTE = (
    f"Passing frequencies in %. Published numbers: exact 95 % interval of {published.RELEASES} releases. rock2d: "
    f"{TABLE_2_RELEASES} releases, exact 95 % interval. Agree: rock2d's number lies in the interval of the "
    "paper's model."
)
MOMENTUM_FACTOR = 2.0  # of the thresholds of Table 3, to show what they decide


def run_demo(out: Path, progress: bool = True) -> None:
    """Run the paper's set-up with both laws, write everything under `out`, and print Table 2 side by side."""
    from rock2d.files.csv_tables import write_csv
    from rock2d.files.folders import check_folder, write_whole
    from rock2d.files.scenario import scenario_file
    from rock2d.files.scenario_reading import load_scenario
    from rock2d.graphics.figure_style import save_figure
    from rock2d.graphics.pages import page
    from rock2d.runs.results import KIND
    from rock2d.runs.run import run, run_bars
    from rock2d_figures.table_2 import side_by_side_figure

    begin = time.perf_counter()
    for engine in ENGINE_OF_MODEL.values():
        check_folder(out / engine, KIND)
    scenario = load_scenario(scenario_file("paper_setup.yaml"))
    for model, engine in ENGINE_OF_MODEL.items():
        bars = run_bars(scenario, engine, progress)
        result = run(scenario, engine=engine, progress=bars)
        result.write(out / engine, progress=bars)
        if model == FILMED_MODEL:
            film = out / engine / FILM
            result.write_video(film, releases=1, titles=(scenario.name,), progress=progress, **VIDEO)
    table = side_by_side(scenario)
    save_figure(side_by_side_figure(table), out / FIGURE)
    write_csv(out / TABLE, table)
    said = list(findings(scenario, table))
    write_whole(out / PAGE, page(TITLE, list(_sections(scenario, table, said, out))))
    print("\n".join([table_text(table), *said, *(f"  assumed: {sentence}" for sentence in scenario.assumed)]))
    print(f"written: {out} in {time.perf_counter() - begin:.1f} s; open {out / PAGE}")


def findings(scenario: Scenario, table: pd.DataFrame) -> Iterator[str]:
    """Where the models agree with the paper's, and what Table 3 decides where its column is not met."""
    for model in published.COLUMNS:
        own = table[~table[f"{model}_agrees"]]
        off = ", ".join(f"{row['block']} {spoken(row['line'])}" for row in own.to_dict("records"))
        met = len(table) - len(own)
        yield f"The paper's {model} column is met in {met} of {len(table)} cells{f'; not: {off}' if off else ''}."
    if not table["probabilistic_agrees"].all():
        yield table_3_finding(scenario)


def table_3_finding(scenario: Scenario) -> str:
    """What the thresholds of the momentum in Table 3 decide."""
    from rock2d.files.scenario_variants import variant

    key, law = "momentum_half_kg_m_s", published.REBOUND_PARAMETERS
    more = {
        f"model.probabilistic.default.{zone}.{key}": MOMENTUM_FACTOR * law[f"{name}.{key}"]
        for zone, name in (("default", "ditch"), ("ditch", "ditch"), ("uphill_face", "facing"))
    }
    passed = simulated_passed(variant(scenario, more), "probabilistic", TABLE_2_RELEASES)
    sphere = published.BLOCKS.index("sphere")
    ours = ", ".join(f"{100 * n / TABLE_2_RELEASES:.0f}" for n in passed[sphere])
    paper = ", ".join(map(str, published.PROBABILISTIC[sphere]))
    return (
        "Why: both models of the paper started from the same arrivals, and none were found from which Tables 3 and 4 "
        "both give their columns. The thresholds M½ of Table 3 decide how much of its speed the sphere keeps: with "
        f"{MOMENTUM_FACTOR:g} times M½ it passes the lines in {ours} % (paper: {paper} %). What the paper leaves open, "
        "the facing, the lines and how M½ is meant, decides whether Table 3 gives this row."
    )


def table_rows(table: pd.DataFrame) -> list[tuple[str, ...]]:
    """Rows of HEAD from a table of `side_by_side`."""
    rows = []
    for row in table.to_dict("records"):
        cells = [row["block"], spoken(row["line"]), interval_text(row, "experiment")]
        for model in published.COLUMNS:
            agrees = "yes" if row[f"{model}_agrees"] else "NO"
            cells += [interval_text(row, f"paper_{model}"), interval_text(row, model), agrees]
        rows.append(tuple(cells))
    return rows


def table_text(table: pd.DataFrame) -> str:
    """Table 2 as a person reads it in a terminal."""
    return "\n".join([*aligned([HEAD, *table_rows(table)]), NOTE])


def _sections(scenario: Scenario, table: pd.DataFrame, said: list[str], out: Path) -> Iterator[Section]:
    """The parts of the page."""
    from rock2d.graphics.pages import Picture, Section, Table, embedded_picture

    def picture(path: Path, caption: str) -> Picture:
        return Picture(embedded_picture(path), caption, caption)

    filmed = ENGINE_OF_MODEL[FILMED_MODEL]
    yield Section(texts=[scenario.about], video=f"{filmed}/{FILM}")
    yield Section(
        "Table 2", said,
        pictures=[picture(out / FIGURE, "Bars: exact 95 % intervals of the published releases; filled: rock2d")],
        tables=[Table(HEAD, table_rows(table), note=NOTE)],
    )  # fmt: skip
    paths = [
        picture(out / engine / "trajectories.png", f"{scenario.releases} releases of each block, {model} model")
        for model, engine in ENGINE_OF_MODEL.items()
    ]
    yield Section("Paths", pictures=paths)
    yield Section("What is assumed", items=scenario.assumed)
