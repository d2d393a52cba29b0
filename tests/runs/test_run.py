"""What a user of `rock2d run` sees: results that repeat, that are whole, and mistakes said in one line."""

import hashlib
from pathlib import Path

import numpy as np
import pytest

from rock2d.files.experiment import load_experiment
from rock2d.files.scenario_reading import load_scenario
from rock2d.runs.incident_states import fit_first_flight
from rock2d.runs.run import run
from rock2d.scene.blocks import make_block
from rock2d.scene.cross_section import CrossSection
from tests.programs import commanded, other_hash_seed, rock2d
from tests.scenarios_of_tests import SHIPPED


def digest(folder: Path) -> dict[str, str]:
    return {p.name: hashlib.sha256(p.read_bytes()).hexdigest() for p in sorted(folder.glob("*.csv"))}


def test_results_are_identical_for_any_number_of_workers_and_hash_seed(tmp_path):
    words = ["run", SHIPPED / "paper_setup.yaml", "--releases", 1, "--quiet", "--no-figures"]
    here = commanded(*words, "--workers", 1, "--out", tmp_path / "a")
    assert here.exit_code == 0, here.output
    done = rock2d(*words, "--workers", 2, "--out", tmp_path / "b", PYTHONHASHSEED=other_hash_seed())
    assert done.returncode == 0, done.stderr
    seen = [digest(tmp_path / name / "paper_setup_pymunk") for name in "ab"]
    assert seen[0] == seen[1]
    assert "trajectories.csv" in seen[0]


@pytest.mark.parametrize("engine", ["pymunk", "point_mass"])
def test_what_is_written_is_an_experiment_that_reads_back(tmp_path, engine):
    scenario = load_scenario(SHIPPED / "paper_setup.yaml")
    result = run(scenario, engine=engine, releases=2, workers=1, progress=False)
    result.write(tmp_path / "out")
    back = load_experiment(tmp_path / "out")
    table = result.to_pandas("trajectories")
    assert back.trajectories is not None
    assert np.allclose(back.trajectories["x_m"], table["x_m"], rtol=0, atol=1e-12)
    # events are exact: the impact's state lies on the track itself, not on a camera frame
    impacts = result.to_pandas("impacts")
    first = impacts[impacts["release"] == 0].iloc[0]
    assert np.isclose(result.tracks[0].knots[:, 0], first["t_s"], rtol=0, atol=1e-15).any()


def test_every_scenario_runs_as_it_stands(data_root):
    for path in sorted(SHIPPED.glob("*.yaml")):
        scenario = load_scenario(path, data_root)
        assert scenario.assumed, f"{path.name} must say what it assumes"
        result = run(scenario, releases=1, workers=1, progress=False)
        assert len(result.tracks) == len(result.blocks)


def test_a_mistake_is_one_line_with_its_place_and_exit_code_2_and_a_former_key_is_named(tmp_path):
    text = (SHIPPED / "flat_floor.yaml").read_text().replace("rolling_cap: false", "rolling_in_crater: false")
    (tmp_path / "bad.yaml").write_text(text.replace("{fps:", "{fsp:", 1))
    done = rock2d("run", tmp_path / "bad.yaml", "--out", tmp_path / "out")
    assert done.returncode == 2 and not (tmp_path / "out").exists()
    warned, error = done.stderr.splitlines()
    assert "bad.yaml:" in error and "did you mean 'fps'" in error
    assert warned.startswith(f"warning: {tmp_path / 'bad.yaml'}:") and "'rolling_in_indentation'" in warned


def test_first_flight_is_recovered_from_exact_frames_and_stops_at_the_impact():
    block, cross_section = (make_block("cube", "square", 0.05, side_m=0.06), CrossSection([[-1, 0], [1, 0]], ["floor"]))
    t = np.arange(60) / 250
    truth = np.array([0.1, 0.15, 0.3, -0.4, 0.2, 5.0])
    q = truth[:3] + np.outer(t, truth[3:])
    q[:, 1] -= 0.5 * 9.81 * t**2
    hits = int(np.argmax(q[:, 1] < block.height_above_lowest_point_m(q[:, 2])))
    q[hits:] = q[hits]  # it stops dead: these frames must not be used
    state, used = fit_first_flight(np.column_stack([t, q]), block, cross_section, 9.81, (1e-4, 1e-3))
    assert used <= hits
    assert np.allclose(state, truth, atol=1e-9)


def test_first_flight_errors_are_those_of_least_squares():
    block, cross_section = (
        make_block("ball", "circle", 0.05, diameter_m=0.02),
        CrossSection([[-9, 0], [9, 0]], ["floor"]),
    )
    t, truth, sigma = np.arange(20) / 1000, np.array([0.0, 1.0, 0.0, 1.0, -1.0, 3.0]), (3e-4, 2e-2)
    exact = truth[:3] + np.outer(t, truth[3:])
    exact[:, 1] -= 0.5 * 9.81 * t**2
    rng = np.random.default_rng(5)
    fits = np.array(
        [
            fit_first_flight(
                np.column_stack([t, exact + rng.normal(size=exact.shape) * [sigma[0], sigma[0], sigma[1]]]),
                block, cross_section, 9.81, sigma,
            )[0]
            for _ in range(400)
        ]
    )  # fmt: skip
    design = np.column_stack([np.ones_like(t), t])
    spread = np.sqrt(np.linalg.inv(design.T @ design)[1, 1])
    expected = np.array([sigma[0], sigma[0], sigma[1]]) * spread
    assert np.allclose(fits[:, 3:].std(axis=0), expected, rtol=0.15)
    assert (np.abs(fits.mean(axis=0) - truth)[3:] < 4 * expected / 20).all()


@pytest.mark.filterwarnings("ignore::rock2d.errors.OldKeyWarning")
def test_releases_that_once_made_energy_keep_their_balance(data_root):
    """Corners under an ellipse, soft soil, narrow walls, soils side by side: see the first line of each file."""
    paths = sorted((data_root / "cases").glob("*.yaml"))
    if not paths:
        pytest.skip("no folder cases beside the data")
    for path in paths:
        track = run(load_scenario(path), engine="batch").tracks[0]
        assert abs(track.energy_J["residual"]) < 1e-6 * track.energy_J["initial"], path.name
        assert (track.stop == "buried") == (path.name == "rest_in_wall.yaml")
