"""Scenario YAML: what to release, onto what, with which laws and parameters. Loaded, checked, completed.

`load_scenario` returns a `Scenario` whose names all resolve; a mistake raises `InputError` with its place.
"""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from pydantic import Field, PrivateAttr

from rock2d.errors import InputError
from rock2d.files import law_parameters
from rock2d.files.checked_yaml import Checked, Document, did_you_mean, json_schema, shown
from rock2d.files.experiment import Experiment, load_experiment
from rock2d.files.folders import OutsideFolderError, path_inside
from rock2d.files.places import number_at
from rock2d.files.scenario_keys import FromExperiment, Incident, Laws, Outputs, Soil
from rock2d.files.setup_keys import BlockKeys, CrossSectionKeys, DitchKeys, EmbankmentKeys, Name
from rock2d.files.uncertainty_keys import Uncertainty
from rock2d.scene.blocks import Block
from rock2d.scene.cross_section import CrossSection, CrossSectionError
from rock2d.scene.earthworks import EarthworkError, with_earthworks
from rock2d.scene.site_scales import site_time_limit_s
from rock2d.scene.soils import SOIL_CLASSES

if TYPE_CHECKING:
    from rock2d.laws.contact import ContactParameters
    from rock2d.laws.rebound import ReboundParameters

DATA_VARIABLE = "ROCK2D_DATA"


class Scenario(Checked):
    """A rock2d scenario. SI units; x to the right, y up, angles counter-clockwise positive."""

    name: str = Field(
        pattern=r"^[A-Za-z0-9][A-Za-z0-9_.-]{0,99}$", description="Name, also of the results folder"
    )
    about: str = Field(default="", description="One sentence on what this scenario is")
    assumed: list[str] = Field(
        default=[], description="Each value that is assumed, not published or measured"
    )
    gravity_m_s2: float = Field(default=9.81, ge=0, le=1000, description="Gravity in m/s²")
    engine: Literal["pymunk", "batch", "point_mass"] = Field(
        default="pymunk",
        description="pymunk: deterministic rigid bodies; batch: the same law, compiled; "
        "point_mass: probabilistic rebound",
    )
    releases: int = Field(default=50, ge=1, le=1_000_000, description="Releases of each block")
    seed: int = Field(default=1, ge=0, le=2**63 - 1, description="Seed of every random draw")
    time_limit_s: float | None = Field(
        default=None,
        gt=0,
        le=3600,
        description="A release ends after this time in s; default: 10 √(2 L / g), L the length of the surface",
    )
    cross_section: CrossSectionKeys | None = Field(
        default=None,
        description="The ground; may be left out when the incident states come from an experiment",
    )
    embankment: EmbankmentKeys | None = Field(
        default=None, description="An embankment that stands on the cross-section"
    )
    ditch: DitchKeys | None = Field(default=None, description="A ditch before the embankment")
    blocks: dict[Name, BlockKeys] | None = Field(
        default=None, min_length=1, description="Block name -> its profile; may be left out likewise"
    )
    model: Laws = Field(description="Parameters of the impact laws, by zone")
    incident: dict[str, Incident] = Field(
        min_length=1, description="Block name, or default, -> state at the start of a release"
    )
    uncertainty: Uncertainty | None = Field(
        default=None, description="What is not known about the site: distributions of numbers of this file"
    )
    outputs: Outputs = Field(default_factory=Outputs, description="How the releases are recorded")

    _document: Document | None = PrivateAttr(default=None)
    _experiment: Experiment | None = PrivateAttr(default=None)

    @property
    def document(self) -> Document | None:
        """The file that the scenario was read from, or None."""
        return self._document

    @property
    def experiment(self) -> Experiment | None:
        """The filmed experiment whose releases are restarted, or None."""
        return self._experiment

    def longest_release_s(self) -> float:
        """The time after which a release ends: the scenario's own, else what follows from the cross-section."""
        if self.time_limit_s is not None:
            return self.time_limit_s
        if self.gravity_m_s2 == 0.0:
            message = "without gravity nothing says how long a release lasts: missing key 'time_limit_s'"
            raise self.error(message, "gravity_m_s2", code="missing_key", key="time_limit_s")
        return site_time_limit_s(self.make_cross_section(), self.gravity_m_s2)

    def make_cross_section(self) -> CrossSection:
        """The cross-section: the scenario's own, else the experiment's; with the embankment and the ditch."""
        ground = self._natural_ground()
        if self.embankment is None:
            return ground
        return with_earthworks(ground, self.embankment.make(), self.ditch.make() if self.ditch else None)

    def _natural_ground(self) -> CrossSection:
        if self.cross_section is not None:
            return self.cross_section.make()
        if self._experiment is None:
            raise InputError(
                "missing key 'cross_section'", self._file, code="missing_key", key="cross_section"
            )
        return self._experiment.cross_section

    def make_blocks(self) -> dict[str, Block]:
        """Name -> block: the scenario's own, else the experiment's."""
        if self.blocks is not None:
            return {name: keys.make(name) for name, keys in self.blocks.items()}
        if self._experiment is None:
            raise InputError("missing key 'blocks'", self._file, code="missing_key", key="blocks")
        return dict(self._experiment.blocks)

    def incident_of(self, block: str) -> Incident:
        """The block's own incident states, else the default's."""
        return self.incident.get(block) or self.incident["default"]

    def contact_parameters(self, block: Block) -> dict[str, ContactParameters]:
        """Zone name -> parameters of the deterministic law for `block`; "default" serves every other zone."""
        return law_parameters.contact_parameters(self, block)

    def rebound_parameters(self, block: Block) -> dict[str, ReboundParameters]:
        """Zone name -> parameters of the probabilistic law for `block`; "default" serves every other zone."""
        return law_parameters.rebound_parameters(self, block)

    @property
    def _file(self) -> Path | None:
        return self._document.file if self._document else None

    def error(
        self, message: str, *path: str | int, at: str = "value", code: str = "bad_value", **fields: Any
    ) -> InputError:
        if self._document is None:
            return InputError(f"{'.'.join(map(str, path))}: {message}", code=code, **fields)
        return self._document.error(message, *path, at=at, code=code, **fields)


