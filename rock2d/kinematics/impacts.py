"""Impacts of a film and impacts of a table.

An *impact* of a film is everything between two consecutive flights: one touch of the ground, or several. Between other
pairs of flights the block touches nothing; they may be one flight."""

from __future__ import annotations

import itertools
from dataclasses import dataclass, fields, replace
from typing import Self

import numpy as np

from rock2d.arrays import Array
from rock2d.engines.geometry import block_arrays, ground_arrays
from rock2d.files.experiment import Experiment
from rock2d.kinematics.flights import Film, Flights, block_clearances, clearances
from rock2d.kinematics.states import States, move_freely
from rock2d.records.columns import LINEAR_VELOCITY, POSE, POSITION, RATES, STATE_NAMES, after
from rock2d.scene.nearest_facet import nearest_facets
from rock2d.scene.world import World

START_HEIGHT_RADII = 0.5  # block radii above the ground at which the simulation of an impact starts
COMPARISON_WINDOW = 2.0  # length of the compared part of the flight after an impact, in √(radius / g)
NEAR_RADII = 0.5  # clearance in block radii below which the ground may have acted
SEARCHED_INSTANTS = 33  # instants between two flights at which clearances are computed
AFTER_COLUMNS = tuple(map(after, STATE_NAMES[RATES]))
VELOCITY_AFTER, SPIN_AFTER = slice(0, 2), 2  # columns of `ImpactTable.after`


@dataclass
class FlightPairs:
    """Pairs of consecutive flights, with or without an impact between them: (n,) arrays.

    Attributes
    ----------
    before, after : index of the two flights
    block, release : index of block and release
    start_s : recorded instant, from the middle of the flight before, at which a simulation of the impact starts
    begin_s : recorded instant, from the middle of the flight after, at which that flight begins
    wait_s : recorded time from the start of the simulation to that beginning
    window_s : recorded time for which the flight after is compared with a simulation
    zone : zone of the nearest facet of the ground
    tangent : (n, 2) direction of that facet
    touch_s, leave_s : recorded instants, from the middles of the two flights, at which the block touches and leaves the
        ground. Both flights are extrapolated; if neither reaches the ground, the instants are those at which the
        flights are nearest to each other
    arriving, leaving : (n, 6) true states at these instants
    clearance_m : least clearance of the outline between the flights"""

    before: Array
    after: Array
    block: Array
    release: Array
    start_s: Array
    begin_s: Array
    wait_s: Array
    window_s: Array
    zone: Array
    tangent: Array
    touch_s: Array
    leave_s: Array
    arriving: Array
    leaving: Array
    clearance_m: Array

    def __len__(self) -> int:
        return len(self.before)

    def are_impacts(self, world: World) -> Array:
        """(n,) whether the ground is near the outline, or the velocity across the ground changes its sign."""
        coming, going = (ground_axes(self.tangent, own[:, LINEAR_VELOCITY])[1] for own in (self.arriving, self.leaving))
        return (self.clearance_m < NEAR_RADII * world.radii_m[self.block]) | ((coming < 0.0) & (going > 0.0))

    def only(self, keep: Array) -> FlightPairs:
        """Some of the pairs, given as a mask."""
        return FlightPairs(*(getattr(self, f.name)[keep] for f in fields(self)))


def start_instants(world: World, film: Film, flights: Flights, states: States) -> Array:
    """(flights,) recorded instant, from the middle of each flight, at which a simulation from it starts.

    It is the last frame at which the block is well above the ground; NaN if the block is never above it."""
    flight = np.repeat(np.arange(len(flights)), np.diff(flights.start))
    t, block = film.t_s[flights.frames] - flights.middle[flight], flights.block[flight]
    clearance = block_clearances(world, block, move_freely(world, block, states.middle[flight], t)[:, POSE])
    well_above = clearance > START_HEIGHT_RADII * world.radii_m[block]
    start = np.full(len(flights), np.nan)
    for i, (a, b) in enumerate(itertools.pairwise(flights.start)):
        high = np.flatnonzero(well_above[a:b])
        at = a + (high[-1] if len(high) else int(np.argmax(clearance[a:b])))
        if clearance[at] > 0.0:
            start[i] = t[at]
    return start


def find_pairs(world: World, film: Film, flights: Flights, states: States, start: Array) -> FlightPairs:
    """All pairs of consecutive flights; `start`: see `start_instants`."""
    after = np.flatnonzero((flights.follows >= 0) & np.isfinite(start[flights.follows]))
    before = flights.follows[after]
    ends = film.t_s[flights.last[before] - 1] - flights.middle[before]
    begin = film.t_s[flights.first[after]] - flights.middle[after]
    leaves = move_freely(world, flights.block[before], states.middle[before], ends)
    arrives = move_freely(world, flights.block[after], states.middle[after], begin)
    facet = nearest_facets(0.5 * (leaves + arrives)[:, POSITION], world.cross_section.points_m)
    wait = film.t_s[flights.first[after]] - (flights.middle[before] + start[before])
    length = film.t_s[flights.last[after] - 1] - film.t_s[flights.first[after]]
    size = world.radii_m[flights.block[after]]
    window = np.minimum(length, COMPARISON_WINDOW * np.sqrt(size / max(world.gravity_m_s2, 1e-3)))
    return FlightPairs(
        before, after, flights.block[after], flights.release[after], start[before], begin, wait, window,
        world.cross_section.zone_ids[facet], world.cross_section.tangents[facet],
        *_contacts(world, film, flights, states, (before, after)),
    )  # fmt: skip


