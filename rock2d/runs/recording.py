"""Tracks as a camera would record them: poses at the frame times, with noise."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from rock2d.arrays import Array
from rock2d.records.columns import TIME
from rock2d.records.track import Track
from rock2d.runs.incident_states import NOISE_STREAM
from rock2d.scene.blocks import Block, poses_at

if TYPE_CHECKING:
    import pandas as pd

FRAME_TOLERANCE = 1e-9  # share of a frame interval, so that rounding does not remove a frame at the end


@dataclass(frozen=True)
class Recording:
    """Sampling of the trajectories of a simulation.

    Attributes
    ----------
    fps : frames per second
    position_noise_m, angle_noise_rad : added noise, 1 sigma
    times_s : release -> instants of its samples, instead of `fps`
    seed : seed of the noise"""

    fps: float = 250.0
    position_noise_m: float = 0.0
    angle_noise_rad: float = 0.0
    times_s: Mapping[int, Array] = field(default_factory=dict)
    seed: int = 0


def trajectories_table(
    tracks: Sequence[Track], recording: Recording, bodies: Callable[[Track], Block] | None = None
) -> pd.DataFrame:
    """Tracks as a camera would record them: release, block, t_s, x_m, y_m, theta_rad at every frame.

    Poses are those of the centroid of the block that `bodies` returns for a track; without `bodies`, those of the
    centre of mass. Each release has its own random stream of noise."""
    import pandas as pd

    sigma = [recording.position_noise_m, recording.position_noise_m, recording.angle_noise_rad]
    times, poses = [], []
    for track in tracks:
        t = recording.times_s.get(track.release)
        if t is None:
            begin = float(track.knots[0, TIME])
            whole = int((track.end_s - begin) * recording.fps + FRAME_TOLERANCE)
            t = begin + np.arange(whole + 1) / recording.fps
        pose = track.states(t)[:, :3]
        centre = np.array(bodies(track).centre_of_mass_m if bodies else (0.0, 0.0))
        pose = poses_at(pose, -centre) if centre.any() else pose
        stream = np.random.SeedSequence(recording.seed, spawn_key=(NOISE_STREAM, track.release))
        times.append(t)
        poses.append(pose + np.random.default_rng(stream).normal(size=pose.shape) * sigma)
    frames, every = [len(t) for t in times], np.concatenate(poses)
    return pd.DataFrame(
        {
            "release": np.repeat([track.release for track in tracks], frames),
            "block": np.repeat(np.array([track.block for track in tracks], object), frames),
            "t_s": np.concatenate(times),
            "x_m": every[:, 0],
            "y_m": every[:, 1],
            "theta_rad": every[:, 2],
        }
    )
