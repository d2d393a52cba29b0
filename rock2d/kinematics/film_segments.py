"""Flights and impacts of a film with measured states, without a model of contact."""

from collections.abc import Callable, Hashable
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Self, TypeVar

import numpy as np

from rock2d.arrays import Array
from rock2d.kinematics.flights import RESIDUAL_DEGREES, Film, Flights, find_flights
from rock2d.kinematics.impacts import FlightPairs, find_pairs, release_order, start_instants
from rock2d.kinematics.rest_poses import RestPoses
from rock2d.kinematics.states import States, fit_states, free_motion_key, move_freely
from rock2d.records.columns import N_POSE, N_STATE, OMEGA, POSITION, RATES, THETA, VX, VY, X, Y
from rock2d.scene.world import World
from rock2d.statistics import MAD_TO_SD

Value = TypeVar("Value")

KEPT_VALUES = 4
# degrees of a flight's residuals that show slow errors: forces reach the lower ones
SLOW_DEGREES = np.arange(4, 2 + RESIDUAL_DEGREES)
FEWEST_SLOW_FLIGHTS = 8
MEDIAN_ERROR = 1.17  # standard error of the median size of n normal numbers, over that size, times √n
CLEARLY_SLOW = 4.0  # standard errors by which they must exceed the noise


class LastValues(dict[Hashable, Value]):
    """Values of the last KEPT_VALUES keys."""

    def of(self, key: Hashable, make: Callable[[], Value]) -> Value:
        """The value of a key, made if it is not known."""
        if key not in self:
            if len(self) >= KEPT_VALUES:
                del self[next(iter(self))]
            self[key] = make()
        return self[key]


@dataclass
class FilmSegments:
    """Flights and impacts of a film.

    Attributes
    ----------
    film, flights : the film and its flights
    impacts : pairs of consecutive flights between which the block met the ground or its normal velocity changed sign
    mid_air : other pairs of consecutive flights, which may be one flight
    start_s : (flights,) see `impacts.start_instants`
    unknown_spin : (flights,) 1 sigma in rad/s of the spin where the angle was not measured (that of rolling), else 0
    slow : (flights, 3) see `slow_errors`
    order : (releases,) number of earlier releases of the same block
    rests : blocks that lie on the ground at the end"""

    film: Film
    flights: Flights
    impacts: FlightPairs
    mid_air: FlightPairs
    start_s: Array
    unknown_spin: Array
    slow: Array
    order: Array
    rests: RestPoses
    _states: LastValues[States] = field(default_factory=LastValues, init=False, repr=False, compare=False)

    @classmethod
    def of(cls, film: Film, world: World) -> Self:
        """Divide a film into segments in `world`, which is the stated one or that of `sanity.Sanity.registered`.

        `film.noise` and `film.long_noise` become those of its flights, without slow errors."""
        flights = find_flights(world, film)
        states = fit_states(world, film, flights)
        start = start_instants(world, film, flights, states)
        pairs = find_pairs(world, film, flights, states, start)
        real = pairs.are_impacts(world)
        spin = np.where(film.angle_known[flights.release], 0.0, _rolling(world, flights, states))
        order = release_order(film.release_block).astype(float)
        rests = RestPoses.of(film, world)
        slow, film.long_noise = slow_errors(film, flights, states)
        return cls(film, flights, pairs.only(real), pairs.only(~real), start, spin, slow, order, rests)

    def only(self, releases: Array) -> Self:
        """The segments of some of the releases, given as a mask; releases keep their numbers."""
        keep = releases[self.flights.release]
        index = np.append(np.cumsum(keep) - 1, -1)  # -1 stays -1: the first flight of a release follows none
        flights = self.flights.only(keep)
        flights.follows = index[flights.follows]
        pairs = [each.only(releases[each.release]) for each in (self.impacts, self.mid_air)]
        for each in pairs:
            each.before, each.after = index[each.before], index[each.after]
        return replace(
            self, flights=flights, impacts=pairs[0], mid_air=pairs[1], start_s=self.start_s[keep],
            unknown_spin=self.unknown_spin[keep], slow=self.slow[keep], rests=self.rests.only(releases),
        )  # fmt: skip

    def states(self, world: World) -> States:
        """The states of the flights in a world; they do not depend on the ground."""
        make = partial(fit_states, world, self.film, self.flights)
        return self._states.of(free_motion_key(world), make)

    def states_at(self, world: World, which: Array, dt: Array) -> Array:
        """(n, 6) true states of flights `which` in a world, at recorded instants dt (n,) from their middle."""
        block = self.flights.block[which]
        return move_freely(world, block, self.states(world).middle[which], dt * world.view.time_scale)

    def true_covariance(self, world: World, which: Array, dt: Array, states: Array) -> Array:
        """`state_covariance` of the recorded states, transformed to the true `states` (n, 6) there."""
        unit = np.ones((len(which), N_STATE))
        for c, axis in ((X, (1.0, 0.0)), (Y, (0.0, 1.0))):
            unit[:, c] = unit[:, VX + c] = world.view.true_per_recorded(states, np.array(axis))
        unit[:, RATES] /= world.view.time_scale
        return self.state_covariance(which, dt) * unit[:, :, None] * unit[:, None, :]

    def state_covariance(self, which: Array, dt: Array) -> Array:
        """(n, 6, 6) covariance of the measured states of flights `which`, at recorded instants dt from their middle.

        An angle that was not measured is uniform, and its spin may be that of rolling in either sense."""
        out = np.zeros((len(which), N_STATE, N_STATE))
        rate, level = self.flights.slope[which] ** 2, self.flights.level[which] ** 2
        for c in range(N_POSE):
            variance = self.film.long_noise[c] ** 2 * (1.0 + self.slow[which, c] ** 2)
            out[:, c, c] = variance * (level + rate * dt**2)
            out[:, c, VX + c] = out[:, VX + c, c] = variance * rate * dt
            out[:, VX + c, VX + c] = variance * rate
        no_angle = self.unknown_spin[which] > 0.0
        for c, variance in ((THETA, np.pi**2 / 3.0), (OMEGA, self.unknown_spin[which][no_angle] ** 2)):
            out[no_angle, c, :] = out[no_angle, :, c] = 0.0
            out[no_angle, c, c] = variance
        return out


