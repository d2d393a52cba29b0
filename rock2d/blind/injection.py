"""A known cause of known size, added to a real record: the result is again an experiment.

Causes in the camera are exact: the recorded numbers are converted to true ones and recorded by the other camera. Causes
in the motion are simulated differences: each release is divided into pieces in the middle of those of its flights that
are long enough for two. From the beginning of each flight on, a piece is simulated from the measured state, with and
without the cause, and the difference is added to the record. The pieces are the releases of the new record: after an
impact with the cause, the next impact would have another instant and state, which the record does not show. What the
model misses remains in the record."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from rock2d.arrays import Array
from rock2d.diagnosis.known_causes import with_cause
from rock2d.diagnosis.model import Model
from rock2d.effects.effect import Effect
from rock2d.engines.batch import run_world
from rock2d.files.experiment import Experiment, seen_frames
from rock2d.kinematics.film_segments import FilmSegments
from rock2d.kinematics.flights import FEWEST_FLIGHT_FRAMES, Film, Flights, load_film
from rock2d.kinematics.impacts import release_order
from rock2d.kinematics.states import centres_of_mass, centroid_poses, move_freely
from rock2d.kinematics.turned_ground import approach_s, run_on_turned_ground
from rock2d.records.columns import BEFORE, I_TIME, INSTANT_STATE, N_STATE, POSE_NAMES
from rock2d.runs.run import FRAME_MARGIN_S
from rock2d.scene.blocks import states_at
from rock2d.scene.world import World

Worlds = Callable[[Array], tuple[World, World]]

COUNTED_IMPACTS = 16  # largest number of impacts of a stretch whose instants are compared
# Frames by which an impact of the model, with or without the cause, may lie inside a flight of the record. It looks
# like a longer contact if no flight could be seen in between.
LARGEST_SHIFT_FRAMES = FEWEST_FLIGHT_FRAMES // 2


@dataclass(frozen=True)
class Injected:
    """A record with a known cause.

    Attributes
    ----------
    experiment : the experiment with changed trajectories
    releases : number of releases of the record
    pieces, cut : number of releases of the experiment, and of those that end early, before an impact during a flight of
        the record"""

    experiment: Experiment
    releases: int
    pieces: int
    cut: int


def injected(
    experiment: Experiment, model: Model, p: Array, effect: Effect, values: Mapping[str, float], seed: int = 0
) -> Injected:
    """Add an effect with these values to a film.

    Parameters
    ----------
    model, p : diagnosed model and its parameters; if the model has the effect, it adds up with the cause, see
        `with_cause`
    values : parameter -> value; missing parameters are neutral
    seed : for an effect that varies from impact to impact"""
    model, before, after = with_cause(model, p, effect, values)
    film = load_film(experiment)
    old, new = model.world(before, np.zeros(1)), model.world(after, np.zeros(1))
    true, kept, release = old.view.true(film.pose), np.ones(len(film.t_s), bool), film.release
    table = seen_frames(experiment).sort_values(["release", "t_s"], kind="stable").reset_index(drop=True)
    if not effect.camera:
        data = FilmSegments.of(film, old)
        stretches = _Stretches.of(data)
        release = np.searchsorted(stretches.edges, np.arange(len(film.t_s)), side="right") - 1
        # over a series of pieces the order grows as much as over the series of the releases
        order = release_order(film.release_block[film.release[stretches.edges[:-1]]])[stretches.piece]
        order = order * len(film.release_names) / (len(stretches.edges) - 1)
        rng = np.random.default_rng(np.random.SeedSequence(seed))
        drawn: Any = rng.normal(0.0, next(iter(values.values())), len(order)) if effect.scatter else None

        def worlds(own: Array) -> tuple[World, World]:
            ahead = model.world(after, order[own])
            if effect.scatter:
                ahead = effect.apply(ahead, [drawn[own]])
            return model.world(before, order[own]), ahead

        change, kept = _pose_changes(data, stretches, worlds)
        true, table["release"] = true + change, release
    table[list(POSE_NAMES)] += new.view.record(true) - old.view.record(old.view.true(film.pose))
    faster = new.view.time_scale / old.view.time_scale
    table["t_s"] /= faster
    changed = replace(experiment, trajectories=table[kept].reset_index(drop=True), fps=experiment.fps * faster)
    return Injected(changed, len(film.release_names), int(release[-1]) + 1, len(np.unique(release[~kept])))


class _Stretches(NamedTuple):
    """n stretches, each from the beginning of a flight, or its middle if a piece begins there, to the next such point.

    Attributes
    ----------
    edges : (pieces + 1,) first frame of each piece, and the end of the film
    flight, begin : (n,) flight with which each stretch begins, and its first frame
    piece, number : (n,) piece to which it belongs, and its position in the piece"""

    edges: Array
    flight: Array
    begin: Array
    piece: Array
    number: Array

    @classmethod
    def of(cls, data: FilmSegments) -> _Stretches:
        """The stretches of a film. A flight is halved if it is long enough for two and lies between others."""
        film, flights = data.film, data.flights
        flight = np.flatnonzero(np.isfinite(data.start_s))
        length = flights.last - flights.first
        between = (flights.follows >= 0) & np.isin(np.arange(len(flights)), flights.follows)
        halved = flight[(between & (length >= 2 * FEWEST_FLIGHT_FRAMES))[flight]]
        middle = flights.first[halved] + length[halved] // 2
        begin = np.concatenate([flights.first[flight], middle])
        order = np.argsort(begin)
        starts = np.searchsorted(film.release, np.arange(len(film.release_names)))
        edges = np.unique(np.concatenate([starts, middle, [len(film.t_s)]]))
        flight, begin = np.concatenate([flight, halved])[order], begin[order]
        piece = np.searchsorted(edges, begin, side="right") - 1
        return cls(edges, flight, begin, piece, np.arange(len(piece)) - np.searchsorted(piece, piece))


def _pose_changes(data: FilmSegments, stretches: _Stretches, worlds: Worlds) -> tuple[Array, Array]:
    """(frames, 3) change of the true poses of a film, and (frames,) whether it is known.

    `worlds`: numbers of stretches -> worlds without and with the cause. Each stretch starts from the measured state,
    with the difference so far."""
    film, flights = data.film, data.flights
    change, kept = np.zeros_like(film.pose), np.ones(len(film.t_s), bool)
    off = np.zeros((len(stretches.edges) - 1, N_STATE))
    goes_on = np.ones(len(off), bool)
    margin = LARGEST_SHIFT_FRAMES * float(np.median(np.diff(film.t_s)[np.diff(film.release) == 0]))
    flying, landed = _flying_or_landed(flights, film)
    last = np.append(stretches.piece[1:] != stretches.piece[:-1], True)[: len(stretches.piece)]
    ends = np.where(last, stretches.edges[stretches.piece + 1], np.append(stretches.begin[1:], 0))
    for k in range(stretches.number.max(initial=-1) + 1):
        rows = np.flatnonzero((stretches.number == k) & goes_on[stretches.piece])
        flight, begin, end, piece = (a[rows] for a in (stretches.flight, stretches.begin, ends, stretches.piece))
        old, new = worlds(rows)
        scale, block = old.view.time_scale, flights.block[flight]
        since = (film.t_s[begin] - data.flights.middle[flight]) * scale
        state = _tracked(old, block, move_freely(old, block, data.states(old).middle[flight], since))
        frames = begin[:, None] + np.arange((end - begin).max(initial=0))
        in_stretch = frames < end[:, None]
        times = (
            np.where(in_stretch, film.t_s[np.where(in_stretch, frames, 0)] - film.t_s[begin][:, None], np.inf) * scale
        )
        until = np.where(last[rows], film.t_s[end - 1] + FRAME_MARGIN_S, film.t_s[np.minimum(end, len(film.t_s) - 1)])
        limit = (until - film.t_s[begin]) * scale
        without_cause = _simulated(old, block, state, times, limit)
        with_cause = _simulated(new, block, state + off[piece], times, limit)
        off[piece] = with_cause.last - without_cause.last
        known_until = limit.copy()
        for own_s, other_s in (
            (without_cause.impacts_s, with_cause.impacts_s),
            (with_cause.impacts_s, without_cause.impacts_s),
        ):
            at = begin[:, None] + (own_s[..., None] > times[:, None, 1:]).sum(axis=-1)
            time_between = np.nan_to_num(np.abs(own_s[:, :, None] - other_s[:, None, :]), nan=np.inf)
            unmatched = (time_between > margin * scale).all(axis=-1)
            at_fault = np.isfinite(own_s) & (flying[at] | (landed[at] & unmatched))
            known_until = np.minimum(known_until, np.where(at_fault, own_s, np.inf).min(axis=1, initial=np.inf))
        difference = with_cause.poses - without_cause.poses
        known = in_stretch & (times < known_until[:, None]) & np.isfinite(difference).all(axis=-1)
        known = np.logical_and.accumulate(known, axis=1)
        change[frames[known]] = difference[known]
        for row in np.flatnonzero((known_until < limit) | (in_stretch & ~known).any(axis=1)):
            goes_on[piece[row]] = False
            kept[begin[row] + known[row].sum() : stretches.edges[piece[row] + 1]] = False
    return change, kept


class _Motion(NamedTuple):
    """Simulated stretches: poses (n, k, 3) and last states (n, 6) of the tracked point, instants of impacts (n, i)."""

    poses: Array
    last: Array
    impacts_s: Array


def _simulated(world: World, block: Array, tracked: Array, times_s: Array, limit_s: Array) -> _Motion:
    """Simulate from states (n, 6) of the tracked point to the end `limit_s` (n,); poses at the instants (n, k)."""
    starts = states_at(tracked, centres_of_mass(world, block))
    flat = run_world(world, starts, block, time_limit_s=limit_s, times_s=times_s, impact_room=COUNTED_IMPACTS)
    samples, last, impacts = flat.samples, flat.ends[:, INSTANT_STATE], flat.impacts[..., I_TIME]
    touch = flat.impacts[:, 0]
    if world.slope_rad.any() and (hit := np.isfinite(touch[:, I_TIME])).any():
        back = np.minimum(approach_s(world, block), touch[:, I_TIME])
        begin = np.where(hit, touch[:, I_TIME] - back, limit_s)
        near = move_freely(world, block, np.where(hit[:, None], touch[:, BEFORE], last), np.where(hit, -back, 0.0))
        since = np.maximum(np.minimum(times_s, limit_s[:, None]) - begin[:, None], 0.0)
        run = run_on_turned_ground(world, block, near, limit_s - begin, since, impact_room=COUNTED_IMPACTS)
        samples = np.where((times_s < begin[:, None])[..., None], samples, run.samples)
        last = np.where(hit[:, None], run.ends, last)
        impacts = np.where(hit[:, None], begin[:, None] + run.impacts_s, np.nan)
    return _Motion(centroid_poses(world, block, samples), _tracked(world, block, last), impacts)


def _flying_or_landed(flights: Flights, film: Film) -> tuple[Array, Array]:
    """(frames + 1,) whether a frame is well within a flight of the record; and whether it is after the last flight of
    its release."""
    flying, landed = np.zeros((2, len(film.t_s) + 1), bool)
    landed[:-1] = True
    for release, first, last in zip(flights.release, flights.first, flights.last, strict=True):
        flying[first + LARGEST_SHIFT_FRAMES : last - LARGEST_SHIFT_FRAMES] = True
        landed[np.searchsorted(film.release, release) : last] = False
    return flying, landed


def _tracked(world: World, block: Array, states: Array) -> Array:
    """States (n, 6) of the tracked point, from those of the centre of mass."""
    return states_at(states, -centres_of_mass(world, block))
