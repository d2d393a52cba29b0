"""Scenario files with what they refer to: experiment, diagnosis, terrain, draws of a calibration.

`load_scenario` reads and checks a file. A mistake raises `InputError` with its place."""

from __future__ import annotations

import os
import warnings
from dataclasses import replace
from pathlib import Path

from rock2d.errors import UnusualWarning
from rock2d.files.checked_yaml import Document, shown
from rock2d.files.diagnosed_model import DiagnosedModel, diagnosed_model
from rock2d.files.diagnosis import DIAGNOSIS
from rock2d.files.experiment import Experiment, load_experiment
from rock2d.files.field_releases import FieldTestKeys, read_releases
from rock2d.files.folders import path_inside
from rock2d.files.posterior_table import read_posterior
from rock2d.files.scenario import Scenario
from rock2d.files.scenario_checks import check_scenario, doubts
from rock2d.files.scenario_keys import FromExperiment
from rock2d.files.surveys.terrain import read_terrain
from rock2d.files.surveys.terrain_sections import TerrainSections

DATA_VARIABLE = "ROCK2D_DATA"


def load_scenario(path: str | Path, data_root: str | Path | None = None) -> Scenario:
    """Load and check a scenario file.

    `data_root` (else the variable ROCK2D_DATA) is the folder under which `from_experiment` looks.
    Raises `InputError` with file, line and column of the first mistake. Warns with `UnusualWarning` of each number
    that is possible but unusual."""
    scenario = checked_scenario(Document(path), None, data_root)
    for doubt in doubts(scenario):
        warnings.warn(UnusualWarning(str(scenario.error(doubt.text, *doubt.key, at="key"))), stacklevel=2)
    return scenario


def checked_scenario(
    document: Document,
    experiment: Experiment | None,
    data_root: str | Path | None = None,
    diagnosed: DiagnosedModel | None = None,
    terrain: TerrainSections | None = None,
) -> Scenario:
    """Check the data of a scenario file; see `load_scenario`. An experiment, a diagnosis or a terrain that is given is
    not loaded again."""
    scenario = document.check(Scenario)
    scenario._document = document
    data_root = data_root or os.environ.get(DATA_VARIABLE)
    _load_experiment(scenario, data_root, experiment)
    if scenario.field_test is not None:
        found = terrain or _load_terrain(scenario, scenario.field_test, data_root)
        scenario._terrain = replace(found, beyond_deg=scenario.field_test.beyond_deg)
    if scenario.model.diagnosis is not None:
        scenario._diagnosed = diagnosed or _load_diagnosed_model(scenario, scenario.model.diagnosis, data_root)
    if scenario.uncertainty is not None and scenario.uncertainty.posterior is not None:
        given, beside = scenario.uncertainty.posterior, document.file.absolute().parent
        file = path_inside(beside, given, "uncertainty", "posterior", error=scenario.error)
        scenario._posterior = read_posterior(given, file)
    for key, value in (
        ("cross_section", scenario.cross_section or scenario.field_test),
        ("blocks", scenario.blocks or scenario.populations),
    ):
        if not value and scenario.experiment is None:
            raise document.error(f"missing key {key!r}", code="missing_key", key=key)
    check_scenario(scenario)
    scenario.longest_release_s()
    return scenario


def _load_diagnosed_model(scenario: Scenario, given: str, data_root: str | Path | None) -> DiagnosedModel:
    """The diagnosis beside the scenario file, or under the data root.

    Raises InputError with the place in the scenario, or in the diagnosis."""
    where = ("model", "diagnosis")
    roots = [scenario.document.file.absolute().parent, *([Path(data_root)] if data_root else [])]
    for root in roots:
        file = path_inside(root, given, *where, error=scenario.error)
        if os.path.isdir(file):
            file = path_inside(root, f"{given}/{DIAGNOSIS}", *where, error=scenario.error)
        if os.path.exists(file):  # unlike Path.exists, for a name that no file can have, too
            blocks = {**(scenario.blocks or {}), **scenario.populations}
            return diagnosed_model(given, file, blocks or (scenario.experiment.blocks if scenario.experiment else {}))
    message = f"no file {shown(given)} beside the scenario or under the data root"
    raise scenario.error(message, *where, code="missing_file", name=given)


def _load_experiment(scenario: Scenario, data_root: str | Path | None, loaded: Experiment | None = None) -> None:
    given = scenario.incident.items()
    sources = {name: item.from_experiment for name, item in given if item.from_experiment}
    if not sources:
        return
    if list(scenario.incident) != ["default"]:
        name = next(iter(sources))
        message = "from_experiment serves all blocks: put it under incident.default, alone"
        raise scenario.error(message, "incident", name, at="key", code="wrong_kind")
    source, where = sources["default"], ("incident", "default", "from_experiment", "folder")
    experiment = loaded or _found_experiment(scenario, source, where, data_root)
    if experiment.trajectories is None:
        message = "this experiment has impacts only, no frames to start from"
        raise scenario.error(message, *where, code="wrong_kind")
    most = int(experiment.trajectories.groupby("block")["release"].nunique().max())
    if "releases" not in scenario.model_fields_set:
        scenario.releases = most
    elif scenario.releases > most:
        message = f"the experiment has {most} releases of a block at most"
        raise scenario.error(message, "releases")
    if "gravity_m_s2" not in scenario.model_fields_set:
        scenario.gravity_m_s2 = experiment.gravity_m_s2
    if scenario.blocks is not None:
        for name in sorted(set(experiment.trajectories["block"]) - set(scenario.blocks)):
            message = f"block {shown(name)} of the experiment is missing"
            raise scenario.error(message, "blocks", at="key", code="missing_key", key=name)
    scenario._experiment = experiment


def _load_terrain(scenario: Scenario, keys: FieldTestKeys, data_root: str | Path | None) -> TerrainSections:
    """Terrain and releases. The data root may be any folder of the path `keys.folder`."""
    where, steps = ("field_test", "folder"), Path(keys.folder).parts
    root = _given_root(scenario, keys.folder, where, data_root)
    tails = [str(Path(*steps[i:], keys.releases)) for i in range(len(steps) + 1)]
    files = [path_inside(root, tail, *where, error=scenario.error) for tail in tails]
    table = next((file for file in files if file.is_file()), None)
    if table is None:
        message = f"no {keys.releases} in {shown(keys.folder)} {_under(root)}"
        raise scenario.error(message, *where, code="missing_data", folder=keys.folder)
    grid = path_inside(table.parent, keys.terrain, *where, error=scenario.error)
    known = read_releases(table, keys.block_ids)
    return TerrainSections(read_terrain(grid), known, keys.zones, keys.edge_m)


def _found_experiment(
    scenario: Scenario, source: FromExperiment, where: tuple[str, ...], data_root: str | Path | None
) -> Experiment:
    """The experiment under the data root."""
    root = _given_root(scenario, source.folder, where, data_root)
    folder = path_inside(root, source.folder, *where, error=scenario.error)
    if not folder.is_dir():
        message = f"no folder {shown(source.folder)} {_under(root)}"
        raise scenario.error(message, *where, code="missing_data", folder=source.folder)
    return load_experiment(folder)


def _given_root(scenario: Scenario, folder: str, where: tuple[str, ...], data_root: str | Path | None) -> str | Path:
    if not data_root:
        message = f"no data root: give the folder that contains {shown(folder)} with --data or {DATA_VARIABLE}"
        raise scenario.error(message, *where, code="missing_data", folder=folder)
    return data_root


def _under(root: str | Path) -> str:
    return f"under the data root {str(root)!r} (--data or {DATA_VARIABLE})"
