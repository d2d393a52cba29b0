"""Where two flights meet: impacts and their velocities, and what is none."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from rock2d.files.experiment import Experiment
from rock2d.kinematics.film_segments import FilmSegments
from rock2d.kinematics.flights import Flights, load_film
from rock2d.kinematics.impacts import _crossed, find_pairs, start_instants
from rock2d.kinematics.setup_world import setup_world
from rock2d.kinematics.states import fit_states
from rock2d.scene.blocks import make_block
from rock2d.scene.cross_section import CrossSection

FPS, GRAVITY, RADIUS_M, NOISE_M = 30.0, 9.81, 0.04, 2e-4
FLOOR = CrossSection([[-5.0, 0.0], [5.0, 0.0]], ["floor"])
BALL = make_block("ball", "circle", 0.2, "solid_sphere", diameter_m=2 * RADIUS_M)


def bouncing(restitution: float, frames: int, height_m: float, lift_m: float = 0.0) -> Experiment:
    """A ball that is let fall and bounces; `lift_m`: height at which it turns round, over the stated floor."""
    t = np.arange(frames) / FPS
    begins, speed, y, rows = 0.0, 0.0, height_m, []
    for now in t:
        while True:
            hit = (speed + np.sqrt(speed**2 + 2 * GRAVITY * (y - RADIUS_M - lift_m))) / GRAVITY
            if begins + hit > now:
                break
            begins, speed, y = begins + hit, restitution * (GRAVITY * hit - speed), RADIUS_M + lift_m
        since = now - begins
        rows.append((0.3 * now, y + speed * since - 0.5 * GRAVITY * since**2))
    places = np.array(rows) + np.random.default_rng(3).normal(size=(frames, 2)) * NOISE_M
    table = pd.DataFrame({
        "release": 0, "block": "ball", "t_s": t, "x_m": places[:, 0], "y_m": places[:, 1], "theta_rad": np.nan,
    })  # fmt: skip
    return Experiment("bouncing", GRAVITY, FPS, NOISE_M, 0.01, FLOOR, {"ball": BALL}, trajectories=table)


@pytest.mark.parametrize("restitution", [0.6, 0.8])
@pytest.mark.parametrize("lift_m", [0.0, 0.5])  # also where the ground lies higher than stated
def test_velocities_are_those_at_the_contact(restitution, lift_m):
    experiment = bouncing(restitution, 60, 1.8 + lift_m, lift_m)
    world = setup_world(experiment)
    data = FilmSegments.of(load_film(experiment), world)
    assert len(data.impacts) >= 2 and not len(data.mid_air)
    impacts = data.impacts
    hit_s = np.sqrt(2 * (1.8 - RADIUS_M) / GRAVITY)
    assert data.flights.middle[impacts.before[0]] + impacts.touch_s[0] == pytest.approx(hit_s, abs=1e-3)
    assert impacts.arriving[0, 4] == pytest.approx(-GRAVITY * hit_s, rel=2e-3)
    np.testing.assert_allclose(-impacts.leaving[:, 4] / impacts.arriving[:, 4], restitution, atol=5e-3)


@pytest.mark.parametrize("middle", [12, 20])
def test_a_free_flight_that_is_divided_has_no_impact(middle):
    """Up and down without a touch: neither is the ground near, nor does the velocity across it turn upward."""
    t = np.arange(32) / FPS
    y = 1.0 + 5.0 * t - 0.5 * GRAVITY * t**2
    table = pd.DataFrame({"release": 0, "block": "ball", "t_s": t, "x_m": t, "y_m": y, "theta_rad": np.nan})
    experiment = Experiment("toss", GRAVITY, FPS, 1e-4, 0.01, FLOOR, {"ball": BALL}, trajectories=table)
    film, world = load_film(experiment), setup_world(experiment)
    flights = Flights.of(film, *np.array([[0, middle + 2], [middle - 2, 32], [-1, 0]]))
    states = fit_states(world, film, flights)
    pairs = find_pairs(world, film, flights, states, start_instants(world, film, flights, states))
    assert len(pairs) == 1 and not pairs.are_impacts(world).any()
    assert replace(pairs, clearance_m=np.array([0.2 * RADIUS_M])).are_impacts(world).all()


def test_the_instant_of_contact_is_between_two_clearances_that_are_known():
    when = np.array([0.0, 1.0, 2.0])
    for gap, found in (([1.0, -1.0, -3.0], 0.5), ([2.0, 1.0, 0.5], 2.0), ([np.inf, -1.0, -2.0], 1.0),
                       ([1.0, -np.inf, np.inf], 1.0), ([-1.0, 1.0, 1.0], 0.0)):  # fmt: skip
        assert _crossed(when, np.array(gap)) == found
