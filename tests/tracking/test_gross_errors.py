"""Frames that no motion explains, errors that flights show, and what all frames share."""

import numpy as np
import pytest
from rock2d_tracking.film_scale import FilmScale
from rock2d_tracking.first_setup import ground_of
from rock2d_tracking.gross_errors import bounces_of, reject_gross_errors
from rock2d_tracking.sights import SLOW_ERROR_FACTOR, FollowedRelease, Sight, flights_of, set_errors
from rock2d_tracking.tracked_film import renumber_dropped

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


def bounce(dropped: int, hidden: range, noise_px: float, seed: int) -> tuple[list[Sight], int]:
    """A rolling block that a soft ground throws up again: 120 frames, its friction in proportion to the force, which
    is a half sine from frame 55 to 65. Frame `dropped` is missing, and `hidden` frames are lost. Returns its sights,
    numbered as in the file, and their true number."""
    fine = np.linspace(0, 120, 12001)
    force = np.where((fine > 55) & (fine < 65), np.sin(np.pi * np.clip((fine - 55) / 10, 0, 1)), 0.0)
    thrown = np.cumsum(force) / force.sum()
    step = fine[1] - fine[0]
    u = np.cumsum(1.5 - 0.6 * thrown) * step
    v = np.cumsum(0.02 * fine + 0.1 - 1.9 * thrown) * step
    turn = np.cumsum(0.02 + 0.06 * thrown) * step
    path = np.column_stack([u, v, turn])[:: len(fine) // 120][:120]
    rng = np.random.default_rng(seed)
    numbers = [k for k in range(120) if k != dropped]
    sights = [
        Sight(i, path[k] + rng.normal(0, noise_px, 3) * [1, 1, 1 / RADIUS_PX], np.full(3, noise_px), 1.0)
        for i, k in enumerate(numbers)
    ]
    for sight, k in zip(sights, numbers, strict=True):
        if k in hidden:
            sight.reject("half hidden")
    return sights, 120


@pytest.mark.parametrize(
    ("dropped", "hidden"), [*((k, range(0)) for k in (30, 56, 60, 63, 90)), *((k, range(57, 62)) for k in (30, 59, 90))]
)
def test_a_frame_dropped_in_flight_or_in_contact_is_counted(dropped, hidden):
    for seed in range(5):
        sights, frames = bounce(dropped, hidden, 0.01, seed)
        assert renumber_dropped(sights, RADIUS_PX) == 1
        assert sights[-1].frame == frames - 1 and sights[10].frame == 10


@pytest.mark.parametrize("hidden", [range(0), range(57, 62)])
@pytest.mark.parametrize("noise_px", [0.01, 0.1])
def test_no_frame_is_counted_that_was_not_dropped(hidden, noise_px):
    for seed in range(20):
        sights, _ = bounce(-1, hidden, noise_px, seed)
        assert renumber_dropped(sights, RADIUS_PX) == 0
