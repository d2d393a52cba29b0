"""Gravity of flights: its error is honest for short flights, jitter and scattered scales; what a film says follows."""

from dataclasses import replace

import numpy as np
import pytest

from rock2d.kinematics.flight_gravity import Measured, flight_gravity
from rock2d.kinematics.flights import Film, Flights

TRUE_M_S2, STATED_M_S2 = 9.67, 9.81


def flights(
    rng: np.random.Generator, n: int, fps: float, groups: tuple[int, int], sigma: float, *, tau: float = 0.0,
    spread: float = 0.0, correlation: float = 0.0, gravity: float = TRUE_M_S2, smear: float = 0.0,
) -> tuple[Film, Flights]:  # fmt: skip
    """(releases, flights of each) with `n` frames of position noise `sigma` and instant noise `tau`; gravity varies by
    `spread` from release to release; all places lie beside the path by the speed times a time of 1 sigma `smear`."""
    releases, each = groups
    count, t = releases * each, np.arange(n) / fps
    release = np.repeat(np.arange(releases), each)
    g = gravity * (1.0 + spread * rng.normal(size=releases))[release]
    noise = rng.normal(size=(count, n, 2))
    for k in range(1, n) if correlation else ():
        noise[:, k] = correlation * noise[:, k - 1] + np.sqrt(1 - correlation**2) * noise[:, k]
    seen = t + tau * rng.normal(size=(count, n))
    vx, vy = rng.normal(size=(2, count, 1)) * [[[1.0]], [[2.0]]]
    position = np.stack([vx * seen, vy * seen - 0.5 * g[:, None] * seen**2], axis=2) + sigma * noise
    position[..., 1] += smear * rng.normal() * np.hypot(vx, vy - g[:, None] * t)
    pose = np.concatenate([position, np.zeros((count, n, 1))], axis=2).reshape(-1, 3)
    first = np.arange(count) * n
    film = Film(
        np.tile(t, count), pose, np.repeat(release, n), np.arange(releases), np.zeros(releases, int), ["ball"],
        np.zeros(releases, bool), *[np.full(3, sigma)] * 3, smear,
    )  # fmt: skip
    return film, Flights.of(film, first, first + n, np.full(count, -1))


@pytest.mark.parametrize(
    ("n", "fps", "groups", "sigma", "faults"),
    [
        (70, 1000.0, (1, 1), 2e-5, {}),
        (15, 30.0, (1, 1), 1e-3, {"tau": 1e-3}),
        (35, 1000.0, (8, 1), 3e-4, {}),  # one flight alone says nothing
        (20, 240.0, (6, 2), 3e-4, {"spread": 0.01}),
    ],
)
def test_the_error_is_that_of_repeated_films(n, fps, groups, sigma, faults):
    rng = np.random.default_rng(np.random.SeedSequence(11))
    found = [flight_gravity(*flights(rng, n, fps, groups, sigma, **faults), STATED_M_S2) for _ in range(150)]
    pulls = np.array([(own.gravity_m_s2.value - TRUE_M_S2) / own.gravity_m_s2.error for own in found if own])
    assert len(pulls) > 140
    # 2.6 and 3 of their own standard errors
    assert abs(pulls.std() - 1.0) < 0.15 and abs(pulls.mean()) < 0.25


def test_an_offset_that_grows_with_the_speed_does_not_average_out():
    """It bends all flights of a film alike. A part of it shows in their scatter, so that the error is rather large."""
    rng = np.random.default_rng(np.random.SeedSequence(12))
    films = [flights(rng, 15, 30.0, (1, 4), 5e-4, smear=1e-3) for _ in range(150)]

    def pulls(smear_offset_s: float) -> float:
        found = [flight_gravity(replace(f, smear_offset_s=smear_offset_s), own, STATED_M_S2) for f, own in films]
        own = [((g.gravity_m_s2.value - TRUE_M_S2) / g.gravity_m_s2.error) for g in found if g]
        assert len(own) > 140
        return float(np.std(own))

    assert pulls(0.0) > 1.4
    assert 0.65 < pulls(1e-3) < 1.15


def test_without_noise_of_instants_the_error_is_the_closed_form():
    rng = np.random.default_rng(np.random.SeedSequence(5))
    n, fps, sigma = 200, 1000.0, 1e-4
    found = flight_gravity(*flights(rng, n, fps, (1, 1), sigma), STATED_M_S2)
    assert found is not None and not found.slow
    closed = sigma / (n / fps) ** 2 * np.sqrt(720.0 / n)
    assert found.gravity_m_s2.error == pytest.approx(closed, rel=0.15)
    assert found.noise_m == pytest.approx(sigma, rel=0.15)


def test_noise_of_instants_is_told_from_that_of_positions():
    rng = np.random.default_rng(np.random.SeedSequence(6))
    found = flight_gravity(*flights(rng, 30, 60.0, (20, 1), 5e-4, tau=1e-3), STATED_M_S2)
    assert found is not None
    assert found.instant_noise_s == pytest.approx(1e-3, rel=0.15)
    assert found.noise_m == pytest.approx(5e-4, rel=0.15)


def test_slow_errors_widen_the_interval():
    rng = np.random.default_rng(np.random.SeedSequence(7))
    slow = flight_gravity(*flights(rng, 60, 500.0, (6, 2), 1e-4, correlation=0.8), STATED_M_S2)
    assert slow is not None and slow.slow
    white = 1e-4 / 0.12**2 * np.sqrt(720.0 / 60) / np.sqrt(12)
    assert slow.gravity_m_s2.error > 1.5 * white


def test_a_slide_is_no_flight_and_a_carried_block_does_not_count():
    rng = np.random.default_rng(np.random.SeedSequence(8))
    film, own = flights(rng, 40, 240.0, (4, 1), 2e-4)
    t = film.t_s[:40]
    # down a slope, straight, as smooth as a flight
    film.pose[:40, :2] = np.outer(0.5 * t + 1.5 * t**2, [0.8, -0.6])
    film.pose[40:80, 1] += 0.4 * 9.81 * t**2  # carried: falls with a fifth of gravity
    film.pose[:80, :2] += 2e-4 * rng.normal(size=(80, 2))
    found = flight_gravity(film, own, STATED_M_S2)
    assert found is not None and found.used.tolist() == [False, False, True, True]
    assert abs(found.gravity_m_s2.value - TRUE_M_S2) < 4 * found.gravity_m_s2.error


def test_a_turned_picture_shows_in_the_direction_of_gravity():
    rng = np.random.default_rng(np.random.SeedSequence(9))
    film, own = flights(rng, 60, 240.0, (4, 1), 1e-4)
    c, s = np.cos(0.03), np.sin(0.03)
    film.pose[:, :2] = film.pose[:, :2] @ np.array([[c, s], [-s, c]])  # counter-clockwise
    found = flight_gravity(film, own, STATED_M_S2)
    assert found is not None and abs(found.tilt_rad.value - 0.03) < 4 * found.tilt_rad.error < 0.01
    film.pose[:, 1] *= -1.0
    mirrored = flight_gravity(film, own, STATED_M_S2)
    assert mirrored is not None
    assert mirrored.gravity_m_s2.value == pytest.approx(found.gravity_m_s2.value, rel=1e-9)


def test_an_interval_is_1_96_errors_on_each_side():
    assert Measured(2.0, 0.5).ci95 == pytest.approx((2.0 - 0.98, 2.0 + 0.98), abs=1e-4)
