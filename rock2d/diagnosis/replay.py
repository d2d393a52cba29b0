"""Filmed releases and their segments simulated again: from a measured flight on, at the camera's instants and in its
coordinates.

A segment lasts from the end of one flight to the end of the next, or of the film. Its simulation starts in the previous
flight, from its measured state, a little above the ground. The poses of releases are those that the camera records,
with a mirrored axis corrected, so that measured and simulated poses belong to the same cross-section."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from rock2d.arrays import Array
from rock2d.diagnosis.data import FilmData
from rock2d.diagnosis.fitting import Fit
from rock2d.diagnosis.model import BASE_WIDTH, with_changed_law
from rock2d.engines.batch import run_world
from rock2d.kinematics.film_segments import FilmSegments
from rock2d.kinematics.states import centroid_poses
from rock2d.records.columns import THETA, X
from rock2d.scene.world import World

Signs = tuple[float, float, float]

END_MARGIN_S = 1e-9  # so that the simulation includes the last frame


@dataclass
class Segments:
    """The n segments of a film that can be predicted, in the order of time.

    Attributes
    ----------
    flight : (n,) index of the previous flight
    block, release, number : (n,) index of the block; of the release; of the segment in its release
    frames : frames of each in the film
    instants_s : (n, k) recorded time of its frames from the start of the simulation, infinite beyond the last
    began_s : (n,) recorded time of the start of the simulation in its release
    frame_s : recorded time from frame to frame"""

    flight: Array
    block: Array
    release: Array
    number: Array
    frames: list[Array]
    instants_s: Array
    began_s: Array
    frame_s: float

    @classmethod
    def of(cls, data: FilmSegments) -> Segments:
        """The segments of a film, after flights from which a simulation can start and that are followed by frames."""
        film, flights = data.film, data.flights
        ends = np.searchsorted(film.release, flights.release, side="right")
        later = np.flatnonzero(flights.follows >= 0)
        ends[flights.follows[later]] = flights.last[later]
        flight = np.flatnonzero(np.isfinite(data.start_s) & (flights.last < ends))
        frames = [np.arange(flights.last[f], ends[f]) for f in flight]
        instants = np.full((len(flight), max(map(len, frames), default=0)), np.inf)
        begins = data.flights.middle[flight] + data.start_s[flight]
        for i, rows in enumerate(frames):
            instants[i, : len(rows)] = film.t_s[rows] - begins[i]
        release = flights.release[flight]
        first = np.searchsorted(release, release)  # flights are in the order of their releases
        return cls(
            flight, flights.block[flight], release, np.arange(len(flight)) - first, frames, instants,
            begins - film.t_s[np.searchsorted(film.release, release)],
            float(np.median(np.diff(film.t_s)[np.diff(film.release) == 0])),
        )  # fmt: skip

    def __len__(self) -> int:
        return len(self.flight)

    def only(self, keep: Array) -> Segments:
        """Some of the segments, given as a mask."""
        return replace(
            self, flight=self.flight[keep], block=self.block[keep], release=self.release[keep],
            number=self.number[keep], frames=[self.frames[i] for i in np.flatnonzero(keep)],
            instants_s=self.instants_s[keep], began_s=self.began_s[keep],
        )  # fmt: skip


def recorded_poses(world: World, block: Array, samples: Array, last: Array) -> Array:
    """(n, k, 3) poses as the camera records them, from simulated poses `samples` (n, k, 3). After a block has left the
    cross-section, its last pose is repeated; `last` (n, 3): pose before the first instant."""
    for k in range(samples.shape[1]):  # the first pose is missing of a block that starts deep in the ground
        gone = ~np.isfinite(samples[:, k, X])
        samples[gone, k] = last[gone]
        last = samples[:, k]
    return np.asarray(world.view.record(centroid_poses(world, block, samples)))


def as_rows(data: FilmSegments, segments: Segments, poses: Array) -> tuple[Array, Array, Array]:
    """Index of the segment (m,), frame of the film (m,) and pose (m, 3) of all frames of all segments; an angle that
    was not measured is NaN."""
    segment = np.repeat(np.arange(len(segments)), list(map(len, segments.frames)))
    frame = np.concatenate(segments.frames)
    pose = np.concatenate([poses[i, : len(rows)] for i, rows in enumerate(segments.frames)])
    pose[~data.film.angle_known[segments.release[segment]], THETA] = np.nan
    return segment, frame, pose


@dataclass
class Releases:
    """Releases frame by frame, measured or simulated, each from its first flight on.

    Attributes
    ----------
    flight : (n,) the first flight of each release; `release`, `block` (n,) as in the film
    t_s : (n, k) recorded instants, NaN beyond the last frame
    pose : (n, k, 3) as the camera records them, NaN likewise
    impact : (n,) index of the first frame after the first flight"""

    flight: Array
    release: Array
    block: Array
    t_s: Array
    pose: Array
    impact: Array

    def __len__(self) -> int:
        return len(self.flight)


def measured_releases(data: FilmData, signs: Signs, most_frames: int) -> Releases:
    """Every release with a flight; every k-th frame if there are more than `most_frames` in total."""
    film, flights = data.film, data.flights
    first = np.flatnonzero(flights.follows < 0)
    ends = np.searchsorted(film.release, flights.release[first], side="right")
    step = int(np.ceil((ends - flights.first[first]).sum() / most_frames))
    frames = [np.arange(flights.first[f], end, step) for f, end in zip(first, ends, strict=True)]
    shape = (len(first), max(map(len, frames)))
    t, pose = np.full(shape, np.nan), np.full((*shape, 3), np.nan)
    for i, rows in enumerate(frames):
        t[i, : len(rows)], pose[i, : len(rows)] = film.t_s[rows], film.pose[rows] * signs
    impact = np.array([np.searchsorted(rows, flights.last[f]) for f, rows in zip(first, frames, strict=True)])
    return Releases(first, flights.release[first], flights.block[first], t, pose, impact)


def simulated_releases(data: FilmData, fit: Fit, film: Releases, signs: Signs, *, repetitions: int = 0) -> Array:
    """Poses (n, k, 3) of the releases of `film`; with `repetitions` (repetitions, n, k, 3), each with a soil drawn from
    the fitted scatter and with the film's noise.

    The soil varies from strike to strike. Few strikes of a release matter, so one soil is drawn for each release."""
    order = data.order[film.release]
    if not repetitions:
        return recorded_simulation(data, fit.model.world(fit.p, order), film.flight, film.t_s, film.t_s[:, 0], signs)
    rng = np.random.default_rng(0)
    n, k = film.t_s.shape
    world = with_drawn_soils(fit, fit.model.world(fit.p, np.tile(order, repetitions)), repetitions * n, rng)
    t = np.tile(film.t_s, (repetitions, 1))
    poses = recorded_simulation(data, world, np.tile(film.flight, repetitions), t, t[:, 0], signs)
    return (poses + rng.normal(size=poses.shape) * data.film.noise).reshape(repetitions, n, k, 3)


def with_drawn_soils(fit: Fit, world: World, n: int, rng: np.random.Generator) -> World:
    """The world with a soil drawn from the fitted scatter for each of n releases."""
    return with_changed_law(world, rng.normal(size=(n, len(BASE_WIDTH))) * fit.scatter[: len(BASE_WIDTH)])


def recorded_simulation(
    data: FilmData, world: World, flights: Array, t_s: Array, start_s: Array, signs: Signs
) -> Array:
    """Recorded poses (n, k, 3) at recorded instants `t_s` (n, k; NaN where there is none, at the end of a row).

    The simulation starts at the recorded instant `start_s` (n,) from the state fitted to each of `flights` (n,). After
    a block has left the cross-section, its last pose is repeated."""
    block = data.flights.block[flights]
    starts = data.states_at(world, flights, start_s - data.flights.middle[flights])
    times = (t_s - start_s[:, None]) * world.view.time_scale
    limits, instants = np.nanmax(times, axis=1) + END_MARGIN_S, np.where(np.isfinite(times), times, np.inf)
    samples = run_world(world, starts, block, time_limit_s=limits, times_s=instants).samples
    poses = recorded_poses(world, block, samples, samples[:, 0]) * signs
    return np.where(np.isfinite(t_s)[..., None], poses, np.nan)
