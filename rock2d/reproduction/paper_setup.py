"""The set-up and arrivals under which Tables 3 and 4 agree best with the paper's columns, as a scenario file; and
Table 2 next to simulations of a scenario."""

import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd

from rock2d.arrays import Array
from rock2d.files.scenario import Scenario
from rock2d.files.setup_keys import block_keys
from rock2d.records.columns import STATE_NAMES
from rock2d.reproduction import published, summary
from rock2d.reproduction.hypotheses import (
    DOWNHILL_FACE_DEG,
    Values,
    hypothesis_cross_section,
    incident_distributions,
    table_3,
)
from rock2d.reproduction.likelihood import log_counts
from rock2d.reproduction.outcomes import TIME_LIMIT_S, Outcome, probabilistic_outcome
from rock2d.runs.model_comparison import Model, model_table
from rock2d.wording import listed

SCENARIO_FILE = "paper_setup.yaml"
NAME = "paper_setup"
LENGTH_DECIMALS = 4  # 0.1 mm
# state -> decimals of its mean and standard deviation
STATE_DECIMALS = dict(zip(STATE_NAMES, (LENGTH_DECIMALS, LENGTH_DECIMALS, 3, 3, 3, 1), strict=True))
LINE_CHARACTERS = 120
ENGINE_OF_MODEL = {"deterministic": "batch", "probabilistic": "point_mass"}
TABLE_2_RELEASES = 2000  # of each block; the half-width of an exact interval is then at most 2.2 points


@dataclass(frozen=True)
class FoundSetup:
    """The best hypothesis.

    Attributes
    ----------
    place : index of the hypothesis
    of : number of hypotheses
    releases : simulated releases of each block
    agrees : model -> (blocks, lines) whether the simulated frequency agrees with the paper's, see `summary.agrees`
    reached : model -> (2, blocks, lines) lowest and highest simulated frequency of all hypotheses, in %"""

    place: int
    of: int
    releases: int
    agrees: Mapping[str, Array]
    reached: Mapping[str, Array]

    def met(self) -> str:
        """The number of cells of each column that agree, and the names of the others."""
        return "; ".join(f"{model} {met_cells(own)}" for model, own in self.agrees.items())

    def missed(self) -> list[str]:
        """For each cell that does not agree, the range of all hypotheses."""
        return [
            f"{published.BLOCKS[b]} {published.LINES[i]}, {model}: {published.COLUMNS[model][b, i]} % in the paper, "
            f"{self.reached[model][0, b, i]:.0f} to {self.reached[model][1, b, i]:.0f} % over all hypotheses"
            for model, own in self.agrees.items()
            for b, i in np.argwhere(~own)
        ]


def met_cells(agrees: Array) -> str:
    """The number of cells (blocks, lines) of a column that agree, and the names of the others."""
    off = [f"{published.BLOCKS[b]} {published.LINES[i]}" for b, i in np.argwhere(~agrees)]
    return f"{agrees.sum()} of {agrees.size}" + (f" (not {listed(off)})" if off else "")


def found_setup(values: Values, with_table_4: list[Outcome], draws: Mapping[str, Array]) -> FoundSetup:
    """The hypothesis with which most cells of the deterministic column agree. Among equals, the one with most cells of
    the probabilistic column; among equals, the one with the highest likelihood of both.

    `with_table_4`: outcomes of the three blocks under Table 4, from the standard normal `draws`."""
    ones = np.ones(len(values["slope_deg"]))
    with_table_3 = [
        probabilistic_outcome(table_3(values), block, draws[block], published.SLOPE_REDUCTION_DEG[block] * ones)
        for block in published.BLOCKS
    ]
    likely, agrees, reached = np.zeros(len(ones)), dict[str, Array](), dict[str, Array]()
    for model, outcomes in (("deterministic", with_table_4), ("probabilistic", with_table_3)):
        column, percent = published.COLUMNS[model], np.stack([100 * o.frequencies for o in outcomes], axis=1)
        agrees[model] = summary.agrees(percent, column)
        reached[model] = np.stack([percent.min(axis=0), percent.max(axis=0)])
        for block, outcome in zip(published.BLOCKS, outcomes, strict=True):
            likely += log_counts(outcome.by_last_line, published.counts_by_last_line(column, block))
    met = {model: own.sum(axis=(1, 2)) for model, own in agrees.items()}
    best = int(np.lexsort((likely, met["probabilistic"], met["deterministic"]))[-1])
    releases = with_table_4[0].crossed.shape[1]
    return FoundSetup(best, len(ones), releases, {model: own[best] for model, own in agrees.items()}, reached)


