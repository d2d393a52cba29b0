"""Segments of a film: each from the end of one flight to the end of the next, or of the film.

The simulation of a segment starts in the previous flight, from its measured state, a little above the ground.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from rock2d.kinematics.film_segments import FilmSegments
from rock2d.kinematics.states import centroid_poses
from rock2d.records.columns import THETA, X
from rock2d.scene.world import World

Array = np.ndarray

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
    frame_s : recorded time from frame to frame
    """

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
        begins = data.basis.middle[flight] + data.start_s[flight]
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
