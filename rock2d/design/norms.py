"""Design values of a scenario at its measure lines by two norms: characteristic percentiles times partial factors.

UNI 11211-4:2012, Opere di difesa dalla caduta massi, part 4, after D. Peila and C. Ronco, Nat. Hazards Earth Syst. Sci.
9 (2009) 1291; ONR 24810:2017, Technischer Steinschlagschutz. The numbers were not compared with the texts of the norms,
and there are later editions, UNI 11211-4:2018 and ONR 24810:2021. NORM_NUMBERS lists the published sources of each
number; a number is verified if two independent sources agree."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from rock2d.files.scenario import Scenario
from rock2d.files.scenario_keys import OnrKeys, UniKeys
from rock2d.runs.indicators.passing import LINE_QUANTITIES
from rock2d.scene.earthworks import ARRIVAL_LINE, is_line, number_of_line
from rock2d.statistics import DESIGN_PERCENTILE, Estimate

if TYPE_CHECKING:
    import pandas as pd

DESIGN_COLUMNS = (
    "block", "line", "norm", "quantity", "characteristic", "characteristic_low95", "characteristic_high95", "factors",
    "design", "low95", "high95", "not_verified",
)  # fmt: skip
LEAST_FREEBOARD_M = 0.5


class DesignValue(NamedTuple):
    """A design value.

    Attributes
    ----------
    quantity : name with the unit at its end
    factors : the partial factors, in words and numbers
    uses : names in NORM_NUMBERS of the numbers that it uses"""

    norm: str
    quantity: str
    characteristic: Estimate
    factors: str
    design: Estimate
    uses: tuple[str, ...]


UNI, ONR = "UNI 11211-4", "ONR 24810"
ROCFALL = "RocFall help"
MARCHELLI = "Marchelli 2022"
SOURCES = {
    ROCFALL: "Rocscience, RocFall help, Verification following UNI 11211-4 (UNI11211 Design Page), which cites "
    "UNI 11211-4:2012; scribd.com/document/615855522",
    MARCHELLI: "M. Marchelli (2022), A design method for double line of rockfall net fences in the framework of "
    "probabilistic trajectory analyses, Geoingegneria e attività estrattiva 166, "
    "doi 10.19199/2022.166.1121-9041.019, on UNI 11211-4:2018 and ONR 24810:2021",
}


class NormNumber(NamedTuple):
    """A number of a norm, and its published sources.

    Attributes
    ----------
    name : key under design_values in a scenario, or its name in words if it has no key
    values : values of the norm according to the sources
    sources : keys of SOURCES that state these values"""

    norm: str
    name: str
    values: str
    sources: tuple[str, ...] = ()

    @property
    def verified(self) -> bool:
        return len(self.sources) >= FEWEST_SOURCES


FEWEST_SOURCES = 2
PERCENTILE, FREEBOARD = "percentile", "freeboard"
NORM_NUMBERS = (
    NormNumber(UNI, PERCENTILE, "95 (Marchelli: 95 or 99)", (ROCFALL, MARCHELLI)),
    NormNumber(UNI, "gamma_tr", "1.02 calibrated, 1.10 from literature", (ROCFALL,)),
    NormNumber(UNI, "gamma_dp", "1.02 good survey, 1.10 poor", (ROCFALL,)),
    NormNumber(UNI, "gamma_vol", "1.02 good survey, 1.10 poor", (ROCFALL,)),
    NormNumber(UNI, "gamma_gamma", "1.00", (ROCFALL,)),
    NormNumber(UNI, "gamma_r", "1.00 to 1.20"),
    NormNumber(UNI, FREEBOARD, "half the block, at least 0.5 m", (ROCFALL,)),
    NormNumber(ONR, PERCENTILE, "95 (Marchelli: 95 or 99)", (MARCHELLI,)),
    NormNumber(ONR, "gamma_e", "CC1 1.00, CC2 1.05, CC3 1.15"),
    NormNumber(ONR, "gamma_h", "CC1 1.05, CC2 1.10, CC3 1.30"),
)


def uni_11211_4(at_line: Mapping[str, Estimate], mass_kg: float, size_m: float, factors: UniKeys) -> list[DesignValue]:
    """Design velocity, mass, energy and height at a line.

    Parameters
    ----------
    at_line : "speed_m_s" and "passing_height_m" -> 95th percentile of the blocks that pass
    mass_kg, size_m : mass and size of the design block
    factors : partial factors

    v_d = v_95 γTr γDp; m_d = m γVol γγ; E_d = γR ½ m_d v_d²; H_d = H_95 γTr γDp + f, with the freeboard f the radius of
    the block and at least 0.5 m."""
    f, norm = factors, UNI
    paths, masses = f.gamma_tr * f.gamma_dp, f.gamma_vol * f.gamma_gamma
    speed, height = at_line["speed_m_s"], at_line["passing_height_m"]
    fast = speed.times(paths)
    heavy = mass_kg * masses
    energy = Estimate(*(f.gamma_r * 0.5 * heavy * v**2 for v in fast))
    plain = Estimate(*(0.5 * mass_kg * v**2 for v in speed))
    freeboard = max(0.5 * size_m, LEAST_FREEBOARD_M)
    on_paths = f"gamma_Tr {f.gamma_tr:g} x gamma_Dp {f.gamma_dp:g}"
    on_mass = f"gamma_Vol {f.gamma_vol:g} x gamma_gamma {f.gamma_gamma:g}"
    of_paths, of_mass = (PERCENTILE, "gamma_tr", "gamma_dp"), ("gamma_vol", "gamma_gamma")
    return [
        DesignValue(norm, "speed_m_s", speed, on_paths, fast, of_paths),
        DesignValue(
            norm, "mass_kg", Estimate(mass_kg, mass_kg, mass_kg), on_mass, Estimate(heavy, heavy, heavy), of_mass
        ),
        DesignValue(
            norm, "energy_J", plain, f"gamma_R {f.gamma_r:g} x {on_mass} x ({on_paths})^2", energy,
            (*of_paths, *of_mass, "gamma_r"),
        ),
        DesignValue(
            norm, "height_m", height, f"{on_paths}, + freeboard {freeboard:.3g} m",
            height.times(paths).plus(freeboard), (*of_paths, FREEBOARD),
        ),
    ]  # fmt: skip


def onr_24810(at_line: Mapping[str, Estimate], factors: OnrKeys) -> list[DesignValue]:
    """Design energy and height at a line: E_d = E_95 γE, H_d = H_95 γH; `at_line` has "kinetic_J" and
    "passing_height_m"."""
    norm, energy, height = ONR, at_line["kinetic_J"], at_line["passing_height_m"]
    return [
        DesignValue(norm, "energy_J", energy, f"gamma_E {factors.gamma_e:g}", energy.times(factors.gamma_e),
                    (PERCENTILE, "gamma_e")),
        DesignValue(norm, "height_m", height, f"gamma_H {factors.gamma_h:g}", height.times(factors.gamma_h),
                    (PERCENTILE, "gamma_h")),
    ]  # fmt: skip


def design_table(scenario: Scenario, percentiles: pd.DataFrame, uncertain: pd.DataFrame | None = None) -> pd.DataFrame:
    """Design values of every block at every line that it passes; DESIGN_COLUMNS.

    `percentiles` is the table of a run or a campaign, with intervals of sampling. If there is a table over the possible
    sites (`uncertain`), its values and intervals are used instead. The mass is that of `Scenario.design_block`.
    `not_verified` names the numbers of the norm that too few sources confirm."""
    import pandas as pd

    uni, onr = scenario.design_values.uni_11211_4, scenario.design_values.onr_24810
    open_numbers, rows = not_verified(scenario), []
    for (name, line), at_line in characteristic_values(percentiles, uncertain).items():
        block = scenario.design_block(name)
        values = [*uni_11211_4(at_line, block.mass_kg, block.size_m, uni), *onr_24810(at_line, onr)]
        for found in values:
            unsure = ", ".join(number for number in found.uses if number in open_numbers[found.norm])
            rows.append(
                (name, line, found.norm, found.quantity, *found.characteristic, found.factors, *found.design, unsure)
            )
    return pd.DataFrame(rows, columns=list(DESIGN_COLUMNS))


def norm_table(scenario: Scenario) -> list[tuple[str, ...]]:
    """One row for each of NORM_NUMBERS: norm, number, value in the scenario, values of the norm according to the
    sources, two sources, and whether it is verified."""
    keys, rows = _keys(scenario), []
    for number in NORM_NUMBERS:
        found = getattr(keys[number.norm], number.name, None)
        value = "" if found is None else f"{found:g}"
        sources = (*number.sources, "none", "none")[:2]
        state = "verified" if number.verified else "not verified"
        state = "set in the scenario" if number.name in keys[number.norm].model_fields_set else state
        rows.append((number.norm, number.name, value, number.values, *sources, state))
    return rows


def norm_remarks(scenario: Scenario) -> list[str]:
    """One line on the numbers of the norms that are not verified; empty if there are none."""
    text = "; ".join(f"{norm}: {', '.join(names)}" for norm, names in not_verified(scenario).items() if names)
    if not text:
        return []
    return [
        f"design values: not verified by two published sources: {text}. Compare them with the norm; numbers that are "
        "set under design_values count as compared"
    ]


def not_verified(scenario: Scenario) -> dict[str, list[str]]:
    """Norm -> names of its numbers with fewer than FEWEST_SOURCES sources, without those that the scenario gives."""
    return {
        norm: [n.name for n in NORM_NUMBERS if n.norm == norm and not n.verified and n.name not in own.model_fields_set]
        for norm, own in _keys(scenario).items()
    }


def _keys(scenario: Scenario) -> dict[str, UniKeys | OnrKeys]:
    return {UNI: scenario.design_values.uni_11211_4, ONR: scenario.design_values.onr_24810}


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
        rows = percentiles[percentiles["percentile"] == DESIGN_PERCENTILE]
    else:
        suffix = f"_{DESIGN_PERCENTILE:g}"
        characteristic = uncertain["quantity"].isin([f"{q}{suffix}" for q in LINE_QUANTITIES])
        rows = uncertain[characteristic].dropna(subset="value")
        rows = rows.assign(quantity=rows["quantity"].str.removesuffix(suffix))
    found: dict[tuple[str, str], dict[str, Estimate]] = {}
    columns = ("block", "line", "quantity", "value", "low95", "high95")
    for name, line, quantity, *numbers in rows[list(columns)].itertuples(index=False):
        found.setdefault((name, line), {})[quantity] = Estimate(*map(float, numbers))
    return {key: values for key, values in found.items() if len(values) == len(LINE_QUANTITIES)}
