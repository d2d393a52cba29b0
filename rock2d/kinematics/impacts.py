"""Impacts of a film: pairs of consecutive flights.

An *impact* here is everything between two flights: one touch of the ground, or several.
"""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np

from rock2d.engines.geometry import block_arrays, ground_arrays
from rock2d.kinematics.flights import Segmentation, clearances
from rock2d.kinematics.states import Basis, States, move_freely
from rock2d.records.columns import POSE, POSITION
from rock2d.scene.nearest_facet import nearest_facets
from rock2d.scene.world import World

Array = np.ndarray

START_HEIGHT_RADII = 0.5  # block radii above the ground at which the simulation of an impact starts
COMPARISON_WINDOW = 2.0  # length of the compared part of the flight after an impact, in √(radius / g)


@dataclass
class Impacts:
    """Pairs of consecutive flights: (n,) arrays.

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
    order : number of releases of the same block that were filmed before
    """

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
    order: Array

    def __len__(self) -> int:
        return len(self.before)

    def only(self, keep: Array) -> Impacts:
        """Some of the pairs, given as a mask."""
        return Impacts(*(getattr(self, f.name)[keep] for f in fields(self)))


def start_instants(world: World, segmentation: Segmentation, basis: Basis, states: States) -> Array:
    """(flights,) recorded instant, from the middle of each flight, at which a simulation from it starts.

    It is the last frame at which the block is well above the ground; NaN if the block is never above it.
    """
    film, flights = segmentation.film, segmentation.flights
    blocks = list(world.blocks.values())
    ground = ground_arrays(world.cross_section)
    start = np.full(len(flights), np.nan)
    for i in range(len(flights)):
        block = blocks[flights.block[i]]
        t = film.t_s[flights.first[i] : flights.last[i]] - basis.middle[i]
        path = move_freely(
            world, np.full(len(t), flights.block[i]), np.repeat(states.middle[i][None], len(t), 0), t
        )
        gap = clearances(block_arrays(block), ground, path[:, POSE])
        high = np.flatnonzero(gap > START_HEIGHT_RADII * block.radius_m)
        at = high[-1] if len(high) else int(np.argmax(gap))
        if gap[at] > 0.0:
            start[i] = t[at]
    return start


def find_impacts(
    world: World, segmentation: Segmentation, basis: Basis, states: States, start: Array
) -> Impacts:
    """All pairs of consecutive flights, with or without an impact; `start`: see `start_instants`."""
    film, flights = segmentation.film, segmentation.flights
    after = np.flatnonzero((flights.follows >= 0) & np.isfinite(start[flights.follows]))
    before = flights.follows[after]
    blocks = list(world.blocks.values())
    ends = film.t_s[flights.last[before] - 1] - basis.middle[before]
    begin = film.t_s[flights.first[after]] - basis.middle[after]
    leaves = move_freely(world, flights.block[before], states.middle[before], ends)
    arrives = move_freely(world, flights.block[after], states.middle[after], begin)
    facet = nearest_facets(0.5 * (leaves + arrives)[:, POSITION], world.cross_section.points_m)
    wait = film.t_s[flights.first[after]] - (basis.middle[before] + start[before])
    length = film.t_s[flights.last[after] - 1] - film.t_s[flights.first[after]]
    size = np.array([b.radius_m for b in blocks])[flights.block[after]]
    window = np.minimum(length, COMPARISON_WINDOW * np.sqrt(size / max(world.gravity_m_s2, 1e-3)))
    return Impacts(
        before, after, flights.block[after], flights.release[after], start[before], begin, wait, window,
        world.cross_section.zone_ids[facet], world.cross_section.tangents[facet],
        release_order(film.release_block)[flights.release[after]].astype(float),
    )  # fmt: skip


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
