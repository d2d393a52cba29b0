"""The public face: what `import rock2d` offers, how fast it comes, and that its examples hold."""

import doctest
import importlib
import pickle
import tomllib
import webbrowser
from dataclasses import replace
from importlib.resources import files
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import rock2d
from rock2d.errors import CODES, InputError
from rock2d.files.scenario import scenario_file
from tests.diagnosis.test_impact_table_data import impacts, plain_world
from tests.programs import ROOT, printed, refusal
from tests.scenarios_of_tests import small_site

WITH_EXAMPLES = [
    "rock2d",
    "rock2d.api.films",
    "rock2d.api.sites",
    "rock2d.errors",
    "rock2d.files.scenario_variants",
    "rock2d.runs.simulation",
    "rock2d.scene.blocks",
    "rock2d.scene.cross_section",
]
HEAVY = ("numpy", "numba", "pandas", "scipy", "matplotlib", "pydantic", "shapely", "cv2")
BALL = rock2d.make_block("ball", "circle", 0.022, "solid_sphere", diameter_m=0.025)
FLOOR = rock2d.CrossSection([[-1, 0], [2, 0]], ["floor"], {"gate": [[0.2, 0], [0.2, 1]]})
REBOUND = rock2d.ReboundParameters(11, 0.04, 0.89)
DROPS = [[0, 0.3, 0, 0.5, 0, 0], [0, 0.4, 0, 0.8, 0, 0], [0, 0.2, 0, 0.1, 0, 0]]


def drops(**options):
    return rock2d.simulate(BALL, FLOOR, REBOUND, DROPS, engine="point_mass", **options)


@pytest.mark.parametrize("name", WITH_EXAMPLES)
def test_the_examples_of_the_documentation_hold(name):
    failed, tried = doctest.testmod(importlib.import_module(name), optionflags=doctest.ELLIPSIS)
    assert failed == 0 and tried > 0


def test_importing_rock2d_imports_nothing_heavy_and_gives_the_schemas_as_documented():
    code = f"import sys, rock2d; print([name for name in {HEAVY} if name in sys.modules]); "
    heavy, title = printed(code + "print(rock2d.schemas.file_schema('experiment')['title'])").splitlines()
    assert heavy == "[]" and "experiment" in title


def test_every_public_name_is_there_and_documented():
    for name in rock2d.__all__:
        found = getattr(rock2d, name)
        assert found.__doc__ and name in dir(rock2d), name
    with pytest.raises(AttributeError, match="no attribute 'nonsense'"):
        _ = rock2d.nonsense


def test_given_states_are_simulated_and_give_tables():
    result = drops()
    assert [track.release for track in result.tracks] == [0, 1, 2]
    assert set(result.to_pandas("crossings")["release"]) == {0, 1}
    assert result.to_pandas("passing")["passed"].tolist() == [2]
    trajectories = result.to_pandas()
    np.testing.assert_allclose(trajectories["t_s"].diff().iloc[1], 1 / 250)
    assert "energy" not in result.table_names()
    trajectories["x_m"] = 0.0
    assert result.to_pandas()["x_m"].abs().max() > 0  # a table that is given away is a copy


def test_a_release_does_not_depend_on_the_others():
    rough = rock2d.ReboundParameters(11, 0.04, 0.89, 20, "uniform")
    both = rock2d.simulate(BALL, FLOOR, rough, DROPS[:2], engine="point_mass", seed=3)
    one = rock2d.simulate(BALL, FLOOR, rough, DROPS[0], engine="point_mass", seed=3)
    other = rock2d.simulate(BALL, FLOOR, rough, DROPS[0], engine="point_mass", seed=4)
    assert np.array_equal(one.tracks[0].knots, both.tracks[0].knots)
    assert not np.array_equal(one.tracks[0].knots[-1], other.tracks[0].knots[-1])


