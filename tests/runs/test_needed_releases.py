"""`--precision`: as many releases as the intervals need, and not many more."""

from dataclasses import replace

import pytest

from rock2d.cluster import Workers
from rock2d.commands.run import RunRequest, run_scenarios
from rock2d.files.scenario_reading import load_scenario
from rock2d.runs.campaigns import campaign
from rock2d.runs.needed_releases import releases_for_precision
from rock2d.runs.run import run
from tests.programs import refusal
from tests.scenarios_of_tests import SLOPE, scenario_file, small_site


@pytest.mark.parametrize("engine", ["batch", "point_mass"])
def test_every_interval_is_narrow_enough_and_the_releases_are_not_wasted(tmp_path, engine):
    scenario, half_width = small_site(tmp_path), 0.05
    releases = releases_for_precision(scenario, engine, 4, half_width, 20)
    passing = run(scenario, engine=engine, seed=4, releases=releases).to_pandas("passing")
    widest = (0.5 * (passing["high95"] - passing["low95"])).max()
    assert 0.8 * half_width < widest <= half_width
    assert releases <= 1.1 * (0.98 / half_width) ** 2  # the most that a share of one half needs


def test_what_is_precise_already_needs_no_more(tmp_path):
    assert releases_for_precision(small_site(tmp_path), "batch", 4, 0.5, 20) == 20


def test_without_a_measure_line_nothing_can_be_precise(tmp_path):
    scenario = load_scenario(scenario_file(tmp_path, "bare", ground=SLOPE))
    refusal(releases_for_precision, scenario, "batch", 1, 0.1, 20, said="needs measure_lines")


def test_a_run_that_precision_makes_a_campaign_replaces_a_run_and_is_continued(tmp_path, monkeypatch):
    monkeypatch.setattr(campaign, "MOST_RELEASES_IN_MEMORY", 30)
    small_site(tmp_path, unknown="")
    lines: list[str] = []
    given = {"workers": Workers(1), "draw": False, "progress": False, "report": lines.append}
    plain = RunRequest(tmp_path / "out", **given)
    run_scenarios([tmp_path / "small.yaml"], plain)
    precise = replace(plain, precision=0.1, overwrite=True)
    run_scenarios([tmp_path / "small.yaml"], precise)
    folder = tmp_path / "out" / "small_batch"
    assert (folder / "campaign.json").is_file() and not (folder / "run.json").exists()
    assert "1 of 1 chunks are done already" not in lines
    run_scenarios([tmp_path / "small.yaml"], replace(precise, overwrite=False))
    assert "1 of 1 chunks are done already" in lines
    refusal(run_scenarios, [tmp_path / "small.yaml"], replace(precise, video=True), said="--video is not for campaigns")
