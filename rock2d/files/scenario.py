"""Scenarios: blocks, ground, impact laws and their parameters, number of releases."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import fields
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from pydantic import Field, PrivateAttr

from rock2d.errors import InputError, ParameterError, comma_list, counted
from rock2d.files.checked_yaml import Checked, Document, shown
from rock2d.files.diagnosed_model import DiagnosedModel
from rock2d.files.distributions import Variation, quantiles
from rock2d.files.experiment import Experiment
from rock2d.files.field_releases import FieldTestKeys
from rock2d.files.law_parameters import GivenParameters, of_soils
from rock2d.files.places import number_at
from rock2d.files.posterior_table import ROW, Posterior
from rock2d.files.scatter_keys import Population, RoughnessKeys, Uncertainty
from rock2d.files.scenario_keys import ContactKeys, DesignValueKeys, Incident, Laws, Outputs, Project, ReboundKeys
from rock2d.files.setup_keys import BlockKeys, CrossSectionKeys, Ditches, DitchKeys, EmbankmentKeys, Embankments, Name
from rock2d.scene.blocks import Block
from rock2d.scene.cross_section import CrossSection, site_time_limit_s
from rock2d.scene.earthworks import with_earthworks, with_numbered_earthworks

if TYPE_CHECKING:
    from rock2d.files.surveys.terrain_sections import TerrainSections
    from rock2d.laws.contact import ContactParameters
    from rock2d.laws.rebound import ReboundParameters


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
        from rock2d.laws.contact import ContactParameters
        from rock2d.laws.soil_scaling import soil_contact

        model, diagnosed = self.model, self._diagnosed
        if model.deterministic is None and model.soils is None and diagnosed is None:
            message = "missing key 'deterministic', which the engines pymunk and batch need"
            raise self.error(message, "model", code="missing_key", key="deterministic")
        numbers = model.deterministic.named() if model.deterministic is not None else {}
        switches = ContactKeys(rolling_cap=False, rolling_in_indentation=False)
        rest = (switches,) if diagnosed is None else (diagnosed.model.soil, switches)
        given = GivenParameters(of_soils(model.soils, soil_contact, block), numbers, {}, rest)
        return self._by_zone(ContactParameters, given, "deterministic")

    def rebound_parameters(self, block: Block) -> dict[str, ReboundParameters]:
        """Zone name -> parameters of the probabilistic law for `block`; "default" serves every other zone."""
        from rock2d.laws.rebound import ReboundParameters
        from rock2d.laws.soil_scaling import soil_rebound

        model = self.model
        if model.probabilistic is None and model.soils is None:
            message = "missing key 'probabilistic', which engine point_mass needs"
            raise self.error(message, "model", code="missing_key", key="probabilistic")
        blocks = model.probabilistic.named() if model.probabilistic is not None else {}
        numbers, own = (blocks[name].named() if name in blocks else {} for name in ("default", block.name))
        rest = (ReboundKeys(slope_reduction_deg=0.0, slope_reduction="constant"),)
        given = GivenParameters(of_soils(model.soils, soil_rebound, block), numbers, own, rest)
        return self._by_zone(ReboundParameters, given, "probabilistic", block.name)

    def _by_zone(self, kind: Any, given: GivenParameters, law: str, *block: str) -> dict[str, Any]:
        """Zone name -> parameters of class `kind`, whose keys in the file are `law` and `block`. "default" may be
        missing if every zone has its own soil class or numbers."""
        names = [field.name for field in fields(kind)]
        zones = list(dict.fromkeys(("default", *given.numbers, *given.own, *given.soils)))
        if given.soils and "default" not in given.soils and None in given.values("default", names):
            for zone in self.make_cross_section().zone_names:
                if zone not in zones:
                    message = f"zone {shown(zone)} has no soil class, neither its own nor a default"
                    raise self.error(message, "model", "soils", at="key", code="missing_key", key=zone)
            zones.remove("default")
        out = {}
        for zone in zones:
            path = ("model", law, *(block if zone in given.own else ("default",) * len(block)), zone)
            values = given.values(zone, names)
            if None in values:
                name = names[values.index(None)]
                message = f"{name} is given neither here nor under default"
                raise self.error(message, *path, at="key", code="missing_key", key=name)
            try:
                out[zone] = kind(*values)
            except ParameterError as error:
                raise self.error(error.message, *path, error.key, code="bad_parameter", key=error.key) from None
        return out

    def error(self, message: str, *path: str | int, **more: Any) -> InputError:
        """See `Document.error`."""
        return self._document.error(message, *path, **more)


def scenario_file(name: str) -> Path:
    """Path of the shipped scenario file `name`: inside the package if it is installed, beside it in a checkout."""
    package = Path(__file__).resolve().parents[1]
    installed = package / "scenarios" / name
    return installed if installed.exists() else package.parent / "scenarios" / name