def test_what_cannot_be_simulated_is_refused_with_a_code():
    def code(*arguments, **options):
        error = refusal(rock2d.simulate, *arguments, **options)
        assert error.code in CODES
        return error.code

    assert code(BALL, FLOOR, REBOUND, DROPS) == "wrong_kind"
    assert code(BALL, FLOOR, REBOUND, DROPS, engine="warp") == "unknown_name"
    assert code(BALL, FLOOR, REBOUND, [[0, 1, 0]], engine="point_mass") == "bad_value"
    assert code(BALL, FLOOR, REBOUND, [0, np.nan, 0, 0, 0, 0], engine="point_mass") == "bad_value"
    error = refusal(drops().to_pandas, "velocities")
    assert (error.code, error.fields) == ("unknown_name", {"name": "velocities"})


def test_plots_and_notebooks_show_the_releases():
    result = drops()
    assert len(result.plot().axes) == 1
    html = result._repr_html_()
    assert "<table" in html and "data:image/png;base64," in html and "3 rest" in html


def test_a_scenario_runs_and_is_written(tmp_path):
    scenario = rock2d.load_scenario(scenario_file("flat_floor.yaml"))
    result = rock2d.run(scenario, engine="point_mass", seed=2, releases=2)
    assert isinstance(result, rock2d.RunResult) and isinstance(result, rock2d.Simulation)
    tables = result.write(tmp_path / "out")
    names = {path.name for path in (tmp_path / "out").iterdir()}
    assert {f"{name}.csv" for name in tables} | {"trajectories.csv", "trajectories.png", "run.json"} <= names
    back = rock2d.load_experiment(tmp_path / "out")
    assert back.name == "flat_floor_point_mass" and len(back.blocks) == 5


def opened_page(result, monkeypatch, **options) -> str:
    """The page that `view` opens in the browser."""
    opened: list[str] = []
    with monkeypatch.context() as patch:
        patch.setattr(webbrowser, "open", opened.append)
        path = result.view(**options)
    assert opened == [path.as_uri()]
    return path.read_text(encoding="utf-8")


def test_a_site_is_assessed_designed_and_reported(tmp_path, monkeypatch):
    site = small_site(tmp_path, engine="point_mass")
    assessment = rock2d.assess(site)
    assert "How sure is that" in opened_page(assessment, monkeypatch)
    page = opened_page(rock2d.run(site), monkeypatch, assessment=assessment)
    assert "rock2d.write_report in Python" in page and "over sampling and what is not known" in page
    assert isinstance(assessment, rock2d.Assessment)
    assert set(assessment.uncertain["line"]) == {"arrival", "crest", "facing_1_3", "facing_2_3"}
    assert "<table" in assessment._repr_html_()
    rock2d.write_report(rock2d.run(site), tmp_path / "out" / "page", assessment=assessment)
    found = {path.name for path in (tmp_path / "out" / "page").iterdir()}
    assert {"report.html", "envelopes.csv", "design_values.csv", "uncertainty.csv", "reach.csv"} <= found
    page = (tmp_path / "out" / "page" / "report.html").read_text(encoding="utf-8")
    assert "rock2d.write_report in Python" in page and "over sampling and what is not known" in page

    target = rock2d.Target("crest", frequency=0.2, confidence=0.9)
    answer = rock2d.least_size(site, "embankment.height_m", (1.0, 6.0), target)
    assert isinstance(answer, rock2d.Answer) and answer.least is not None and answer.least > 1.0
    tried = answer.to_pandas().set_index("size")
    assert tried.loc[answer.least, "high"] <= 0.2 < tried.loc[1.0, "high"]
    assert "<img" in answer._repr_html_()
    assert all(len(str(found)) < 500 for found in (site, assessment, answer))
    least = rock2d.variant(site, {answer.place: answer.least}, uncertain=True)
    assert least.embankment.height_m == answer.least and least.uncertainty is not None


def test_what_has_no_answer_is_refused_with_a_code(tmp_path):
    known = small_site(tmp_path, unknown="", engine="point_mass")
    assert refusal(rock2d.assess, known).code == "missing_key"
    with pytest.raises(InputError, match="no measure line top"):
        rock2d.least_size(known, "embankment.height_m", (1.0, 6.0), rock2d.Target("top", 0.2, 0.9))
    assert refusal(rock2d.variant, known, {"embankment.high_m": 3.0}).code == "unknown_name"


