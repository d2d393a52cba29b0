"""Studies of known causes: the plan, what the linear model expects, how diagnoses correct it, and the command."""

import json
from dataclasses import asdict, replace
from functools import partial

import numpy as np
import pytest

from rock2d.blind import recovery
from rock2d.blind.recovery import Plan, read_sizes, recovered
from rock2d.diagnosis.detection import ODDS_90, SHARED_SHIFT, Curve, corrected, detection_curves, read_limits
from rock2d.diagnosis.diagnose import diagnose
from rock2d.diagnosis.known_causes import effects_of_size
from rock2d.diagnosis.report.sections import LIMIT_COLUMNS, limit_lines, limit_rows
from rock2d.effects import catalogue
from rock2d.errors import InputError
from rock2d.files.experiment import load_experiment, write_experiment
from tests.diagnosis.test_impact_table_data import impacts
from tests.kinematics.synthetic_films import coarse_fits, effects, film, world
from tests.programs import commanded

TRIED = effects("camera_tilt", "air_drag", "angle_offset")
CURVES = {name: Curve(0.1, 4.0, "1", 0.05, 0.0, False, 1.0) for name in ("air_drag", "inertia_error")}
WITHOUT_CASES = 0.1 * np.exp(SHARED_SHIFT)  # what is seen with 50 % before there are cases


@pytest.fixture(scope="module")
def diagnosed():
    with coarse_fits():
        return diagnose(film(world(), 10, seed=1), effects=TRIED)


def test_a_plan_has_every_effect_and_size_once_and_effects_in_turn():
    limits = {name: {"seen50": 1.0, "seen90": 3.0} for name in "abc"}
    plan = Plan(99, read_sizes("seen50,2*seen90"), seed=1)
    cases = plan.of(limits)
    assert sorted(cases) == sorted((name, size) for name in "abc" for size in (1.0, 6.0))
    assert {name for name, _ in cases[:3]} == set("abc") and {size for _, size in cases[:3]} == {1.0, 6.0}
    assert Plan(4, plan.sizes, 1).of(limits) == cases[:4]


@pytest.mark.parametrize("text", ["", "seen95", "0*seen50", "x*seen50", "seen50;seen90", "-1*seen90"])
def test_sizes_that_are_none_are_refused(text):
    with pytest.raises(InputError):
        read_sizes(text)


def test_effects_without_a_size_are_refused():
    assert "mirrored_axis" not in effects_of_size("") and effects_of_size("air_drag") == ["air_drag"]
    for names in ("mirrored_axis", "air_drag,drag"):
        with pytest.raises(InputError, match="no effect"):
            effects_of_size(names)


def test_a_linear_model_expects_stronger_effects_to_be_seen(diagnosed):
    """The size that is seen grows with the noise, and is a part of the plausible range. The first film is so quiet that
    its limit is the least size that matters, 0.00225 rad."""
    curves = detection_curves(diagnosed, TRIED)
    with coarse_fits():
        noisy = detection_curves(diagnose(film(world(), 10, seed=1, noise_m=3e-3), effects=TRIED), TRIED)
    tilt, worse = curves["camera_tilt"], noisy["camera_tilt"]
    assert 1e-4 < tilt.seen50 < tilt.size(ODDS_90) < 0.05
    assert worse.seen50 > 1.5 * tilt.seen50 and worse.compatible > tilt.compatible
    assert not tilt.found and tilt.limit()["upper95"] >= tilt.size(ODDS_90)


def test_what_was_found_has_no_upper_limit_and_a_scatter_has_a_curve():
    tilted = catalogue()["camera_tilt"].apply(world(), [0.03, 0.0, 0.0])
    tried = effects("camera_tilt", "surface_roughness")
    with coarse_fits():
        curves = detection_curves(diagnose(film(tilted, 8, seed=1), effects=tried), tried)
    assert curves["camera_tilt"].found and curves["camera_tilt"].limit()["upper95"] is None
    assert curves["camera_tilt"].seen50 < 0.03
    assert 5e-4 < curves["surface_roughness"].seen50 < 0.02


def test_without_cases_all_curves_are_shifted_alike_and_become_flatter():
    found = corrected(CURVES, [])
    for own in found.values():
        assert own.seen50 == pytest.approx(WITHOUT_CASES, rel=1e-3)
        assert own.size(ODDS_90) > 2.0 * WITHOUT_CASES  # the shift is not known


def test_cases_shift_their_effect_more_than_the_others():
    missed = corrected(CURVES, [("air_drag", size, False) for size in (0.1, 0.2, 0.3)])
    assert missed["air_drag"].seen50 > missed["inertia_error"].seen50 > 1.1 * WITHOUT_CASES
    seen = corrected(CURVES, [("air_drag", size, True) for size in (0.1, 0.05)])
    assert seen["air_drag"].seen50 < seen["inertia_error"].seen50 < 0.9 * WITHOUT_CASES


def test_an_effect_that_no_plausible_size_shows_has_no_limit():
    missed = [("air_drag", 1.0, False)] * 9
    assert set(corrected(CURVES, missed)) == {"inertia_error"} < set(corrected(CURVES, missed[:1]))


def test_many_cases_give_the_true_curve():
    """Causes are seen from 0.2 ± on, where 0.1 was expected."""
    rng = np.random.default_rng(1)
    sizes = 0.2 * np.exp(rng.normal(0.0, 0.6, 200))
    seen = rng.random(200) < 1.0 / (1.0 + (0.2 / sizes) ** 4.0)
    found = corrected(CURVES, [("air_drag", s, bool(y)) for s, y in zip(sizes, seen, strict=True)])["air_drag"]
    assert found.seen50 == pytest.approx(0.2, rel=0.15) and found.steepness == pytest.approx(4.0, rel=0.1)