def _contacts(
    world: World, film: Film, flights: Flights, states: States, pairs: tuple[Array, Array]
) -> tuple[Array, ...]:
    """`FlightPairs.touch_s` to `FlightPairs.clearance_m` of pairs of flights, given as their indices."""
    before, after = pairs
    block, scale = flights.block[before], world.view.time_scale

    def at(which: Array, dt: Array) -> Array:
        return move_freely(world, block, states.middle[which], dt * scale)

    apart = flights.middle[after] - flights.middle[before]
    ends = film.t_s[flights.last[before] - 1] - flights.middle[before]
    begins = film.t_s[flights.first[after]] - flights.middle[before]
    one, other = at(before, ends), at(after, ends - apart)
    off, pace = (other - one)[:, POSITION], (other - one)[:, LINEAR_VELOCITY] * scale
    nearest = -(off * pace).sum(axis=1) / np.maximum((pace**2).sum(axis=1), 1e-12)  # both fall alike
    meet = np.clip(ends + nearest, ends, begins)
    share = np.linspace(0.0, 1.0, SEARCHED_INSTANTS)
    touch, leave, least = meet.copy(), meet.copy(), np.full(len(before), np.inf)
    ground, arrays = ground_arrays(world.cross_section), [block_arrays(b) for b in world.blocks.values()]
    for i in range(len(before)):
        shape, which = arrays[block[i]], np.full(SEARCHED_INSTANTS, i)
        down, up = ends[i] + share * (meet[i] - ends[i]), begins[i] + share * (meet[i] - begins[i])
        both = [clearances(shape, ground, at(flight[which], when)[:, POSE])
                for flight, when in ((before, down), (after, up - apart[i]))]  # fmt: skip
        touch[i], leave[i] = (_crossed(when, own) for when, own in zip((down, up), both, strict=True))
        seen = world.view.true(film.pose[flights.last[before[i]] - 1 : flights.first[after[i]] + 1])
        least[i] = min(both[0].min(), both[1].min(), clearances(shape, ground, seen).min())
    return touch, leave - apart, at(before, touch), at(after, leave - apart), least


def _crossed(when: Array, clearance: Array) -> float:
    """The instant at which a clearance first falls to 0; the last one if it does not."""
    below = np.flatnonzero(clearance <= 0.0)
    if not len(below):
        return float(when[-1])
    k = int(below[0])
    if k == 0 or not np.isfinite(clearance[k - 1 : k + 1]).all():  # far from the ground, or on the far side of it
        return float(when[k])
    return float(when[k - 1] + (when[k] - when[k - 1]) * clearance[k - 1] / (clearance[k - 1] - clearance[k]))


def release_order(release_block: Array) -> Array:
    """(releases,) number of earlier releases of the same block."""
    order = np.zeros(len(release_block), np.int64)
    for block in np.unique(release_block):
        of_block = release_block == block
        order[of_block] = np.arange(of_block.sum())
    return order


def ground_axes(tangent: Array, vectors: Array) -> tuple[Array, Array]:
    """Components (n,) of vectors (n, 2) along the ground and across it; `tangent` (n, 2) is the ground's direction."""
    tx, ty = tangent.T
    x, y = vectors.T
    return tx * x + ty * y, -ty * x + tx * y


@dataclass
class ImpactTable:
    """Impacts of a table.

    Attributes
    ----------
    before : (n, 6) recorded states before the impacts
    after : (n, 3) recorded velocities (vx, vy, omega) after them
    impact_block, impact_zone, impact_release : (n,) index of block, zone and release of each impact
    tangent : (n, 2) direction of the nearest facet
    impact_order : (n,) `order` of the release of each impact
    order : (releases,) number of earlier releases of the same block"""

    before: Array
    after: Array
    impact_block: Array
    impact_zone: Array
    tangent: Array
    impact_release: Array
    impact_order: Array
    order: Array

    @classmethod
    def of(cls, experiment: Experiment) -> Self:
        """Impacts of an experiment with an impact table; rows without a state after are left out."""
        table = experiment.impacts
        assert table is not None
        table = table.dropna(subset=[*STATE_NAMES, *AFTER_COLUMNS]).sort_values("release", kind="stable")
        names = list(experiment.blocks)
        releases, index = np.unique(table["release"].to_numpy(), return_inverse=True)
        block = table["block"].map({name: i for i, name in enumerate(names)}).to_numpy(np.int64)
        first = np.searchsorted(index, np.arange(len(releases)))
        before = table[list(STATE_NAMES)].to_numpy(float)
        cross_section = experiment.cross_section
        facet = nearest_facets(before[:, POSITION], cross_section.points_m)
        order = release_order(block[first]).astype(float)
        return cls(
            before, table[list(AFTER_COLUMNS)].to_numpy(float), block, cross_section.zone_ids[facet],
            cross_section.tangents[facet], index, order[index], order,
        )  # fmt: skip

    @property
    def release_block(self) -> Array:
        """(releases,) index of the block of each."""
        return self.impact_block[np.unique(self.impact_release, return_index=True)[1]]

    def only(self, releases: Array) -> Self:
        """The impacts of some of the releases, given as a mask; releases keep their numbers."""
        own = releases[self.impact_release]
        rows = {f.name: getattr(self, f.name)[own] for f in fields(self) if f.name != "order"}
        return replace(self, **rows)
