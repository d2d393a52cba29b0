"""Flights without impacts: what they show is diagnosed, of the rest nothing is said."""

import json
import os
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from rock2d.diagnosis.detection import detection_curves
from rock2d.diagnosis.diagnose import Diagnosis, diagnose
from rock2d.diagnosis.diagnosis_content import diagnosis_json
from rock2d.diagnosis.predict import diagnosed_world
from rock2d.effects import catalogue
from rock2d.effects.flight import drag_coefficient as coefficient
from rock2d.files.diagnosis import diagnosis_text, read_fitted_diagnosis
from rock2d.files.experiment import Experiment, load_experiment
from rock2d.kinematics.setup_world import setup_world
from rock2d.scene.blocks import Block, make_block
from rock2d.scene.cross_section import CrossSection
from tests.kinematics.synthetic_films import effects

G, NOISE_M, STEP_S, STEPS_PER_FRAME = 9.81, 2e-3, 1e-3, 17
BALLS = {
    name: make_block(name, "circle", mass, "solid_sphere", diameter_m=0.07)
    for name, mass in (("heavy", 0.5), ("light", 0.06), ("foam", 0.03))
}
DRAG = {"heavy": 0.45, "light": 0.6, "foam": 0.3}  # drag coefficients


def flights(
    blocks: dict[str, Block], drag: dict[str, float], *, throw_m_s: float = 0.0, lift_1_m: float = 0.0, drops: int = 4
) -> Experiment:
    """Balls dropped or thrown from 30 m, filmed without marks; lift turns the path, as topspin does."""
    rng, rows = np.random.default_rng(np.random.SeedSequence(3)), []
    for release, name in enumerate(name for name in blocks for _ in range(drops)):
        c = drag[name] / coefficient(blocks[name], 1.0)
        state, path = np.array([0.0, 30.0, throw_m_s * rng.uniform(0.8, 1.2), 0.0]), []
        for k in range(round(1.8 / STEP_S)):
            if k % STEPS_PER_FRAME == 0:
                path.append([k * STEP_S, *state[:2]])
            v = state[2:] + 0.5 * STEP_S * np.array([0.0, -G])
            speed = np.hypot(*v)
            pull = -c * speed * v + lift_1_m * speed * np.array([v[1], -v[0]]) - np.array([0.0, G])
            state = state + STEP_S * np.concatenate([v, pull])
        t, x, y = np.array(path).T
        x, y = np.stack([x, y]) + NOISE_M * rng.normal(size=(2, len(t))) * [[float(throw_m_s > 0)], [1.0]]
        rows.append(pd.DataFrame({"release": release, "block": name, "t_s": t, "x_m": x, "y_m": y}))
    table = pd.concat(rows, ignore_index=True).assign(theta_rad=np.nan)
    ground = CrossSection([[-60.0, 0.0], [60.0, 0.0]], ["ground"])
    return Experiment("drops", G, 1.0 / (STEPS_PER_FRAME * STEP_S), NOISE_M, 0.05, ground, blocks, trajectories=table)


@pytest.fixture(scope="module")
def drops() -> Diagnosis:
    return diagnose(flights(BALLS, DRAG))


@pytest.fixture(scope="module")
def content(drops) -> dict:
    return json.loads(diagnosis_text(diagnosis_json(drops)))


def test_each_ball_has_its_own_drag_coefficient(content):
    assert content["verdict"] == "air_drag"
    each = content["model"]["parameters"]["air_drag"]["drag_per_mass_1_m"]["by_block"]
    assert each.keys() == BALLS.keys()
    for name, own in each.items():
        found = own["drag_coefficient"]
        low, high = found["ci95"]
        assert low <= DRAG[name] <= high
        assert high - low < 0.4


def test_what_flights_do_not_show_is_not_tried_and_not_excluded(content):
    impacts = {name for name, effect in catalogue().items() if effect.phase == "impact"}
    assert impacts <= content["unseen"].keys() and not impacts & content["effects"].keys()
    chances = content["probabilities"]
    assert sum(chances.values()) == pytest.approx(1.0)
    assert all(0.0 < chances[name] < 0.001 for name in content["unseen"])
    assert not {own["effect"] for own in content["causes"]} & content["unseen"].keys()
    assert content["unseen"]["flight_damping"].endswith("air_drag")  # only the spin would tell them apart


def test_the_law_of_the_ground_is_not_called_fitted(drops, content):
    assert content["law"]["fitted"] is False and content["predicted"] is None
    assert any("it was not fitted" in line for line in content["assumptions"])
    np.testing.assert_allclose(drops.found.base.fit.p, 0.0, atol=1e-9)


def test_a_prediction_takes_the_drag_of_each_ball(drops, content, tmp_path):
    file = tmp_path / "diagnosis.json"
    file.write_text(json.dumps(content), encoding="utf-8")
    read_fitted_diagnosis(file)
    setup = setup_world(drops.experiment)
    world = diagnosed_world(content, setup, setup.order, base_only=False)
    each = content["model"]["parameters"]["air_drag"]["drag_per_mass_1_m"]["by_block"]
    for name, block in world.blocks.items():
        assert max(block.air) == pytest.approx(each[name]["value"] * block.mass_kg)


def test_limits_know_that_each_ball_has_its_own_drag_and_what_cannot_be_seen(drops):
    curves = detection_curves(drops, effects("air_drag", "scale_error", "flight_damping"))
    assert set(curves) == {"air_drag", "scale_error"}  # without the spin no damping can be seen
    drag, each = curves["air_drag"], [DRAG[name] / coefficient(ball, 1.0) for name, ball in BALLS.items()]
    assert drag.value == pytest.approx(np.mean(each), rel=0.05)
    assert max(each) < drag.compatible < 1.1 * max(each)
    assert drag.found and drag.seen50 < max(each) and drag.limit()["upper95"] is None
    scale = curves["scale_error"].limit()
    assert scale["seen50"] < scale["seen90"] <= scale["upper95"] < 0.02


def test_lift_of_an_unmeasured_spin_is_no_error_of_the_camera():
    """Thrown with topspin, balls fall faster, as a scale that is too long would make them."""
    light = {"light": BALLS["light"]}
    found = diagnose(flights(light, DRAG, throw_m_s=12.0, lift_1_m=0.006, drops=8))
    content = diagnosis_json(found)
    assert found.film.spin > 0.0 and not content["film"]["gravity"]["off"]
    named = {own["effect"] for own in content["causes"] if own["closes"] is not None}
    assert not named & {"scale_error", "frame_rate_error", "magnus_lift"}
    assert {"scale_error", "frame_rate_error", "magnus_lift"} <= content["unseen"].keys()


@pytest.mark.skipif(not os.environ.get("ROCK2D_DATA"), reason="needs the real drops under ROCK2D_DATA")
def test_real_balls_are_braked_by_the_air_whatever_else_bends_their_flights():
    """11 balls that fall 36 m. A lens gains less than half of what the air gains; only the heights were measured."""
    content = diagnosis_json(diagnose(load_experiment(Path(os.environ["ROCK2D_DATA"]) / "data/ball_drops")))
    assert content["verdict"] == "air_drag"
    assert {cause["effect"] for cause in content["causes"] if cause["named"]} == {"air_drag"}
    assert not any("angle" in check["words"] for check in content["checks"])
