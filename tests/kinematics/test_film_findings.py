"""What a film says of itself: scale and frame rate as one set, air and place allowed for, rests, unknown angles."""

import json
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from rock2d.files.experiment import Experiment, FromGravity
from rock2d.kinematics.film_findings import FilmFindings, film_findings, write_film_findings
from rock2d.kinematics.film_segments import FilmSegments
from rock2d.kinematics.flights import load_film
from rock2d.kinematics.setup_world import setup_world
from rock2d.scene.blocks import make_block
from rock2d.scene.cross_section import CrossSection

BALL = make_block("ball", "circle", 0.2, "solid_sphere", diameter_m=0.06)
FLOOR = CrossSection([[-1.0, 0.0], [3.0, 0.0]], ["floor"])


def tossed(gravity: float = 9.81, *, fps: float = 120.0, rest_m: float | None = None) -> Experiment:
    """One toss that is in the air at the end of the film, or lies on the floor, `rest_m` above it, for 40 frames."""
    rng = np.random.default_rng(np.random.SeedSequence(3))
    t = np.arange(60) / fps
    path = list(np.column_stack([1.5 * t, 1.0 + 2.0 * t - 0.5 * gravity * t**2]))
    if rest_m is not None:
        path += [np.array([1.2, 0.03 + rest_m])] * 40
        t = np.arange(100) / fps
    x, y = (np.array(path) + 1e-4 * rng.normal(size=(len(path), 2))).T
    table = pd.DataFrame({"release": 0, "block": "ball", "t_s": t, "x_m": x, "y_m": y, "theta_rad": np.nan})
    return Experiment("toss", 9.81, fps, 1e-4, 0.0, FLOOR, {"ball": BALL}, trajectories=table)


def stated(experiment: Experiment) -> FilmFindings:
    world = setup_world(experiment)
    data = FilmSegments.of(load_film(experiment), world)
    return film_findings(data, world, experiment.fps, experiment.from_gravity)


def test_one_flight_names_scale_and_frame_rate_as_one_set_with_size_and_interval():
    said = stated(tossed(9.67))
    assert said.suspects == ["scale_error", "frame_rate_error"]
    scale = said.parameters()["scale_error"]["scale"]
    low, high = scale["ci95"]
    error = (high - low) / 3.92
    assert abs(scale["value"] - 9.67 / 9.81) < 4 * error and error < 0.001
    rate = said.parameters()["frame_rate_error"]["time_scale"]
    assert rate["value"] ** 2 == pytest.approx(scale["value"])
    assert said.true_fps().value == pytest.approx(120.0 * np.sqrt(9.81 / 9.67), rel=0.002)
    assert said.sentences()[0].startswith("{scale_error, frame_rate_error}: 1.")
    assert "too short" in said.sentences()[0] and said.without_angle == ["ball"]


@pytest.mark.parametrize("which", ["fps", "scale"])
def test_gravity_that_gave_the_frame_rate_or_the_scale_is_no_measurement(which):
    said = stated(replace(tossed(9.67), from_gravity=FromGravity(which=which, relative_error=0.004)))
    assert said.suspects == [] and said.parameters() == {} and said.content()["gravity"] is None
    assert set(said.unjudged) == {"scale_error", "frame_rate_error"}
    sentence = said.sentences()[0]
    assert "was taken from gravity" in sentence and "0.4 %" in sentence and "g =" not in sentence
    assert ("120.0 ± 0.5 frames/s" in sentence) == (which == "fps")


def test_a_right_film_is_not_accused():
    said = stated(tossed())
    assert not said.off and "agrees with the stated 9.81" in said.sentences()[0]


def test_what_the_air_would_do_is_no_error_of_the_camera():
    film = tossed(9.75)
    light = make_block("ball", "circle", 0.01, "solid_sphere", diameter_m=0.06)
    heavy, other = stated(film), stated(replace(film, blocks={"ball": light}))
    # it falls faster than it rose
    assert other.air[0] == pytest.approx(20 * heavy.air[0]) and other.air[0] < -0.003
    assert heavy.off and heavy.ratio == other.ratio
    assert not other.off and "no more than air" in other.sentences()[0]


def test_the_height_at_rest_is_stated_against_the_size_of_the_block(tmp_path):
    (rest,) = stated(tossed(rest_m=0.003)).rests
    assert rest.height_m == pytest.approx(0.003, abs=2e-4)
    assert rest.height_radii == pytest.approx(0.1, abs=0.01)
    assert rest.error_m is None and rest.rests == 1
    write_film_findings(tmp_path, stated(tossed(rest_m=0.003)))
    content = json.loads((tmp_path / "film.json").read_text(encoding="utf-8"))
    assert content["rests"][0]["block"] == "ball" and content["gravity"]["flights"] == 1


def test_a_block_may_rest_exactly_on_the_ground():
    """Two releases of a simulation, without noise."""
    film = tossed(rest_m=0.0)
    table = film.trajectories
    table.loc[60:, ["x_m", "y_m"]] = 1.25, 0.03125
    both = pd.concat([table, table.assign(release=1)], ignore_index=True)
    ball = make_block("ball", "circle", 0.2, "solid_sphere", diameter_m=0.0625)
    said = stated(replace(film, trajectories=both, blocks={"ball": ball}))
    (rest,) = said.rests
    assert rest.height_m == rest.error_m == 0.0
    (line,) = (line for line in said.sentences() if "at rest" in line)
    assert "block ball lies 0 ± 0 mm" in line and not line.endswith("?")


def test_without_a_flight_nothing_is_said_of_gravity():
    short = tossed()
    said = stated(replace(short, trajectories=short.trajectories[:5]))
    assert said.gravity is None and not said.suspects and "cannot be checked" in said.sentences()[0]
    assert said.content()["gravity"] is None