def scenario_text(values: Values, found: FoundSetup, seed: int) -> str:
    """A found set-up as a scenario file (YAML) with rounded numbers."""
    ground = hypothesis_cross_section(values, found.place)
    keys = {
        "name": NAME,
        "about": "The paper's sphere, cube and parallelepiped against its ditch and embankment, with both impact laws.",
        "assumed": _assumed(values, found, seed),
        "gravity_m_s2": float(published.GRAVITY_M_S2),
        "engine": "pymunk",
        "releases": published.RELEASES,
        "seed": int(seed),
        "time_limit_s": TIME_LIMIT_S,
        "cross_section": {
            "points_m": _lengths(ground.points_m),
            "zones": list(ground.zones),
            "measure_lines": {line: _lengths(ends) for line, ends in ground.measure_lines.items()},
        },
        "blocks": {block: block_keys(published.SETUP_BLOCKS[block]) for block in published.BLOCKS},
        "model": {
            "deterministic": {"default": {**published.CONTACT_PARAMETERS, "rolling_cap": False}},
            "probabilistic": _table_3(),
        },
        "incident": {block: {"distribution": _arrival(values, found.place, block)} for block in published.BLOCKS},
        "outputs": {"fps": 1000, "position_noise_m": 0, "angle_noise_rad": 0, "slow_motion": 20, "video_releases": 3},
    }
    head = f"# Written by `rock2d reproduce --seed {seed}`."
    return "\n".join([head, *_lines(keys, 0), ""])


def _assumed(values: Values, found: FoundSetup, seed: int) -> list[str]:
    """The entries of the key `assumed`: how set-up and arrivals were found, and the assumptions."""
    tilt = float(values["line_tilt_deg"][found.place])
    missed = "; ".join(found.missed())
    return [
        "Set-up and arrivals, of which the paper gives the embankment's height and crest, the blocks and the drop: "
        f"`rock2d reproduce --seed {seed}` found {found.of} hypotheses that explain the paper's deterministic column "
        "with Table 4, the text on first impacts and the filmed spheres. This one meets most cells of that "
        "column, of these most of the probabilistic column with Table 3, of these both are likeliest.",
        f"Cells met, {found.releases} releases to the exact 95 % interval of the paper's {published.RELEASES}: "
        f"{found.met()}.{f' Not met: {missed}.' if missed else ''}",
        f"Measure lines: straight, {tilt:.0f} deg from upright, over the ditch.",
        f"Downhill facing: {DOWNHILL_FACE_DEG:.0f} deg; results do not depend on it.",
        "Releases start where they leave the slope for the last time. States are normal; x is uniform with the same "
        "standard deviation, so that no block starts inside the slope.",
        "The paper's simulated and its filmed releases are independent draws of one distribution.",
        *published.MEANINGS,
        "Inertia: the sphere a ball, cube and parallelepiped uniform. Table 1's masses are used; its densities "
        "contradict them.",
        "Deterministic law: one set of parameters (Table 4) for all zones; no cap on the rolling moment.",
        "Probabilistic law: zones other than ditch and uphill_face take the ditch's parameters; slope reduction "
        "constant.",
    ]


def _lengths(points_m: Array) -> list[list[float]]:
    return np.round(np.asarray(points_m, float), LENGTH_DECIMALS).tolist()


def _table_3() -> dict[str, Any]:
    zones: dict[str, dict[str, Any]] = {"ditch": {}, "uphill_face": {}}
    for name, value in published.REBOUND_PARAMETERS.items():
        zone, key = name.split(".")
        zones["ditch" if zone == "ditch" else "uphill_face"][key] = value
    default = {**zones["ditch"], "slope_reduction_deg": 0.0, "slope_reduction": "constant"}
    return {"default": {"default": default, **zones}} | {
        block: {"default": {"slope_reduction_deg": alpha}}
        for block, alpha in published.SLOPE_REDUCTION_DEG.items()
        if alpha > 0
    }


