"""Tables of a run as a person reads them in a terminal."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from rock2d.runs.resolution import stop_counts
from rock2d.wording import with_interval

if TYPE_CHECKING:
    import pandas as pd

    from rock2d.files.scenario import Scenario
    from rock2d.runs.results import RunResult

PASSING_HEAD = (
    "line", "block", "released", "left source", "arrived", "passed", "% of released", "% of arriving", "unresolved",
)  # fmt: skip


def print_tables(result: RunResult) -> None:
    """Passing frequencies, stops and the energy audit of one run."""
    from rock2d.engines.energy_balance import audit_tolerance

    print(f"\n{result.scenario.name}: {result.scenario.about} [{result.engine}, seed {result.seed}]")
    passing = result.to_pandas("passing")
    if len(passing):
        print(passing_text(passing, table_note(result.scenario)))
    print(stops_text(result.to_pandas("stops"), table_note(result.scenario)))
    if "energy" in result.table_names():
        energy = result.to_pandas("energy")
        left = energy["residual_J"].abs() / energy["initial_J"]
        print(f"energy audit: closes to {left.max():.1e} of the initial energy at worst")
        open_audits = energy["release"][left > audit_tolerance(energy["effects_J"].to_numpy())]
        if len(open_audits):
            some = ", ".join(map(str, open_audits[:5])) + (", ..." if len(open_audits) > 5 else "")
            print(f"energy audit: DOES NOT CLOSE for {len(open_audits)} of {len(left)} releases: {some}")
    for sentence in result.scenario.assumed:
        print(f"  assumed: {sentence}")


def print_campaign(scenario: Scenario, engine: str, tables: dict[str, pd.DataFrame]) -> None:
    """Passing frequencies and stops of a campaign."""
    print(f"\n{scenario.name}: {scenario.about} [{engine}]")
    if len(tables.get("passing", ())):
        print(passing_text(tables["passing"], table_note(scenario)))
    if "stops" in tables:
        print(stops_text(tables["stops"], table_note(scenario)))
    for sentence in scenario.assumed:
        print(f"  assumed: {sentence}")


def table_note(scenario: Scenario | None) -> str:
    """What the tables of a run leave out."""
    return scenario.diagnosed.left_out if scenario is not None and scenario.diagnosed is not None else ""


def stops_text(stops: pd.DataFrame, note: str = "") -> str:
    """How the releases ended, one row a block."""
    return "how releases ended" + (f"; {note}" if note else "") + f"\n{stop_counts(stops).to_string()}"


def passing_text(passing: pd.DataFrame, note: str = "") -> str:
    """Passing frequencies as a person reads them, one row for each line and block."""
    import pandas as pd

    head = "passing frequency in % [95 % interval]"
    if passing["unresolved"].any():
        head += "; the upper bound counts all releases as passed that were cut short or buried"
    head += f"; {note}" if note else ""
    cells = pd.DataFrame(passing_cells(passing), columns=list(PASSING_HEAD))
    return f"{head}\n{cells.to_string(index=False)}"


def passing_cells(passing: pd.DataFrame) -> list[tuple[str, ...]]:
    """Rows of PASSING_HEAD from a table of `indicators.passing`."""
    rows: list[Any] = list(passing.itertuples())
    return [
        (r.line, r.block, str(r.releases), f"{r.left_source:.0f}".replace("nan", "-"), str(r.arrived), str(r.passed),
         with_interval(r.frequency, r.low95, r.high95, 100.0),
         with_interval(r.per_arriving, r.per_arriving_low95, r.per_arriving_high95, 100.0), str(r.unresolved))
        for r in rows
    ]  # fmt: skip


def residual_text(summary: pd.DataFrame) -> str:
    """Residuals by stage and channel, in mm and degrees."""
    scale = {"m": (1e3, "mm"), "rad": (57.29577951308232, "deg")}
    rows = summary.copy()
    for column in ("median_abs", "rms", "noise"):
        rows[column] = [v * scale[u][0] for v, u in zip(rows[column], rows["unit"], strict=True)]
    rows["unit"] = [scale[u][1] for u in rows["unit"]]
    text = rows.to_string(index=False, float_format=lambda v: f"{v:.3g}")
    return "simulated - measured\n" + str(text)
