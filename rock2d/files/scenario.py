"""Scenario files: blocks, ground, impact laws and their parameters, number of releases.

`load_scenario` reads and checks a file. A mistake raises `InputError` with its place."""

from __future__ import annotations

import os
import warnings
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from pydantic import Field, PrivateAttr

from rock2d.errors import InputError, UnusualWarning, comma_list, counted
from rock2d.files import law_parameters
from rock2d.files.checked_yaml import Checked, Document, shown
from rock2d.files.diagnosed_model import DiagnosedModel, load_diagnosed_model
from rock2d.files.distributions import Variation, quantiles
from rock2d.files.experiment import Experiment, load_experiment
from rock2d.files.field_releases import FieldTestKeys
from rock2d.files.folders import path_inside
from rock2d.files.places import number_at
from rock2d.files.posterior_table import ROW, Posterior, read_posterior
from rock2d.files.scatter_keys import Population, RoughnessKeys, Uncertainty
from rock2d.files.scenario_checks import check_scenario, doubts
from rock2d.files.scenario_keys import DesignValueKeys, FromExperiment, Incident, Laws, Outputs, Project
from rock2d.files.setup_keys import BlockKeys, CrossSectionKeys, Ditches, DitchKeys, EmbankmentKeys, Embankments, Name
from rock2d.scene.blocks import Block
from rock2d.scene.cross_section import CrossSection, site_time_limit_s
from rock2d.scene.earthworks import with_earthworks, with_numbered_earthworks

if TYPE_CHECKING:
    from rock2d.files.surveys.terrain_sections import TerrainSections
    from rock2d.laws.contact import ContactParameters
    from rock2d.laws.rebound import ReboundParameters

DATA_VARIABLE = "ROCK2D_DATA"


