"""Recording of the motion by a camera, with its flaws, noise and lost frames."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from rock2d.blind.reality.catalogue import CAUSES
from rock2d.blind.reality.cause import View
from rock2d.blind.reality.data_model import Array, Camera, Hidden


def record_poses(poses: Array, times_s: Array, camera: Camera, hidden: Sequence[Hidden], seed: int) -> Array:
    """The recording of true poses (n, frames, 3) at the stated instants.

    A frame-rate error acts on the true poses already, see `simulate_poses`: the recording keeps the stated instants.
    """
    record = np.array(poses, float)
    view = View(np.array(times_s, float), np.asarray(camera.centre_m, float), camera.extent_m, seed)
    # an axis is mirrored by software, after the lens
    for cause in sorted(hidden, key=lambda own: own.name == "mirrored_axis"):
        recorded = CAUSES[cause.name].recorded
        if recorded is not None:
            record = recorded(record, view, cause.values)
    sd = np.array([camera.position_noise_m, camera.position_noise_m, camera.angle_noise_rad])
    for i, release in enumerate(record):
        rng = np.random.default_rng([seed, i, 11])
        release += sd * _coloured(rng.normal(size=release.shape), camera.colour)
        release[rng.random(len(release)) < camera.lost] = np.nan
    return record


def _coloured(white: Array, colour: float) -> Array:
    """Noise (frames, 3) of unit variance with the correlation `colour` from frame to frame."""
    if colour == 0.0:
        return white
    noise = white.copy()
    for k in range(1, len(noise)):
        noise[k] = colour * noise[k - 1] + np.sqrt(1.0 - colour**2) * white[k]
    return noise
