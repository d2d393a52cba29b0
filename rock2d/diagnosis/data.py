"""The data of a fit: segments of a film or impacts of a table, and their residuals in a world.

Every impact of a film is simulated from the measured flight before it, a little above the ground. It is compared with
the next flight by the differences of pose and velocity at the beginning of that flight, along the ground and across it.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import NamedTuple, Self

import numpy as np

from rock2d.arrays import Array
from rock2d.diagnosis.quantities import (
    SERIES,
    TIME_S,
    history_quantities,
    incident_features,
    incident_quantities,
    moving_quantities,
)
from rock2d.engines.batch import BATCH_STEP_FRACTION, BatchResult, run_world
from rock2d.kinematics.film_segments import FilmSegments, LastValues
from rock2d.kinematics.flights import RESIDUAL_DEGREES, block_clearances
from rock2d.kinematics.impacts import SPIN_AFTER, VELOCITY_AFTER, FlightPairs, ImpactTable, ground_axes
from rock2d.kinematics.states import free_motion_key, move_freely
from rock2d.kinematics.turned_ground import TurnedRun, run_on_turned_ground
from rock2d.records.columns import (
    AFTER,
    BEFORE,
    INSTANT_STATE,
    N_POSE,
    N_STATE,
    OMEGA,
    POSE,
    POSITION,
    RATES,
    THETA,
    VX,
    VY,
    X,
    Y,
)
from rock2d.scene.world import World

ALONG, ACROSS = range(2)  # columns of residuals of impacts; their rates follow three columns later
COARSE_STEPS = 2.0  # factor on time steps: it changes residuals by 0.01 of the noise (median), 0.3 (95 %)
START_GAP_RADII = 0.3  # block radii by which the block is moved back before the touch
SLOWEST_START_M_S = 0.05  # speed of a slower block when it is moved back
UNSEEN_TURN_RAD = np.pi / 2.0  # turn between two frames from which on full turns cannot be counted for sure
COMPARED_INSTANTS = 5  # within `FlightPairs.window_s`
VELOCITY_STEP_S = 1e-6  # for velocities in the image
LONGEST_IMPACT = 3.0  # in √(radius / g)
RELATIVE_PRECISION = 1e-3  # precision of the numbers in a table, in units of the spread of their column


@dataclass
class Residuals:
    """Impacts (n, d) in SI, NaN where one cannot be simulated; flights (m, 3, degrees) in units of noise. On film the
    rests of each block follow the flights, see `as_rows_of_flights`.

    d = 6 on film: along the ground and across it (m) and angle (rad), then their rates; in an impact table the rates
    alone."""

    impacts: Array
    flights: Array

    def minus(self, other: Residuals) -> Residuals:
        """Difference to other residuals; 0 where an impact cannot be simulated."""
        return Residuals(np.nan_to_num(self.impacts - other.impacts), self.flights - other.flights)


class Observed(NamedTuple):
    """What a film shows in a world, whatever its contact law.

    Attributes
    ----------
    starts : (n, 6) true states a little before each impact, with which simulations begin
    moments_s : (n, k) true times after the beginning of the next flight at which outcomes are compared
    instants_s : (n, k) the same times after the starts
    poses : (n, k, 3) true poses then, from the next flight
    units_m : (n, 2) true lengths along the ground and across it for a recorded length of 1 m
    uncounted : (n,) whether the block turns so fast that its full turns cannot be counted
    flights : residuals of flights and rests"""

    starts: Array
    moments_s: Array
    instants_s: Array
    poses: Array
    units_m: Array
    uncounted: Array
    flights: Array


@dataclass
class FilmData(FilmSegments):
    """n impacts and m flights of a film. `step_fraction`: that of the simulated impacts, see `run_batch`.

    Attributes
    ----------
    impact_release, impact_block, impact_zone : (n,) index of release, block and zone of each impact
    impact_order : (n,) position of each impact's release in its block's series
    tangent : (n, 2) direction of the ground at each impact
    flown : number of flights
    flight_release, flight_block : (m,) index of release and block of each flight, then of the rests of each block"""

    step_fraction: float = BATCH_STEP_FRACTION
    _observed: LastValues[Observed] = field(default_factory=LastValues, init=False, repr=False, compare=False)

    def coarse(self) -> Self:
        """The same data with fewer steps in simulated impacts, for exploring."""
        return replace(self, step_fraction=COARSE_STEPS * self.step_fraction)

    def flights_alone(self) -> Self:
        """The same data without impacts."""
        return replace(self, impacts=self.impacts.only(np.zeros(len(self.impacts), bool)))

    @property
    def impact_release(self) -> Array:
        return self.impacts.release

    @property
    def flown(self) -> int:
        return len(self.flights)

    @cached_property
    def flight_release(self) -> Array:
        return np.concatenate([self.flights.release, self.rests.first_release])

    @cached_property
    def flight_block(self) -> Array:
        return np.concatenate([self.flights.block, self.rests.blocks])

    @property
    def impact_order(self) -> Array:
        return self.order[self.impacts.release]

    @property
    def impact_block(self) -> Array:
        return self.impacts.block

    @property
    def impact_zone(self) -> Array:
        return self.impacts.zone

    @property
    def tangent(self) -> Array:
        return self.impacts.tangent

    def residuals(self, world: World, shift: Array | float = 0.0) -> Residuals:
        """Residuals in a world, in the camera's units; `shift` (6,) or (n, 6) is added to the states before the
        impacts."""
        known = self.observed(world)
        starts = known.starts + shift
        simulated = _simulated_poses(world, self.impacts, starts, known.instants_s, self.step_fraction)
        difference = self.outcomes(world, simulated - known.poses)
        turns = difference[known.uncounted, THETA] / (2.0 * np.pi)
        difference[known.uncounted, THETA] -= 2.0 * np.pi * np.round(turns)
        return Residuals(difference, known.flights)

    def observed(self, world: World) -> Observed:
        """What the film shows in a world, whatever its contact law."""
        key = free_motion_key(world), self.rests.key(world)
        return self._observed.of(key, lambda: self._observe(world))

    def _observe(self, world: World) -> Observed:
        impacts, states, pace = self.impacts, self.states(world), world.view.time_scale
        recorded_s = np.linspace(0.0, 1.0, COMPARED_INSTANTS) * impacts.window_s[:, None]
        after, since = np.repeat(impacts.after, COMPARED_INSTANTS), impacts.begin_s[:, None] + recorded_s
        poses = self.states_at(world, after, since.ravel())[:, POSE]
        along = impacts.tangent
        units_m = np.column_stack([
            world.view.true_per_recorded(states.middle[impacts.after], direction)
            for direction in (along, np.column_stack([-along[:, Y], along[:, X]]))
        ])  # fmt: skip
        spin = np.fmax(*np.abs(states.middle[[impacts.before, impacts.after], OMEGA]))
        noise = self.film.measured * self.film.noise / self._coefficient_noise
        flights = [states.residuals * noise[..., None], as_rows_of_flights(self.rests.residuals(world))]
        return Observed(
            self.incident(world), recorded_s * pace, (impacts.wait_s[:, None] + recorded_s) * pace,
            poses.reshape(len(impacts), COMPARED_INSTANTS, N_POSE), units_m,
            spin * self._hidden_s * pace > UNSEEN_TURN_RAD, np.concatenate(flights),
        )  # fmt: skip

    @cached_property
    def _coefficient_noise(self) -> Array:
        """(flown, 3) standard deviations of the recorded coefficients of flights, of degree 2 and higher."""
        return np.asarray(self.film.long_noise * np.sqrt(1.0 + (self.slow / 2.0) ** 2))

    @cached_property
    def _hidden_s(self) -> Array:
        """(n,) longest recorded time between two frames, from the flight before each impact to the flight after."""
        flights, t_s = self.flights, self.film.t_s
        first, last = flights.last[self.impacts.before] - 1, flights.first[self.impacts.after]
        return np.array([np.diff(t_s[a : b + 1]).max() for a, b in zip(first, last, strict=True)], float)

    def outcomes(self, world: World, difference: Array) -> Array:
        """Residuals (n, 6), in the camera's units, from differences of true poses (n, k, 3) at the compared
        instants."""
        known = self.observed(world)
        difference = _level_and_rate(self.impacts.tangent, known.moments_s, difference)
        for c in (ALONG, ACROSS):
            difference[:, [c, VX + c]] /= known.units_m[:, [c]]
        difference[:, RATES] *= world.view.time_scale
        no_angle = self.unknown_spin[self.impacts.after] > 0.0
        difference[np.ix_(no_angle, (THETA, OMEGA))] = 0.0  # not measured
        return difference

    def incident(self, world: World) -> Array:
        """(n, 6) states at the starts of the simulations."""
        return self.states_at(world, self.impacts.before, self.impacts.start_s)

    def state_noise(self, world: World) -> Array:
        """(n, 6, 6) covariance of the states before the impacts, in a world."""
        impacts = self.impacts
        return self.true_covariance(world, impacts.before, impacts.start_s, self.incident(world))

    def outcome_noise(self) -> Array:
        """(n, 6, 6) covariance of the states after the impacts, along the ground and across it."""
        turn = self._to_ground_axes()
        return turn @ self.state_covariance(self.impacts.after, self.impacts.begin_s) @ turn.transpose(0, 2, 1)

    def _to_ground_axes(self) -> Array:
        """(n, 6, 6) from states x, y, theta and their rates to those along the ground and across it."""
        turn = np.zeros((len(self.impacts), N_STATE, N_STATE))
        tx, ty = self.impacts.tangent.T
        for x, y, theta in ((X, Y, THETA), (VX, VY, OMEGA)):
            turn[:, x, x], turn[:, x, y], turn[:, y, x], turn[:, y, y] = tx, ty, -ty, tx
            turn[:, theta, theta] = 1.0
        return turn

    def slow_outcomes(self) -> Array:
        """(n, 6, k) columns: slow errors of pose and velocity after the impacts, along the ground and across it, 1
        sigma; k = 6, or 0 if the track has none."""
        if not self.slow.any():
            return np.empty((len(self.impacts), N_STATE, 0))
        which = self.impacts.after
        size = self.slow[which] * self.film.long_noise
        level, rate = (np.zeros((len(which), N_STATE, N_STATE)) for _ in range(2))
        for c in range(N_POSE):
            level[:, c, c] = size[:, c] * self.flights.level[which]
            rate[:, VX + c, VX + c] = size[:, c] * self.flights.slope[which]
            rate[:, c, VX + c] = rate[:, VX + c, VX + c] * self.impacts.begin_s
        return self._to_ground_axes() @ (level + rate)

    def extra_scatter(self) -> Array:
        """(n, 6, 0) directions of noise whose size is fitted with the soil's scatter. A film has none: its noise is
        estimated from the flights."""
        return np.empty((len(self.impacts), N_STATE, 0))

    def impact_features(self, world: World) -> Array:
        """(n, features) of impacts: velocities along and across the facet, spin, orientation, place, order."""
        impacts = self.impacts
        known = incident_features(world, impacts.block, impacts.zone, impacts.tangent, self.incident(world))
        return np.column_stack([known, self.impact_order, impacts.wait_s])

    def impact_quantities(self, world: World) -> dict[str, Array]:
        """Name -> (n,): what is known of each impact before it happens; see `incident_quantities`."""
        impacts = self.impacts
        began = self.flights.middle[impacts.before] + impacts.start_s
        found = incident_quantities(world, impacts.block, impacts.zone, impacts.tangent, self.incident(world))
        found |= history_quantities(impacts.release, self.impact_order, began) | {TIME_S: self._times(world)}
        return found

    def outcome_quantities(self, world: World) -> dict[str, Array]:
        """Name -> (n,): what is known of each flight after an impact."""
        impacts = self.impacts
        after = self.states_at(world, impacts.after, impacts.begin_s)
        known = {SERIES: self.impact_order, TIME_S: self._times(world)}
        return moving_quantities(after[:, RATES]) | known

    def _times(self, world: World) -> Array:
        """(n,) true time in s from the beginning of the release to the end of each impact."""
        impacts = self.impacts
        begin = self.film.t_s[np.searchsorted(self.film.release, impacts.release)]
        return np.asarray((self.flights.middle[impacts.after] + impacts.begin_s - begin) * world.view.time_scale)

    def flight_noise(self, world: World) -> Array:
        """(m, 3) standard deviations of the true coefficients of flights; residuals of flights are in these units."""
        noise = self._coefficient_noise.copy()
        middle = self.states(world).middle
        for c, axis in ((X, (1.0, 0.0)), (Y, (0.0, 1.0))):
            noise[:, c] *= world.view.true_per_recorded(middle, np.array(axis))
        return noise

    def flight_features(self, world: World) -> Array:
        """(m, features) of flights: accelerations that forces would cause, times the bend under a unit acceleration."""
        flights = self.flights
        bends = self.unit_bends()
        x, y, theta, vx, vy, w = self.states(world).middle.T
        speed, radius = np.hypot(vx, vy), world.radii_m[flights.block]
        terms = [vx, vy, speed * vx, speed * vy, w * radius * vx, w * radius * vy, x, y, x * vx, y * vy,
                 self.order[flights.release], np.sin(theta), np.cos(theta), w * radius * np.sin(theta),
                 w * radius * np.cos(theta)]  # fmt: skip
        kinds = [flights.block == b for b in range(len(world.blocks))]
        return np.column_stack([bends, *[t * bends for t in terms], *terms, *kinds, *[k * bends for k in kinds]])

    def unit_bends(self) -> Array:
        """(m,) bend of each flight under the same acceleration, scaled to unit mean square."""
        duration = 1.0 / (self.flights.slope * self.flights.level)
        bends = duration**2 / self.flights.level
        return np.asarray(bends / np.sqrt(np.mean(bends**2)))


@dataclass
class TableData(ImpactTable):
    """n impacts of a table, with the methods of `FilmData`. Each impact is simulated from the state before it.

    Only velocities are compared: the position of the block at the instant of the measurement is rarely known to the
    depth of an indentation. On a hard floor the time in contact is not seen either, so the data determine only the
    ratio of the stiffnesses."""

    flown = 0
    flight_release = flight_block = np.empty(0, np.int64)

    def coarse(self) -> Self:
        """The same data: single impacts take little time."""
        return self

    def residuals(self, world: World, shift: Array | float = 0.0) -> Residuals:
        """Simulated less recorded velocities after each impact: along the ground, across it, spin. `shift` (6,) or
        (n, 6) is added to the states before.

        A block that does not leave the ground has the velocities with which it stays on the ground."""
        true = _true_states(world, self.before) + shift
        radius = world.radii_m[self.impact_block]
        starts, gap = true.copy(), block_clearances(world, self.impact_block, true[:, POSE])
        starts[:, X] += gap * self.tangent[:, Y]  # along the normal, until the block touches the ground
        starts[:, Y] -= gap * self.tangent[:, X]
        pace = np.maximum(np.hypot(starts[:, VX], starts[:, VY]), SLOWEST_START_M_S)
        earlier = move_freely(world, self.impact_block, starts, -START_GAP_RADII * radius / pace)
        # a slow block, or one that rotates into the ground, may touch the ground on the way back
        clear = block_clearances(world, self.impact_block, earlier[:, POSE]) > 0.0
        starts = np.where(clear[:, None], earlier, starts)
        lasts = LONGEST_IMPACT * np.sqrt(radius / max(world.gravity_m_s2, 1e-3))
        limit = lasts + 10 * START_GAP_RADII * radius / pace
        result = run_world(world, starts, self.impact_block, time_limit_s=limit, impact_limit=1, impact_room=1)
        touch = result.impacts[:, 0]
        leaves = np.isfinite(touch[:, AFTER])
        stays = np.isfinite(touch[:, BEFORE]) & ~leaves
        end = np.where(stays, result.ends[:, INSTANT_STATE], touch[:, AFTER])
        recorded = _recorded_velocities(world, end)
        d = recorded - self.after
        residuals = np.column_stack([*ground_axes(self.tangent, d[:, VELOCITY_AFTER]), d[:, SPIN_AFTER]])
        return Residuals(residuals, np.empty((0, N_POSE, RESIDUAL_DEGREES)))

    def incident(self, world: World) -> Array:
        """(n, 6) states before the impacts."""
        return _true_states(world, self.before)

    def state_noise(self, world: World) -> Array:
        """(n, 6, 6) zeros: the noise of a table is unknown. It is fitted, see `extra_scatter`."""
        return np.zeros((len(self.before), N_STATE, N_STATE))

    def outcome_noise(self) -> Array:
        """(n, 3, 3) covariance of rounding errors: a table gives numbers with a few digits."""
        return np.eye(3) * (RELATIVE_PRECISION * self._spread()) ** 2 * np.ones((len(self.before), 1, 1))

    def slow_outcomes(self) -> Array:
        """(n, 3, 0): a table has no slow errors of a track."""
        return np.empty((len(self.before), 3, 0))

    def extra_scatter(self) -> Array:
        """(n, 3, 3) directions of the measurement noise: the velocities, in units of their spread."""
        return np.eye(3) * self._spread() * np.ones((len(self.before), 1, 1))

    def _spread(self) -> Array:
        return np.maximum(self.after.std(axis=0), 1e-6)

    def impact_features(self, world: World) -> Array:
        """(n, features) of impacts."""
        known = incident_features(world, self.impact_block, self.impact_zone, self.tangent, self.before)
        return np.column_stack([known, self.impact_order])

    def impact_quantities(self, world: World) -> dict[str, Array]:
        """Name -> (n,): what is known of each impact before it happens; see `incident_quantities`."""
        found = incident_quantities(world, self.impact_block, self.impact_zone, self.tangent, self.incident(world))
        return found | history_quantities(self.impact_release, self.impact_order, np.arange(len(self.before)))

    def outcome_quantities(self, world: World) -> dict[str, Array]:
        """Name -> (n,): the velocities after the impacts."""
        return moving_quantities(self.after) | {SERIES: self.impact_order.astype(float)}


def _true_states(world: World, recorded: Array) -> Array:
    """States of the centre of mass from recorded states (n, 6) of the centroid."""
    pose = world.view.true(recorded[:, POSE])
    later_pose = world.view.true(recorded[:, POSE] + VELOCITY_STEP_S * recorded[:, RATES])
    return np.column_stack([pose, (later_pose - pose) / (VELOCITY_STEP_S * world.view.time_scale)])


def _recorded_velocities(world: World, true: Array) -> Array:
    """(n, 3) velocities in the image of true states (n, 6)."""
    pose = world.view.record(true[:, POSE])
    later_pose = world.view.record(true[:, POSE] + VELOCITY_STEP_S * true[:, RATES])
    return (later_pose - pose) / VELOCITY_STEP_S * world.view.time_scale


def _simulated_poses(world: World, impacts: FlightPairs, starts: Array, times_s: Array, step_fraction: float) -> Array:
    """Poses (n, k, 3) of the centre of mass at true instants `times_s` (n, k) after `starts` (n, 6).

    NaN where a start is not finite, as after extrapolating a flight back with an impossible drag."""
    possible = np.isfinite(starts).all(axis=1)
    starts, times_s = np.where(possible[:, None], starts, 0.0), np.where(possible[:, None], times_s, 0.0)
    limits = times_s[:, -1] + 1e-9

    def run(at: Array | slice, moved_m: Array) -> TurnedRun | BatchResult:
        own = replace(world, contact=world.contact[at]) if len(world.contact) > 1 else world
        states = starts[at] - np.eye(N_STATE)[X] * moved_m[:, None]
        if world.slope_rad.any():
            own = replace(own, slope_rad=world.slope_rad[at]) if len(world.slope_rad) > 1 else own
            return run_on_turned_ground(own, impacts.block[at], states, limits[at], times_s[at], step_fraction)
        return run_world(
            own, states, impacts.block[at], time_limit_s=limits[at], times_s=times_s[at], step_fraction=step_fraction
        )

    found = run(slice(None), np.zeros(len(starts)))
    samples, moved_m = found.samples, moved_before(impacts.release, np.where(possible, found.ground_shift_m, 0.0))
    if len(again := np.flatnonzero(moved_m)):  # the ground stays where it was pushed until the release ends
        samples[again] = run(again, moved_m[again]).samples
        samples[again, :, X] += moved_m[again, None]
    samples[~possible] = np.nan
    return samples


def moved_before(release: Array, shift_m: Array) -> Array:
    """(n,) displacements of the ground in m by the earlier impacts of the same release, from those by each impact."""
    if not shift_m.any():
        return np.zeros(len(shift_m))
    first = np.r_[True, release[1:] != release[:-1]]
    before = np.cumsum(shift_m) - shift_m
    return before - before[np.maximum.accumulate(np.where(first, np.arange(len(first)), 0))]


def _level_and_rate(tangent: Array, t: Array, difference: Array) -> Array:
    """(n, 6) straight lines through differences of poses (n, k, 3) at times t (n, k): along the ground, across it (m),
    angle (rad) at t = 0, then their rates."""
    centred = t - t.mean(axis=1, keepdims=True)
    rate = (centred[..., None] * difference).sum(axis=1) / (centred**2).sum(axis=1)[:, None]
    level = difference.mean(axis=1) - rate * t.mean(axis=1)[:, None]
    return np.column_stack([
        *ground_axes(tangent, level[:, POSITION]), level[:, THETA],
        *ground_axes(tangent, rate[:, POSITION]), rate[:, THETA],
    ])  # fmt: skip


def as_rows_of_flights(rests: Array) -> Array:
    """(k, 3, degrees, ...) rows of `Residuals.flights` from `RestPoses.residuals` (k, 3, ...): y has height and slope,
    the angle its own."""
    rows = np.zeros((len(rests), N_POSE, RESIDUAL_DEGREES, *rests.shape[2:]))
    rows[:, Y, :2], rows[:, THETA, 0] = rests[:, [0, 2]], rests[:, 1]
    return rows


Data = FilmData | TableData
