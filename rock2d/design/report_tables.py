"""Tables of a report, with three significant digits and the usual units."""

from __future__ import annotations

from dataclasses import astuple, fields
from typing import TYPE_CHECKING, Any

import numpy as np

from rock2d.design.norms import SOURCES, norm_table
from rock2d.design.uncertainty import SHARES
from rock2d.files.scenario import Scenario
from rock2d.graphics.pages import Download, Table, download
from rock2d.runs.engines import engine_named
from rock2d.runs.indicators.reach import ENERGY_LINE, REACH
from rock2d.runs.model_comparison import COLUMNS_OF_QUANTITY, COLUMNS_OF_SHARE
from rock2d.runs.printed_tables import PASSING_HEAD, passing_cells
from rock2d.runs.release_remarks import stop_counts
from rock2d.scene.soils import SOIL_CLASSES
from rock2d.wording import energy_unit, three_digits, with_interval, without_unit

if TYPE_CHECKING:
    import pandas as pd

NAME_OF_QUANTITY = {
    "kinetic_J": "energy", "energy_J": "energy", "passing_height_m": "passing height", "height_m": "height",
    "speed_m_s": "speed", "mass_kg": "mass", **SHARES,
}  # fmt: skip
ANGLES = {REACH: "reach (Fahrböschung)", ENERGY_LINE: "energy line"}
USUAL_REACH = (
    "Of the blocks that fell in the Friuli earthquake of 1976, half stopped above 33.5°, 72 % above 32° and all above "
    "28.5° (Onofri and Candian 1979, from secondary sources)."
)


def quantity_text(quantity: str, value: float, low: float, high: float) -> str:
    """A value with its interval and its unit, which is the end of the name of the quantity."""
    if not np.isfinite(value):
        return "-"
    _, unit = without_unit(quantity)
    if unit == "kg" and low == high:
        return f"{three_digits(value)} kg"
    factor, unit = energy_unit(abs(value)) if unit == "J" else (1.0, unit)
    return f"{with_interval(value, low, high, factor)} {unit}"


def _rows(table: pd.DataFrame) -> list[Any]:
    return list(table.itertuples())


def data_of(name: str, table: pd.DataFrame) -> Download:
    """Download link of a table with all digits."""
    return download(name, list(table.columns), table.itertuples(index=False))


def passing_page_table(passing: pd.DataFrame) -> Table:
    """Passing frequencies in %, of the released and of the arriving blocks."""
    return Table(
        PASSING_HEAD, passing_cells(passing),
        note="Left: ended more than 5 block sizes from the start. Arrived: came to the arrival line. Intervals: 95 %, "
        "sampling only (Wilson). Unresolved releases count as passed in the upper bound.",
        data=data_of("passing.csv", passing),
    )  # fmt: skip


def stop_page_table(stops: pd.DataFrame) -> Table:
    """Numbers of releases by kind of stop."""
    counts = stop_counts(stops)
    rows = [(str(block), *(str(n) for n in by_stop)) for block, by_stop in counts.iterrows()]
    return Table(("block", *map(str, counts.columns)), rows)


def reach_page_table(reach: pd.DataFrame, held: bool) -> Table:
    """Angle of reach and energy line angle; `held`: whether the ground has an embankment."""
    rows = []
    for r in _rows(reach):
        most = "≤ " if r.not_stopped else ""
        angles = (three_digits(r.least_deg), with_interval(r.exceeded_by_95_deg, r.low95_deg, r.high95_deg))
        rows.append((r.block, ANGLES[r.angle], str(r.left_source), str(r.not_stopped),
                     *(f"{most}{angle}°" if angle[0] != "-" else "-" for angle in angles)))  # fmt: skip
    note = (
        "Slope of the line from the start of a block (energy line: from its energy head there) to its end, for blocks "
        f"that left their source. {USUAL_REACH}"
    )
    if held:
        note += " The embankment stops blocks that would run farther: compare a run without it."
    if reach["not_stopped"].any():
        note += " ≤: some blocks left the cross-section or were cut short; they would run farther."
    head = ("block", "angle", "left source", "not stopped", "flattest", "95 % of blocks stop above")
    return Table(head, rows, "Angle of reach", note, data_of("reach.csv", reach))


def percentile_page_table(percentiles: pd.DataFrame) -> Table:
    """Percentiles of the blocks that pass each line."""
    rows = [
        (r.line, r.block, NAME_OF_QUANTITY[r.quantity], f"{r.percentile:g} %", str(r.passed),
         quantity_text(r.quantity, r.value, r.low95, r.high95))
        for r in _rows(percentiles.dropna(subset="value"))
    ]  # fmt: skip
    return Table(
        ("line", "block", "quantity", "percentile", "passed", "value [95 % interval]"), rows,
        note="Intervals: sampling only, distribution-free. Percentiles of too few blocks are left out.",
        data=data_of("percentiles.csv", percentiles),
    )  # fmt: skip


def design_value_page_table(values: pd.DataFrame) -> Table:
    """Design values by norm."""
    rows = [
        (r.line, r.block, r.norm, NAME_OF_QUANTITY[r.quantity],
         quantity_text(r.quantity, r.characteristic, r.characteristic_low95, r.characteristic_high95),
         quantity_text(r.quantity, r.design, r.low95, r.high95), "not verified" if r.not_verified else "verified",
         r.factors)
        for r in _rows(values)
    ]  # fmt: skip
    return Table(
        ("line", "block", "norm", "quantity", "characteristic (95 %)", "design value", "verified", "factors"), rows,
        data=data_of("design_values.csv", values),
    )  # fmt: skip


