"""`rock2d design` over several numbers: the least size for low, middle and high of each of the others."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rock2d.design.command import run_design
from rock2d.design.least_size import Answer, Target
from rock2d.errors import InputError
from rock2d.files.folders import write_whole
from rock2d.files.scenario import load_scenario
from rock2d.files.scenario_variants import variant

if TYPE_CHECKING:
    import pandas as pd

VALUES_OF_A_RANGE = 3
MOST_COMBINATIONS = 27
TABLE = "combinations.csv"


def run_combinations(
    path: Path,
    place: str,
    bounds: tuple[float, float],
    others: Sequence[tuple[str, float, float]],
    target: Target,
    out: Path,
    *,
    overwrite: bool = False,
    report: Callable[[str], Any] = print,
    **options: Any,
) -> list[tuple[dict[str, float], Answer]]:
    """Find the least size for every combination of low, middle and high of the `others` (place, low, high).

    Writes a folder `out` with combinations.csv and a folder of `run_design`, whose `options` are taken, for each.
    Combinations that were found before an interruption are kept.

    Returns the values of the others and the answer of each combination. Raises InputError for a mistake in the scenario
    or the question.
    """
    scenario = load_scenario(path)
    grids = [
        [(name, low + (high - low) * i / (VALUES_OF_A_RANGE - 1)) for i in range(VALUES_OF_A_RANGE)]
        for name, low, high in others
    ]
    combinations = [dict(values) for values in itertools.product(*grids)]
    if len(combinations) > MOST_COMBINATIONS:
        raise InputError(
            f"{len(combinations)} combinations are too many: vary up to 3 numbers beside {place}"
        )
    if any(name == place for name, _, _ in others):
        raise InputError(f"{place} is sought and varied over, too")
    for values in combinations:
        variant(scenario, values)  # a value that makes no sense is refused before any work
    folders = [
        out / "_".join(f"{name.rpartition('.')[2]}_{v:g}" for name, v in c.items()) for c in combinations
    ]
    found = []
    for values, folder in zip(combinations, folders, strict=True):
        report("\n" + ", ".join(f"{name} = {value:g}" for name, value in values.items()))
        answer = run_design(
            path, place, bounds, target, folder, overwrite=overwrite, changed=values, report=report, **options
        )
        found.append((values, answer))
        write_whole(out / TABLE, combination_table(place, found).to_csv(index=False, lineterminator="\n"))
    report("\n" + combination_table(place, found).to_string(index=False, na_rep="none"))
    report(f"written: {out}")
    return found


def combination_table(place: str, found: Sequence[tuple[dict[str, float], Answer]]) -> pd.DataFrame:
    """A row for each combination: the values, and the least size (NaN if none of the range holds)."""
    import pandas as pd

    return pd.DataFrame([{**values, f"least {place}": answer.least} for values, answer in found]).astype(
        float
    )