class Scenario(Checked):
    """A rock2d scenario. SI units; x to the right, y up, angles counter-clockwise positive."""

    name: str = Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9_.-]{0,99}$", description="Name, also of the results folder")
    about: str = Field(default="", description="One sentence on what this scenario is")
    assumed: list[str] = Field(default=[], description="Each value that is assumed, not published or measured")
    project: Project | None = Field(default=None, description="Head of the report that is handed in")
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
        description="The ground; may be left out when the incident states come from an experiment, or with field_test",
    )
    field_test: FieldTestKeys | None = Field(
        default=None, description="Measured releases on a slope; the ground is the terrain along their ways"
    )
    embankment: Embankments | None = Field(
        default=None,
        description="An embankment that stands on the cross-section; of several: number -> embankment, 1, 2, ... from "
        "uphill to downhill",
    )
    ditch: Ditches | None = Field(
        default=None,
        description="A ditch before the embankment; of several embankments: number of the embankment -> ditch",
    )
    blocks: dict[Name, BlockKeys] | None = Field(
        default=None,
        min_length=1,
        description="Block name -> its profile; may be left out when the incident states come from an experiment",
    )
    populations: dict[Name, Population] = Field(
        default={}, description="Name -> blocks that differ from release to release, beside those under blocks"
    )
    model: Laws = Field(description="Parameters of the impact laws, by zone")
    incident: dict[str, Incident] = Field(
        min_length=1, description="Block name, or default, -> state at the start of a release"
    )
    scatter: dict[str, Variation] = Field(
        default={},
        max_length=50,
        description="Numbers that vary from release to release: place of a number under model or blocks -> its "
        "distribution, or {times: distribution of a factor}",
    )
    roughness: dict[Name, RoughnessKeys] = Field(
        default={}, description="Zone name -> how rough its ground is; each release has its own surface"
    )
    uncertainty: Uncertainty | None = Field(
        default=None, description="What is not known about the site: distributions of numbers of this file"
    )
    design_values: DesignValueKeys = Field(
        default_factory=DesignValueKeys, description="Partial factors of the norms in a report"
    )
    outputs: Outputs = Field(default_factory=Outputs, description="How the releases are recorded")

    def __repr__(self) -> str:
        blocks = [*(self.blocks or {}), *self.populations]
        return (
            f"<Scenario {self.name}: engine {self.engine}, {counted(self.releases, 'release')} of each block, seed "
            f"{self.seed}\n blocks: {comma_list(blocks) or 'those of its experiment'}>"
        )

    __str__ = __repr__

    _document: Document = PrivateAttr()
    _experiment: Experiment | None = PrivateAttr(default=None)
    _terrain: TerrainSections | None = PrivateAttr(default=None)
    _diagnosed: DiagnosedModel | None = PrivateAttr(default=None)
    _posterior: Posterior | None = PrivateAttr(default=None)

    @property
    def document(self) -> Document:
        """The file that the scenario was read from."""
        return self._document

    @property
    def experiment(self) -> Experiment | None:
        """The filmed experiment whose releases are restarted, or None."""
        return self._experiment

    @property
    def terrain(self) -> TerrainSections | None:
        """The terrain and the releases of the field test, or None."""
        return self._terrain

    @property
    def diagnosed(self) -> DiagnosedModel | None:
        """The diagnosis whose soil and effects the scenario has, or None."""
        return self._diagnosed

    @property
    def posterior(self) -> Posterior | None:
        """The draws of a calibration that `uncertainty` names, or None."""
        return self._posterior

    def with_diagnosed(self, diagnosed: DiagnosedModel) -> Scenario:
        """The scenario with another diagnosis."""
        other = self.model_copy()
        other._diagnosed = diagnosed
        return other

    def unknown(self) -> dict[str, Callable[[Any], Any]]:
        """Place of each value that is not known about the site -> its quantile function, of arguments in (0, 1). Empty
        without the key `uncertainty`."""
        if self.uncertainty is None:
            return {}
        out: dict[str, Callable[[Any], Any]] = {}
        for place, draw in self.uncertainty.site.items():
            value = number_at(self._document.data, place) or 0.0
            out[place] = partial(quantiles, draw, value=value)
        if self._diagnosed is not None:
            out |= {place: draw.quantiles for place, draw in self._diagnosed.unknown().items()}
        if self._posterior is not None:
            out[ROW] = self._posterior.row
        return out

    def longest_release_s(self) -> float:
        """The time limit of a release in s: that of the file, else one that follows from the cross-section."""
        if self.time_limit_s is not None:
            return self.time_limit_s
        if self.gravity_m_s2 == 0.0:
            message = "without gravity there is no default time limit: missing key 'time_limit_s'"
            raise self.error(message, "gravity_m_s2", code="missing_key", key="time_limit_s")
        return site_time_limit_s(self.make_cross_section(), self.gravity_m_s2)

    def make_cross_section(self) -> CrossSection:
        """The cross-section of the file, else that of the experiment, with embankments and ditches."""
        ground = self.natural_ground()
        if self.embankment is None:
            return ground
        if isinstance(self.embankment, EmbankmentKeys):
            ditch = self.ditch.make() if isinstance(self.ditch, DitchKeys) else None
            return with_earthworks(ground, self.embankment.make(), ditch)
        ditches = self.ditch if isinstance(self.ditch, dict) else {}
        works = {
            int(number): (own.make(), ditches[number].make() if number in ditches else None)
            for number, own in self.embankment.items()
        }
        return with_numbered_earthworks(ground, works)

    def natural_ground(self) -> CrossSection:
        """The cross-section without embankment and ditch."""
        if self.cross_section is not None:
            return self.cross_section.make()
        if self._terrain is not None:
            return self._terrain.mean_section()
        assert self._experiment is not None  # checked with the file
        return self._experiment.cross_section

    def make_blocks(self) -> dict[str, Block]:
        """Name -> block of the file, else of the experiment; of a population the block of median size."""
        if self.blocks is not None or self.populations:
            made = {name: keys.make(name) for name, keys in (self.blocks or {}).items()}
            return made | {name: own.median_block(name) for name, own in self.populations.items()}
        assert self._experiment is not None  # checked with the file
        return dict(self._experiment.blocks)

    def design_block(self, name: str) -> Block:
        """The block of that name; of a population the 95th percentile of size."""
        if name in self.populations:
            return self.populations[name].block(name, np.array([0.95, 0.5, 0.0, 0.5]))
        return self.make_blocks()[name]

    def incident_of(self, block: str) -> Incident:
        """The block's own incident states, else the default's."""
        return self.incident.get(block) or self.incident["default"]

    def contact_parameters(self, block: Block) -> dict[str, ContactParameters]:
        """Zone name -> parameters of the deterministic law for `block`; "default" serves every other zone."""
        return law_parameters.contact_parameters(self, block)

    def rebound_parameters(self, block: Block) -> dict[str, ReboundParameters]:
        """Zone name -> parameters of the probabilistic law for `block`; "default" serves every other zone."""
        return law_parameters.rebound_parameters(self, block)

    def error(self, message: str, *path: str | int, **more: Any) -> InputError:
        """See `Document.error`."""
        return self._document.error(message, *path, **more)


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
        scenario._diagnosed = diagnosed or load_diagnosed_model(scenario, scenario.model.diagnosis, data_root)
    if scenario.uncertainty is not None and scenario.uncertainty.posterior is not None:
        scenario._posterior = _load_posterior(scenario, scenario.uncertainty.posterior)
    for key, value in (
        ("cross_section", scenario.cross_section or scenario.field_test),
        ("blocks", scenario.blocks or scenario.populations),
    ):
        if not value and scenario.experiment is None:
            raise document.error(f"missing key {key!r}", code="missing_key", key=key)
    check_scenario(scenario)
    scenario.longest_release_s()
    return scenario


def _load_posterior(scenario: Scenario, given: str) -> Posterior:
    """The table beside the scenario file."""
    beside, where = scenario.document.file.absolute().parent, ("uncertainty", "posterior")
    return read_posterior(given, path_inside(beside, given, *where, error=scenario.error))


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


def scenario_file(name: str) -> Path:
    """Path of the shipped scenario file `name`: inside the package if it is installed, beside it in a checkout."""
    package = Path(__file__).resolve().parents[1]
    installed = package / "scenarios" / name
    return installed if installed.exists() else package.parent / "scenarios" / name


def _load_terrain(scenario: Scenario, keys: FieldTestKeys, data_root: str | Path | None) -> TerrainSections:
    """Terrain and releases. The data root may be any folder of the path `keys.folder`."""
    from rock2d.files.field_releases import read_releases
    from rock2d.files.surveys.terrain import read_terrain
    from rock2d.files.surveys.terrain_sections import TerrainSections

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
