"""How blocks look: the colour in which they stand out, and their learned picture."""

import cv2
import numpy as np
import pytest
from rock2d_tracking.looks import BlockFrame, best_channel_mix, learned_picture, matched


def scene(colour: tuple[int, int, int], place: tuple[float, float]) -> tuple[np.ndarray, np.ndarray]:
    wall = np.full((100, 140, 3), (90, 90, 90), np.uint8)
    frame = wall.copy()
    cv2.circle(frame, (int(place[0]), int(place[1])), 12, colour, -1)
    return frame, wall


def test_a_block_as_bright_as_the_wall_is_seen_by_its_colour():
    frame, wall = scene((20, 84, 128), (70, 50))  # the grey of the wall, to one level
    mix = best_channel_mix([BlockFrame(0, frame, np.array([70.0, 50.0]), np.zeros(2))], wall, 12.0)
    grey = cv2.cvtColor(frame, cv2.COLOR_BGR2GRAY).astype(float)
    assert abs(grey[50, 70] - grey[5, 5]) < 5
    seen = mix(frame).astype(float)
    assert abs(seen[50, 70] - seen[5, 5]) > 30


def test_without_colour_the_view_is_the_usual_grey():
    frame, wall = scene((200, 200, 200), (70, 50))
    mix = best_channel_mix([BlockFrame(0, frame, np.array([70.0, 50.0]), np.zeros(2))], wall, 12.0)
    assert mix.weights_bgr is None
    np.testing.assert_array_equal(mix(frame), cv2.cvtColor(frame, cv2.COLOR_BGR2GRAY))


@pytest.mark.parametrize("shift", [(0.0, 0.0), (3.0, -2.0)])
def test_a_learned_picture_is_found_again(shift):
    rng = np.random.default_rng(1)
    wall = np.full((120, 120), 80.0, np.float32)
    own = cv2.GaussianBlur(rng.normal(0, 60, (120, 120)).astype(np.float32), (0, 0), 3)
    own *= np.hypot(*np.meshgrid(np.arange(120) - 60, np.arange(120) - 60)) < 14
    picture = learned_picture([BlockFrame(0, wall + own, np.full(2, 60.0), np.zeros(2))], wall, 14.0)
    assert picture is not None
    moved = np.roll(own, (int(shift[1]), int(shift[0])), axis=(0, 1))
    found = matched(wall + moved, wall, picture, np.array([61.0, 59.0]), 14.0)
    assert found is not None and found[1] > 0.95
    np.testing.assert_allclose(found[0], [60 + shift[0], 60 + shift[1]], atol=0.05)
