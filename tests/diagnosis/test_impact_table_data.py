"""Impact tables: the law run through each impact from the state before it."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from rock2d.diagnosis.data import TableData
from rock2d.diagnosis.diagnose import diagnose
from rock2d.diagnosis.diagnosis_content import diagnosis_json
from rock2d.diagnosis.predict import predict
from rock2d.effects import catalogue
from rock2d.engines.batch import run_batch, world_ensemble
from rock2d.files.experiment import Experiment
from rock2d.kinematics.impacts import AFTER_COLUMNS
from rock2d.laws.contact import ContactParameters, contact_table
from rock2d.records.columns import AFTER, BEFORE, STATE_NAMES
from rock2d.scene.blocks import make_block
from rock2d.scene.cross_section import CrossSection
from rock2d.scene.world import World
from tests.kinematics.synthetic_films import effects

FLOOR = CrossSection([[-2.0, 0.0], [2.0, 0.0]], ["floor"])
SQUARE = {"square": make_block("square", "square", 0.05, side_m=0.06)}
HARD = ContactParameters(4e5, 1.6e6, 3e5, 20.0, 0.0)


def impacts(world: World, n: int, *, seed: int, noise: float) -> Experiment:
    """A table of `n` first impacts on a flat floor, velocities with relative noise."""
    rng = np.random.default_rng(np.random.SeedSequence(seed))
    states = np.column_stack([
        rng.uniform(-0.3, 0.3, n), np.full(n, 0.06), rng.uniform(-np.pi, np.pi, n),
        rng.normal(0.3, 0.3, n), rng.normal(-1.5, 0.2, n), rng.normal(0.0, 6.0, n),
    ])  # fmt: skip
    ensemble, tables = world_ensemble(world)
    row = run_batch(ensemble, states, table_ids=tables, impact_limit=1, impact_room=1).impacts[:, 0]
    before, after = row[:, BEFORE], row[:, AFTER]
    after[:, 3:] *= 1 + noise * rng.normal(size=(n, 3))
    columns = {"release": np.arange(n), "block": "square"}
    columns |= dict(zip(STATE_NAMES, before.T, strict=True))
    columns |= dict(zip(AFTER_COLUMNS, after[:, 3:].T, strict=True))
    return Experiment("table", 9.81, 250.0, 1e-4, 1e-3, FLOOR, SQUARE, impacts=pd.DataFrame(columns))


def plain_world() -> World:
    return World(SQUARE, FLOOR, contact_table(HARD, FLOOR.zone_names)[None])


def test_true_law_reproduces_the_table():
    experiment = impacts(plain_world(), 40, seed=1, noise=0.0)
    residuals = TableData.of(experiment).residuals(plain_world()).impacts
    assert np.quantile(np.abs(residuals), 0.9, axis=0) == pytest.approx([0, 0, 0], abs=0.05)


def test_slow_impacts_and_those_that_end_at_rest_have_an_outcome():
    """A slow block is not moved back into the ground; one that sticks ends almost without motion."""
    experiment = impacts(plain_world(), 3, seed=1, noise=0.0)
    table = experiment.impacts.assign(x_m=0.0, y_m=0.03, theta_rad=0.0, vx_m_s=0.0, omega_rad_s=0.0)
    table["vy_m_s"] = [-0.02, -0.002, 0.01]  # the last one only turns into the ground
    table.loc[2, ["theta_rad", "y_m", "omega_rad_s"]] = [-0.4, 0.0393, 8.0]
    data = TableData.of(replace(experiment, impacts=table))
    after = data.residuals(plain_world()).impacts + data.after
    assert np.isfinite(after).all() and np.abs(after[:2, :2]).max() < 0.02


def test_a_table_is_predicted_from_the_states_before_the_impacts_alone():
    experiment = impacts(plain_world(), 40, seed=3, noise=0.0)
    after = list(AFTER_COLUMNS)
    unmeasured = replace(experiment, impacts=experiment.impacts.assign(**dict.fromkeys(after, np.nan)))
    names = ("k_l_N_m", "k_ul_N_m", "k_t_N_m", "friction_angle_deg", "k_r_Nm_rad")
    law = {name: getattr(HARD, name) for name in names}
    found = predict(unmeasured, {"verdict": "none", "base": law})
    assert list(found.columns) == ["release", "block", "segment", *after]
    error = np.abs(found[after].to_numpy() - experiment.impacts[after].to_numpy())
    assert np.quantile(error, 0.9, axis=0) == pytest.approx([0, 0, 0], abs=0.05)


def test_only_the_ratio_of_stiffnesses_is_told():
    experiment = impacts(plain_world(), 120, seed=2, noise=0.01)
    content = diagnosis_json(diagnose(experiment, effects=effects("inertia_error", "angle_offset")))
    base = content["base"]
    assert base["k_ul_N_m"] / base["k_l_N_m"] == pytest.approx(4.0, rel=0.15)
    assert base["friction_angle_deg"] == pytest.approx(20.0, abs=1.5)
    assert content["verdict"] == "none"


def test_effect_is_found_in_a_table():
    world = catalogue()["inertia_error"].apply(plain_world(), [1.3])
    tried = effects("inertia_error", "angle_offset", "surface_roughness")
    content = diagnosis_json(diagnose(impacts(world, 150, seed=3, noise=0.01), effects=tried))
    assert content["verdict"] == "inertia_error"
    assert content["effects"]["inertia_error"]["parameters"]["factor"]["value"] == pytest.approx(1.3, rel=0.06)


def test_columns_the_wrong_way_round_are_said():
    experiment = impacts(plain_world(), 30, seed=4, noise=0.0)
    table = experiment.impacts
    pairs = list(zip(STATE_NAMES[3:], AFTER_COLUMNS, strict=True))
    experiment.impacts = table.rename(columns=dict(pairs) | {b: a for a, b in pairs})
    result = diagnose(experiment)
    assert "exchanged" in result.sanity.faults[0].message
