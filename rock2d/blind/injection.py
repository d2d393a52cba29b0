"""A known cause of known size, put into a real record: the result is again an experiment.

Of the camera exactly: the recorded numbers are turned into true ones and recorded again by the other camera. Of the
motion as simulated differences: each release is divided into pieces, in the middle of its flights, where these are long
enough for two. Each piece is simulated from its measured state on, with the cause and without it, and the difference is
added to the record. Pieces are the releases of the new record: after an impact with the cause the next one would come
at another instant, in another state, and the record does not show it. All that the model misses stays in the record.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from rock2d.diagnosis.impact_prediction import turned
from rock2d.diagnosis.known_causes import with_cause
from rock2d.diagnosis.model import Model
from rock2d.effects.effect import Effect
from rock2d.engines.batch import BatchResult, run_batch, world_ensemble
from rock2d.files.experiment import Experiment, seen_frames
from rock2d.kinematics.film_segments import FilmSegments
from rock2d.kinematics.flights import FEWEST_FLIGHT_FRAMES, Film, Flights, load_film
from rock2d.kinematics.impacts import release_order
from rock2d.kinematics.states import centroid_poses, drift
from rock2d.records.columns import AT, BEFORE, I_TIME, TIME
from rock2d.scene.blocks import states_at
from rock2d.scene.world import World

Array = np.ndarray

COUNTED_IMPACTS = 16  # of a piece, whose instants are compared
APPROACH = 0.3  # of √(radius / g), before and after an impact: so long the ground is turned, where it varies
END_MARGIN_S = 1e-9  # the last frame is inside
# by which an impact with the cause, or with the model, may lie inside a flight of the record, which looks like a longer
# contact as long as no flight could be seen in between
LARGEST_SHIFT_FRAMES = FEWEST_FLIGHT_FRAMES // 2
OF_THE_SERIES = ("soil_compaction",)  # whose size refers to one release more: with pieces, to one piece more


@dataclass(frozen=True)
class Injected:
    """A record with a known cause.

    Attributes
    ----------
    experiment : with the changed trajectories
    releases : of the record
    pieces, cut : releases of the experiment; and how many of them end early, before an impact where the record flies
    """

    experiment: Experiment
    releases: int
    pieces: int
    cut: int


def of_releases(experiment: Experiment, names: Array) -> Experiment:
    """The releases of a film that have these names."""
    table = experiment.trajectories
    assert table is not None
    return replace(experiment, trajectories=table[table["release"].isin(names)])


def injected(
    experiment: Experiment,
    model: Model,
    p: Array,
    effect: Effect,
    values: Mapping[str, float],
    seed: int = 0,
) -> Injected:
    """A film with an effect of these values.

    Parameters
    ----------
    model, p : what the record was diagnosed with; an effect that it has adds up with the cause, see `with_cause`
    values : parameter -> value; those that are missing are neutral
    seed : of an effect that varies from impact to impact
    """
    model, before, after = with_cause(model, p, effect, values)
    film = load_film(experiment)
    old, new = model.world(before, np.zeros(1)), model.world(after, np.zeros(1))
    true, kept, release = old.view.true(film.pose), np.ones(len(film.t_s), bool), film.release
    table = seen_frames(experiment).sort_values(["release", "t_s"], kind="stable").reset_index(drop=True)
    if not effect.camera:
        rng = np.random.default_rng(np.random.SeedSequence(seed))
        data = FilmSegments.of(film, old)
        pieces = _Pieces.of(data)
        release = np.searchsorted(pieces.edges, np.arange(len(film.t_s)), side="right") - 1
        # a series of pieces changes from its first to its last as much as that of the releases
        order = release_order(film.release_block[film.release[pieces.edges[:-1]]])[pieces.number]
        order = order * len(film.release_names) / (len(pieces.edges) - 1)
        ahead = model.world(after, order)
        if effect.scatter:
            drawn: Any = rng.normal(0.0, next(iter(values.values())), len(order))
            ahead = effect.apply(ahead, [drawn])
        change, kept = _change(data, pieces, model.world(before, order), ahead)
        true, table["release"] = true + change, release
    table[["x_m", "y_m", "theta_rad"]] += new.view.record(true) - old.view.record(old.view.true(film.pose))
    faster = new.view.time_scale / old.view.time_scale
    table["t_s"] /= faster
    changed = replace(
        experiment, trajectories=table[kept].reset_index(drop=True), fps=experiment.fps * faster
    )
    return Injected(changed, len(film.release_names), int(release[-1]) + 1, len(np.unique(release[~kept])))


class _Pieces(NamedTuple):
    """Pieces of releases.

    Attributes
    ----------
    edges : (pieces + 1,) the first frame of each, and the end of the film
    number : (n,) of those that have a flight
    flight, begin : (n,) with which each of these begins, and the frame of it
    """

    edges: Array
    number: Array
    flight: Array
    begin: Array

    @classmethod
    def of(cls, data: FilmSegments) -> _Pieces:
        """The first flight of a release begins a piece, and the second half of each that is long enough for two and has
        another after it."""
        film, flights = data.film, data.segmentation.flights
        flight = np.flatnonzero(np.isfinite(data.start_s))
        release, length = flights.release[flight], (flights.last - flights.first)[flight]
        opens = np.append(True, release[1:] != release[:-1])[: len(release)]
        halved = ~opens & np.isin(flight, flights.follows) & (length >= 2 * FEWEST_FLIGHT_FRAMES)
        begin = flights.first[flight] + np.where(opens, 0, length // 2)
        starts = np.searchsorted(film.release, np.arange(len(film.release_names)))
        edges = np.unique(np.concatenate([starts, begin[halved], [len(film.t_s)]]))
        flight, begin = flight[opens | halved], begin[opens | halved]
        return cls(edges, np.searchsorted(edges, begin, side="right") - 1, flight, begin)


def _change(data: FilmSegments, pieces: _Pieces, old: World, new: World) -> tuple[Array, Array]:
    """(frames, 3) what changes in the true poses of a film from a world without the cause, `old`, to one with it, and
    (frames,) whether that is known; worlds of the pieces."""
    film, scale = data.film, old.view.time_scale
    change, kept = np.zeros_like(film.pose), np.ones(len(film.t_s), bool)
    margin = LARGEST_SHIFT_FRAMES * float(np.median(np.diff(film.t_s)[np.diff(film.release) == 0]))
    block, begin_s = data.segmentation.flights.block[pieces.flight], film.t_s[pieces.begin]
    count = pieces.edges[pieces.number + 1] - pieces.begin
    since = (begin_s - data.basis.middle[pieces.flight]) * scale
    state = _tracked(old, block, drift(old, block, data.states(old).middle[pieces.flight], since))
    frames = pieces.begin[:, None] + np.arange(count.max(initial=0))
    own = np.arange(count.max(initial=0)) < count[:, None]
    times = np.where(own, film.t_s[np.where(own, frames, 0)] - begin_s[:, None], np.inf) * scale
    limit = np.where(own, times, 0.0).max(axis=1, initial=0.0) + END_MARGIN_S
    plain, ahead = (_moved(world, block, state, times, limit) for world in (old, new))
    aloft, landed = _aloft(data.segmentation.flights, film)
    parted = limit.copy()
    for own_s, other_s in ((plain.impacts_s, ahead.impacts_s), (ahead.impacts_s, plain.impacts_s)):
        at = pieces.begin[:, None] + (own_s[..., None] > times[:, None, 1:]).sum(axis=-1)
        alone = (np.abs(own_s[:, :, None] - other_s[:, None, :]) > margin * scale) | np.isnan(other_s)[
            :, None, :
        ]
        at_fault = np.isfinite(own_s) & (aloft[at] | (landed[at] & alone.all(axis=-1)))
        parted = np.minimum(parted, np.where(at_fault, own_s, np.inf).min(axis=1, initial=np.inf))
    difference = ahead.poses - plain.poses
    known = own & (times < parted[:, None]) & np.isfinite(difference).all(axis=-1)
    known = np.logical_and.accumulate(known, axis=1)
    change[frames[known]] = difference[known]
    kept[frames[own & ~known]] = False
    return change, kept


class _Motion(NamedTuple):
    """Simulated pieces: poses (n, k, 3) of the tracked point, instants of impacts (n, i)."""

    poses: Array
    impacts_s: Array


def _moved(world: World, block: Array, tracked: Array, times_s: Array, limit_s: Array) -> _Motion:
    """From states (n, 6) of the tracked point on, at instants (n, k), to the end `limit_s` (n,)."""
    starts = states_at(tracked, _offsets(world, block))
    ensemble, tables = world_ensemble(world)

    def run(start: Array, limit: Array, **more: Any) -> BatchResult:
        return run_batch(
            ensemble, start, block_ids=block, table_ids=tables, gravity_m_s2=world.gravity_m_s2,
            time_limit_s=limit, impact_room=COUNTED_IMPACTS, **more,
        )  # fmt: skip

    plain = run(starts, limit_s, times_s=times_s)
    samples, last, impacts = plain.samples, plain.ends[:, AT], plain.impacts[..., I_TIME]
    slope = np.broadcast_to(world.slope_rad, len(block))
    if slope.any():
        # ground that is turned where the first impact is: the same as the stated ground, the motion turned against it,
        # from a little before the impact to a little after, where the block is clear of its indentation
        radius, touch = np.array([b.radius_m for b in world.blocks.values()])[block], plain.impacts[:, 0]
        hit, little = np.isfinite(touch[:, I_TIME]), APPROACH * np.sqrt(radius / world.gravity_m_s2)
        back = np.where(hit, np.minimum(little, touch[:, I_TIME]), 0.0)
        pivot, begin = (
            np.where(hit[:, None], touch[:, BEFORE], last),
            np.where(hit, touch[:, I_TIME] - back, np.inf),
        )
        near = turned(drift(world, block, pivot, -back), pivot, -slope)
        left = np.where(hit, limit_s - begin, 0.0)
        left = np.minimum(left, run(near, left, impact_limit=1).ends[:, TIME] + little)
        since = np.maximum(times_s - np.where(hit, begin, 0.0)[:, None], 0.0)
        during = run(near, left, times_s=since)
        left = begin + left
        after = turned(during.ends[:, AT], pivot, slope)
        onward = run(
            after, np.where(hit, np.maximum(limit_s - left, 0.0), 0.0),
            times_s=np.maximum(times_s - np.where(hit, left, 0.0)[:, None], 0.0),
        )  # fmt: skip
        within = turned(during.samples, pivot[:, None], slope[:, None])
        late = times_s[..., None] >= left[:, None, None]
        samples = np.where(
            times_s[..., None] < begin[:, None, None], samples, np.where(late, onward.samples, within)
        )
        instants = [begin[:, None] + during.impacts[..., I_TIME], left[:, None] + onward.impacts[..., I_TIME]]
        impacts = np.where(hit[:, None], np.hstack(instants), np.nan)
    return _Motion(centroid_poses(world, block, samples), impacts)


def _aloft(flights: Flights, film: Film) -> tuple[Array, Array]:
    """(frames + 1,) whether a frame is in a flight of the record, well within it; and whether it is after the last
    flight of its release."""
    aloft, landed = np.zeros((2, len(film.t_s) + 1), bool)
    landed[:-1] = True
    for release, first, last in zip(flights.release, flights.first, flights.last, strict=True):
        aloft[first + LARGEST_SHIFT_FRAMES : last - LARGEST_SHIFT_FRAMES] = True
        landed[np.searchsorted(film.release, release) : last] = False
    return aloft, landed


def _offsets(world: World, block: Array) -> Array:
    """(n, 2) the centre of mass from the tracked point, in the axes of each block."""
    return np.array([b.centre_of_mass_m for b in world.blocks.values()])[block]


def _tracked(world: World, block: Array, states: Array) -> Array:
    """States (n, 6) of the tracked point, from those of the centre of mass."""
    return states_at(states, -_offsets(world, block))
