"""Contacts between two flights: whether a block met the ground, and when it touched and left it."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from rock2d.engines.geometry import block_arrays, ground_arrays
from rock2d.kinematics.flights import Segmentation, clearances
from rock2d.kinematics.states import Basis, States, move_freely
from rock2d.records.columns import LINEAR_VELOCITY, POSE, POSITION
from rock2d.scene.world import World

Array = np.ndarray

NEAR_RADII = 0.5  # clearance in block radii below which the ground may have acted
SEARCHED_INSTANTS = 33  # instants between two flights at which clearances are computed


class Contacts(NamedTuple):
    """Contacts between pairs of flights: (n,) arrays.

    Attributes
    ----------
    touch_s, leave_s : recorded instants at which the block touches and leaves the ground, from the middles of the two
        flights. Both flights are extrapolated; the instants are those of contact with the ground, or else the instant
        at which the flights are nearest to each other
    arriving, leaving : (n, 6) states at these instants
    clearance_m : least clearance of the outline between the flights
    """

    touch_s: Array
    leave_s: Array
    arriving: Array
    leaving: Array
    clearance_m: Array

    def are_impacts(self, tangent: Array, radius_m: Array) -> Array:
        """(n,) whether the ground is near the outline, or the normal velocity changes its sign; `tangent` (n, 2):
        direction of the ground."""
        across = np.column_stack([-tangent[:, 1], tangent[:, 0]])
        coming, going = (
            (states[:, LINEAR_VELOCITY] * across).sum(axis=1) for states in (self.arriving, self.leaving)
        )
        return (self.clearance_m < NEAR_RADII * radius_m) | ((coming < 0.0) & (going > 0.0))


def find_contacts(
    world: World, segmentation: Segmentation, basis: Basis, states: States, pairs: tuple[Array, Array]
) -> Contacts:
    """Contacts between pairs of flights: (n,) indices of those before and of those after."""
    film, flights = segmentation.film, segmentation.flights
    before, after = pairs
    block, scale = flights.block[before], world.view.time_scale

    def at(which: Array, dt: Array) -> Array:
        return move_freely(world, block, states.middle[which], dt * scale)

    apart = basis.middle[after] - basis.middle[before]
    ends = film.t_s[flights.last[before] - 1] - basis.middle[before]
    begins = film.t_s[flights.first[after]] - basis.middle[before]
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
        gaps = [clearances(shape, ground, at(flight[which], when)[:, POSE])
                for flight, when in ((before, down), (after, up - apart[i]))]  # fmt: skip
        touch[i], leave[i] = (_crossed(when, gap) for when, gap in zip((down, up), gaps, strict=True))
        seen = world.view.true(film.pose[flights.last[before[i]] - 1 : flights.first[after[i]] + 1])
        least[i] = min(gaps[0].min(), gaps[1].min(), clearances(shape, ground, seen).min())
    return Contacts(touch, leave - apart, at(before, touch), at(after, leave - apart), least)


def _crossed(when: Array, gap: Array) -> float:
    """The instant at which a clearance first falls to 0; the last one if it does not."""
    below = np.flatnonzero(gap <= 0.0)
    if not len(below):
        return float(when[-1])
    k = int(below[0])
    if k == 0 or not np.isfinite(gap[k - 1 : k + 1]).all():  # far from the ground, or on the far side of it
        return float(when[k])
    return float(when[k - 1] + (when[k] - when[k - 1]) * gap[k - 1] / (gap[k - 1] - gap[k]))
