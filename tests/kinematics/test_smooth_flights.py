"""What bends a flight away from a parabola is no impact, and an impact is none of that."""

import numpy as np
import pandas as pd
import pytest

from rock2d.files.experiment import Experiment
from rock2d.kinematics.film_segments import FilmSegments
from rock2d.kinematics.flights import load_film
from rock2d.kinematics.setup_world import setup_world
from rock2d.scene.blocks import make_block
from rock2d.scene.cross_section import CrossSection

BALL = make_block("ball", "circle", 0.01, "solid_sphere", diameter_m=0.04)
G, STEP_S, RESTITUTION = 9.81, 1e-4, 0.75


def ball_film(
    fps: float, noise_m: float, *, drag_1_m: float = 0.0, perspective_1_s: float = 0.0, floor_m: float = -9.0,
    duration_s: float = 0.7,
) -> tuple[Experiment, int]:  # fmt: skip
    """A tossed ball that air holds back, that comes nearer to the camera, or that bounces on a floor; and how often."""
    state, bounces, path = np.array([0.0, 1.0, 2.5, 2.5]), 0, []
    every = round(1.0 / (fps * STEP_S))
    for k in range(round(duration_s / STEP_S)):
        if k % every == 0:
            path.append(state[:2] * (1.0 + perspective_1_s * k * STEP_S))
        velocity = state[2:]
        state = state + STEP_S * np.append(velocity, -drag_1_m * np.hypot(*velocity) * velocity - np.array([0.0, G]))
        if state[1] < floor_m + 0.02 and state[3] < 0.0:
            state[3] *= -RESTITUTION
            bounces += 1
    rng = np.random.default_rng(np.random.SeedSequence([int(fps), int(1e6 * noise_m)]))
    x, y = (np.array(path) + noise_m * rng.normal(size=(len(path), 2))).T
    table = pd.DataFrame({
        "release": 0, "block": "ball", "t_s": np.arange(len(x)) * every * STEP_S, "x_m": x, "y_m": y, "theta_rad": 0.0
    })  # fmt: skip
    ground = CrossSection([[-1.0, -9.0], [9.0, -9.0]], ["floor"])  # stated far below: everything is aloft
    return Experiment("toss", G, fps, noise_m, 0.01, ground, {"ball": BALL}, trajectories=table), bounces


def test_the_first_estimate_of_the_noise_needs_no_even_times():
    """A phone in changing light: a parabola over unequal steps of time leaves the noise and nothing else."""
    rng = np.random.default_rng(5)
    t = np.cumsum(np.tile([1.0, 1.0, 1.5, 1.0, 1.3, 1.0], 20)) / 30.0
    places = np.column_stack([0.5 * t, 5.0 * t - 0.5 * G * t**2]) + 1e-3 * rng.normal(size=(len(t), 2))
    table = pd.DataFrame({
        "release": 0, "block": "ball", "t_s": t, "x_m": places[:, 0], "y_m": places[:, 1], "theta_rad": 0.0
    })  # fmt: skip
    ground = CrossSection([[-1.0, -99.0], [9.0, -99.0]], ["floor"])
    film = load_film(Experiment("toss", G, 26.0, 0.1, 0.01, ground, {"ball": BALL}, trajectories=table))
    np.testing.assert_allclose(film.noise[:2], 1e-3, rtol=0.3)


def test_the_noise_of_a_tracked_film_is_that_of_its_flights_however_often_a_ball_bounces():
    """At 30 frames/s hardly any window of frames is without a bounce; what the tracker states is better."""
    from types import SimpleNamespace

    from rock2d_tracking.tracked_film import film_of

    film, bounces = ball_film(30.0, 3e-4, floor_m=0.9, duration_s=1.9)
    assert bounces >= 4 and load_film(film).noise[1] > 10 * 3e-4
    np.testing.assert_allclose(film_of(film, SimpleNamespace(metres_per_pixel=1e-3)).noise[:2], 3e-4)


def segments(experiment: Experiment) -> FilmSegments:
    return FilmSegments.of(load_film(experiment), setup_world(experiment))


@pytest.mark.parametrize("drag", [0.06, 0.15, 0.3])
@pytest.mark.parametrize(("fps", "noise"), [(30.0, 3e-4), (60.0, 1e-4), (240.0, 3e-4), (500.0, 2e-5), (1000.0, 3e-4)])
def test_a_light_ball_that_air_holds_back_makes_one_flight(fps, noise, drag):
    data = segments(ball_film(fps, noise, drag_1_m=drag)[0])
    assert len(data.flights) == 1 and len(data.impacts) == 0


@pytest.mark.parametrize("fps", [30.0, 240.0])
def test_a_ball_that_comes_nearer_to_the_camera_makes_one_flight(fps):
    assert len(segments(ball_film(fps, 2e-4, perspective_1_s=0.05)[0]).flights) == 1


@pytest.mark.parametrize("drag", [0.0, 0.15])
@pytest.mark.parametrize(("fps", "noise"), [(60.0, 3e-4), (120.0, 1e-4), (240.0, 3e-4), (1000.0, 3e-4)])
def test_bounces_on_a_floor_that_lies_higher_than_stated_are_impacts(fps, noise, drag):
    experiment, bounces = ball_film(fps, noise, drag_1_m=drag, floor_m=0.7, duration_s=1.3)
    assert bounces >= 2
    assert len(segments(experiment).impacts) == bounces


def test_a_change_of_velocity_in_mid_air_divides_a_flight_but_is_no_impact():
    """By 0.25 m/s, at once, of a ball that flies on and does not turn round, far from the ground."""
    experiment, _ = ball_film(240.0, 2e-4)
    table = experiment.trajectories
    late = np.maximum(table["t_s"].to_numpy() - 0.35, 0.0)
    table["y_m"] += 0.25 * late
    data = segments(experiment)
    assert (len(data.flights), len(data.impacts), len(data.mid_air)) == (2, 0, 1)
