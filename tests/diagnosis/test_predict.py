"""Predictions of a diagnosed model on other releases, and the two commands."""

import copy
import json
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from rock2d.diagnosis.command import run_diagnosis
from rock2d.diagnosis.diagnose import check_and_segment, diagnose
from rock2d.diagnosis.diagnosis_content import diagnosis_json
from rock2d.diagnosis.predict import COLUMNS, predict, read_for_prediction, setup_remarks
from rock2d.diagnosis.predicted_gap import MOST_UNCERTAIN, REPLICATES, PredictedGap
from rock2d.diagnosis.report.text import share_closed
from rock2d.effects import catalogue
from rock2d.errors import InputError, OldKeyWarning, UnusualWarning
from rock2d.files.experiment import Experiment, write_experiment
from rock2d.kinematics.setup_world import setup_world
from rock2d.scene.cross_section import CrossSection
from tests.diagnosed_files import with_learnt
from tests.kinematics.synthetic_films import SOIL, coarse_fits, effects, film, world, yielded
from tests.programs import commanded, refusal

TILTED = catalogue()["camera_tilt"].apply(world(), [0.03, 0.0, 0.0])


@pytest.fixture(scope="module")
def content():
    with coarse_fits():
        found = diagnose(film(TILTED, 8, seed=1), effects=effects("camera_tilt", "angle_offset"))
    return json.loads(json.dumps(diagnosis_json(found)))


def misses(table: pd.DataFrame, measured: pd.DataFrame) -> np.ndarray:
    """Distances in m between prediction and measurement."""
    both = table.merge(measured, on=["release", "t_s"], suffixes=("", "_measured"))
    return np.hypot(both.x_m - both.x_m_measured, both.y_m - both.y_m_measured).to_numpy()


def test_effect_shrinks_the_miss_on_other_releases(content):
    other = film(TILTED, 8, seed=99)
    assert content["verdict"] == "camera_tilt"
    base, augmented = (predict(other, content, base_only=flag) for flag in (True, False))
    assert list(augmented.columns) == list(COLUMNS)
    assert not augmented.isna().any().any()
    assert np.median(misses(augmented, other.trajectories)) < 0.5 * np.median(misses(base, other.trajectories))
    # most of the remaining distance is noise of the camera and scatter of the soil
    assert np.median(misses(augmented, other.trajectories)) < 4 * other.position_noise_m


def test_what_was_found_beside_an_unknown_cause_is_used(content):
    other, unknown = film(TILTED, 8, seed=99), {**content, "verdict": "unknown"}
    assert list(content["model"]["parameters"]) == ["camera_tilt"]
    pd.testing.assert_frame_equal(predict(other, unknown), predict(other, content))
    nothing = {**unknown, "model": None}
    pd.testing.assert_frame_equal(predict(other, nothing), predict(other, nothing, base_only=True))


def test_a_parameter_without_values_by_block_says_so_with_null_or_not_at_all(content):
    other, null = film(TILTED, 2, seed=99, duration_s=0.6), copy.deepcopy(content)
    for parameter in null["model"]["parameters"]["camera_tilt"].values():
        parameter["by_block"] = None
    pd.testing.assert_frame_equal(predict(other, null), predict(other, content))


def known(effect: str = "none", *values: float) -> dict:
    """A diagnosis that found the law of the synthetic films and one effect with these values."""
    own = {p.name: {"value": v} for p, v in zip(PARAMETERS.get(effect, ()), values, strict=True)}
    return {"base": SOIL, "verdict": effect, "effects": {effect: {"base": SOIL, "parameters": own}}}


def test_a_change_in_time_is_predicted_for_segments_that_end_in_an_impact():
    """On ground that swallows a block, the simulated impact has no end."""
    wave = {"quantity": "time_s", "kind": "waves", "numbers": [20.0]}
    push = [[1e-3, 0.0], [0.0, 0.0], [0.0, 0.0], [0.0, 0.0]]  # m/s, of the sine and the cosine
    shaken = {"lever": "frame", "depends_on": "time", "curves": [wave], "coefficients": push}
    content = known()
    law = {**content["base"], "k_ul_N_m": 1e6, "k_r_Nm_rad": 3.0}
    content["model"] = with_learnt(law, shaken)
    assert not predict(film(TILTED, 8, seed=99), content).isna().any().any()