def slow_errors(film: Film, flights: Flights, states: States) -> tuple[Array, Array]:
    """(flights, 3) errors of x, y and theta that change slowly, over the noise of averages over many frames, and (3,)
    that noise without them.

    Dust, shadow and soil pull the outline of a block for as long as it is near the ground, that is in flights after a
    contact. Such errors do not average out. They are like a random walk: their coefficients of degree k in a flight
    fall as 1/k. Degrees 4 to 6, which forces, lens and perspective hardly reach, show them: they are larger in flights
    after a contact than in those before."""
    found, noise = np.zeros((len(flights), N_POSE)), film.long_noise.copy()
    size = np.abs(states.residuals[:, :, SLOW_DEGREES - 2]) * film.noise[:, None]
    long, later = flights.degrees == RESIDUAL_DEGREES, flights.follows >= 0
    after, before = long & later, long & ~later
    if min(after.sum(), before.sum()) < FEWEST_SLOW_FLIGHTS:
        return found, noise
    typical, usual = (MAD_TO_SD * np.median(size[own], axis=0) for own in (after, before))
    unsure = MEDIAN_ERROR * np.sqrt(1.0 / after.sum() + 1.0 / before.sum())
    for which in (POSITION, slice(THETA, THETA + 1)):  # x and y come from one outline
        own, expected = typical[which], usual[which]
        if own.mean() > expected.mean() * (1.0 + CLEARLY_SLOW * unsure / np.sqrt(own.size)):
            noise[which] = np.clip(expected.mean(axis=1), film.noise[which], noise[which])
            excess = SLOW_DEGREES**2 * (own**2 - expected**2) / noise[which, None] ** 2
            found[later, which] = np.sqrt(max(float(excess.mean()), 0.0))
    return found, noise


def _rolling(world: World, flights: Flights, states: States) -> Array:
    """(flights,) spin in rad/s of a block that rolls at its speed of flight, or at least at √(g radius)."""
    radius = world.radii_m[flights.block]
    speed = np.hypot(states.middle[:, VX], states.middle[:, VY])
    return np.asarray(np.maximum(speed, np.sqrt(max(world.gravity_m_s2, 1e-3) * radius)) / radius)
