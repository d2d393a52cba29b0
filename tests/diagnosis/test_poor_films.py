"""Films that are too poor to diagnose: what can be said is said, the rest is named, nothing crashes."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from rock2d.diagnosis.command import run_diagnosis, run_prediction
from rock2d.diagnosis.diagnose import check_and_segment
from rock2d.diagnosis.likelihood import log_likelihood
from rock2d.errors import InputError
from rock2d.files.experiment import Experiment, load_experiment, write_experiment
from rock2d.kinematics.setup_world import setup_world
from rock2d.records.columns import OMEGA, THETA
from rock2d.schemas import file_schema
from tests.diagnosed_files import content as none_found
from tests.kinematics.synthetic_films import film, without_angles, world
from tests.kinematics.test_film_findings import tossed
from tests.programs import refusal


def diagnosed(folder: Path, experiment: Experiment) -> tuple[dict, list[str], InputError]:
    """diagnosis.json, the lines that were printed, and the error of a film that is refused."""
    import jsonschema

    write_experiment(folder / "film", experiment)
    lines: list[str] = []
    options = {"seed": 0, "workers": 1, "progress": False, "report": lines.append}
    error = refusal(run_diagnosis, folder / "film", folder / "out", **options)
    content = json.loads((folder / "out/diagnosis.json").read_text(encoding="utf-8"))
    jsonschema.validate(content, file_schema("diagnosis"))
    assert error.code == "not_diagnosed"
    return content, lines, error


def test_one_flight_of_a_wrong_scale_is_refused_but_the_set_is_named_with_its_size(tmp_path):
    content, lines, error = diagnosed(tmp_path, tossed(9.67))
    assert "1 release is too few" in str(error)
    assert any(line.startswith("film: {scale_error, frame_rate_error}: 1.") for line in lines)
    assert content["verdict"] == "unknown" and content["film"]["gravity"]["off"]
    found = {cause["effect"]: cause for cause in content["causes"]}
    assert list(found) == ["scale_error", "frame_rate_error"]
    assert found["scale_error"]["group"] == ["frame_rate_error"]
    assert found["scale_error"]["parameters"]["scale"]["value"] == pytest.approx(9.67 / 9.81, abs=0.004)
    assert content["probabilities"]["scale_error"] == content["probabilities"]["frame_rate_error"] == 0.25
    assert sum(content["probabilities"].values()) == pytest.approx(1.0)
    page = (tmp_path / "out/report.html").read_text(encoding="utf-8")
    assert "What the film says of itself" in page and "multiply" in page and "the angle of block ball" in page


@pytest.mark.parametrize("frames", [4, 60])
def test_a_right_film_without_impacts_names_no_cause(tmp_path, frames):
    right = tossed()
    content, _, _ = diagnosed(tmp_path, replace(right, trajectories=right.trajectories[:frames]))
    assert content["causes"] == [] and content["verdict"] == "unknown"
    assert (content["film"]["gravity"] is None) == (frames == 4)


def test_nothing_is_predicted_where_no_block_touches_the_ground(tmp_path):
    write_experiment(tmp_path / "film", tossed())
    law = {"k_l_N_m": 1e4, "k_ul_N_m": 7e4, "k_t_N_m": 3e3, "friction_angle_deg": 32.0, "k_r_Nm_rad": 0.03}
    (tmp_path / "d.json").write_text(json.dumps(none_found(base=law)), encoding="utf-8")
    lines = list[str]()
    files, options = ((tmp_path / "d.json", tmp_path / "p.csv"), {"base_only": False, "report": lines.append})
    said = "no block touches the ground after a flight"
    refusal(run_prediction, tmp_path / "film", *files, **options, said=said)
    assert not (tmp_path / "p.csv").exists()
    write_experiment(tmp_path / "few", without_angles(film(world(), 2, seed=3), "sphere"))
    run_prediction(tmp_path / "few", *files, **options)
    assert not any("not fitted" in line for line in lines)
    (tmp_path / "d.json").write_text(json.dumps(none_found(base=law, law={"fitted": False})), encoding="utf-8")
    run_prediction(tmp_path / "few", *files, **options)
    assert sum("not fitted" in line for line in lines) == 1
    predicted = pd.read_csv(tmp_path / "p.csv").groupby("block")
    assert predicted["theta_rad"].count()["sphere"] == 0 and predicted["theta_rad"].count()["cube"] > 0
    assert np.isfinite(predicted.get_group("sphere")["x_m"]).all()


def test_an_angle_that_was_not_measured_is_no_measured_spin_of_zero(tmp_path):
    full = film(world(), 8, seed=5)
    write_experiment(tmp_path, without_angles(full, "sphere"))
    read = load_experiment(tmp_path)
    setup = setup_world(read)
    sanity, data = check_and_segment(read, setup)
    assert not sanity.faults and "never changes" not in " ".join(sanity.remarks)
    sphere = data.impact_block == list(read.blocks).index("sphere")
    residuals = data.residuals(setup).impacts
    assert not residuals[np.ix_(sphere, (THETA, OMEGA))].any()
    assert residuals[np.ix_(~sphere, (THETA, OMEGA))].any(axis=1).all()
    noise = data.state_noise(setup)
    assert (np.sqrt(noise[sphere, OMEGA, OMEGA]) > 28.0).all()  # rad/s: √(g / r), of the slowest
    assert (np.sqrt(noise[~sphere, OMEGA, OMEGA]) < 20.0).all()
    _, whole = check_and_segment(full, setup)
    # the noise of the angles of the cubes alone
    assert np.median(data.film.noise[THETA]) == pytest.approx(whole.film.noise[THETA], rel=0.1)
    assert np.isfinite(log_likelihood(residuals, data.outcome_noise())).all()
