"""Films as hard as reality: repeatable, with a true path."""

from dataclasses import replace

import numpy as np

from tests.tracking.real_looks import compressed, drawn_look, path_of, real_film

SIZE_PX = (320, 200)


def test_a_look_is_the_same_film_every_time():
    look = drawn_look(3, "severe", seed=5)
    a, b = (list(real_film(look, SIZE_PX, 5)) for _ in range(2))
    for one, other in zip(a, b, strict=True):
        np.testing.assert_array_equal(one.image, other.image)
        np.testing.assert_array_equal(one.pose, other.pose)


def test_h264_keeps_the_pictures_and_loses_more_at_a_higher_rate_factor():
    look = next(look for look in (drawn_look(i, "moderate") for i in range(40)) if look.crf)
    drawn = [f.image for f in real_film(replace(look, crf=0.0, quality=100), SIZE_PX, 12)]
    lost = []
    for crf in (18.0, 34.0):
        seen = list(compressed(drawn, crf))
        assert len(seen) == len(drawn)
        lost.append(np.abs(np.array(seen, float) - drawn).mean())
    assert 0 < lost[0] < lost[1] < 12


def test_a_block_falls_with_the_stated_gravity():
    look = drawn_look(0, "mild")
    path = path_of(look, 40, (4000, 100000))
    np.testing.assert_allclose(np.diff(path[10:, 1], 2), look.g_px_frame2, rtol=1e-6)


def test_the_block_is_where_the_truth_says():
    look = drawn_look(6, "mild")  # white before a dark wall
    film = [f for f in real_film(look, SIZE_PX, 30) if f.free]
    assert film
    for frame in film:
        grey = frame.image.astype(float).mean(axis=2)
        bright = grey > 0.5 * grey.max()
        v, u = np.nonzero(bright)
        near = np.hypot(u - frame.pose[0], v - frame.pose[1]) < 2 * look.radius_px
        assert np.hypot(u[near].mean() - frame.pose[0], v[near].mean() - frame.pose[1]) < 1.0
