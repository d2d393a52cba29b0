"""Learnt changes in a prediction: every segment of another film, from one flight to the next.

A learnt change needs to know where the block will touch the ground. So the segment is simulated once without it; that
gives the place. Then follow the law and the state with the change, and what it adds to the motion after the impact.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from rock2d.diagnosis.features import incident_quantities, moving_quantities
from rock2d.diagnosis.flight_fields import flight_paths, integral, path_quantities, response
from rock2d.diagnosis.impact_prediction import turned
from rock2d.diagnosis.levers import FLIGHT, FRAME, FRAME_COLUMNS, LAW, OUTCOME, SLOPE, STATE
from rock2d.diagnosis.model import with_changed_law
from rock2d.diagnosis.quantities import (
    BLOCK,
    HISTORY,
    MOST_COUNTED_IMPACTS,
    SERIES,
    TIME_S,
    Basis,
    read_basis,
)
from rock2d.engines.batch import run_batch, world_ensemble
from rock2d.kinematics.film_segments import POSE_SIZE, STATE_SIZE, FilmSegments
from rock2d.records.columns import AFTER, AT, BEFORE, I_TIME_AFTER, POSITION, RATES, X
from rock2d.scene.nearest_facet import nearest_facets
from rock2d.scene.world import World

Array = np.ndarray


@dataclass
class KnownChange:
    """A learnt change of a diagnosis: lever, basis and coefficients (numbers of the lever, functions), in SI."""

    lever: str
    basis: Basis
    coefficients: Array

    def of(self, quantities: Mapping[str, Array]) -> Array:
        """(n, numbers of the lever) change at quantities (n,)."""
        return np.asarray(self.basis.features(quantities) @ self.coefficients.T)


def read_changes(content: Sequence[Mapping[str, Any]]) -> list[KnownChange]:
    """The changes that a diagnosis holds."""
    return [KnownChange(c["lever"], read_basis(c), np.array(c["coefficients"], float)) for c in content]


@dataclass
class Segments:
    """Segments to be predicted: (n,) arrays.

    Attributes
    ----------
    flight : the flight before
    block, order : index of the block; place of the release in its series
    number : impacts of the release before that of the segment
    start : (n, 6) states at which the simulations start
    start_s : their recorded instants, from the middle of the flight
    begin_s : true instants of the starts in their releases
    limit_s : true duration of the segment
    """

    flight: Array
    block: Array
    order: Array
    number: Array
    start: Array
    start_s: Array
    begin_s: Array
    limit_s: Array


class LearntMotion:
    """The segments of a film with learnt changes."""

    def __init__(
        self, changes: Sequence[KnownChange], world: World, data: FilmSegments, segments: Segments
    ) -> None:
        self._changes, self._segments, self._world = changes, segments, world
        touch = self._impacts(world, segments.start)
        known = np.isfinite(touch.impacts[:, 0, 0])
        at = np.where(known[:, None], touch.impacts[:, 0, BEFORE], touch.ends[:, AT])
        facet = nearest_facets(np.ascontiguousarray(at[:, POSITION]), world.cross_section.points_m)
        self._tangent = world.cross_section.tangents[facet]
        zone = world.cross_section.zone_ids[facet]
        self._history = {
            SERIES: segments.order.astype(float),
            HISTORY: np.minimum(segments.number, MOST_COUNTED_IMPACTS).astype(float),
        }
        ended = touch.impacts[:, 0, I_TIME_AFTER]  # NaN where there is no impact, or the segment ends in it
        lasts = np.where(np.isfinite(ended), ended, segments.limit_s)
        self._history[TIME_S] = segments.begin_s + lasts
        self._quantities = self._history | incident_quantities(
            world, segments.block, zone, self._tangent, segments.start
        )
        self._pivot, self._slope = at[:, POSITION], np.zeros(len(at))
        self.world, self.start = world, segments.start.copy()
        for change in changes:
            if change.lever == SLOPE:
                self._slope += change.of(self._quantities)[:, 0]
            elif change.lever == FRAME:
                self.start[:, FRAME_COLUMNS] += change.of(self._quantities)
            elif change.lever == LAW:
                self.world = with_changed_law(self.world, change.of(self._quantities))
            elif change.lever == STATE:
                self.start += change.of(self._quantities)
            elif change.lever == FLIGHT:
                self.start += self._flown(change, data)
        # a slope of the ground is the same as the stated ground with the motion turned the other way
        self.start = turned(self.start, self._pivot, -self._slope)

    def _impacts(self, world: World, start: Array) -> Any:
        """The first impact of each segment."""
        s = self._segments
        ensemble, tables = world_ensemble(world)
        return run_batch(
            ensemble, start, block_ids=s.block, table_ids=tables, gravity_m_s2=world.gravity_m_s2,
            time_limit_s=s.limit_s, impact_limit=1, impact_room=1,
        )  # fmt: skip

    def _flown(self, change: KnownChange, data: FilmSegments) -> Array:
        """(n, 6) what an acceleration changes in the states at the starts."""
        s = self._segments
        answer = response(data, self._world, flight_paths(data, self._world), change.basis)
        place, rate = answer.state_change(s.flight, s.start_s * self._world.view.time_scale)
        return np.column_stack([place @ change.coefficients.T, rate @ change.coefficients.T])

    def added(self, t_s: Array, samples: Array) -> Array:
        """(n, k, 3) what the changes add to simulated poses (n, k, 3) after the impact; t_s (n, k): true time from the
        start, infinite where there is no frame."""
        found = np.zeros_like(samples)
        after = [c for c in self._changes if c.lever in (SLOPE, OUTCOME, FRAME, FLIGHT)]
        if not after:
            return found
        impacts = self._impacts(self.world, self.start).impacts[:, 0]
        for i in map(int, np.flatnonzero(np.isfinite(impacts[:, I_TIME_AFTER]))):
            end = impacts[i, I_TIME_AFTER]
            own = np.flatnonzero(np.isfinite(t_s[i]) & (t_s[i] > end) & np.isfinite(samples[i, :, X]))
            if not len(own):
                continue
            t = np.concatenate([[end], t_s[i, own]])
            leaves = impacts[i, AFTER]
            path = np.vstack([leaves[:POSE_SIZE], samples[i, own]])
            state = turned(leaves[None], self._pivot[i : i + 1], self._slope[i : i + 1])[0] - leaves
            for change in after:
                if change.lever == OUTCOME:
                    state = state + self._left(change, i)
                elif change.lever == FRAME:
                    state[list(FRAME_COLUMNS)] -= change.of(self._leaving(i, leaves))[0]
                elif change.lever == FLIGHT:
                    found[i, own] += self._pushed(change, i, t, path)[1:]
            found[i, own] += state[:POSE_SIZE] + (t[1:, None] - end) * state[POSE_SIZE:]
        return found

    def _leaving(self, i: int, state: Array) -> dict[str, Array]:
        """What the frame may depend on after the impact of segment i, which leaves in a state (6,)."""
        known = {name: values[i : i + 1] for name, values in self._history.items()}
        return moving_quantities(state[None, RATES]) | known

    def _left(self, change: KnownChange, i: int) -> Array:
        """(6,) what a changed outcome adds to the state after the impact of segment i."""
        one = {name: values[i : i + 1] for name, values in self._quantities.items()}
        along = change.of(one)[0]
        tx, ty = self._tangent[i]
        found = np.empty(STATE_SIZE)
        for first in (X, RATES.start):
            a, b = along[first : first + 2]
            found[first : first + 3] = tx * a - ty * b, ty * a + tx * b, along[first + 2]
        return found

    def _pushed(self, change: KnownChange, i: int, t: Array, path: Array) -> Array:
        """(k, 3) what an acceleration moves along the path (k, 3) of segment i after its impact, at t (k,)."""
        rates = np.gradient(path, t, axis=0) if len(t) > 1 else np.zeros_like(path)
        quantities = path_quantities(self._world, np.column_stack([path, rates]))
        count, s = len(t), self._segments
        quantities |= {
            BLOCK: np.full(count, float(s.block[i])),
            SERIES: np.full(count, self._history[SERIES][i]),
            HISTORY: np.full(count, min(s.number[i] + 1.0, MOST_COUNTED_IMPACTS)),
            TIME_S: s.begin_s[i] + t,
        }
        return integral(t, integral(t, change.of(quantities)))
