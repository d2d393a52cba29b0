"""Design values before and after a diagnosis: the same releases with the paper's law and with the effects found."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from rock2d.files.diagnosed_model import DiagnosedModel, FittedModel
from rock2d.files.scenario import Scenario
from rock2d.runs.campaigns.job import job_of
from rock2d.runs.engines import engine_named
from rock2d.runs.found_causes import Causes
from rock2d.runs.indicators.crossings import CROSSING_VALUES, crossing_values
from rock2d.runs.indicators.passing import PASSING_COLUMNS, passing_rows
from rock2d.runs.indicators.percentiles import QUANTITIES, percentile_table
from rock2d.runs.run import run

if TYPE_CHECKING:
    import pandas as pd

    from rock2d.runs.results import RunResult

DESIGN_PERCENTILE = 95.0
MOST_RELEASES = 10_000  # releases of each block of a campaign that are simulated with each model
COLUMNS_OF_QUANTITY = {
    "kinetic_J": ("kinetic_p95_J", "kinetic_p95_low95_J", "kinetic_p95_high95_J"),
    "passing_height_m": ("passing_height_p95_m", "passing_height_p95_low95_m", "passing_height_p95_high95_m"),
}
BEFORE_AFTER_COLUMNS = (
    "block", "line", "model", "p", "releases", "passed", "unresolved", "frequency", "low95", "high95",
    *(name for names in COLUMNS_OF_QUANTITY.values() for name in names),
)  # fmt: skip


def compared_models(scenario: Scenario) -> list[FittedModel]:
    """The paper's law, the soil alone where effects were fitted with another one and act, and what was found."""
    diagnosed = _diagnosed(scenario)
    models = [diagnosed.before]
    for found in diagnosed.alternatives:
        acts = Causes(
            found, scenario.make_blocks(), scenario.make_cross_section(), scenario.gravity_m_s2
        ).anything
        if acts and found.soil != diagnosed.before.soil:
            models.append(found._replace(name=found.name.replace("after", "soil"), effects={}))
        models.append(found)
    return models


def before_after(scenario: Scenario, result: RunResult, *, workers: int | None = None) -> pd.DataFrame:
    """BEFORE_AFTER_COLUMNS: passing frequency, and 95th percentiles of energy and height of what passes, of each block
    at each line with each model; `result` is the run itself, whose releases all models share."""

    rows = []
    for model in compared_models(scenario):
        own = result if _same(model, _diagnosed(scenario).model) else _with(scenario, model, result, workers)
        rows += _rows(own.to_pandas("passing"), own.to_pandas("percentiles"), model)
    return _table(rows)


def campaign_before_after(
    scenario: Scenario, engine: str, seed: int | None = None, releases: int | None = None
) -> pd.DataFrame:
    """BEFORE_AFTER_COLUMNS of the first MOST_RELEASES releases of each block of a campaign."""
    count = min(releases or scenario.releases, MOST_RELEASES)
    rows = []
    for model in compared_models(scenario):
        other = scenario.with_diagnosed(_diagnosed(scenario).using(model))
        passing, crossings = _of_ensemble(other, engine, scenario.seed if seed is None else seed, count)
        rows += _rows(passing, percentile_table(crossings), model)
    return _table(rows)


def _of_ensemble(scenario: Scenario, engine: str, seed: int, count: int) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Passing table, and of each crossing block, line and QUANTITIES, of `count` releases of each block."""
    import pandas as pd

    chosen = engine_named(engine)
    assert chosen.ensemble is not None  # a campaign's engine
    job = job_of(scenario, engine, seed, ("crossings",), Path(), "")
    lines = job.cross_section.measure_lines
    passing, crossings = [], [pd.DataFrame(columns=["block", "line", *QUANTITIES])]
    for b, block in enumerate(job.blocks):
        group = job.conditions.group(b, 0, count)
        found = chosen.ensemble(job, group)
        passed = found.passed(len(lines))
        passing += passing_rows(block.name, list(lines), count, float("nan"), found.passing(job.cross_section))
        for k, (line, ends) in enumerate(lines.items()):
            own = passed[:, k]
            values = crossing_values(found.crossings[own, k], ends, job.cross_section, group.masses()[own])
            table = pd.DataFrame(values, columns=list(CROSSING_VALUES))[list(QUANTITIES)]
            crossings.append(table.assign(block=block.name, line=line))
    own_rows = [table for table in crossings if len(table)] or crossings[:1]
    return pd.DataFrame(passing, columns=list(PASSING_COLUMNS)), pd.concat(own_rows)


def _table(rows: list[tuple[object, ...]]) -> pd.DataFrame:
    """Rows of all models, those of a block and line together."""
    import pandas as pd

    table = pd.DataFrame(rows, columns=list(BEFORE_AFTER_COLUMNS))
    order = {name: i for i, name in enumerate(dict.fromkeys(zip(table["block"], table["line"], strict=True)))}
    place = [order[key] for key in zip(table["block"], table["line"], strict=True)]
    return table.iloc[pd.Series(place, dtype=int).argsort(kind="stable")].reset_index(drop=True)


def _diagnosed(scenario: Scenario) -> DiagnosedModel:
    assert scenario.diagnosed is not None
    return scenario.diagnosed


def _same(model: FittedModel, other: FittedModel) -> bool:
    return model.soil == other.soil and model.effects == other.effects


def _with(scenario: Scenario, model: FittedModel, result: RunResult, workers: int | None) -> RunResult:
    """The same releases with another model."""
    releases = max(sum(track.block == name for track in result.tracks) for name in result.blocks)
    other = scenario.with_diagnosed(_diagnosed(scenario).using(model))
    return run(other, engine=result.engine, seed=result.seed, releases=releases, workers=workers)


def _rows(passing: pd.DataFrame, percentiles: pd.DataFrame, model: FittedModel) -> list[tuple[object, ...]]:
    own = percentiles[percentiles["percentile"] == DESIGN_PERCENTILE].set_index(["block", "line", "quantity"])
    rows: list[tuple[object, ...]] = []
    for row in passing.itertuples():
        values: list[float] = []
        for quantity in COLUMNS_OF_QUANTITY:
            key = (row.block, row.line, quantity)
            found = own.loc[[key]].iloc[0] if key in own.index else None
            names = ("value", "low95", "high95")
            values += [float("nan") if found is None else float(found[name]) for name in names]
        head = (row.block, row.line, model.name, model.p, row.releases, row.passed, row.unresolved)
        rows.append((*head, row.frequency, row.low95, row.high95, *values))
    return rows
