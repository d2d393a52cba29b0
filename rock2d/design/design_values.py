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

    `percentiles` is the table of a run or a campaign, whose intervals are those of sampling. Where there is a table of
    the possible sites (`uncertain`), its values and intervals take their place. The mass is that of
    `Scenario.design_block`. `not_verified` names the numbers of the norm that hardly any source states.
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
    """Norm, number, value of the scenario, values that the norm is said to give, two sources, and whether it is
    verified; one row a number of NORM_NUMBERS."""
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
    """One line on the numbers of the norms that are not verified; none if there are none."""
    unsure = {norm: not_verified(norm, given) for norm, given in _given(scenario).items()}
    said = "; ".join(f"{norm}: {', '.join(names)}" for norm, names in unsure.items() if names)
    if not said:
        return []
    return [
        f"design values: not verified by two published sources: {said}. Compare them with the norm; what is set under "
        "design_values counts as compared"
    ]


def _given(scenario: Scenario) -> dict[str, set[str]]:
    """Norm -> factors that the scenario gives."""
    keys = scenario.design_values
    return {UNI: keys.uni_11211_4.model_fields_set, ONR: keys.onr_24810.model_fields_set}


def demands(
    percentiles: pd.DataFrame, uncertain: pd.DataFrame | None = None
) -> dict[tuple[int | None, str], tuple[str, Estimate]]:
    """What each embankment must take: its number (None if there is one) and "kinetic_J" or "passing_height_m" -> the
    block with the largest 95th percentile at its arrival line, and that percentile; {} without such a line."""
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
    """(block, line) -> quantity -> 95th percentile, where there are all of them; see `design_table`."""
    if uncertain is None:
        own = percentiles[percentiles["percentile"] == CHARACTERISTIC_PERCENTILE]
    else:
        suffix = f"_{CHARACTERISTIC_PERCENTILE:g}"
        own = uncertain[uncertain["quantity"].isin([f"{q}{suffix}" for q in QUANTITIES])].dropna(
            subset="value"
        )
        own = own.assign(quantity=own["quantity"].str.removesuffix(suffix))
    found: dict[tuple[str, str], dict[str, Estimate]] = {}
    columns = ("block", "line", "quantity", "value", "low95", "high95")
    for name, line, quantity, *numbers in own[list(columns)].itertuples(index=False):
        found.setdefault((name, line), {})[quantity] = Estimate(*map(float, numbers))
    return {key: of for key, of in found.items() if len(of) == len(QUANTITIES)}