def test_names_of_the_pieces_are_false_only_beside_a_cause_of_the_camera(tmp_path):
    """The record without a cause shows a wrong inertia in pieces, and nothing as it is."""
    case = {"size": 0.1, "expected": 0.1}
    cases = {f"00{k}": {"effect": name, **case} for k, name in enumerate(("air_drag", "camera_tilt"))}
    curves = {name: asdict(CURVES["air_drag"]) for name in ("air_drag", "camera_tilt", "inertia_error")}
    truth = {"named": [], "cases": cases, "curves": curves, "without_cause": "002"}
    (tmp_path / "results").mkdir()
    (tmp_path / "truth.json").write_text(json.dumps(truth))
    named_in = (["air_drag", "inertia_error"], ["inertia_error"], ["inertia_error"])
    for name, named in zip(("000", "001", "002"), named_in, strict=True):
        result = {"named": {own: [] for own in named}, "parameters": {}}
        (tmp_path / "results" / f"{name}.json").write_text(json.dumps(result))
    moved, recorded = recovered(tmp_path)[0]
    assert moved["seen"] and moved["false"] == []
    assert not recorded["seen"] and recorded["false"] == ["inertia_error"]


def test_a_table_of_impacts_is_refused_before_it_is_diagnosed(tmp_path):
    table = impacts(world(), 20, seed=1, noise=0.01)
    write_experiment(tmp_path / "table", replace(table, impacts=table.impacts.fillna(0.0)))
    done = commanded("blind", "inject", tmp_path / "table", "--out", tmp_path / "study")
    assert isinstance(done.exception, InputError) and done.exception.code == "wrong_kind"
    assert not (tmp_path / "study").exists()


def test_limits_are_said_in_words():
    limits = {
        "camera_tilt": {"seen50": 0.01, "seen90": 0.02, "upper95": 0.03, "unit": "rad"},
        "scale_error": {"seen50": 0.01, "seen90": 0.02, "upper95": None, "unit": "1"},
    }
    assert all(len(row) == len(LIMIT_COLUMNS) for row in limit_rows(limits))
    tilt, scale = limit_lines(limits)
    assert "camera tilt of 1.1" in tilt and "°" in tilt and "none was found, so it is at most 1.7" in tilt
    assert "off 1" in scale and scale.endswith("it was found")


def test_a_study_is_made_continues_and_goes_into_a_report(tmp_path, monkeypatch):
    """The study and the report share the diagnosis of the film itself; the case has its own."""
    few = partial(diagnose, effects=effects("camera_tilt"))
    write_experiment(tmp_path / "film", film(world(), 8, seed=1))
    found = few(load_experiment(tmp_path / "film"))
    monkeypatch.setattr(recovery, "diagnose", few)
    for module in ("blind.record_cases", "diagnosis.command"):
        monkeypatch.setattr(f"rock2d.{module}.diagnose", lambda *given, **options: found)
    words = ["blind", "inject", tmp_path / "film", "--out", tmp_path / "study", "--workers", 1, "--quiet"]
    words += ["--effects", "camera_tilt", "--cases", 1, "--sizes", "4*seen90"]
    done = commanded(*words)
    assert done.exit_code == 0, done.output
    assert "1 of 1 known causes were seen" in done.output and "names that are false: 0" in done.output
    truth, limits = (json.loads((tmp_path / "study" / f"{name}.json").read_text()) for name in ("truth", "limits"))
    case = truth["cases"]["000"]
    assert truth["without_cause"] is None  # a cause of the camera needs no pieces
    assert case["effect"] == "camera_tilt" and case["expected"] == pytest.approx(case["size"], rel=1e-3)
    assert limits["camera_tilt"]["seen50"] < case["size"]
    assert limits == read_limits(tmp_path / "study", load_experiment(tmp_path / "film"))
    before = (tmp_path / "study" / "results" / "000.json").stat().st_mtime_ns
    assert commanded(*words).exit_code == 0
    assert (tmp_path / "study" / "results" / "000.json").stat().st_mtime_ns == before
    other = commanded(*words, "--seed", 1)
    assert isinstance(other.exception, InputError) and "other options" in str(other.exception)
    report = ["diagnose", tmp_path / "film", "--out", tmp_path / "d", "--workers", 1, "--quiet"]
    done = commanded(*report, "--limits", tmp_path / "study")
    assert done.exit_code == 0, done.output
    assert json.loads((tmp_path / "d" / "diagnosis.json").read_text())["limits"] == limits
    page = (tmp_path / "d" / "report.html").read_text()
    assert "What this film would have shown" in page and "were added to this film" in page
    refused = commanded(*report, "--limits", tmp_path / "d")
    assert isinstance(refused.exception, InputError)
    write_experiment(tmp_path / "other", film(world(), 8, seed=2))  # of the same name
    for command in (words, [*report, "--limits", tmp_path / "study"]):
        refused = commanded(*[tmp_path / "other" if word == tmp_path / "film" else word for word in command])
        assert isinstance(refused.exception, InputError) and "of another film" in str(refused.exception)
    assert commanded(*report, "--limits").exit_code == 0
    page = (tmp_path / "d" / "report.html").read_text()
    assert page.count("that a linear model expects") == 2 and "were added to this film" not in page
