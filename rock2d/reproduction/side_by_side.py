"""Table 2 next to simulations of a scenario: the experiment, the paper's two models and both laws of this project."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from rock2d.files.scenario import Scenario
from rock2d.reproduction import published, summary
from rock2d.runs.before_after import Model, model_table

if TYPE_CHECKING:
    import pandas as pd

ENGINE_OF_MODEL = {"deterministic": "batch", "probabilistic": "point_mass"}
RELEASES = 2000  # of each block; the half-width of an exact interval is then at most 2.2 points


def side_by_side(scenario: Scenario, releases: int = RELEASES) -> pd.DataFrame:
    """Passing frequencies in %, one row for each block and line of the paper.

    Columns: experiment, paper_deterministic and paper_probabilistic are published, with the exact 95 % intervals
    (low95, high95) of 50 releases. deterministic and probabilistic are simulated, with the intervals of `releases`.
    deterministic_agrees and probabilistic_agrees: whether they lie in the interval of the paper's model
    (`summary.agrees`).

    Raises KeyError if the scenario lacks a block or a line of the paper.
    """
    import pandas as pd

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
