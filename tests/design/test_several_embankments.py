"""Two embankments in one scenario: what blocks do there, which of them is sought, and what the page says."""

import json

import numpy as np
import pandas as pd
import pytest

from rock2d.commands.run import RunRequest, run_scenarios
from rock2d.design import command
from rock2d.design.least_size import line_of_place
from rock2d.design.norms import demands
from rock2d.design.report_tables import quantity_text
from rock2d.effects.ground import as_built
from rock2d.files.scenario_reading import load_scenario
from rock2d.runs.run import run
from rock2d.scene.blocks import make_block
from rock2d.scene.plausibility import earthwork_doubts
from tests.diagnosis.test_report import Page
from tests.programs import commanded
from tests.scenarios_of_tests import SLOPE, scenario_file

FIRST = "1: {x_m: 26, height_m: 0.8, crest_m: 1.0, uphill_deg: 60, downhill_deg: 34}"
SECOND = "2: {x_m: 34, height_m: 0.6, crest_m: 0.8, uphill_deg: 60, downhill_deg: 34}"
BOTH = f"{SLOPE}embankment: {{{FIRST}, {SECOND}}}\nditch: {{2: {{width_m: 1.5, depth_m: 0.2, uphill_deg: 45}}}}"
RELEASES = 120


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    return scenario_file(tmp_path_factory.mktemp("two"), "two", ground=BOTH, releases=RELEASES)


@pytest.fixture(scope="module")
def crossings(site):
    return run(load_scenario(site)).to_pandas("crossings")


def those_that_pass(crossings: pd.DataFrame, line: str) -> set[int]:
    return set(crossings.loc[crossings["line"] == line, "release"])


def test_nothing_passes_the_second_crest_without_the_first(crossings):
    lines = ("arrival_1", "crest_1", "arrival_2", "crest_2")
    arrived_1, passed_1, arrived_2, passed_2 = (those_that_pass(crossings, line) for line in lines)
    assert passed_2 < arrived_2 <= passed_1 < arrived_1 and len(passed_2) >= 5


def test_the_first_embankment_is_met_as_if_there_were_no_other(crossings, tmp_path):
    ground = f"{SLOPE}embankment: {{{FIRST}}}"
    alone = run(load_scenario(scenario_file(tmp_path, "one", ground=ground, releases=RELEASES)))
    alone_table = alone.to_pandas("crossings")
    both = crossings[crossings["line"].isin(alone_table["line"].unique())].reset_index(drop=True)
    pd.testing.assert_frame_equal(both, alone_table, check_exact=True)
    plain = ground.replace("{1: ", "").replace("}}", "}")
    without_number = run(load_scenario(scenario_file(tmp_path, "plain", ground=plain, releases=RELEASES)))
    unnumbered = alone_table.assign(line=alone_table["line"].str.removesuffix("_1"))
    pd.testing.assert_frame_equal(without_number.to_pandas("crossings"), unnumbered, check_exact=True)


def test_arrived_at_a_crest_means_at_the_arrival_line_of_its_embankment(site, crossings):
    passing = run(load_scenario(site)).to_pandas("passing").set_index("line")
    for number in (1, 2):
        arrived = len(those_that_pass(crossings, f"arrival_{number}"))
        assert passing.loc[f"crest_{number}", "arrived"] == arrived
        assert passing.loc[f"facing_1_3_{number}", "arrived"] == arrived
    assert passing.loc["crest_2", "arrived"] < passing.loc["crest_1", "arrived"]


def test_a_higher_second_embankment_is_found_and_the_first_stays(site, tmp_path, monkeypatch):
    """Without its page, which takes longer than the search; that of two embankments is below."""
    monkeypatch.setattr(command, "_write_page", lambda *of: [])
    words = "--vary embankment.2.height_m --range 0.3 5 --target 12 --tolerance 0.5 --quiet --out"
    done = commanded("design", site, *words.split(), tmp_path / "design")
    assert done.exit_code == 0, done.output
    facts = json.loads((tmp_path / "design" / "design.json").read_text())
    assert facts["target"]["line"] == "crest_2" and 0.3 < facts["least"] < 5.0
    medians = [judged["median"]["ball"] for judged in facts["judgements"]]
    assert medians == sorted(medians, reverse=True) and medians[0] > medians[-1]
    least = load_scenario(tmp_path / "design" / "least.yaml").embankment
    assert least["2"].height_m == facts["least"] and least["1"].height_m == 0.8
    without_number = commanded("design", site, "--range", 1, 5, "--target", 50, "--quiet", "--out", tmp_path / "none")
    assert "did you mean 'embankment.1.height_m'" in str(without_number.exception)
    assert not (tmp_path / "none").exists()


def test_the_line_of_a_search_is_the_crest_of_what_is_varied():
    known = {
        "embankment.height_m": "crest", "embankment.2.x_m": "crest_2", "ditch.1.width_m": "crest_1",
        "ditch.width_m": "crest", "cross_section.points_m.2.0": "crest",
    }  # fmt: skip
    assert {place: line_of_place(place) for place in known} == known


def test_the_page_lists_both_embankments(site, tmp_path):
    run_scenarios([site], RunRequest(tmp_path, page_command="rock2d run", progress=False, report=str))
    folder = tmp_path / "two_batch"
    text = (folder / "report.html").read_text()
    for number in (1, 2):
        assert (folder / f"embankment_{number}.png").is_file()
        assert any(f"at embankment {number}, enlarged" in image["alt"] for image in Page(text).of("img"))
        assert f"Share of ball that pass crest_{number}" in text
    percentiles = pd.read_csv(folder / "percentiles.csv")
    found = demands(percentiles)
    assert {number for number, _ in found} == {1, 2}
    table = percentiles[percentiles["percentile"] == 95.0].set_index(["line", "quantity"])["value"]
    for (number, quantity), (block, estimate) in found.items():
        assert block == "ball" and estimate.value == table[f"arrival_{number}", quantity]
        assert quantity_text(quantity, *estimate) in text
    assert "Energy that arrives (95\N{NO-BREAK SPACE}%), embankment 1" in text and "embankment 2</span>" in text
    assert not (folder / "embankment.png").exists()


def test_a_block_is_compared_with_each_embankment(site):
    ground = load_scenario(site).make_cross_section()

    def told(diameter_m: float) -> list[str]:
        return [
            doubt.text for doubt in earthwork_doubts(make_block("it", "circle", 1e3, diameter_m=diameter_m), ground)
        ]

    assert told(0.5) == []
    assert told(0.7) == ["block it of 0.7 m is higher than the embankment 2 of 0.6 m"]
    assert [text.split("higher than ")[1] for text in told(1.0)] == [
        "the embankment 1 of 0.8 m",
        "the embankment 2 of 0.6 m",
    ]


def test_an_error_of_the_survey_turns_each_facing(site):
    ground = load_scenario(site).make_cross_section()
    built = as_built(ground, 0.1, 0.0, 0.6)
    for bank in ground.embankments:
        run_m, height_m = built.points_m[bank.crest] - built.points_m[bank.left]
        assert np.arctan2(height_m, run_m) == pytest.approx(np.deg2rad(60.0) + 0.1)