PARAMETERS = {name: effect.parameters for name, effect in catalogue().items()}
STICKY = catalogue()["adhesion"].apply(world(), [12.0])
SCALED = catalogue()["scale_error"].apply(world(), [1.15, 1.0, 0.5, 0.8])


@pytest.mark.parametrize(
    ("true", "found"),
    [
        (STICKY, known("adhesion", 12.0)),
        (yielded(STICKY, 0.02), known("adhesion", 12.0)),
        (yielded(world(), 0.04), known()),
        (SCALED, known("scale_error", 1.15, 1.0, 0.5, 0.8)),
    ],
    ids=["blocks that stick", "sticky and yielded", "yielded", "scale"],
)
def test_where_one_half_is_diagnosed_the_other_is_predicted(true, found):
    """The other half may have few releases, and few flights in them."""
    first, other = (film(true, n, seed=n, fps=500.0, duration_s=0.8) for n in (12, 2))
    assert not check_and_segment(first, setup_world(first))[0].faults
    table = predict(other, found)
    assert set(table.release) == {0, 1, 2, 3} and not table.isna().any().any()


def test_a_diagnosed_scale_is_undone_before_the_film_is_judged_and_divided():
    other = film(SCALED, 2, seed=9, duration_s=0.6)
    base, right = (predict(other, found) for found in (known(), known("scale_error", 1.15, 1.0, 0.5, 0.8)))
    assert np.median(misses(base, other.trajectories)) > 10 * other.position_noise_m
    assert np.median(misses(right, other.trajectories)) < 4 * other.position_noise_m


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda t: {"x_m": 1e3 * t.x_m, "y_m": 1e3 * t.y_m}, "millimetres"),
        (lambda t: {"theta_rad": np.rad2deg(t.theta_rad)}, "degrees"),
        (lambda t: {"t_s": 4.0 * t.t_s}, "playback rate"),
        (lambda t: {"y_m": 0.03 - t.y_m}, "upwards"),
        (lambda t: {"x_m": 0.0 * t.x_m, "y_m": 0.1 + 0.0 * t.y_m}, "never moved"),
    ],
)
def test_a_film_that_cannot_be_read_is_not_predicted(change, said):
    other = film(world(), 8, seed=4)
    other.trajectories = other.trajectories.assign(**change(other.trajectories))
    with pytest.raises(InputError, match=said):
        predict(other, known())


def test_a_film_that_is_doubtful_is_predicted_with_a_warning_of_one_line():
    other = film(world(), 2, seed=4, duration_s=0.6)
    other.trajectories = other.trajectories.assign(theta_rad=0.5)
    with pytest.warns(UnusualWarning, match="the angle of block .* never changes"):
        predict(other, known())


def test_segments_cover_what_follows_the_first_flight(content):
    other = film(TILTED, 6, seed=5)
    table = predict(other, content)
    one = table[table.release == 0]
    whole = other.trajectories[other.trajectories.release == 0]
    assert one.segment.min() == 0 and set(one.segment) == set(range(one.segment.max() + 1))
    assert one.t_s.is_monotonic_increasing or one.segment.is_monotonic_increasing
    assert one.t_s.max() == whole.t_s.max()


def test_an_old_key_is_read_with_a_warning(tmp_path, content):
    path = tmp_path / "diagnosis.json"
    old = {**content, "law": {"rolling_in_crater": True}}
    path.write_text(json.dumps(old), encoding="utf-8")
    with pytest.warns(OldKeyWarning, match=r"json:1: .*'rolling_in_crater' is called 'rolling_in_indentation'"):
        read = read_for_prediction(path)
    assert read["law"] == {"rolling_in_indentation": True}
    path.write_text(json.dumps({**content, "law": {"rolling_in_indentation": True}}), encoding="utf-8")
    assert read == read_for_prediction(path)


def test_commands_write_what_they_say(tmp_path, content):
    own = film(TILTED, 6, seed=5)
    late = own.trajectories.assign(t_s=own.trajectories["t_s"] + 100 / 7)  # times with many digits
    write_experiment(tmp_path / "film", replace(own, trajectories=late))
    recorded = pd.read_csv(tmp_path / "film" / "trajectories.csv")
    (tmp_path / "diagnosis.json").write_text(json.dumps(content), encoding="utf-8")
    for given in (tmp_path / "diagnosis.json", tmp_path):  # file or folder
        out = tmp_path / "p.csv"
        result = commanded("predict", tmp_path / "film", "--diagnosis", given, "--out", out, "--base-only")
        assert result.exit_code == 0 and "warning" not in result.output, result.output
        table = pd.read_csv(out)
        assert list(table.columns) == list(COLUMNS) and len(table) > 100
        assert len(table.merge(recorded, on=["release", "t_s"])) == len(table)  # times are those of the film
    words = ("predict", tmp_path / "film", "--diagnosis", tmp_path, "--out", tmp_path / "film" / "trajectories.csv")
    assert isinstance(commanded(*words).exception, InputError)
    pd.testing.assert_frame_equal(pd.read_csv(words[-1]), recorded)  # the record was not replaced


