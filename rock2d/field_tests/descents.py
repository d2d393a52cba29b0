"""Simulated descents of a field test: each release several times, on its own section with its own rough ground.

What is random (direction, roughness, orientation) is drawn once for each descent, from its own seed. Two soils differ by
their effect and not by chance.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from rock2d.errors import InputError
from rock2d.field_tests.releases import FieldReleases
from rock2d.files.scenario import Scenario
from rock2d.records.columns import AT_X, STOPS, UNRESOLVED_STOPS, X, Y
from rock2d.scene.blocks import Block
from rock2d.scene.cross_section import CrossSection
from rock2d.scene.placing import touching_height_m
from rock2d.scene.rough_ground import roughened

Array = np.ndarray

NOT_STARTED_M = 10.0  # a block that stops sooner is pushed again, and not counted
START, GROUND = range(2)  # spawn keys of the random streams of a descent


@dataclass(frozen=True)
class Distances:
    """Horizontal distances from start to stop of n releases, each simulated m times.

    Attributes
    ----------
    metres : (n, m); NaN where a block did not begin to move
    unresolved : (n, m) bool, cut short or buried
    """

    metres: Array
    unresolved: Array


@dataclass(frozen=True)
class Descents:
    """Releases that are to be simulated, `copies` times each.

    Attributes
    ----------
    scenario : with the field test; gives blocks, starts and sections
    releases : n releases
    copies : of each
    seed : of every random draw
    """

    scenario: Scenario
    releases: FieldReleases
    copies: int
    seed: int

    @cached_property
    def blocks(self) -> dict[str, Block]:
        """Name -> block."""
        return self.scenario.make_blocks()

    @cached_property
    def sections(self) -> list[CrossSection]:
        """The section of each descent, without roughness: n copies of the first release, then of the second."""
        terrain = self.scenario.terrain
        assert terrain is not None
        found = []
        for start in self.releases.starts_m:
            towards = terrain.direction_rad(start)
            for copy in range(self.copies):
                turn = self._stream(len(found), START).normal(0.0, terrain.lateral_sd_rad)
                found.append(terrain.section(start, towards + turn))
        return found

    @cached_property
    def states(self) -> Array:
        """(n copies, 6) states at the start. Raises InputError if a block cannot be placed."""
        found = np.empty((len(self.sections), 6))
        for k, section in enumerate(self.sections):
            name = self.releases.blocks[k // self.copies]
            stream = self._stream(k, START)
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
            roughened(section, roughness, self._stream(k, GROUND)) for k, section in enumerate(self.sections)
        ]

    def simulated(self, scenario: Scenario) -> Distances:
        """The distances with the soil and the roughness of a scenario, with the batch engine."""
        from rock2d.engines.batch import Ensemble, run_batch
        from rock2d.laws.contact import parameter_table

        names = list(self.blocks)
        zones = tuple(dict.fromkeys(zone for section in self.sections for zone in section.zone_names))
        grounds = [_with_zone_order(ground, zones) for ground in self.rough_sections(scenario)]
        block_ids = np.repeat([names.index(name) for name in self.releases.blocks], self.copies)
        tables = [parameter_table(scenario.contact_parameters(block), zones) for block in self.blocks.values()]
        found = run_batch(
            Ensemble(list(self.blocks.values()), grounds, tables), self.states, block_ids=block_ids,
            cross_section_ids=np.arange(len(grounds)), table_ids=block_ids, gravity_m_s2=scenario.gravity_m_s2,
            time_limit_s=scenario.longest_release_s(), stop_when_captured=True,
        )  # fmt: skip
        return self._distances(found.ends[:, AT_X], np.array(STOPS)[found.stop])

    def _distances(self, x: Array, stop: Array) -> Distances:
        shape = len(self.releases), self.copies
        metres = np.where(x < NOT_STARTED_M, np.nan, x)
        return Distances(metres.reshape(shape), np.isin(stop, UNRESOLVED_STOPS).reshape(shape))

    def _stream(self, descent: int, kind: int) -> np.random.Generator:
        return np.random.default_rng(np.random.SeedSequence(self.seed, spawn_key=(descent, kind)))


def _with_zone_order(ground: CrossSection, zones: tuple[str, ...]) -> CrossSection:
    """The same ground, whose zone ids count in a common order: a parameter table serves all grounds."""
    ground.__dict__["zone_names"] = zones
    return ground
