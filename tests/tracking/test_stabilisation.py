"""The motion of a hand-held camera is read from the background."""

import cv2
import numpy as np
from rock2d_tracking.stabilisation import camera_shifts, stabilised

SIZE_PX = (240, 160)


def wall(seed: int = 0) -> np.ndarray:
    noise = np.random.default_rng(seed).standard_normal(SIZE_PX[::-1]).astype(np.float32)
    return 120 + 60 * cv2.GaussianBlur(noise, (0, 0), 4) / 0.07


def shown(still: np.ndarray, way: np.ndarray, ball: tuple[float, float]) -> np.ndarray:
    """The wall moved by a way, with a bright ball before it."""
    moved = stabilised(still, -way)
    v, u = np.mgrid[: SIZE_PX[1], : SIZE_PX[0]]
    moved[np.hypot(u - ball[0], v - ball[1]) < 14] = 250
    return np.clip(moved, 0, 255).astype(np.uint8)


def test_the_way_of_the_background_is_found_whatever_moves_before_it():
    t = np.arange(50)
    ways = 2.0 * np.column_stack([np.sin(t / 3), np.cos(t / 5) - 1.0])
    film = [shown(wall(), way, (20 + 4 * k, 30 + 0.04 * k**2)) for k, way in enumerate(ways)]
    found = camera_shifts(film, len(film))
    assert found is not None
    assert np.abs(found - ways).max() < 0.15
    again = [stabilised(frame, way) for frame, way in zip(film, found, strict=True)]
    assert camera_shifts(again, len(again)) is None


def test_a_camera_that_stands_still_is_left_alone():
    film = [shown(wall(), np.zeros(2), (20 + 4 * k, 60.0)) for k in range(40)]
    assert camera_shifts(film, len(film)) is None
