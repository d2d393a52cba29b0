"""What `rock2d run` adds where a scenario says what is not known."""

import pandas as pd
import pytest

from rock2d.commands.run import RunRequest, run_scenarios
from rock2d.design.assessment import assess
from rock2d.runs.campaigns import campaign
from rock2d.runs.campaigns.campaign import CampaignOptions
from tests.scenarios_of_tests import UNKNOWN, small_site

FILES = {"uncertainty.csv", "sensitivity.csv", "sites.csv", "tornado.png"}


@pytest.mark.parametrize("releases", [5, 51])  # a run and a campaign
def test_a_run_with_uncertainty_writes_its_tables_and_figure(tmp_path, releases, capsys, monkeypatch):
    monkeypatch.setattr(campaign, "MOST_RELEASES_IN_MEMORY", 50)
    small_site(tmp_path)
    options = CampaignOptions(releases=releases)
    request = RunRequest(tmp_path / "out", options, progress=False, report=lambda line: None)
    run_scenarios([tmp_path / "small.yaml"], request)
    folder = tmp_path / "out" / "small_batch"
    assert (folder / "campaign.json").is_file() == (releases > 50)
    assert {path.name for path in folder.iterdir()} >= FILES
    table = pd.read_csv(folder / "uncertainty.csv").set_index(["line", "quantity"])
    assert set(table.index.get_level_values("line")) == {"arrival", "facing_1_3", "facing_2_3", "crest"}
    row = table.loc[("facing_1_3", "frequency")]
    assert row["low95"] < row["value"] < row["high95"]
    assert row["share_not_known"] + row["share_sampling"] == pytest.approx(1.0)
    assert "over 4 possible sites" in capsys.readouterr().out


def test_a_campaign_that_is_continued_without_uncertainty_keeps_no_tables_of_it(tmp_path, monkeypatch):
    monkeypatch.setattr(campaign, "MOST_RELEASES_IN_MEMORY", 50)
    folder, said, options = tmp_path / "small_batch", list[str](), CampaignOptions(releases=51)
    stale = {"uncertainty.csv", "sensitivity.csv", "sites.csv", "design_values.csv", "report.html"}
    for unknown, page in ((UNKNOWN, "rock2d run small.yaml --report"), ("", None)):
        small_site(tmp_path, unknown)
        request = RunRequest(tmp_path, options, page_command=page, draw=False, progress=False, report=said.append)
        run_scenarios([tmp_path / "small.yaml"], request)
        assert {path.name for path in folder.iterdir()} & stale == (stale if unknown else set())
    assert "1 of 1 chunks are done already" in said


def test_an_assessment_depends_on_its_seed_alone(tmp_path):
    scenario = small_site(tmp_path)
    one, again, other = (assess(scenario, "batch", seed) for seed in (1, 1, 2))
    assert one.uncertain.equals(again.uncertain) and one.sensitivity.equals(again.sensitivity)
    assert not one.uncertain.equals(other.uncertain)


def test_a_drawn_value_that_makes_no_sense_is_refused_with_all_values(tmp_path):
    from rock2d.errors import InputError

    unknown = UNKNOWN.replace("{low: 0.7, high: 1.3}", "{low: 0.01, high: 1.3}")
    with pytest.raises(InputError, match=r"cannot be softer.*with .*k_ul_N_m = "):
        assess(small_site(tmp_path, unknown), "batch", 1)
