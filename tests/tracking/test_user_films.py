"""Films as users make them: their physics, their truth, and what their files are like."""

from dataclasses import replace

import av
import numpy as np
import pytest

from tests.tracking.real_looks import camera_shift, flights_of, hand_shake, path_of, real_film
from tests.tracking.user_films import FILM_KINDS, GRAVITY_M_S2, HIDDEN_FRAMES, drawn_user_film, write_user_film


@pytest.mark.parametrize("kind", FILM_KINDS)
def test_a_ball_falls_with_gravity_in_a_recording_of_this_kind(kind):
    film = drawn_user_film(kind, 0, seed=1)
    begins = flights_of(film.look, film.size_px)
    bounce = 1e9 if film.camera.falls_out else begins[1].flown / (1.0 + film.camera.uneven) - 2
    path = path_of(film.look, film.camera.frames, film.size_px)[6 : int(6 + min(bounce, 40)), 1]
    t_s = film.instants[6 : 6 + len(path)] / film.camera.fps
    fall_m_s2 = 2 * np.polyfit(t_s, path, 2)[0] * film.camera.metres_per_pixel
    assert fall_m_s2 == pytest.approx(GRAVITY_M_S2, rel=1e-6)
    assert path == pytest.approx(np.polyval(np.polyfit(t_s, path, 2), t_s), abs=1e-6)


def test_each_bounce_rises_by_the_square_of_the_restitution():
    film = drawn_user_film("phone", 1, seed=1)
    begins = flights_of(film.look, film.size_px)
    heights = np.array([b.pace**2 / (2 * film.look.g_px_frame2) for b in begins[1:5]])
    np.testing.assert_allclose(heights[1:] / heights[:-1], film.look.restitution**2)
    falls = begins[0].pace ** 2 / (2 * film.look.g_px_frame2) + begins[1].v_px - begins[0].v_px
    assert heights[0] / falls == pytest.approx(film.look.restitution**2)


@pytest.mark.parametrize(("lens", "shake_px"), [(0.0, 0.0), (0.05, 0.0), (0.0, 3.0)])
def test_the_ball_is_seen_where_lens_and_hand_put_it(lens, shake_px):
    film = drawn_user_film("slow motion", 0, seed=3)
    white = replace(film.look, colour=np.full(3, 6.0), background=np.full(3, 0.02), ambient=1.0, diffuse=0.0,
                    lens=lens, shake_px=shake_px, hand=False, shutter=0.0, noise=0.5, untidy=0.0, room=0.0)  # fmt: skip
    for number, frame in enumerate(real_film(white, film.size_px, 40)):
        v, u = np.nonzero(frame.image.min(axis=2) > 180)
        way = camera_shift(white, number)
        np.testing.assert_allclose([u.mean(), v.mean()], frame.pose[:2] + way, atol=0.35)


def test_the_file_of_a_film_of_variable_rate_says_when_its_frames_were_taken(tmp_path):
    film = drawn_user_film("variable rate", 0, seed=1)
    write_user_film(tmp_path / "a.mp4", film)
    with av.open(str(tmp_path / "a.mp4")) as container:
        times = np.array([f.time for f in container.decode(video=0)])
    np.testing.assert_allclose(times * film.camera.fps, film.instants, atol=1e-3)
    steps = np.diff(film.instants)
    assert steps.min() < 0.8 * np.median(steps) and steps.max() > 1.5 * np.median(steps)


def test_a_hand_shakes_the_camera_by_the_stated_way():
    way = hand_shake(4, 1.5, 9.0, np.arange(20000))
    np.testing.assert_allclose(way.std(axis=0), 1.5, rtol=0.05)
    np.testing.assert_allclose(way[0], 0.0)


def test_files_are_like_those_that_spoil_a_track(tmp_path):
    for kind in ("edit list, wide angle", "phone, frames out of order"):
        film = drawn_user_film(kind, 0, seed=1)
        shots = write_user_film(tmp_path / ("a.mp4" if "edit" in kind else "a.avi"), film)
        path = next(tmp_path.glob("a.mp4" if "edit" in kind else "a.avi"))
        with av.open(str(path)) as container:
            stated = container.streams.video[0].frames
            times = [f.time for f in container.decode(video=0)]
        assert len(times) == len(shots)
        assert stated == len(shots) + (HIDDEN_FRAMES if "edit" in kind else 0)
        assert (np.diff(times).min() <= 0.0) == ("order" in kind)
