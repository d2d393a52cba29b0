"""Passing frequencies and percentiles of the same releases with several models: with the law before and after a
diagnosis, or with other laws and soils."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from rock2d.effects import catalogue
from rock2d.files.scenario import Scenario
from rock2d.runs.acting_effects import ActingEffects
from rock2d.runs.campaigns.group_outcomes import group_outcome
from rock2d.runs.campaigns.job import crossings_job
from rock2d.runs.indicators.crossings import CROSSING_VALUES, crossing_values
from rock2d.runs.indicators.passing import PASSING_COLUMNS, passing_rows
from rock2d.statistics import DESIGN_PERCENTILE, percentile_estimate

if TYPE_CHECKING:
    import pandas as pd

MOST_COMPARED_RELEASES = 10_000  # largest number of releases of each block with each model
COLUMNS_OF_SHARE = {
    "frequency": ("frequency", "low95", "high95"),
    "per_arriving": ("per_arriving", "per_arriving_low95", "per_arriving_high95"),
}
COLUMNS_OF_QUANTITY = {
    "kinetic_J": ("kinetic_p95_J", "kinetic_p95_low95_J", "kinetic_p95_high95_J"),
    "passing_height_m": ("passing_height_p95_m", "passing_height_p95_low95_m", "passing_height_p95_high95_m"),
}
MODEL_COLUMNS = (
    "block", "line", "model", "p", *(name for name in PASSING_COLUMNS if name not in ("block", "line", "left_source")),
    *(name for names in COLUMNS_OF_QUANTITY.values() for name in names),
)  # fmt: skip


class Model(NamedTuple):
    """A scenario with an engine, its name in tables, and its probability if it has one."""

    name: str
    scenario: Scenario
    engine: str
    p: float = float("nan")


def diagnosed_models(scenario: Scenario, engine: str) -> list[Model]:
    """The scenario with the base law, and with each alternative of its diagnosis. Before an alternative whose effects
    act and whose soil differs from that of the base law stands its soil alone."""
    diagnosed = scenario.diagnosed
    assert diagnosed is not None
    models = [diagnosed.before]
    for found in diagnosed.alternatives:
        if ActingEffects.of(found, scenario).any_acts and found.soil != diagnosed.before.soil:
            camera = {name: own for name, own in found.effects.items() if catalogue()[name].camera}
            models.append(found._replace(name=found.name.replace("after", "soil"), effects=camera))
        models.append(found)
    return [Model(found.name, scenario.with_diagnosed(diagnosed.using(found)), engine, found.p) for found in models]


def model_table(models: Sequence[Model], seed: int, releases: int) -> pd.DataFrame:
    """MODEL_COLUMNS: passing frequencies and 95th percentiles of energy and height of each block at each line with each
    model, of at most MOST_COMPARED_RELEASES of each block, or of as many as were filmed. Releases of all models have
    the same random numbers. The batch engine replaces pymunk."""
    import pandas as pd

    rows = [row for model in models for row in _rows(model, seed, min(releases, MOST_COMPARED_RELEASES))]
    table = pd.DataFrame(rows, columns=list(MODEL_COLUMNS))
    order = {name: i for i, name in enumerate(dict.fromkeys(zip(table["block"], table["line"], strict=True)))}
    place = [order[key] for key in zip(table["block"], table["line"], strict=True)]
    return table.iloc[pd.Series(place, dtype=int).argsort(kind="stable")].reset_index(drop=True)


def _rows(model: Model, seed: int, count: int) -> list[tuple[object, ...]]:
    job = crossings_job(model.scenario, model.engine, seed)
    job.check_starts(count)
    lines, rows = job.cross_section.measure_lines, list[tuple[object, ...]]()
    for b, block in enumerate(job.blocks):
        group = job.group(b, 0, count)
        if not (number := len(group.states)):  # no release of this block was filmed
            continue
        found = group_outcome(job, group)
        passed = found.passed(len(lines))
        counts = found.passing(job.cross_section)
        for k, row in enumerate(passing_rows(block.name, list(lines), number, float("nan"), counts)):
            which, ends = passed[:, k], lines[row[1]]
            values = crossing_values(found.crossings[which, k], ends, job.cross_section, group.masses()[which])
            ranked = [np.sort(values[:, CROSSING_VALUES.index(name)]) for name in COLUMNS_OF_QUANTITY]
            estimates = [percentile_estimate(each, len(values), DESIGN_PERCENTILE) for each in ranked]
            named = dict(zip(PASSING_COLUMNS, row, strict=True))
            shares = [value for name, value in named.items() if name in MODEL_COLUMNS[4:]]
            rows.append((*row[:2], model.name, model.p, *shares, *itertools.chain(*estimates)))
    return rows
