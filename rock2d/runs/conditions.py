"""What each release of a scenario meets: its block, its ground, its parameters, and the state at which it starts.

Without `scatter`, `roughness` and `populations` it is the same for all releases of a block. With them every release has
its own draws, which are the same however many releases there are and however they are shared out.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from rock2d.errors import InputError
from rock2d.files.distributions import bounds, quantiles
from rock2d.files.places import number_at, place_of
from rock2d.files.scatter_keys import DRAWS_OF_A_BLOCK
from rock2d.files.scenario import Scenario
from rock2d.files.scenario_checks import check_engine
from rock2d.files.scenario_variants import with_numbers
from rock2d.runs.engines import engine_named
from rock2d.runs.found_causes import Causes, about_centre_of_mass, causes_of
from rock2d.runs.incident_states import (
    CHECKED_TOGETHER,
    DRAW_GROUP,
    ROUGHNESS_STREAM,
    SCATTER_STREAM,
    IncidentState,
    drawn_seeds,
    drawn_states,
    measured_states,
    of_groups,
)
from rock2d.scene.blocks import Block
from rock2d.scene.cross_section import CrossSection, CrossSectionError, by_zone
from rock2d.scene.placing import touching_height_m
from rock2d.scene.rough_ground import Roughness, roughened

Array = np.ndarray


class Condition(NamedTuple):
    """What a release meets.

    Attributes
    ----------
    parameters : zone name, or default -> parameters of the engine's law; or, with the effects of a diagnosis, rows
        (zones, columns) of the contact law
    drawn : what was drawn for this release: place in the scenario file, or quantity of the block -> value
    """

    block: Block
    cross_section: CrossSection
    parameters: Mapping[str, Any] | Array
    drawn: Mapping[str, float]


class Suspended(NamedTuple):
    """What n releases that the batch engine suspended need to go on, see `engines.batch.run_batch`.

    Attributes
    ----------
    elapsed_s : (n,) time since the start
    saved_contacts : (n, contacts, N_SAVED) memory of their contacts
    """

    elapsed_s: Array
    saved_contacts: Array

    def part(self, some: Array | slice) -> Suspended:
        """Some of the releases."""
        return Suspended(self.elapsed_s[some], self.saved_contacts[some])


class Group(NamedTuple):
    """Releases of the block with index `block` that are simulated in one call.

    Attributes
    ----------
    states : (n, 6) incident states
    seeds : (n,) of the releases' own random streams
    conditions : n conditions, or a single one for all
    suspended : of releases that were suspended on their way; None at the start
    """

    block: int
    states: Array
    seeds: Array
    conditions: Sequence[Condition]
    suspended: Suspended | None = None

    def masses(self) -> Array:
        """(n, 2) mass in kg and moment of inertia in kg m² of each release."""
        own = np.array([(c.block.mass_kg, c.block.inertia_kg_m2) for c in self.conditions])
        return np.broadcast_to(own, (len(self.states), 2))

    def part(self, some: Array | slice) -> Group:
        """Some of the releases, by their index in the group."""
        own = range(len(self.states))[some] if isinstance(some, slice) else some
        conditions = self.conditions if len(self.conditions) == 1 else [self.conditions[i] for i in own]
        return Group(
            self.block,
            self.states[some],
            self.seeds[some],
            conditions,
            self.suspended and self.suspended.part(some),
        )


@dataclass(frozen=True)
class Conditions:
    """The conditions of all releases of a scenario with an engine and a seed.

    Attributes
    ----------
    blocks : as the scenario states them; of a population, the one of median size
    cross_section : the ground, without roughness
    """

    scenario: Scenario
    engine: str
    seed: int
    blocks: tuple[Block, ...] = field(init=False)
    cross_section: CrossSection = field(init=False)

    def __post_init__(self) -> None:
        check_engine(self.scenario, self.engine)
        ground = self._causes.ground() if self._causes else self.scenario.make_cross_section()
        blocks = self._causes.blocks if self._causes else self.scenario.make_blocks()
        object.__setattr__(self, "blocks", tuple(blocks.values()))
        object.__setattr__(self, "cross_section", ground)

    @property
    def vary(self) -> bool:
        """Whether a release differs from others of its block in more than where it starts."""
        own = self.scenario
        return bool(own.scatter or self._roughness or own.populations)

    def group(self, block: int, first: int, stop: int) -> Group:
        """Releases first .. stop - 1 of the block with index `block`; first < stop."""
        conditions = self.of(block, first, stop)
        states = self._states(conditions, block, first, stop)
        return Group(block, states, drawn_seeds(self.seed, block, first, stop), conditions)

    def of(self, block: int, first: int, stop: int) -> list[Condition]:
        """Conditions of releases first .. stop - 1 of a block; a single one if it is the same for all.

        Raises InputError if drawn values make no sense together.
        """
        common = self.common[block]
        if not self.vary:
            return [common]
        u = of_groups(self._shares, self.seed, SCATTER_STREAM, block, first, stop).clip(1e-9, 1 - 1e-9)
        return [self._condition(common, block, first + i, own) for i, own in enumerate(u)]

    def check_starts(self, count: int) -> None:
        """Refuse a scenario that lets one of `count` releases of a block begin below the ground.

        Raises InputError, code bad_state, with the place of the incident states in the file.
        """
        if self.scenario.experiment is not None:
            return  # where a film begins is measured
        for b, block in enumerate(self.blocks):
            if self._surely_above(block):
                continue
            for first in range(0, count, CHECKED_TOGETHER):
                stop = min(first + CHECKED_TOGETHER, count)
                if (below := self._below(b, first, stop)) is not None:
                    release, (x, y), number = below
                    raise self.scenario.error(
                        f"release {release} of block {block.name} would start below the ground, at x = {x:.4g} m, "
                        f"y = {y:.4g} m; {number} of {stop - first} releases do",
                        "incident", code="bad_state", key="incident",
                    )  # fmt: skip

    @cached_property
    def common(self) -> list[Condition]:
        """Condition of each block, as the scenario states it."""
        parameters = engine_named(self.engine).parameters
        met = [self._with_causes(b, parameters(self.scenario, b)) for b in self.blocks]
        return [Condition(block, self.cross_section, own, {}) for block, own in met]

    @cached_property
    def _causes(self) -> Causes | None:
        return causes_of(self.scenario)

    def _with_causes(
        self, block: Block, parameters: Mapping[str, Any]
    ) -> tuple[Block, Mapping[str, Any] | Array]:
        return (block, parameters) if self._causes is None else self._causes.on(block, parameters)

    @cached_property
    def _roughness(self) -> dict[str, Roughness]:
        found = {} if self._causes is None else self._causes.roughness()
        return found | {zone: keys.make() for zone, keys in self.scenario.roughness.items()}

    @cached_property
    def _rough(self) -> list[dict[str, Roughness]]:
        """Of each block, the roughness of the zones that it meets. The slope reduction of the rebound law stands for
        the same obstacles: where a zone has one, it acts alone."""
        if engine_named(self.engine).law != "probabilistic" or not self._roughness:
            return [self._roughness] * len(self.blocks)
        laws = [
            by_zone(self.scenario.rebound_parameters(b), list(self._roughness), "rebound")
            for b in self.blocks
        ]
        return [
            {
                zone: rough
                for (zone, rough), law in zip(self._roughness.items(), own, strict=True)
                if law.slope_reduction_deg == 0.0
            }
            for own in laws
        ]

    def _shares(self, stream: np.random.Generator) -> Array:
        return stream.uniform(size=(DRAW_GROUP, DRAWS_OF_A_BLOCK + len(self.scenario.scatter)))

    def _condition(self, common: Condition, block: int, release: int, u: Array) -> Condition:
        scenario, name, stated = self.scenario, common.block.name, self.blocks[block]
        drawn, own, parameters = {}, stated, common.parameters
        if name in scenario.populations:
            own = scenario.populations[name].block(name, u[:DRAWS_OF_A_BLOCK])
            drawn = {"size_m": own.size_m, "mass_kg": own.mass_kg}
        if scenario.scatter:
            values = self._values(name, u[DRAWS_OF_A_BLOCK:])
            drawn |= values
        else:
            values = {}
        if values or own is not stated:
            own, parameters = self._with_values(own, values, release)
        else:
            own = common.block
        ground = self._ground(block, release) if self._rough[block] else common.cross_section
        return Condition(own, ground, parameters, drawn)

    @cached_property
    def _scattered(self) -> list[tuple[str, tuple[str | int, ...], Any, float]]:
        """For each scattered number: place, path, distribution, and the value in the file."""
        document, found = self.scenario.document, []
        for place, draw in self.scenario.scatter.items():
            assert document is not None  # the places were checked with it
            path, value = place_of(document.data, place), number_at(document.data, place)
            assert path is not None and value is not None
            found.append((place, path, draw, value))
        return found

    def _values(self, name: str, u: Array) -> dict[str, float]:
        """Place -> value, without those of other blocks."""
        return {
            place: float(quantiles(draw, share, value))
            for (place, path, draw, value), share in zip(self._scattered, u, strict=True)
            if path[0] != "blocks" or path[1] == name
        }

    def _with_values(
        self, block: Block, values: Mapping[str, float], release: int
    ) -> tuple[Block, Mapping[str, Any] | Array]:
        try:
            changed = with_numbers(self.scenario, values)
            if changed.blocks and block.name in changed.blocks:
                block = changed.blocks[block.name].make(block.name)
            return self._with_causes(block, engine_named(self.engine).parameters(changed, block))
        except InputError as error:
            drawn = ", ".join(f"{place} = {value:.6g}" for place, value in values.items())
            message = f"{error.message}; that is release {release} of block {block.name} with {drawn}"
            raise InputError(message, error.file, error.line, error.column, code=error.code) from None
        except ValueError as error:  # raised by the block
            raise self.scenario.error(f"{error}; that is release {release}", "scatter") from None

    def _ground(self, block: int, release: int) -> CrossSection:
        stream = np.random.SeedSequence(self.seed, spawn_key=(ROUGHNESS_STREAM, block, release))
        try:
            return roughened(self.cross_section, self._rough[block], np.random.default_rng(stream))
        except CrossSectionError:
            message = f"too rough: the surface of release {release} crosses itself"
            raise self.scenario.error(message, "roughness", at="key", code="bad_cross_section") from None

    def _states(self, conditions: Sequence[Condition], block: int, first: int, stop: int) -> Array:
        incident = self.scenario.incident_of(self.blocks[block].name)
        states = drawn_states(incident, self.seed, block, first, stop)
        if incident.above_ground is not None:
            self._place_above(conditions, states)
        for i, own in enumerate(conditions):
            some = slice(None) if len(conditions) == 1 else slice(i, i + 1)
            states[some] = about_centre_of_mass(own.block, states[some])
        return states

    def _place_above(self, conditions: Sequence[Condition], states: Array) -> None:
        """Add the height at which each block touches its ground."""
        try:
            if len(conditions) == 1:
                own = conditions[0]
                states[:, 1] += touching_height_m(own.block, own.cross_section, states[:, 0], states[:, 2])
                return
            for state, own in zip(states, conditions, strict=True):
                state[1] += touching_height_m(own.block, own.cross_section, state[0], state[2])[0]
        except ValueError as error:
            raise self.scenario.error(str(error), "incident", code="bad_state", key="incident") from None

    def _below(self, block: int, first: int, stop: int) -> tuple[int, Array, int] | None:
        """Number and place of the first of these releases that starts below the ground, and how many do."""
        incident = self.scenario.incident_of(self.blocks[block].name)
        states = drawn_states(incident, self.seed, block, first, stop)
        if incident.above_ground is not None:
            self._check_clearances(block, first, states)
            return None
        places = states[:, :2]
        below = self.cross_section.covers(places)
        for i in np.flatnonzero(self._near_rough_ground(places)):
            below[i] = self._ground(block, first + int(i)).covers(places[i : i + 1])[0]
        found = np.flatnonzero(below)
        return (first + int(found[0]), places[found[0]], len(found)) if len(found) else None

    def _surely_above(self, block: Block) -> bool:
        """Whether no start that can be drawn lies below the ground."""
        source = self.scenario.incident_of(block.name).distribution
        if source is None:
            return False
        (left, right), (lowest, _) = bounds(source.x_m), bounds(source.y_m)
        rise = max((own.rise_m for own in self._roughness.values()), default=0.0)
        return lowest > self.cross_section.highest_m(left - rise, right + rise) + rise

    def _check_clearances(self, block: int, first: int, states: Array) -> None:
        """Refuse starts beside the cross-section, or with a clearance (in the place of y) below 0."""
        negative = np.flatnonzero(states[:, 1] < 0.0)
        if len(negative):
            raise self.scenario.error(
                f"release {first + negative[0]} of block {self.blocks[block].name} would start below the ground: its "
                f"clearance_m is {states[negative[0], 1]:.3g}; {len(negative)} of {len(states)} releases would",
                "incident", code="bad_state", key="incident",
            )  # fmt: skip
        self._place_above([self.common[block]], states)

    def _near_rough_ground(self, places: Array) -> Array:
        """(n,) bool, which places (n, 2) are so close to the ground that its roughness could cover them."""
        import shapely

        if not self._roughness:
            return np.zeros(len(places), bool)
        reach = max(own.rise_m for own in self._roughness.values())
        return np.asarray(
            shapely.distance(shapely.LineString(self.cross_section.points_m), shapely.points(places)) <= reach
        )


def incident_states(scenario: Scenario, seed: int, releases: int | None = None) -> list[IncidentState]:
    """Incident states of all releases of a scenario, block after block."""
    return [start for start, _ in starts(Conditions(scenario, scenario.engine, seed), releases)]


def starts(conditions: Conditions, releases: int | None = None) -> list[tuple[IncidentState, Condition]]:
    """Incident state and condition of all releases of a scenario, block after block.

    Raises InputError if drawn values make no sense.
    """
    scenario, seed = conditions.scenario, conditions.seed
    if scenario.experiment is not None:
        measured = measured_states(scenario, seed, releases)
        of = {own.name: conditions.of(b, 0, len(measured)) for b, own in enumerate(conditions.blocks)}
        taken = dict.fromkeys(of, -1)
        found = []
        for start in measured:
            taken[start.block] += 1
            own = of[start.block][min(taken[start.block], len(of[start.block]) - 1)]
            state = about_centre_of_mass(own.block, start.state[None])[0]
            found.append((replace(start, state=state), own))
        return found
    count = releases or scenario.releases
    found = []
    for b, block in enumerate(conditions.blocks):
        group = conditions.group(b, 0, count)
        met = group.conditions if len(group.conditions) == count else [group.conditions[0]] * count
        found += [
            (IncidentState(b * count + i, block.name, 0.0, group.states[i], int(group.seeds[i])), met[i])
            for i in range(count)
        ]
    return found
