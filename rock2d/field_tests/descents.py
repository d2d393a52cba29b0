"""Simulated descents of a field test: several for each release, each on its own section with its own rough ground.

Direction, roughness and orientation are drawn once for each descent, from its own seed, so that two soils do not differ
by chance."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from rock2d.arrays import Array
from rock2d.engines.batch import Ensemble, run_batch
from rock2d.engines.point_mass import run_point_mass_batch
from rock2d.errors import InputError
from rock2d.files.field_releases import FieldReleases
from rock2d.files.scenario import Scenario
from rock2d.files.surveys.terrain_sections import EDGE_ZONE, TerrainSections
from rock2d.laws.contact import contact_table
from rock2d.records.columns import INSTANT_X, STOPS, UNRESOLVED_STOPS, X, Y
from rock2d.scene.blocks import Block, touching_height_m
from rock2d.scene.cross_section import CrossSection
from rock2d.scene.rough_ground import roughened

NOT_STARTED_M = 10.0  # a block that stops before counts as not started
START_STREAM, GROUND_STREAM = range(2)  # spawn keys of the random streams of a descent


@dataclass(frozen=True)
class Distances:
    """Horizontal distances from start to stop of n releases, each simulated m times.

    Attributes
    ----------
    metres : (n, m); NaN if a block did not start
    unresolved : (n, m) bool: whether a descent was cut short or buried"""

    metres: Array
    unresolved: Array


@dataclass(frozen=True)
class Descents:
    """Descents of n releases, `copies` of each.

    Attributes
    ----------
    scenario : scenario with the field test, which gives blocks, starts and sections
    releases : n releases
    copies : number of descents of each release
    seed : seed of every random draw
    engine : "batch", or "point_mass"
    other_blocks : name -> block, for releases of blocks that are not in the scenario"""

    scenario: Scenario
    releases: FieldReleases
    copies: int
    seed: int
    engine: str = "batch"
    other_blocks: Mapping[str, Block] = field(default_factory=dict)

    @cached_property
    def blocks(self) -> dict[str, Block]:
        """Name -> block."""
        return {**self.scenario.make_blocks(), **self.other_blocks}

    @cached_property
    def directions_rad(self) -> Array:
        """(n copies,) direction of each descent: n copies of the first release, then of the second."""
        terrain = self._terrain
        found: list[float] = []
        for start in self.releases.starts_m:
            towards = terrain.direction_rad(start)
            for _ in range(self.copies):
                turn = self._stream(len(found), START_STREAM).normal(0.0, terrain.lateral_sd_rad)
                found.append(towards + turn)
        return np.array(found)

    def sections(self, scenario: Scenario) -> list[CrossSection]:
        """The section of each descent on the terrain of a scenario, without roughness."""
        terrain, starts = scenario.terrain, np.repeat(self.releases.starts_m, self.copies, axis=0)
        assert terrain is not None
        return [terrain.section(start, way) for start, way in zip(starts, self.directions_rad, strict=True)]

    @cached_property
    def states(self) -> Array:
        """(n copies, 6) states at the start. Raises InputError if a block cannot be placed."""
        sections = self.sections(self.scenario)
        found = np.empty((len(sections), 6))
        for k, section in enumerate(sections):
            name = self.releases.blocks[k // self.copies]
            stream = self._stream(k, START_STREAM)
            stream.normal()  # the direction
            found[k] = self.scenario.incident_of(name).draw(stream, 1)[0]
            try:
                found[k, Y] += touching_height_m(self.blocks[name], section, found[k, X], found[k, 2])[0]
            except ValueError as error:
                raise InputError(f"release {self.releases.names[k // self.copies]}: {error}") from None
        return found

    def rough_sections(self, scenario: Scenario) -> list[CrossSection]:
        """The ground of each descent with the roughness of a scenario."""
        roughness = {zone: keys.make() for zone, keys in scenario.roughness.items()}
        return [
            roughened(section, roughness, self._stream(k, GROUND_STREAM))
            for k, section in enumerate(self.sections(scenario))
        ]

    def simulated(self, scenario: Scenario) -> Distances:
        """The distances with the soil of a scenario: of blocks on rough ground, or with the engine point_mass of points
        on smooth ground, because the rebound law includes roughness."""
        return self._as_points(scenario) if self.engine == "point_mass" else self._as_blocks(scenario)

    def _as_blocks(self, scenario: Scenario) -> Distances:
        names = list(self.blocks)
        zones = (EDGE_ZONE, *self._terrain.zones)
        grounds = [_with_zone_order(ground, zones) for ground in self.rough_sections(scenario)]
        block_ids = np.repeat([names.index(name) for name in self.releases.blocks], self.copies)
        tables = [contact_table(scenario.contact_parameters(block), zones) for block in self.blocks.values()]
        found = run_batch(
            Ensemble(list(self.blocks.values()), grounds, tables), self.states, block_ids=block_ids,
            cross_section_ids=np.arange(len(grounds)), table_ids=block_ids, gravity_m_s2=scenario.gravity_m_s2,
            time_limit_s=scenario.longest_release_s(), stop_when_captured=True,
        )  # fmt: skip
        return self._distances(found.ends[:, INSTANT_X], np.array(STOPS)[found.stop])

    def _as_points(self, scenario: Scenario) -> Distances:
        by_block = {name: scenario.rebound_parameters(block) for name, block in self.blocks.items()}
        limit = scenario.longest_release_s()
        sections = self.sections(scenario)
        x, stop = np.empty(len(sections)), np.empty(len(sections), int)
        for k, section in enumerate(sections):
            name, seed = (
                self.releases.blocks[k // self.copies],
                self._stream(k, GROUND_STREAM).integers(2**63, size=1),
            )
            found = run_point_mass_batch(
                self.blocks[name], section, by_block[name], self.states[k : k + 1], seed,
                gravity_m_s2=scenario.gravity_m_s2, time_limit_s=limit,
            )  # fmt: skip
            x[k], stop[k] = found.ends[0, INSTANT_X], found.stop[0]
        return self._distances(x, np.array(STOPS)[stop])

    def _distances(self, x: Array, stop: Array) -> Distances:
        shape = len(self.releases), self.copies
        metres = np.where(x < NOT_STARTED_M, np.nan, x)
        return Distances(metres.reshape(shape), np.isin(stop, UNRESOLVED_STOPS).reshape(shape))

    @property
    def _terrain(self) -> TerrainSections:
        assert self.scenario.terrain is not None
        return self.scenario.terrain

    def _stream(self, descent: int, kind: int) -> np.random.Generator:
        return np.random.default_rng(np.random.SeedSequence(self.seed, spawn_key=(descent, kind)))


def _with_zone_order(ground: CrossSection, zones: tuple[str, ...]) -> CrossSection:
    """The same ground with zone ids in a common order, so that one parameter table holds for all grounds."""
    ground.__dict__["zone_names"] = zones
    return ground
