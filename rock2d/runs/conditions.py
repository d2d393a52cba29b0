"""The conditions of each release of a scenario: block, ground, parameters of the law, and incident state.

Without `scatter`, `roughness` and `populations`, all releases of a block have the same block, ground and parameters.
With them each release has its own draws, which do not depend on the number of releases or of processes."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import cycle
from typing import Any, NamedTuple

import numpy as np

from rock2d.arrays import Array
from rock2d.errors import InputError
from rock2d.files.distributions import quantiles
from rock2d.files.places import number_at, place_of
from rock2d.files.scatter_keys import DRAWS_OF_A_BLOCK
from rock2d.files.scenario import Scenario
from rock2d.files.scenario_checks import check_engine
from rock2d.files.scenario_variants import with_numbers
from rock2d.laws.contact import contact_table
from rock2d.records.columns import N_STATE
from rock2d.runs.acting_effects import ActingEffects
from rock2d.runs.engines import Condition, engine_named
from rock2d.runs.incident_states import (
    CHECKED_TOGETHER,
    DRAW_GROUP,
    ROUGHNESS_STREAM,
    SCATTER_STREAM,
    IncidentState,
    drawn_in_groups,
    drawn_seeds,
    drawn_states,
    measured_states,
)
from rock2d.scene.blocks import Block, states_at, touching_height_m
from rock2d.scene.cross_section import CrossSection, CrossSectionError, by_zone
from rock2d.scene.rough_ground import Roughness, roughened


class Suspended(NamedTuple):
    """State of n releases that the batch engine has suspended, see `engines.batch.run_batch`.

    Attributes
    ----------
    elapsed_s : (n,) time since the start
    saved_contacts : (n, contacts, N_SAVED) memory of their contacts"""

    elapsed_s: Array
    saved_contacts: Array

    def subset(self, chosen: Array | slice) -> Suspended:
        """The chosen releases, by their index."""
        return Suspended(self.elapsed_s[chosen], self.saved_contacts[chosen])


class Group(NamedTuple):
    """Releases of the block with index `block` that are simulated in one call.

    Attributes
    ----------
    states : (n, 6) incident states
    seeds : (n,) seeds of the random streams of the releases
    conditions : n conditions, or a single one for all
    suspended : state of suspended releases; None at the start"""

    block: int
    states: Array
    seeds: Array
    conditions: Sequence[Condition]
    suspended: Suspended | None = None

    def masses(self) -> Array:
        """(n, 2) mass in kg and moment of inertia in kg m² of each release."""
        masses = np.array([(c.block.mass_kg, c.block.inertia_kg_m2) for c in self.conditions])
        return np.broadcast_to(masses, (len(self.states), 2))

    def subset(self, chosen: Array | slice) -> Group:
        """The chosen releases, by their index in the group."""
        indices = range(len(self.states))[chosen] if isinstance(chosen, slice) else chosen
        conditions = self.conditions if len(self.conditions) == 1 else [self.conditions[i] for i in indices]
        return Group(
            self.block,
            self.states[chosen],
            self.seeds[chosen],
            conditions,
            self.suspended and self.suspended.subset(chosen),
        )


@dataclass(frozen=True)
class Conditions:
    """The conditions of all releases of a scenario with an engine and a seed.

    Attributes
    ----------
    blocks : blocks of the scenario, with the effects of its diagnosis; of a population, the block of median size
    cross_section : the ground, without roughness"""

    scenario: Scenario
    engine: str
    seed: int
    blocks: tuple[Block, ...] = field(init=False)
    cross_section: CrossSection = field(init=False)

    def __post_init__(self) -> None:
        check_engine(self.scenario, self.engine)
        ground = self._effects.ground() if self._effects else self.scenario.make_cross_section()
        blocks = self._effects.blocks if self._effects else self.scenario.make_blocks()
        object.__setattr__(self, "blocks", tuple(blocks.values()))
        object.__setattr__(self, "cross_section", ground)

    @property
    def vary(self) -> bool:
        """Whether releases of a block differ in more than their incident states."""
        return bool(self.scenario.scatter or self._roughness or self.scenario.populations)

    def group(self, block: int, first: int, stop: int) -> Group:
        """Releases first .. stop - 1 of the block with index `block`; first < stop. Fewer if fewer were filmed."""
        if self.scenario.experiment is not None:
            own = [pair for pair in self.measured(stop) if pair[0].block == self.blocks[block].name][first:]
            conditions = [each for _, each in own] if self.vary and own else [self.common[block]]
            states = np.array([start.state for start, _ in own]).reshape(-1, N_STATE)
            return Group(block, states, np.array([start.seed for start, _ in own], np.uint64), conditions)
        conditions = self.of_releases(block, first, stop)
        states = self._states(conditions, block, first, stop)
        return Group(block, states, drawn_seeds(self.seed, block, first, stop), conditions)

    def measured(self, releases: int | None = None) -> list[tuple[IncidentState, Condition]]:
        """Start and condition of the first `releases` filmed releases of each block, in the order of the film."""
        measured = measured_states(self.scenario, self.seed, releases)
        counts = Counter(start.block for start in measured)
        conditions = {
            block.name: cycle(self.of_releases(b, 0, counts[block.name] or 1)) for b, block in enumerate(self.blocks)
        }
        found = []
        for start in measured:
            condition = next(conditions[start.block])
            state = states_at(start.state, condition.block.centre_of_mass_m)[0]
            found.append((replace(start, state=state), condition))
        return found

    def of_releases(self, block: int, first: int, stop: int) -> list[Condition]:
        """Conditions of releases first .. stop - 1 of a block; a single one if it is the same for all.

        Raises InputError if drawn values make no sense together."""
        common = self.common[block]
        if not self.vary:
            return [common]
        shape = DRAW_GROUP, DRAWS_OF_A_BLOCK + len(self.scenario.scatter)
        u = drawn_in_groups(lambda rng: rng.uniform(size=shape), self.seed, SCATTER_STREAM, block, first, stop)
        u = u.clip(1e-9, 1 - 1e-9)
        return [self._condition(common, block, first + i, row) for i, row in enumerate(u)]

    def check_starts(self, count: int) -> None:
        """Refuse a scenario in which one of `count` releases of a block starts below the ground.

        Raises InputError, code bad_state, with the place of the incident states in the file."""
        if self.scenario.experiment is not None:
            return  # the starts are measured
        for b, block in enumerate(self.blocks):
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
        """Condition of each block, without draws."""
        pairs = [self._with_effects(self.scenario, block) for block in self.blocks]
        return [Condition(block, self.cross_section, of_block, {}) for block, of_block in pairs]

    @cached_property
    def _effects(self) -> ActingEffects | None:
        diagnosed = self.scenario.diagnosed
        return None if diagnosed is None else ActingEffects.of(diagnosed.model, self.scenario)

    def _with_effects(self, scenario: Scenario, block: Block) -> tuple[Block, Any]:
        """A block and its parameters, with the effects of the diagnosis."""
        engine = engine_named(self.engine)
        laws = engine.parameters(scenario, block)
        if engine.law != "deterministic":
            return block, laws
        rows = contact_table(laws, self.cross_section.zone_names)
        return (block, rows) if self._effects is None else self._effects.applied(block, rows)

    @cached_property
    def _roughness(self) -> dict[str, Roughness]:
        found = {} if self._effects is None else self._effects.roughness()
        return found | {zone: keys.make() for zone, keys in self.scenario.roughness.items()}

    @cached_property
    def _roughness_of_blocks(self) -> list[dict[str, Roughness]]:
        """For each block, zone -> roughness. The slope reduction of the rebound law represents the same obstacles: a
        zone that has one has no roughness."""
        if engine_named(self.engine).law != "probabilistic" or not self._roughness:
            return [self._roughness] * len(self.blocks)
        laws = [by_zone(self.scenario.rebound_parameters(b), list(self._roughness), "rebound") for b in self.blocks]
        return [
            {
                zone: rough
                for (zone, rough), law in zip(self._roughness.items(), by_block, strict=True)
                if law.slope_reduction_deg == 0.0
            }
            for by_block in laws
        ]

    def _condition(self, common: Condition, block: int, release: int, u: Array) -> Condition:
        scenario, name, stated = self.scenario, common.block.name, self.blocks[block]
        drawn, own_block, parameters = {}, stated, common.parameters
        if name in scenario.populations:
            own_block = scenario.populations[name].block(name, u[:DRAWS_OF_A_BLOCK])
            drawn = {"size_m": own_block.size_m, "mass_kg": own_block.mass_kg}
        values = self._values(name, u[DRAWS_OF_A_BLOCK:])
        drawn |= values
        if values or own_block is not stated:
            own_block, parameters = self._with_values(own_block, values, release)
        else:
            own_block = common.block
        ground = self._ground(block, release) if self._roughness_of_blocks[block] else common.cross_section
        return Condition(own_block, ground, parameters, drawn)

    @cached_property
    def _scattered(self) -> list[tuple[str, tuple[str | int, ...], Any, float]]:
        """For each scattered number: place, path, distribution, and the value in the file."""
        data, found = self.scenario.document.data, []
        for place, draw in self.scenario.scatter.items():
            path, value = place_of(data, place), number_at(data, place)
            assert path is not None and value is not None
            found.append((place, path, draw, value))
        return found

    def _values(self, name: str, u: Array) -> dict[str, float]:
        """Place -> value, without places of other blocks."""
        return {
            place: float(quantiles(draw, share, value))
            for (place, path, draw, value), share in zip(self._scattered, u, strict=True)
            if path[0] != "blocks" or path[1] == name
        }

    def _with_values(self, block: Block, values: Mapping[str, float], release: int) -> tuple[Block, Any]:
        try:
            changed = with_numbers(self.scenario, values)
            if changed.blocks and block.name in changed.blocks:
                block = changed.blocks[block.name].make(block.name)
            return self._with_effects(changed, block)
        except InputError as error:
            drawn = ", ".join(f"{place} = {value:.6g}" for place, value in values.items())
            message = f"{error.message}; in release {release} of block {block.name} with {drawn}"
            raise InputError(message, error.file, error.line, error.column, code=error.code) from None
        except ValueError as error:  # raised by the block
            raise self.scenario.error(f"{error}; in release {release}", "scatter") from None

    def _ground(self, block: int, release: int) -> CrossSection:
        stream = np.random.SeedSequence(self.seed, spawn_key=(ROUGHNESS_STREAM, block, release))
        try:
            return roughened(self.cross_section, self._roughness_of_blocks[block], np.random.default_rng(stream))
        except CrossSectionError:
            message = f"too rough: the surface of release {release} crosses itself"
            raise self.scenario.error(message, "roughness", at="key", code="bad_cross_section") from None

    def _states(self, conditions: Sequence[Condition], block: int, first: int, stop: int) -> Array:
        incident = self.scenario.incident_of(self.blocks[block].name)
        states = drawn_states(incident, self.seed, block, first, stop)
        if incident.above_ground is not None:
            self._place_above(conditions, states)
        for i, condition in enumerate(conditions):
            if not any(condition.block.centre_of_mass_m):
                continue
            some = slice(None) if len(conditions) == 1 else slice(i, i + 1)
            states[some] = states_at(states[some], condition.block.centre_of_mass_m)
        return states

    def _place_above(self, conditions: Sequence[Condition], states: Array) -> None:
        """Add the height at which each block touches its ground."""
        try:
            if len(conditions) == 1:
                block, ground, *_ = conditions[0]
                states[:, 1] += touching_height_m(block, ground, states[:, 0], states[:, 2])
                return
            for state, (block, ground, *_) in zip(states, conditions, strict=True):
                state[1] += touching_height_m(block, ground, state[0], state[2])[0]
        except ValueError as error:
            raise self.scenario.error(str(error), "incident", code="bad_state", key="incident") from None

    def _below(self, block: int, first: int, stop: int) -> tuple[int, Array, int] | None:
        """(number of the first of these releases that starts below the ground, its place, number of such releases);
        None if there is none."""
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

    def _check_clearances(self, block: int, first: int, states: Array) -> None:
        """Refuse starts outside the cross-section, or with a clearance (instead of y) below 0."""
        negative = np.flatnonzero(states[:, 1] < 0.0)
        if len(negative):
            raise self.scenario.error(
                f"release {first + negative[0]} of block {self.blocks[block].name} would start below the ground: its "
                f"clearance_m is {states[negative[0], 1]:.3g}; {len(negative)} of {len(states)} releases would",
                "incident", code="bad_state", key="incident",
            )  # fmt: skip
        self._place_above([self.common[block]], states)

    def _near_rough_ground(self, places: Array) -> Array:
        """(n,) bool: whether places (n, 2) are so close to the ground that rough ground could cover them."""
        import shapely

        if not self._roughness:
            return np.zeros(len(places), bool)
        reach = max(rough.rise_m for rough in self._roughness.values())
        return np.asarray(
            shapely.distance(shapely.LineString(self.cross_section.points_m), shapely.points(places)) <= reach
        )


def incident_states(scenario: Scenario, seed: int, releases: int | None = None) -> list[IncidentState]:
    """Incident states of all releases of a scenario, block after block."""
    return [start for start, _ in starts(Conditions(scenario, scenario.engine, seed), releases)]


def starts(conditions: Conditions, releases: int | None = None) -> list[tuple[IncidentState, Condition]]:
    """Incident state and condition of all releases of a scenario, block after block.

    Raises InputError if drawn values make no sense."""
    if conditions.scenario.experiment is not None:
        return conditions.measured(releases)
    count = releases or conditions.scenario.releases
    found = []
    for b, block in enumerate(conditions.blocks):
        group = conditions.group(b, 0, count)
        each = group.conditions if len(group.conditions) == count else [group.conditions[0]] * count
        found += [
            (IncidentState(b * count + i, block.name, 0.0, group.states[i], int(group.seeds[i])), each[i])
            for i in range(count)
        ]
    return found