def test_errors_keep_their_facts_when_they_travel_between_processes():
    error = InputError("unknown key", "s.yaml", 3, 1, code="unknown_key", key="engin")
    back = pickle.loads(pickle.dumps(error))
    assert str(back) == str(error) == "s.yaml:3:1: unknown key"
    assert (back.code, back.fields, back.line) == ("unknown_key", {"key": "engin"}, 3)
    from rock2d import errors

    assert all(f"``{code}``" in errors.__doc__ for code in CODES)


def test_every_code_that_is_used_is_documented():
    import re

    for path in Path(rock2d.__file__).parent.rglob("*.py"):
        for code in re.findall(r'\bcode="(\w+)"', path.read_text(encoding="utf-8")):
            assert code in CODES, f"{path}: {code}"


CONTENT = {
    "schema": 1,
    "experiment": "drops <1>",
    "verdict": "air_drag",
    "probabilities": {"none": 0.1, "unknown": 0.0, "air_drag": 0.9},
    "effects": {
        "air_drag": {
            "heldout_score_gain": 12.0, "heldout_score_gain_se": 2.0, "closure": 0.8, "closure_ci95": [0.7, 0.9],
        }
    },
}  # fmt: skip


def test_a_diagnosis_shows_its_verdict_and_its_effects():
    result = rock2d.DiagnosisResult(None, CONTENT)
    assert result.verdict == "air_drag" and result.probabilities["air_drag"] == 0.9
    table = result.to_pandas()
    assert table["effect"].tolist() == ["air_drag", "none", "unknown"]
    assert table.loc[0, ["closure", "closure_low95", "closure_high95"]].tolist() == [0.8, 0.7, 0.9]
    assert pd.isna(table.loc[1, "heldout_score_gain"])
    result.to_dict()["effects"].clear()
    assert result.content["effects"]  # a copy was given away
    assert str(result).splitlines()[0] == "<DiagnosisResult of drops <1>: air_drag"
    html = result._repr_html_()
    assert "drops &lt;1&gt;" in html and "<b>air_drag</b>" in html


def test_an_impact_table_is_diagnosed_and_written(tmp_path, monkeypatch):
    experiment = replace(impacts(plain_world(), 2, seed=1, noise=0.0), name="impacts")
    result = rock2d.diagnose(experiment, workers=1)
    assert result.verdict == "unknown" and result.to_dict()["sanity"]["faults"]
    assert sum(result.probabilities.values()) == pytest.approx(1.0)
    assert len(str(result)) < 500 and str(result.diagnosis) == "<Diagnosis of impacts: unknown>"
    assert opened_page(result, monkeypatch).count("impacts") > 2
    result.write(tmp_path / "diagnosis")
    assert {path.name for path in (tmp_path / "diagnosis").iterdir()} >= {"diagnosis.json", "report.html"}
    with pytest.raises(InputError):
        rock2d.predict(experiment, result)


def test_what_is_public_shows_itself_in_a_few_lines():
    scenario = rock2d.load_scenario(scenario_file("paper_setup.yaml"))
    result = rock2d.run(scenario, engine="point_mass", releases=3)
    shown = [result, *result.tracks, result.experiment(), result.cross_section, scenario, drops()]
    shown += [*rock2d.catalogue().values(), rock2d.Target("crest", 0.1, 0.9)]
    for one in shown:
        text = f"{one}"
        assert len(text) < 500 and len(text.splitlines()) <= 4, text
    assert "9 releases, engine point_mass" in repr(result) and "sphere (3)" in repr(result)
    assert all(name in repr(result) for name in result.table_names())


@pytest.mark.parametrize("package", ["rock2d", "rock2d_tracking", "rock2d_figures"])
def test_packages_say_that_they_have_types(package):
    assert (files(package) / "py.typed").is_file()
    settings = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    assert "py.typed" in settings["tool"]["setuptools"]["package-data"][package]
