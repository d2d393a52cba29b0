"""`rock2d demo`: one page that holds Table 2, the video, the paths and what is assumed."""

import pandas as pd
from rock2d_figures import demo
from rock2d_figures.demo import findings, table_text

from rock2d.files.scenario import scenario_file
from rock2d.files.scenario_reading import load_scenario
from rock2d.reproduction.paper_setup import side_by_side
from tests.programs import commanded


def test_the_page_opens_all_of_it(tmp_path, monkeypatch):
    monkeypatch.setitem(demo.VIDEO, "size_px", (320, 240))  # the film is tested elsewhere
    monkeypatch.setitem(demo.VIDEO, "slow_motion", 1.0)
    done = commanded("demo", "--quiet", "--out", tmp_path)
    assert done.exit_code == 0, done.output
    html = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert 'src="batch/trajectories.webm"' in html and (tmp_path / "batch" / "trajectories.webm").is_file()
    assert html.count("data:image/png") == 3
    scenario = load_scenario(scenario_file("paper_setup.yaml"))
    for sentence in scenario.assumed:
        assert f"assumed: {sentence}" in done.stdout
    assert "98 [89, 100]" in html and "98 [89, 100]" in done.stdout
    table = pd.read_csv(tmp_path / "table_2.csv")
    assert done.stdout.startswith(table_text(table))
    assert (tmp_path / "table_2.png").is_file()
    assert {path.name for path in (tmp_path / "point_mass").iterdir()} >= {"passing.csv", "impacts.csv"}


def test_missed_cells_are_marked_and_explained():
    scenario = load_scenario(scenario_file("paper_setup.yaml"))
    table = side_by_side(scenario, releases=40)
    met = table.assign(deterministic_agrees=True, probabilistic_agrees=True)
    assert len(list(findings(scenario, met))) == 2 and "NO" not in table_text(met)
    missed = met.assign(probabilistic_agrees=met["block"] != "sphere")
    said = list(findings(scenario, missed))
    assert said[1].endswith("met in 6 of 9 cells; not: sphere line 1, sphere line 2, sphere line 3.")
    assert said[2].startswith("Why:") and table_text(missed).count("  NO") == 3