def norm_page_table(scenario: Scenario) -> Table:
    """The numbers of the norms, and their sources."""
    return Table(
        ("norm", "number", "here", "of the norm", "source 1", "source 2", "verified"), norm_table(scenario),
        "Numbers of the norms",
        note="Verified: two independent published sources give the values. They were not compared with the norms. "
        + " ".join(f"{name}: {source}." for name, source in SOURCES.items()),
    )  # fmt: skip


def uncertain_page_table(uncertain: pd.DataFrame) -> Table:
    """Results over all possible sites."""
    rows = []
    for r in _rows(uncertain.dropna(subset="value")):
        base = str(r.quantity).removesuffix("_95")
        shown = (
            f"{with_interval(r.value, r.low95, r.high95, 100.0)} %"
            if base in SHARES
            else quantity_text(base, r.value, r.low95, r.high95)
        )
        share = "" if np.isnan(r.share_not_known) else f"{100 * r.share_not_known:.0f} %"
        rows.append((r.line, r.block, NAME_OF_QUANTITY[base] + ("" if base in SHARES else ", 95 %"), shown, share))
    return Table(
        ("line", "block", "quantity", "median [95 % interval]", "not known"), rows,
        note="Not known: share of the variance from what is not known about the site; the rest is sampling.",
        data=data_of("uncertainty.csv", uncertain),
    )  # fmt: skip


def model_page_table(models: pd.DataFrame, name: str) -> Table:
    """Passing frequencies, energy and height with each of several models; `name`: file name of the full table."""
    rows = []
    for row in models.to_dict("records"):
        shares = [with_interval(*(100.0 * row[n] for n in names)) for names in COLUMNS_OF_SHARE.values()]
        loads = [quantity_text(name, *(row[n] for n in names)) for name, names in COLUMNS_OF_QUANTITY.items()]
        rows.append((row["line"], row["block"], row["model"], *shares, *loads))
    return Table(
        ("line", "block", "model", "% of released", "% of arriving", "energy, 95 %", "passing height, 95 %"), rows,
        note="The same releases with every model. Intervals: sampling only. A dash: too few blocks pass.",
        data=data_of(name, models),
    )  # fmt: skip


def model_text(table: pd.DataFrame, what: str, note: str = "") -> str:
    """`model_page_table` as text."""
    import pandas as pd

    if not len(table):
        return f"{what}: no measure line to compare at"
    shown = model_page_table(table, "")
    text = pd.DataFrame(list(shown.rows), columns=list(shown.head)).to_string(index=False)
    head = f"{what}, same releases: value [95 % interval of sampling]"
    return f"{head}{f'; {note}' if note else ''}\n{text}"


def block_page_table(scenario: Scenario) -> Table:
    """The blocks."""
    rows = [
        (name, "population, median" if name in scenario.populations else block.shape,
         f"{three_digits(block.size_m)} m", f"{three_digits(block.mass_kg)} kg",
         f"{three_digits(block.inertia_kg_m2)} kg m²")
        for name, block in scenario.make_blocks().items()
    ]  # fmt: skip
    head = ("block", "shape", "size", "mass", "moment of inertia")
    return Table(head, rows, "Blocks", "Size: diameter of the circle of equal area.")


def parameter_tables(scenario: Scenario, engine: str) -> list[Table]:
    """Parameters of the law of the engine in every zone, one table for blocks with the same parameters; and the sources
    of soil classes."""
    zones = scenario.make_cross_section().zone_names
    groups: dict[tuple[Any, ...], list[str]] = {}  # parameters in each zone, and the blocks that have them
    for block in scenario.make_blocks().values():
        of_zone = engine_named(engine).parameters(scenario, block)
        groups.setdefault(tuple(of_zone.get(zone) or of_zone["default"] for zone in zones), []).append(block.name)
    tables, found = [], scenario.diagnosed
    note = "" if found is None or found.fitted else f"What the scenario does not state is {found.soil_in_words}."
    for own, blocks in groups.items():
        rows = [(zone, *map(_parameter, astuple(values))) for zone, values in zip(zones, own, strict=True)]
        title = f"Parameters of the {engine_named(engine).law} law"
        title += f": {', '.join(blocks)}" if len(groups) > 1 else ""
        tables.append(Table(("zone", *(field.name for field in fields(own[0]))), rows, title, note))
    if scenario.model.soils:
        tables.append(_soil_sources(scenario))
    return tables


def _parameter(value: Any) -> str:
    if isinstance(value, bool):
        return "yes" if value else "no"
    return value if isinstance(value, str) else three_digits(float(value))


def _soil_sources(scenario: Scenario) -> Table:
    rows = []
    for zone, given in (scenario.model.soils or {}).items():
        soil = SOIL_CLASSES[given if isinstance(given, str) else given.like]
        changed = "" if isinstance(given, str) else " (with numbers of this file)"
        rows.append((zone, soil.name + changed, soil.source, soil.assumed))
    return Table(("zone", "soil class", "source", "assumed"), rows, "Soil classes")