def test_blocks_of_another_size_are_told(tmp_path, content):
    """The stiffness of a soil belongs to a block and a soil."""
    (tmp_path / "diagnosis.json").write_text(json.dumps(content), encoding="utf-8")
    other = film(TILTED, 2, seed=5)
    blocks = {name: replace(block, mass_kg=1000.0 * block.mass_kg) for name, block in other.blocks.items()}
    write_experiment(tmp_path / "film", replace(other, blocks=blocks))
    result = commanded(
        "predict", tmp_path / "film", "--diagnosis", tmp_path, "--out", tmp_path / "p.csv", "--base-only"
    )
    assert result.exit_code == 0 and "do not hold at this scale" in result.output


def test_another_setup_is_told(content):
    """Without a remark, a forecast for another ground looks like one for the ground of the film."""
    other = film(TILTED, 2, seed=5)
    ground = other.cross_section
    assert setup_remarks(other, content) == setup_remarks(other, known()) == []
    lifted = CrossSection(ground.points_m + np.array([0.0, 0.05]), ground.zones)
    blocks = {"egg": other.blocks["sphere"], "cube": replace(other.blocks["cube"], mass_kg=1.0)}
    changed = replace(other, cross_section=lifted, blocks=blocks, gravity_m_s2=9.0)
    differs, meaning = setup_remarks(changed, content)
    for words in ("50.0 mm elsewhere", "no block egg", "mass of block cube: 1 kg", "gravity is 9 m/s²"):
        assert words in differs
    assert "zones" not in differs and "no film tested" in meaning
    fewer = CrossSection(ground.points_m[1:], ["gravel"] * (len(ground.zones) - 1))
    differs, _ = setup_remarks(replace(other, cross_section=fewer), content)
    assert f"{len(ground.points_m) - 1} points" in differs and "zones are gravel" in differs


def one_release() -> Experiment:
    both = film(world(), 2, seed=5)
    return replace(both, trajectories=both.trajectories[both.trajectories["release"] == 0])


def test_a_diagnosis_goes_into_its_own_folder_again_but_into_no_other(tmp_path):
    write_experiment(tmp_path / "film", one_release())

    def diagnose_into(out):
        options = {"seed": 0, "workers": 1, "progress": False, "report": lambda line: None}
        return refusal(run_diagnosis, tmp_path / "film", tmp_path / out, **options).code

    assert diagnose_into("out") == diagnose_into("out") == "not_diagnosed"
    (tmp_path / "out" / "diagnosis.json").write_text('{"schema": 1}')
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "notes.txt").write_text("notes")
    assert diagnose_into("out") == diagnose_into("mine") == diagnose_into("film") == "not_a_result"
    assert [path.name for path in (tmp_path / "mine").iterdir()] == ["notes.txt"]


@pytest.mark.parametrize(("gap", "stated"), [(3.0, True), (0.1, False)])
def test_the_share_of_a_gap_is_stated_if_its_standard_error_is_at_most_15_points(gap, stated):
    """Half of the gap is closed in the mean; each release has its own miss, the same in both models."""
    rng, count = np.random.default_rng(1), 40
    floor, release = rng.lognormal(size=count), np.arange(count)
    noisy = 1.0 + 0.1 * rng.normal(size=count)
    repetitions = np.tile(floor, (REPLICATES, 1))
    misses_of = PredictedGap(
        release, floor + gap, (floor + gap / 2) * noisy, repetitions, np.array([1e-4, 1e-4, 1e-3]), ((0.0, 0.0),) * 2
    )
    typical = misses_of.content(seed=0)["typical"]
    low, high = typical["closure_ci95"]
    assert (typical["closure"] is not None) == stated == (high - low < 4 * MOST_UNCERTAIN)
    assert low < 0.5 < high
    words = share_closed(typical["closure"], typical["closure_ci95"])
    assert words.startswith("not known (") != stated
