"""Design values of a scenario at its measure lines, by the norms of `rock2d.design.norms`."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from rock2d.design.norms import (
    CHARACTERISTIC_PERCENTILE,
    NORM_NUMBERS,
    ONR,
    UNI,
    not_verified,
    onr_24810,
    uni_11211_4,
)
from rock2d.files.scenario import Scenario
from rock2d.runs.indicators.percentiles import QUANTITIES
from rock2d.scene.earthworks import ARRIVAL_LINE, is_line, number_of_line
from rock2d.statistics import Estimate

if TYPE_CHECKING:
    import pandas as pd

DESIGN_COLUMNS = (
    "block", "line", "norm", "quantity", "characteristic", "characteristic_low95", "characteristic_high95", "factors",
    "design", "low95", "high95", "not_verified",
)  # fmt: skip


def design_table(
    scenario: Scenario, percentiles: pd.DataFrame, uncertain: pd.DataFrame | None = None
) -> pd.DataFrame:
    """Design values of every block at every line that it passes; DESIGN_COLUMNS.

    `percentiles` is the table of a run or a campaign, with intervals of sampling. If there is a table over the possible
    sites (`uncertain`), its values and intervals are used instead. The mass is that of `Scenario.design_block`.
    `not_verified` names the numbers of the norm that too few sources confirm.
    """
    import pandas as pd

    uni, onr = scenario.design_values.uni_11211_4, scenario.design_values.onr_24810
    open_numbers, rows = {norm: not_verified(norm, given) for norm, given in _given(scenario).items()}, []
    for (name, line), at_line in characteristic_values(percentiles, uncertain).items():
        block = scenario.design_block(name)
        for found in (
            *uni_11211_4(at_line, block.mass_kg, block.size_m, uni), *onr_24810(at_line, onr)
        ):  # fmt: skip
            unsure = ", ".join(number for number in found.uses if number in open_numbers[found.norm])
            rows.append(
                (name, line, found.norm, found.quantity, *found.characteristic, found.factors, *found.design,
                 unsure)
            )  # fmt: skip
    return pd.DataFrame(rows, columns=list(DESIGN_COLUMNS))


def norm_table(scenario: Scenario) -> list[tuple[str, ...]]:
    """One row for each of NORM_NUMBERS: norm, number, value in the scenario, values of the norm according to the
    sources, two sources, and whether it is verified."""
    given, rows = _given(scenario), []
    values = {UNI: scenario.design_values.uni_11211_4, ONR: scenario.design_values.onr_24810}
    for number in NORM_NUMBERS:
        found = getattr(values[number.norm], number.name, None)
        value = "" if found is None else f"{found:g}"
        sources = (*number.sources, "none", "none")[:2]
        state = "verified" if number.verified else "not verified"
        state = "set in the scenario" if number.name in given[number.norm] else state
        rows.append((number.norm, number.name, value, number.values, *sources, state))
    return rows


def norm_remarks(scenario: Scenario) -> list[str]:
    """One line on the numbers of the norms that are not verified; empty if there are none."""
    unsure = {norm: not_verified(norm, given) for norm, given in _given(scenario).items()}
    text = "; ".join(f"{norm}: {', '.join(names)}" for norm, names in unsure.items() if names)
    if not text:
        return []
    return [
        f"design values: not verified by two published sources: {text}. Compare them with the norm; numbers that are "
        "set under design_values count as compared"
    ]


def _given(scenario: Scenario) -> dict[str, set[str]]:
    """Norm -> factors that the scenario gives."""
    keys = scenario.design_values
    return {UNI: keys.uni_11211_4.model_fields_set, ONR: keys.onr_24810.model_fields_set}


def demands(
    percentiles: pd.DataFrame, uncertain: pd.DataFrame | None = None
) -> dict[tuple[int | None, str], tuple[str, Estimate]]:
    """What each embankment must withstand: (its number, or None if there is only one; "kinetic_J" or
    "passing_height_m") -> (block with the largest 95th percentile at its arrival line, that percentile). Empty without
    an arrival line."""
    found = characteristic_values(percentiles, uncertain)
    out: dict[tuple[int | None, str], tuple[str, Estimate]] = {}
    for line in dict.fromkeys(line for _, line in found if is_line(line, ARRIVAL_LINE)):
        for quantity in ("kinetic_J", "passing_height_m"):
            arriving = {block: own[quantity] for (block, at), own in found.items() if at == line}
            block = max(arriving, key=lambda name: np.nan_to_num(arriving[name].value, nan=-np.inf))
            out[number_of_line(line), quantity] = block, arriving[block]
    return out


def characteristic_values(
    percentiles: pd.DataFrame, uncertain: pd.DataFrame | None
) -> dict[tuple[str, str], dict[str, Estimate]]:
    """(block, line) -> quantity -> 95th percentile, if all quantities have one; see `design_table`."""
    if uncertain is None:
        rows = percentiles[percentiles["percentile"] == CHARACTERISTIC_PERCENTILE]
    else:
        suffix = f"_{CHARACTERISTIC_PERCENTILE:g}"
        rows = uncertain[uncertain["quantity"].isin([f"{q}{suffix}" for q in QUANTITIES])].dropna(
            subset="value"
        )
        rows = rows.assign(quantity=rows["quantity"].str.removesuffix(suffix))
    found: dict[tuple[str, str], dict[str, Estimate]] = {}
    columns = ("block", "line", "quantity", "value", "low95", "high95")
    for name, line, quantity, *numbers in rows[list(columns)].itertuples(index=False):
        found.setdefault((name, line), {})[quantity] = Estimate(*map(float, numbers))
    return {key: values for key, values in found.items() if len(values) == len(QUANTITIES)}