def load_scenario(path: str | Path, data_root: str | Path | None = None) -> Scenario:
    """Load and check a scenario file.

    `data_root` (else the variable ROCK2D_DATA) is the folder under which `from_experiment` looks.
    Raises `InputError` with file, line and column of the first mistake.
    """
    return checked_scenario(Document(path), None, data_root)


def checked_scenario(
    document: Document, experiment: Experiment | None, data_root: str | Path | None = None
) -> Scenario:
    """Check the data of a scenario file; see `load_scenario`. An `experiment` that is given is not loaded again."""
    scenario = document.check(Scenario)
    scenario._document = document
    _load_experiment(scenario, data_root, experiment)
    for key in ("cross_section", "blocks"):
        if getattr(scenario, key) is None and scenario.experiment is None:
            raise document.error(f"missing key {key!r}", code="missing_key", key=key)
    _check_earthworks(scenario)
    _check_names(scenario)
    _check_parameters(scenario)
    _check_incident(scenario)
    _check_uncertainty(scenario)
    scenario.longest_release_s()
    return scenario


def _load_experiment(
    scenario: Scenario, data_root: str | Path | None, loaded: Experiment | None = None
) -> None:
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


def _found_experiment(
    scenario: Scenario, source: FromExperiment, where: tuple[str, ...], data_root: str | Path | None
) -> Experiment:
    """The experiment under the data root."""
    root = data_root or os.environ.get(DATA_VARIABLE)
    if not root:
        message = (
            f"the data are not here: say where {shown(source.folder)} lies with --data or {DATA_VARIABLE}"
        )
        raise scenario.error(message, *where, code="missing_data", folder=source.folder)
    try:
        folder = path_inside(root, source.folder)
    except OutsideFolderError as error:
        raise scenario.error(error.message, *where, code="outside_folder") from None
    if not folder.is_dir():
        message = (
            f"no folder {shown(source.folder)} under the data root {str(root)!r} (--data or {DATA_VARIABLE})"
        )
        raise scenario.error(message, *where, code="missing_data", folder=source.folder)
    return load_experiment(folder)


def _check_earthworks(scenario: Scenario) -> None:
    if scenario.ditch is not None and scenario.embankment is None:
        message = "a ditch lies before an embankment: missing key 'embankment'"
        raise scenario.error(message, "ditch", at="key", code="missing_key", key="embankment")
    try:
        scenario.make_cross_section()
    except EarthworkError as error:
        raise scenario.error(str(error), error.part, error.key, code="bad_cross_section") from None
    except CrossSectionError as error:
        place = (error.line,) if error.line is not None else ()
        raise scenario.error(
            str(error), "cross_section", error.key, *place, code="bad_cross_section"
        ) from None