def _arrival(values: Values, place: int, block: str) -> dict[str, Any]:
    """The keys of the distributions of the incident state of a block."""
    incident = incident_distributions(values, published.SETUP_BLOCKS[block])
    found: dict[str, Any] = {}
    for key, mean, sd in zip(STATE_NAMES, incident.mean[place], incident.sd[place], strict=True):
        decimals = STATE_DECIMALS[key]
        if sd == 0.0:
            found[key] = round(float(mean), decimals)
        elif key == "x_m":
            half = np.sqrt(3.0) * sd
            low, high = (round(float(end), decimals) for end in (mean - half, mean + half))
            found[key] = {"uniform": {"low": low, "high": high}}
        else:
            found[key] = {"normal": {"mean": round(float(mean), decimals), "sd": round(float(sd), decimals)}}
    return found


def _lines(value: dict[str, Any] | list[Any], indent: int) -> Iterator[str]:
    """The YAML lines of a mapping or a list; an item is on one line if it fits."""
    items = value.items() if isinstance(value, dict) else ((None, own) for own in value)
    for key, own in items:
        start = " " * indent + ("- " if key is None else f"{key}: ")
        line = start + _flow(own)
        if len(line) <= LINE_CHARACTERS or not isinstance(own, (dict, list)):
            yield line
        else:
            yield start.rstrip()
            yield from _lines(own, indent + 2)


def _flow(value: Any) -> str:
    """A value as YAML on one line."""
    if isinstance(value, dict):
        return "{" + ", ".join(f"{key}: {_flow(own)}" for key, own in value.items()) + "}"
    if isinstance(value, list):
        return "[" + ", ".join(map(_flow, value)) + "]"
    if isinstance(value, str) and not value.isidentifier():
        return json.dumps(value, ensure_ascii=False)
    if isinstance(value, bool):
        return str(value).lower()
    return f"{value:.10g}" if isinstance(value, float) else str(value)


def side_by_side(scenario: Scenario, releases: int = TABLE_2_RELEASES) -> pd.DataFrame:
    """Passing frequencies in %, one row for each block and line of the paper.

    Columns: experiment, paper_deterministic and paper_probabilistic are published, with the exact 95 % intervals
    (low95, high95) of 50 releases. deterministic and probabilistic are simulated, with the intervals of `releases`.
    deterministic_agrees and probabilistic_agrees: whether they lie in the interval of the paper's model
    (`summary.agrees`).

    Raises KeyError if the scenario lacks a block or a line of the paper."""
    columns = {"experiment": published.EXPERIMENT} | {
        f"paper_{model}": column for model, column in published.COLUMNS.items()
    }
    pairs = [(block, line) for block in published.BLOCKS for line in published.LINES]
    cells: dict[str, list[object]] = {"block": [b for b, _ in pairs], "line": [line for _, line in pairs]}
    for name, percent in columns.items():
        _add(cells, name, published.passed(percent), published.RELEASES)
    for model, column in published.COLUMNS.items():
        passed = simulated_passed(scenario, model, releases)
        _add(cells, model, passed, releases)
        cells[f"{model}_agrees"] = summary.agrees(100 * passed / releases, column).ravel().tolist()
    return pd.DataFrame(cells)


def simulated_passed(scenario: Scenario, model: str, releases: int) -> np.ndarray:
    """(blocks, lines) number of releases that pass each line with a model, out of `releases` of each block."""
    table = model_table([Model(model, scenario, ENGINE_OF_MODEL[model])], scenario.seed, releases)
    counts = table.set_index(["block", "line"])["passed"]
    return np.array([[counts[block, line] for line in published.LINES] for block in published.BLOCKS])


def _add(cells: dict[str, list[object]], name: str, passed: np.ndarray, releases: int) -> None:
    """Add the frequencies of `passed` (blocks, lines) out of `releases`, and their intervals, as columns."""
    flat = passed.ravel().tolist()
    cells[name] = [100 * count / releases for count in flat]
    bounds = [summary.clopper_pearson_interval(count, releases) for count in flat]
    cells[f"{name}_low95"], cells[f"{name}_high95"] = map(list, zip(*bounds, strict=True))
