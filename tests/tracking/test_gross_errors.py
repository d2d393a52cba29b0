"""Frames that no motion explains, errors that flights show, and what all frames share."""

import numpy as np
import pytest
from rock2d_tracking.film_scale import FilmScale
from rock2d_tracking.first_setup import ground_of
from rock2d_tracking.gross_errors import bounces_of, reject_gross_errors
from rock2d_tracking.sights import SLOW_ERROR_FACTOR, FollowedRelease, Sight, flights_of, set_errors

from tests.tracking.real_looks import REST_FRAMES, floor_px, path_of
from tests.tracking.user_films import drawn_user_film

RADIUS_PX = 10.0


def followed(noise_px: float, stated_px: float, seed: int = 0) -> tuple[FollowedRelease, float, np.ndarray]:
    """A ball that bounces four times within 70 frames, its fall in px per frame squared, and its true places."""
    film = drawn_user_film("phone", 1, seed=1)
    path = path_of(film.look, 76, film.size_px)[REST_FRAMES:]
    rng = np.random.default_rng(seed)
    sights = [
        Sight(k, pose * [1, 1, 0] + [*rng.normal(0, noise_px, 2), 0.0], np.array([stated_px, stated_px, np.nan]), 1.0)
        for k, pose in enumerate(path)
    ]  # fmt: skip
    return FollowedRelease("ball", sights, 0.0, RADIUS_PX), film.look.g_px_frame2, path


@pytest.mark.parametrize("noise_px", [0.1, 0.5])
@pytest.mark.parametrize("stated_px", [0.02, 0.3])
def test_errors_are_the_scatter_within_flights_however_often_a_ball_bounces(noise_px, stated_px):
    errors = []
    for seed in range(8):
        release, g_px_frame2, _ = followed(noise_px, stated_px, seed)
        set_errors(release, g_px_frame2)
        errors.append(np.median([s.error[0] for s in release.seen]))
    assert np.mean(errors) == pytest.approx(SLOW_ERROR_FACTOR * max(noise_px, 0.3 * stated_px), rel=0.2)


def test_what_all_frames_share_is_no_part_of_their_errors():
    plain, shared = (followed(0.1, 0.1)[0] for _ in range(2))
    g_px_frame2 = followed(0.1, 0.1)[1]
    shared.bias_px = 5.0
    for release in (plain, shared):
        set_errors(release, g_px_frame2)
    np.testing.assert_array_equal([s.error for s in plain.seen], [s.error for s in shared.seen])
    assert plain.bias_px < 0.2 and shared.bias_px >= 5.0


def test_flights_end_at_the_bounces():
    film = drawn_user_film("phone", 1, seed=1)
    release, g_px_frame2, _ = followed(0.1, 0.1)
    hits = film.bounces - REST_FRAMES
    flights = [own for own in flights_of(release.sights, g_px_frame2) if len(own) > 4]
    assert len(hits) >= 2
    for hit in hits[:2]:
        assert min(abs(own[-1] + 1 - hit) for own in flights) < 2.0


def test_a_true_bounce_is_no_jump_and_lies_on_the_floor():
    film = drawn_user_film("phone", 1, seed=1)
    release, g_px_frame2, _ = followed(0.2, 0.2)
    reject_gross_errors(release, g_px_frame2)
    assert sum(bool(s.reason) for s in release.sights) <= 2
    places = bounces_of(release.seen, g_px_frame2)
    assert len(places) >= 2
    for place in places:
        assert place[1] == pytest.approx(floor_px(film.look, film.size_px), abs=2.5)


def test_a_run_of_frames_on_something_else_is_rejected():
    release, g_px_frame2, _ = followed(0.2, 0.2)
    for sight in release.sights[20:29]:
        sight.pose = sight.pose + np.array([60.0, -40.0, 0.0])
    reject_gross_errors(release, g_px_frame2)
    assert all(s.reason == "jumps" for s in release.sights[20:29])
    assert sum(not s.reason for s in release.sights[:19] + release.sights[30:]) > 50


def test_an_outline_on_the_background_is_rejected():
    release, g_px_frame2, _ = followed(0.2, 0.2)
    for sight in release.sights:
        sight.covered = 0.9
    release.sights[40].covered = 0.1
    reject_gross_errors(release, g_px_frame2)
    assert release.sights[40].reason == "on the background"
    assert "on the background" not in {s.reason for s in release.sights[:40] + release.sights[41:]}


def test_the_ground_lies_under_the_lowest_bounce_unless_the_ball_was_seen_below():
    film = drawn_user_film("phone", 1, seed=1)
    release, _, _ = followed(0.2, 0.2)
    g_px_frame2 = FilmScale(film.camera.metres_per_pixel, film.camera.fps).g_px_frame2
    assert ground_of([release], g_px_frame2) == pytest.approx(floor_px(film.look, film.size_px) + RADIUS_PX, abs=2.5)
    release.sights[-1].pose = release.sights[-1].pose + np.array([0.0, 80.0, 0.0])
    assert ground_of([release], g_px_frame2) is None