def _check_names(scenario: Scenario) -> None:
    zones = {"default", *scenario.make_cross_section().zone_names}
    blocks = {"default", *scenario.make_blocks()}
    laws = scenario.model

    def known(names: Any, among: set[str], what: str, *path: str) -> None:
        for name in names:
            if name not in among:
                choices = ", ".join(sorted(among - {"default"}))
                message = f"unknown {what}{did_you_mean(name, among)}; {what}s of this scenario: {choices}"
                raise scenario.error(message, *path, name, at="key", code="unknown_name", name=name)

    if "default" in scenario.make_cross_section().zone_names:
        raise scenario.error("a zone must not be called default", "cross_section", "zones")
    if "default" in scenario.make_blocks():
        raise scenario.error("a block must not be called default", "blocks", "default", at="key")
    if laws.soils is not None:
        known(laws.soils, zones, "zone", "model", "soils")
        _check_soil_classes(scenario, laws.soils)
    if laws.deterministic is not None:
        known(laws.deterministic.named(), zones, "zone", "model", "deterministic")
    if laws.probabilistic is not None:
        known(laws.probabilistic.named(), blocks, "block", "model", "probabilistic")
        for block, table in laws.probabilistic.named().items():
            known(table.named(), zones, "zone", "model", "probabilistic", block)
    known(scenario.incident, blocks, "block", "incident")
    for name in sorted(blocks - {"default"} - set(scenario.incident)):
        if "default" not in scenario.incident:
            message = f"block {shown(name)} has no incident state, neither its own nor a default"
            raise scenario.error(message, "incident", at="key", code="missing_key", key=name)


def _check_soil_classes(scenario: Scenario, soils: dict[str, Soil]) -> None:
    for zone, given in soils.items():
        name, place = (given, (zone,)) if isinstance(given, str) else (given.like, (zone, "like"))
        if name not in SOIL_CLASSES:
            message = f"unknown soil class {shown(name)}{did_you_mean(name, SOIL_CLASSES)}; soil classes: "
            message += ", ".join(SOIL_CLASSES)
            raise scenario.error(message, "model", "soils", *place, code="unknown_name", name=name)


def _check_parameters(scenario: Scenario) -> None:
    laws = scenario.model
    for block in scenario.make_blocks().values():
        if laws.deterministic is not None or scenario.engine in ("pymunk", "batch"):
            scenario.contact_parameters(block)
        if laws.probabilistic is not None or scenario.engine == "point_mass":
            scenario.rebound_parameters(block)


def _check_incident(scenario: Scenario) -> None:
    """Refuse a fixed start below the ground or beside the cross-section."""
    ground = scenario.make_cross_section()
    points = ground.points_m
    left, right = points[:, 0].min(), points[:, 0].max()
    for name, item in scenario.incident.items():
        if item.fixed is None:
            continue
        path = ("incident", name, "fixed")
        if not left <= item.fixed.x_m <= right:
            message = f"beside the cross-section, which reaches from {left:g} to {right:g}"
            raise scenario.error(message, *path, "x_m", code="bad_state", key="x_m")
        if ground.covers(np.array([[item.fixed.x_m, item.fixed.y_m]])).any():
            raise scenario.error("below the ground", *path, "y_m", code="bad_state", key="y_m")


def _check_uncertainty(scenario: Scenario) -> None:
    if scenario.uncertainty is None or scenario.document is None:
        return
    if scenario.experiment is not None:
        message = "releases that restart a film have no other possible sites"
        raise scenario.error(message, "uncertainty", at="key", code="wrong_kind")
    if not scenario.make_cross_section().measure_lines:
        message = (
            "nothing is uncertain without a measure line: passing frequencies are what is told of the sites"
        )
        raise scenario.error(message, "uncertainty", at="key", code="missing_key", key="measure_lines")

    for place in scenario.uncertainty.site:
        if number_at(scenario.document.data, place) is None:
            message = "there is no number at this place of the file"
            raise scenario.error(
                message, "uncertainty", "site", place, at="key", code="unknown_name", name=place
            )


def scenario_json_schema() -> dict[str, Any]:
    """JSON Schema of a scenario file, for editors: every key with its description and unit."""
    return json_schema(Scenario, "rock2d scenario")
