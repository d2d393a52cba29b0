"""Films as hard as reality: repeatable, with a true path."""

from __future__ import annotations

import numpy as np
from rock2d_tracking.synthetic.real_looks import LOOK_KINDS, drawn_look, path_of, real_film

SIZE_PX = (320, 200)


def test_a_look_is_the_same_film_every_time():
    look = drawn_look(3, "severe", seed=5)
    a, b = (list(real_film(look, SIZE_PX, 5)) for _ in range(2))
    for one, other in zip(a, b, strict=True):
        np.testing.assert_array_equal(one.image, other.image)
        np.testing.assert_array_equal(one.pose, other.pose)


def test_severity_changes_what_spoils_the_film_and_not_what_it_shows():
    mild, severe = drawn_look(4, "mild"), drawn_look(4, "severe")
    assert (mild.kind, mild.shape, mild.radius_px, mild.fall_px) == (
        severe.kind,
        severe.shape,
        severe.radius_px,
        severe.fall_px,
    )
    assert mild.noise < severe.noise and mild.quality > severe.quality and mild.untidy < severe.untidy
    assert abs(mild.stated_size - 1) < abs(severe.stated_size - 1) <= 0.03


def test_looks_of_every_kind_are_drawn():
    assert {drawn_look(i, "mild").kind for i in range(20)} == set(LOOK_KINDS)


def test_a_block_falls_with_the_stated_gravity():
    look = drawn_look(0, "mild")
    path = path_of(look, 40, (4000, 100000))
    np.testing.assert_allclose(np.diff(path[10:, 1], 2), look.fall_px, rtol=1e-6)


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
