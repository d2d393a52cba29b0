"""A lens is told from a scale by what it leaves of parabolas, and only by long flights."""

import numpy as np
import pytest
from rock2d_tracking.camera import PixelMap
from rock2d_tracking.lens import lens_distortion

from rock2d.kinematics.flights import Film, Flights

SIZE_PX = (640, 400)
MIDDLE = np.array([319.5, 199.5])
CAMERA = PixelMap(1e-3, (0.0, 399.0))


def filmed(k: float, frames: int, noise_px: float, seed: int) -> tuple[Film, Flights]:
    """One throw across the picture, seen by a lens with distortion `k` in as many frames; or only the part of it that
    12 frames of 30 per second show."""
    rng = np.random.default_rng(seed)
    share = np.linspace(0.0, 1.0, frames) if frames > 12 else np.linspace(0.3, 0.6, frames)
    true = np.column_stack([40.0 + 560.0 * share, 360.0 - 1300.0 * share * (1.0 - share)])
    off = true - MIDDLE
    seen = MIDDLE + off * (1.0 + k * (off**2).sum(axis=1, keepdims=True) / (MIDDLE**2).sum())
    seen += noise_px * rng.normal(size=seen.shape)
    pose = np.column_stack([CAMERA.to_world(seen), np.zeros(frames)])
    noise = np.full(3, noise_px * 1e-3)
    film = Film(share, pose, np.zeros(frames, int), np.zeros(1, int), np.zeros(1, int), ["ball"],
                np.zeros(1, bool), noise, noise, noise)  # fmt: skip
    one = np.zeros(1, int)
    return film, Flights.of(film, one, one + frames, one - 1)


@pytest.mark.parametrize("k", [-0.06, 0.03])
@pytest.mark.parametrize("seed", range(3))
def test_a_long_flight_shows_the_lens(k, seed):
    found = lens_distortion(*filmed(k, 150, 0.15, seed), CAMERA, SIZE_PX)
    assert found is not None
    assert abs(found.value - k) < 3.0 * found.error + 0.15 * abs(k) and found.error < 0.005


def test_without_a_lens_and_in_short_flights_nothing_is_claimed():
    even = [lens_distortion(*filmed(0.0, 150, 0.15, seed), CAMERA, SIZE_PX) for seed in range(30)]
    short = [lens_distortion(*filmed(-0.06, 12, 0.15, seed), CAMERA, SIZE_PX) for seed in range(30)]
    assert even == [None] * 30 and sum(own is None for own in short) >= 28
