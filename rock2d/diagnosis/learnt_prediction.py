"""Prediction of every segment of another film, from one flight to the next, with learnt changes.

A learnt change depends on the place where the block touches the ground. So the segment is simulated first without the
change to find this place, and then with the changed law and the changed state before the impact.

Changes after an impact were learnt from blocks that fly on. They act only if a flight follows that is long enough for a
film: the state at lift-off changes, learnt accelerations act until the block touches the ground again, and the engine
simulates the rest. For a block that rolls, slides or lies still the engine alone determines the motion."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from rock2d.arrays import Array
from rock2d.diagnosis import quantities as q
from rock2d.diagnosis.data import moved_before
from rock2d.diagnosis.flight_response import flight_paths, flight_response, path_quantities
from rock2d.diagnosis.levers import FLIGHT, FRAME, FRAME_COLUMNS, LAW, OUTCOME, PROFILE, SLOPE, STATE
from rock2d.diagnosis.model import with_changed_law
from rock2d.diagnosis.replay import END_MARGIN_S, Segments, recorded_poses
from rock2d.effects.columns import column, widened
from rock2d.engines.batch import BatchResult, run_batch, run_world, world_ensemble
from rock2d.kinematics.film_segments import FilmSegments
from rock2d.kinematics.flights import FEWEST_FLIGHT_FRAMES, block_clearances
from rock2d.kinematics.states import move_freely
from rock2d.kinematics.turned_ground import touched_points, turned
from rock2d.records.columns import (
    BEFORE,
    I_TIME,
    I_TIME_AFTER,
    INSTANT_STATE,
    LINEAR_VELOCITY,
    N_POSE,
    N_STATE,
    POSE,
    POSITION,
    RATES,
    THETA,
    TIME,
    X,
)
from rock2d.scene.nearest_facet import nearest_facets
from rock2d.scene.rough_ground import raised
from rock2d.scene.world import World

COUNTED_IMPACTS = 16  # impacts of a segment that are searched for a flight after them
STEPS_OF_LEAST_FLIGHT = 8  # time steps in the shortest flight
# in radii of the smallest block, so that no step passes through an edge of the ground
LONGEST_STEP_RADII = 0.25


@dataclass
class KnownChange:
    """A learnt change of a diagnosis: lever, basis and coefficients (components of the lever, functions), in SI."""

    lever: str
    basis: q.Basis
    coefficients: Array

    @property
    def name(self) -> str:
        """Name of the lever and of its dependence."""
        return f"{self.lever} of {self.basis.name}"

    def of(self, quantities: Mapping[str, Array]) -> Array:
        """(n, components of the lever) change for quantities, name -> (n,)."""
        return np.asarray(self.basis.features(quantities) @ self.coefficients.T)


def read_changes(content: Sequence[Mapping[str, Any]], world: World | None = None) -> list[KnownChange]:
    """The learnt changes of a diagnosis, from the key `changes`, for blocks and zones of a `world`."""
    return [KnownChange(c["lever"], q.read_basis(c, world), np.array(c["coefficients"], float)) for c in content]


def predicted_poses(
    data: FilmSegments,
    segments: Segments,
    world: World,
    changes: Sequence[KnownChange] = (),
    shift: Array | float = 0.0,
) -> Array:
    """(n, k, 3) predicted poses of the segments as the camera records them; the rows of `world` are those of the
    segments.

    `shift` (n, 6) is added to the states at the starts."""
    starts = data.states_at(world, segments.flight, data.start_s[segments.flight]) + shift
    block, times = segments.block, segments.instants_s * world.view.time_scale
    limits = np.where(np.isfinite(times), times, 0.0).max(axis=1) + END_MARGIN_S
    begins, moved_m = starts.copy(), np.zeros(len(starts))
    if widened(world.contact)[..., column("recoil_1_kg")].any():
        # the ground stays where it was pushed until the release ends
        pushed_m = run_world(world, starts, block, time_limit_s=limits).ground_shift_m
        moved_m = moved_before(segments.release, pushed_m)
    begins[:, X] -= moved_m
    if changes:
        samples = LearntMotion(changes, world, data, segments, begins, limits).samples(times)
    else:
        samples = run_world(world, begins, block, time_limit_s=limits, times_s=times).samples
    samples[..., X] += moved_m[:, None]
    return recorded_poses(world, block, samples, starts[:, POSE])


class _FlightsAfter(NamedTuple):
    """m flights after impacts, without the changes after the impacts.

    segment : (m,) index of the segment
    left_s, clear_s : (m,) time from the start of the segment to the end of the impact, and until the block is clear of
        the ground
    state : (m, 6) state when clear"""

    segment: Array
    left_s: Array
    clear_s: Array
    state: Array


class LearntMotion:
    """The n segments of a film with learnt changes, from the states `start` (n, 6) on; they last `limit_s` (n,)."""

    def __init__(
        self, changes: Sequence[KnownChange], world: World, data: FilmSegments, segments: Segments, start: Array,
        limit_s: Array,
    ) -> None:  # fmt: skip
        self._changes, self._segments, self._world, self._limit_s = changes, segments, world, limit_s
        self._begin_s = segments.began_s * world.view.time_scale
        # shortest flight that a film shows
        self._least_flight_s = FEWEST_FLIGHT_FRAMES * segments.frame_s * world.view.time_scale
        touch = self._run(world, start, impact_limit=1, impact_room=1)
        known = np.isfinite(touch.impacts[:, 0, 0])
        at = np.where(known[:, None], touch.impacts[:, 0, BEFORE], touch.ends[:, INSTANT_STATE])
        facet = nearest_facets(np.ascontiguousarray(at[:, POSITION]), world.cross_section.points_m)
        self._tangent = world.cross_section.tangents[facet]
        zone = world.cross_section.zone_ids[facet]
        self._history = {
            q.SERIES: world.order.astype(float),
            q.HISTORY: np.minimum(segments.number, q.MOST_COUNTED_IMPACTS).astype(float),
        }
        ended = touch.impacts[:, 0, I_TIME_AFTER]  # NaN where there is no impact, or the segment ends in it
        lasts = np.where(np.isfinite(ended), ended, limit_s)
        self._history[q.TIME_S] = self._begin_s + lasts
        before = q.incident_quantities(world, segments.block, zone, self._tangent, start)
        self._quantities = self._history | before
        self._pivot = touched_points(world, segments.block, at[:, POSE])
        self._slope = np.zeros(len(at))
        self._start, self._frame = start.copy(), np.zeros_like(start)
        for change in changes:
            if change.lever == FLIGHT:
                self._start += self._change_of_starts(change, data)
                continue
            amount = change.of(self._quantities)
            if change.lever == SLOPE:
                self._slope += amount[:, 0]
            elif change.lever == FRAME:
                self._frame[:, FRAME_COLUMNS] += amount
            elif change.lever == LAW:
                self._world = with_changed_law(self._world, amount)
            elif change.lever == STATE:
                self._start += amount
            elif change.lever == PROFILE:
                self._world = _with_profile(self._world, change)

    def _run(self, world: World, start: Array, which: Array | None = None, **more: Any) -> BatchResult:
        """The segments `which` (default: all), simulated from their states `start`."""
        block = self._segments.block
        segment = np.arange(len(block)) if which is None else which
        ensemble, tables = world_ensemble(world)
        return run_batch(
            ensemble, start, block_ids=block[segment], table_ids=tables if len(tables) == 1 else tables[segment],
            gravity_m_s2=world.gravity_m_s2, **{"time_limit_s": self._limit_s[segment], **more},
        )  # fmt: skip

    def _change_of_starts(self, change: KnownChange, data: FilmSegments) -> Array:
        """(n, 6) change of the states at the starts by a learnt acceleration."""
        flight = self._segments.flight
        response = flight_response(data, self._world, flight_paths(data, self._world), change.basis)
        place, rate = response.state_change(flight, data.start_s[flight] * self._world.view.time_scale)
        return np.column_stack([place @ change.coefficients.T, rate @ change.coefficients.T])

    def samples(self, t_s: Array) -> Array:
        """(n, k, 3) poses at true times t_s (n, k) from the start, infinite where there is no frame.

        NaN where the block has left the cross-section."""
        poses = self._run(self._world, self._start, times_s=t_s).samples
        if not any(change.lever in (SLOPE, OUTCOME, FRAME, FLIGHT) for change in self._changes):
            return poses
        # A ground with another slope is equivalent to the stated ground with the motion turned the other way. Unlike in
        # a fit, it also meets later strikes of the same impact.
        begins = turned(self._start + self._frame, self._pivot, -self._slope)
        flights = self._flights_after(begins)
        segment = flights.segment
        if not len(segment):
            return poses
        before = self._run(self._world, begins[segment], segment, times_s=t_s[segment]).samples
        before = turned(before, self._pivot[segment, None], self._slope[segment, None])
        before[..., THETA] -= self._frame[segment, None, THETA]
        since_s = t_s[segment] - flights.clear_s[:, None]
        poses[segment] = np.where(since_s[..., None] > 0.0, self._poses_when_clear(flights, since_s), before)
        return poses

    def _flights_after(self, begins: Array) -> _FlightsAfter:
        """The first flight after an impact that a film would show, for each segment from the states `begins` (n, 6)."""
        least = self._least_flight_s
        longer = self._limit_s + least  # needed to tell whether a flight follows
        result = self._run(self._world, begins, time_limit_s=longer, impact_room=COUNTED_IMPACTS)
        impacts = result.impacts
        following = np.append(impacts[:, 1:, I_TIME], np.full((len(impacts), 1), np.nan), axis=1)
        ends = np.broadcast_to(result.ends[:, None, TIME], following.shape)
        number = np.arange(impacts.shape[1])
        following = np.where(number == result.impact_count[:, None] - 1, ends, following)
        lasts = following - impacts[..., I_TIME_AFTER]
        long = lasts >= least  # NaN in an impact that has no end: the block stays on the ground
        segment = np.flatnonzero(long.any(axis=1))
        at = (segment, long[segment].argmax(axis=1))
        left_s = impacts[at][:, I_TIME_AFTER]
        # at the end of an impact the block is still in its indentation
        after_s = np.linspace(0.0, 0.5, 1 + STEPS_OF_LEAST_FLIGHT) * lasts[at][:, None]
        poses = self._run(
            self._world, begins[segment], segment, time_limit_s=longer[segment], times_s=left_s[:, None] + after_s
        ).samples
        clear = np.column_stack([self._clear(segment, poses[:, k]) for k in range(after_s.shape[1])])
        clear_s = after_s[np.arange(len(segment)), clear.argmax(axis=1)]
        states = self._run(self._world, begins[segment], segment, time_limit_s=left_s + clear_s).ends[:, INSTANT_STATE]
        known = clear.any(axis=1)
        return _FlightsAfter(segment[known], left_s[known], (left_s + clear_s)[known], states[known])

    def _states_when_clear(self, flights: _FlightsAfter) -> Array:
        """(m, 6) states of the blocks when clear of the ground, with the changes of the impact."""
        segment = flights.segment
        left = flights.state[:, RATES]
        change = np.zeros_like(flights.state)
        tx, ty = self._tangent[segment].T
        for learnt in self._changes:
            if learnt.lever == OUTCOME:
                along = learnt.of({name: values[segment] for name, values in self._quantities.items()})
                if along.shape[1] == N_POSE:  # learnt from a table of impacts: rates alone
                    along = np.column_stack([np.zeros_like(along), along])
                for first in (X, RATES.start):
                    a, b = along[:, first], along[:, first + 1]
                    change[:, first] += tx * a - ty * b
                    change[:, first + 1] += ty * a + tx * b
                    change[:, first + 2] += along[:, first + 2]
            elif learnt.lever == FRAME:
                known = {name: values[segment] for name, values in self._history.items()}
                change[:, FRAME_COLUMNS] -= learnt.of(q.moving_quantities(left) | known)
        change[:, POSE] += (flights.clear_s - flights.left_s)[:, None] * change[:, RATES]
        change += turned(flights.state, self._pivot[segment], self._slope[segment]) - flights.state
        # a changed pose must not put the block into the ground
        change[~self._clear(segment, flights.state + change), POSE] = 0.0
        return np.asarray(flights.state + change)

    def _path(self, flights: _FlightsAfter) -> tuple[Array, Array, float, Array]:
        """The flights with all changes in time steps, until the blocks touch the ground or their segments end: states
        (steps, m, 6), accelerations (steps, m, 3), duration of a step, and (m,) last step at which the block is clear
        of the ground."""
        segment, states = flights.segment, self._states_when_clear(flights)
        block = self._segments.block[segment]
        radius = min(block.radius_m for block in self._world.blocks.values())
        fastest = max(float(np.hypot(*states[:, LINEAR_VELOCITY].T).max()), 1e-9)
        step = min(self._least_flight_s / STEPS_OF_LEAST_FLIGHT, LONGEST_STEP_RADII * radius / fastest)
        path, pushes = [states], [self._acceleration(flights, states, 0.0)]
        last, left_s = np.zeros(len(segment), np.int64), self._limit_s[segment] - flights.clear_s
        # without learnt accelerations the engine simulates the flight, too
        flies = (left_s > 0.0) & any(change.lever == FLIGHT for change in self._changes)
        while flies.any():
            now = len(path) * step
            states = move_freely(self._world, block, states, np.full(len(segment), step))
            states[:, POSE] += 0.5 * step**2 * pushes[-1]
            states[:, RATES] += step * pushes[-1]
            flies &= self._clear(segment, states) & (now < left_s)
            last[flies] = len(path)
            path.append(states)
            pushes.append(self._acceleration(flights, states, now))
        return np.array(path), np.array(pushes), step, last

    def _poses_when_clear(self, flights: _FlightsAfter, since_s: Array) -> Array:
        """(m, k, 3) poses at times since_s (m, k) after the blocks are clear of the ground: along their paths, and from
        the last clear state on simulated by the engine."""
        path, pushes, step_s, last = self._path(flights)
        segment, m, resumed_s = flights.segment, np.arange(len(last)), last * step_s
        rest = self._run(
            self._world, path[last, m], segment,
            time_limit_s=np.maximum(self._limit_s[segment] - flights.clear_s - resumed_s, 0.0) + END_MARGIN_S,
            times_s=np.maximum(since_s - resumed_s[:, None], 0.0),
        ).samples  # fmt: skip
        flown_s = np.clip(since_s, 0.0, resumed_s[:, None])
        step = np.minimum(flown_s // step_s, last[:, None]).astype(int)
        beyond = (flown_s - step * step_s).ravel()
        states = path[step, m[:, None]].reshape(-1, N_STATE)
        block = np.repeat(self._segments.block[segment], since_s.shape[1])
        flown = move_freely(self._world, block, states, beyond)[:, POSE].reshape(rest.shape)
        flown += 0.5 * pushes[step, m[:, None]] * beyond.reshape(step.shape)[..., None] ** 2
        return np.where((since_s > resumed_s[:, None])[..., None], rest, flown)

    def _clear(self, segment: Array, states: Array) -> Array:
        """(m,) whether blocks in these states (m, 6) are clear of the ground."""
        return block_clearances(self._world, self._segments.block[segment], states[:, POSE]) > 0.0

    def _acceleration(self, flights: _FlightsAfter, states: Array, since_s: float) -> Array:
        """(m, 3) learnt accelerations of blocks in these states (m, 6), `since_s` after they are clear of the
        ground."""
        s, segment = self._segments, flights.segment
        acceleration = np.zeros((len(segment), N_POSE))
        changes = [change for change in self._changes if change.lever == FLIGHT]
        if changes:
            quantities = path_quantities(self._world, states) | {
                q.BLOCK: s.block[segment].astype(float),
                q.SERIES: self._history[q.SERIES][segment],
                q.HISTORY: np.minimum(s.number[segment] + 1.0, q.MOST_COUNTED_IMPACTS),
                q.TIME_S: self._begin_s[segment] + flights.clear_s + since_s,
            }
            for change in changes:
                acceleration += change.of(quantities)
        return acceleration


def _with_profile(world: World, change: KnownChange) -> World:
    """The world with a learnt profile of the ground."""
    x_m = change.basis.curves[0].grid()
    ground = raised(world.cross_section, x_m, change.of({q.PLACE_M: x_m})[:, 0])
    return replace(world, cross_section=ground)
