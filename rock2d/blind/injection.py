"""A known cause of known size, put into a real record: the result is again an experiment.

Of the camera exactly: the recorded numbers are turned into true ones and recorded again by the other camera. Of the
motion as simulated differences: each stretch of a release, from the beginning of a flight to that of the next, is
simulated with the cause and without it, and the difference is added to the record. The next stretch begins from the
measured state with the difference so far. All that the model misses stays in the record.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
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
from rock2d.kinematics.flights import FEWEST_FLIGHT_FRAMES, load_film
from rock2d.kinematics.states import centroid_poses, drift
from rock2d.records.columns import AT, BEFORE, I_TIME, N_STATE, TIME
from rock2d.scene.blocks import states_at
from rock2d.scene.world import World

Array = np.ndarray
Worlds = Callable[[Array], tuple[World, World]]

COUNTED_IMPACTS = 16  # of a stretch, whose instants are compared
APPROACH = 0.3  # of √(radius / g), before and after an impact: so long the ground is turned, where it varies
END_MARGIN_S = 1e-9  # the last frame is inside
# by which a cause may shift an impact: the record has its own at another instant, which looks like a longer contact as
# long as no flight could be seen in between
LARGEST_SHIFT_FRAMES = FEWEST_FLIGHT_FRAMES // 2


@dataclass(frozen=True)
class Injected:
    """A record with a known cause.

    Attributes
    ----------
    experiment : with the changed trajectories
    releases, cut : how many there are; and how many of them end early, before an impact that the cause moves by more
        than LARGEST_SHIFT_FRAMES frames: the record has its own at another instant
    """

    experiment: Experiment
    releases: int
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
    true, kept = old.view.true(film.pose), np.ones(len(film.t_s), bool)
    if not effect.camera:
        rng = np.random.default_rng(np.random.SeedSequence(seed))

        def worlds(order: Array) -> tuple[World, World]:
            ahead = model.world(after, order)
            if effect.scatter:
                drawn: Any = rng.normal(0.0, next(iter(values.values())), len(order))
                ahead = effect.apply(ahead, [drawn])
            return model.world(before, order), ahead

        change, kept = _change(FilmSegments.of(film, old), worlds)
        true = true + change
    table = seen_frames(experiment).sort_values(["release", "t_s"], kind="stable").reset_index(drop=True)
    table[["x_m", "y_m", "theta_rad"]] += new.view.record(true) - old.view.record(old.view.true(film.pose))
    faster = new.view.time_scale / old.view.time_scale
    table["t_s"] /= faster
    cut = len(np.unique(film.release[~kept]))
    changed = replace(
        experiment, trajectories=table[kept].reset_index(drop=True), fps=experiment.fps * faster
    )
    return Injected(changed, len(film.release_names), cut)


class _Stretches(NamedTuple):
    """From the first frame of a flight to that of the next (n,): the flight, release and number in it, first and last
    instant as recorded; the frames of each."""

    flight: Array
    release: Array
    number: Array
    begin_s: Array
    until_s: Array
    frames: list[Array]

    @classmethod
    def of(cls, data: FilmSegments) -> _Stretches:
        """The last of each release leads to its end."""
        film, flights = data.film, data.segmentation.flights
        flight = np.flatnonzero(np.isfinite(data.start_s))
        release = flights.release[flight]
        number = np.arange(len(flight)) - np.searchsorted(release, release)
        begin = film.t_s[flights.first[flight]]
        edges = np.searchsorted(film.release, np.arange(len(film.release_names) + 1))
        last = np.append(release[1:] != release[:-1], True)[: len(release)]
        until = np.where(last, film.t_s[edges[release + 1] - 1] + END_MARGIN_S, np.append(begin[1:], 0.0))
        frames = []
        for r, both in zip(release, np.column_stack([begin, until]), strict=True):
            a, b = edges[r] + np.searchsorted(film.t_s[edges[r] : edges[r + 1]], both)
            frames.append(np.arange(a, b))
        return cls(flight, release, number, begin, until, frames)


def _change(data: FilmSegments, worlds: Worlds) -> tuple[Array, Array]:
    """(frames, 3) what changes in the true poses of a film, and (frames,) whether that is known; `worlds`: places of
    releases in their series -> without the cause and with it."""
    film, all_ = data.film, _Stretches.of(data)
    change, kept = np.zeros_like(film.pose), np.ones(len(film.t_s), bool)
    off, goes_on = np.zeros((len(film.release_names), N_STATE)), np.ones(len(film.release_names), bool)
    margin = LARGEST_SHIFT_FRAMES * float(np.median(np.diff(film.t_s)[np.diff(film.release) == 0]))
    for k in range(all_.number.max(initial=-1) + 1):
        own = np.flatnonzero((all_.number == k) & goes_on[all_.release])
        flight, release, begin = all_.flight[own], all_.release[own], all_.begin_s[own]
        old, new = worlds(data.order[release])
        scale, block = old.view.time_scale, data.segmentation.flights.block[flight]
        since = (begin - data.basis.middle[flight]) * scale
        state = _tracked(old, block, drift(old, block, data.states(old).middle[flight], since))
        times = np.full((len(own), max((len(all_.frames[i]) for i in own), default=0)), np.inf)
        for row, i in enumerate(own):
            times[row, : len(all_.frames[i])] = (film.t_s[all_.frames[i]] - all_.begin_s[i]) * scale
        limit = (all_.until_s[own] - begin) * scale
        plain = _moved(old, block, state, times, limit)
        ahead = _moved(new, block, state + off[release], times, limit)
        off[release] = ahead.last - plain.last
        parted = _parted(plain.impacts_s, ahead.impacts_s, limit, margin * scale)
        known = (times < parted[:, None]) & np.isfinite(ahead.poses - plain.poses).all(axis=-1)
        known = np.logical_and.accumulate(known | np.isinf(times), axis=1)
        for row, i in enumerate(own):
            frames, good = all_.frames[i], known[row, : len(all_.frames[i])]
            change[frames[good]] = (ahead.poses - plain.poses)[row, : len(frames)][good]
            if parted[row] < limit[row] or not good.all():
                goes_on[release[row]] = False
                rest = np.searchsorted(film.release, release[row], side="right")
                kept[frames[0] + good.sum() if len(frames) else rest : rest] = False
    return change, kept


class _Motion(NamedTuple):
    """Simulated stretches: poses (n, k, 3) and last states (n, 6) of the tracked point, instants of impacts (n, i)."""

    poses: Array
    last: Array
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
        last = np.where(hit[:, None], onward.ends[:, AT], last)
        instants = [begin[:, None] + during.impacts[..., I_TIME], left[:, None] + onward.impacts[..., I_TIME]]
        impacts = np.where(hit[:, None], np.hstack(instants), np.nan)
    return _Motion(centroid_poses(world, block, samples), _tracked(world, block, last), impacts)


def _parted(plain: Array, ahead: Array, limit_s: Array, margin_s: float) -> Array:
    """(n,) the first instant at which the impacts (n, i) of two motions no longer agree; their end if they do."""
    apart = np.abs(plain[:, :, None] - ahead[:, None, :])
    apart[np.isnan(apart)] = np.inf
    alone = [
        np.where((apart.min(axis=axis) > margin_s) & np.isfinite(own), own, np.inf).min(
            axis=1, initial=np.inf
        )
        for own, axis in ((plain, 2), (ahead, 1))
    ]
    return np.minimum.reduce([*alone, limit_s])


def _offsets(world: World, block: Array) -> Array:
    """(n, 2) the centre of mass from the tracked point, in the axes of each block."""
    return np.array([b.centre_of_mass_m for b in world.blocks.values()])[block]


def _tracked(world: World, block: Array, states: Array) -> Array:
    """States (n, 6) of the tracked point, from those of the centre of mass."""
    return states_at(states, -_offsets(world, block))
