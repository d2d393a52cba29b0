"""Tables of a run as text for a terminal."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from rock2d.runs.release_remarks import stop_counts
from rock2d.wording import with_interval

if TYPE_CHECKING:
    import pandas as pd

    from rock2d.files.scenario import Scenario

PASSING_HEAD = (
    "line", "block", "released", "left source", "arrived", "passed", "% of released", "% of arriving", "unresolved",
)  # fmt: skip


PRINTED_TABLES = ("passing", "stops", "energy")


def print_tables(scenario: Scenario, run: str, tables: Mapping[str, pd.DataFrame]) -> None:
    """Print passing frequencies, stops and the energy audit, as far as there are tables of them. `run`: the engine, and
    what else a reader needs to repeat it."""
    print(f"\n{scenario.name}: {scenario.about} [{run}]")
    note = table_note(scenario)
    if len(tables.get("passing", ())):
        print(passing_text(tables["passing"], note))
    if "stops" in tables:
        print(stops_text(tables["stops"], note))
    if "energy" in tables:
        print(_audit_text(tables["energy"]))
    for sentence in scenario.assumed:
        print(f"  assumed: {sentence}")


def _audit_text(energy: pd.DataFrame) -> str:
    from rock2d.engines.energy_balance import audit_tolerance

    residual = energy["residual_J"].abs() / energy["initial_J"]
    text = f"energy audit: closes to {residual.max():.1e} of the initial energy at worst"
    unclosed = energy["release"][residual > audit_tolerance(energy["effects_J"].to_numpy())]
    if len(unclosed):
        some = ", ".join(map(str, unclosed[:5])) + (", ..." if len(unclosed) > 5 else "")
        text += f"\nenergy audit: DOES NOT CLOSE for {len(unclosed)} of {len(residual)} releases: {some}"
    return text


def table_note(scenario: Scenario | None) -> str:
    """Note on what the tables of a run do not have of a diagnosis, or it of the film; may be empty."""
    return scenario.diagnosed.note if scenario is not None and scenario.diagnosed is not None else ""


def stops_text(stops: pd.DataFrame, note: str = "") -> str:
    """Numbers of releases by kind of stop, one row a block."""
    return "how releases ended" + (f"; {note}" if note else "") + f"\n{stop_counts(stops).to_string()}"


def passing_text(passing: pd.DataFrame, note: str = "") -> str:
    """Passing frequencies as text, one row for each line and block."""
    import pandas as pd

    head = "passing frequency in % [95 % interval]"
    if passing["unresolved"].any():
        head += "; the upper bound counts releases that were cut short or buried as passed"
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
