"""What a camera makes of the motion: its flaws, its noise, and the frames it loses."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from rock2d.blind.reality.data_model import Array, Hidden


def film(
    poses: Array,
    times_s: Array,
    *,
    hidden: Sequence[Hidden],
    position_noise_m: float,
    angle_noise_rad: float,
    colour: float,
    lost: float,
    centre_m: Array,
    extent_m: float,
    seed: int,
) -> tuple[Array, Array]:
    """The record of true poses (n, frames, 3) and its instants in s.

    colour : correlation of the noise from frame to frame (0: white); its standard deviations are `*_noise_*`
    lost : share of the frames that are lost (NaN)
    centre_m, extent_m : what the camera aims at, and the length that distortions are measured by

    A frame-rate error shows in `poses` already, see `fall`: the record keeps the stated instants.
    """
    record = np.array(poses, float)
    times = np.array(times_s, float)
    for effect in hidden:
        record = _flawed(record, times, effect, np.asarray(centre_m, float), extent_m, seed)
    sd = np.array([position_noise_m, position_noise_m, angle_noise_rad])
    for i, one in enumerate(record):
        rng = np.random.default_rng([seed, i, 11])
        one += sd * _coloured(rng.normal(size=one.shape), colour)
        one[rng.random(len(one)) < lost] = np.nan
    return record, times


def _coloured(white: Array, colour: float) -> Array:
    """Noise (frames, 3) of unit variance with the correlation `colour` from frame to frame."""
    if colour == 0.0:
        return white
    noise = white.copy()
    for k in range(1, len(noise)):
        noise[k] = colour * noise[k - 1] + np.sqrt(1.0 - colour**2) * white[k]
    return noise


def _flawed(record: Array, times: Array, effect: Hidden, centre: Array, extent: float, seed: int) -> Array:
    """The record with one flaw of the camera; any other effect leaves it."""
    v = effect.values
    out = record.copy()
    if effect.name == "camera_tilt":
        pivot = centre + extent * np.array([v["off_x"], v["off_y"]])
        c, s = np.cos(v["turn_rad"]), np.sin(v["turn_rad"])
        along = (record[..., :2] - pivot) @ np.array([[c, s], [-s, c]])
        out[..., :2] = pivot + along / (1.0 + v["keystone"] * along[..., 1:] / extent)
        out[..., 2] += v["turn_rad"]
    elif effect.name == "scale_error":
        out[..., :2] = centre + (record[..., :2] - centre) * np.array([v["x"], v["y"]])
    elif effect.name == "lens_distortion":
        off = record[..., :2] - centre
        square = np.sum((off / extent) ** 2, axis=-1, keepdims=True)
        swell = v["k"] * square
        out[..., :2] = centre + off * (
            1.0 / np.maximum(1.0 - swell, 0.2) if v["division"] > 0.0 else 1.0 + swell
        )
    elif effect.name == "angle_offset":
        jitter = np.random.default_rng([seed, 12]).normal(0.0, 1.0, len(out))
        out[..., 2] += v["offset_rad"] + v["jitter_rad"] * jitter[:, None]
    elif effect.name == "mirrored_axis":
        out[..., 0] *= v["x"]
        out[..., 2] *= v["theta"]
    elif effect.name == "late_angle":
        for i, one in enumerate(record):
            out[i, :, 2] = np.interp(times - v["lag_s"], times, one[:, 2])
    elif effect.name == "sliding_camera":
        way = np.random.default_rng([seed, 13]).uniform(0.0, 2.0 * np.pi, len(out))
        slide = v["speed_m_s"] * np.stack([np.cos(way), np.sin(way)], axis=-1)
        out[..., :2] -= slide[:, None, :] * (times - times[0])[:, None]
    return out
