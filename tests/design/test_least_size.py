"""The least size is where the bound crosses the target, and the command answers with it."""

import json
import re
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from scipy import stats

from rock2d.cluster import Workers
from rock2d.design import command
from rock2d.design.command import answer_text, run_design
from rock2d.design.least_size import Answer, Judgement, Search, Target, judge, least_size
from rock2d.design.possible_sites import SiteResults
from rock2d.errors import InputError
from rock2d.files.experiment import TRAJECTORY_COLUMNS, Experiment, write_experiment
from rock2d.files.scenario_reading import load_scenario
from tests.diagnosed_files import content, undiagnosed
from tests.programs import cluster
from tests.scenarios_of_tests import UNKNOWN, scenario_file, small_site

PLACE = "embankment.height_m"
TARGET = Target("crest", 0.1, 0.95)


def search(scenario) -> Search:
    return Search(scenario, PLACE, (1.0, 5.0), TARGET, "batch", 1)


def bound_at(needed: float):
    """A judge for whom sizes from `needed` on meet the target; notes what it was asked."""
    asked: list[float] = []

    def judged(size: float) -> Judgement:
        asked.append(size)
        high = 0.1 * needed / size
        return Judgement(size, {"ball": high / 2}, {"ball": 0.0}, {"ball": high}, high <= 0.1)

    return judged, asked


def test_bisection_finds_the_least_size_with_few_questions(tmp_path):
    judged, asked = bound_at(3.3)
    answer = least_size(search(small_site(tmp_path)), judged, 0.05)
    assert answer.least is not None and 3.3 <= answer.least <= 3.35 and answer.monotone
    assert len(asked) == 2 + 7  # 4 m halved seven times are less than 0.05 m
    assert [j.size for j in answer.judgements] == sorted(asked)
    assert answer.least_text == f"{answer.least:.4g} (to within 0.05)"


def test_a_range_without_an_answer_and_one_that_is_met_everywhere(tmp_path):
    scenario = small_site(tmp_path)
    unmet = least_size(search(scenario), bound_at(6.0)[0])
    assert unmet.least is None and unmet.least_text == "none up to 5"
    judged, asked = bound_at(0.5)
    met = least_size(search(scenario), judged)
    assert met.least == 1.0 and len(asked) == 2
    assert met.least_text == "at most 1 (the range begins there)"
    assert "least embankment.height_m: at most 1 (the range begins there)" in answer_text(met, search(scenario))


def test_the_bound_holds_with_the_stated_confidence():
    """One site whose frequency is the target: at most 5 % of such films are judged to meet it, and nearly so many."""
    films, releases = stats.binom(300, 0.1), np.arange(300)
    meets = 0.0
    for count in range(51):  # more than 50 pass in one film of 10 000
        passed = (releases < count).reshape(1, 1, 1, 300)
        results = SiteResults(("ball",), ("crest",), passed, passed & False, passed, {})
        meets += films.pmf(count) * judge(results, 1.0, TARGET).meets
    assert 0.025 < meets < 0.05


def test_a_share_of_the_arriving_blocks_and_a_limit_of_energy():
    """300 releases: 100 arrive, 20 pass, 5 with more than 50 kJ. One site: the bound is that of Jeffreys' posterior."""
    arrived, passed, energy_J = np.arange(300) < 100, np.arange(300) < 20, np.full(300, np.nan)
    energy_J[:20] = np.where(np.arange(20) < 5, 60e3, 40e3)
    shaped = [own.reshape(1, 1, 1, 300) for own in (passed, passed & False, arrived)]
    crossings = {"kinetic_J": energy_J.reshape(1, 1, 1, 300)}
    results = SiteResults(("ball",), ("crest",), *shaped, crossings)
    for aim, hits, of in (
        (Target("crest", 0.1, 0.95), 20, 300),
        (Target("crest", 0.1, 0.95, "arriving"), 20, 100),
        (Target("crest", 0.1, 0.95, "arriving", above_J=50e3), 5, 100),
    ):
        judged = judge(results, 1.0, aim)
        assert judged.median["ball"] == hits / of
        assert judged.high["ball"] == pytest.approx(stats.beta(hits + 0.5, of - hits + 0.5).ppf(0.95), rel=0.1)
    # 30 more that sink before the line may arrive and pass
    buried = (np.arange(300) >= 270).reshape(1, 1, 1, 300)
    judged = judge(replace(results, unresolved=buried), 1.0, Target("crest", 0.1, 0.95, "arriving"))
    assert judged.median["ball"] == 20 / 100
    assert judged.low["ball"] == pytest.approx(stats.beta(20.5, 110.5).ppf(0.05), rel=0.1)
    assert judged.high["ball"] == pytest.approx(stats.beta(50.5, 80.5).ppf(0.95), rel=0.1)
    none = SiteResults(("ball",), ("crest",), *(own & False for own in shaped), crossings)
    assert not judge(none, 1.0, Target("crest", 0.1, 0.95, "arriving")).meets
    assert judge(none, 1.0, Target("crest", 0.1, 0.95)).meets


@pytest.mark.parametrize(
    ("place", "bounds", "target", "said"),
    [
        (PLACE, (5.0, 1.0), TARGET, "must rise"),
        (PLACE, (1.0, 5.0), Target("crust", 0.1, 0.95), "no measure line crust; there are: .*crest"),
        (PLACE, (1.0, 5.0), Target("crest", 1.0, 0.95), "between 0 and 100"),
        (
            "model.deterministic.default.k_ul_N_m",
            (1e7, 5e7),
            TARGET,
            "is varied by the search and is also under uncertainty",
        ),
        ("embankment.hight_m", (1.0, 5.0), TARGET, "no number at embankment.hight_m"),
    ],
)
def test_questions_that_make_no_sense_are_refused(tmp_path, place, bounds, target, said):
    scenario = small_site(tmp_path)
    with pytest.raises(InputError, match=said):
        asked = Search(scenario, place, bounds, target, "batch", 1)
        least_size(asked, asked.judge)


def test_releases_that_restart_a_film_are_refused(tmp_path):
    """They are as many as were filmed, not as many as the search asks for."""
    site = small_site(tmp_path)
    rows = [(0, "ball", 0.1 * i, 1.0 + i, 22.0 - i, 0.0) for i in range(4)]
    frames = pd.DataFrame(rows, columns=list(TRAJECTORY_COLUMNS))
    film = Experiment("film", 9.81, 10.0, 0.01, 0.01, site.make_cross_section(), site.make_blocks(), frames)
    write_experiment(tmp_path / "film", film)
    path = scenario_file(tmp_path, "again", releases=1, incident="from_experiment: {folder: film}")
    asked = search(load_scenario(path, tmp_path))
    with pytest.raises(InputError, match=r"incident\.default: a search draws its releases"):
        least_size(asked, asked.judge)


def test_a_size_that_cannot_be_built_leaves_nothing_behind(tmp_path):
    small_site(tmp_path)
    with pytest.raises(InputError, match=r"embankment\.height_m = 80"):
        run_design(tmp_path / "small.yaml", PLACE, (1.0, 80.0), TARGET, tmp_path / "out", progress=False)
    assert [path.name for path in tmp_path.iterdir()] == ["small.yaml"]


def test_the_command_answers_with_a_scenario_that_meets_the_target(tmp_path):
    small_site(tmp_path)
    lines: list[str] = []
    question = (tmp_path / "small.yaml", PLACE, (0.5, 8.0), TARGET, tmp_path / "design")
    answer = run_design(*question, progress=False, report=lines.append)
    assert answer.least is not None and 0.5 < answer.least < 8.0
    medians = [judged.median["ball"] for judged in answer.judgements]
    assert medians[0] > 0.2 > medians[-1]  # a higher embankment lets fewer pass
    least = load_scenario(tmp_path / "design" / "least.yaml")
    assert least.embankment is not None and least.embankment.height_m == answer.least
    facts = json.loads((tmp_path / "design" / "design.json").read_text())
    assert facts["least"] == answer.least and facts["sites"] == 8
    assert (
        lines[0].startswith(f"least {PLACE}: ")
        and "8 possible sites (twice uncertainty.sites), 40 releases" in lines[0]
    )
    assert {path.name for path in (tmp_path / "design").iterdir()} >= {"design.csv", "design.png"}
    check_slider((tmp_path / "design" / "report.html").read_text(encoding="utf-8"), answer)
    assert not list(tmp_path.glob(".*"))
    with pytest.raises(InputError, match="earlier run"):
        run_design(*question, progress=False)


@pytest.mark.parametrize("given", [".", "calib", "calib/", "calib/diagnosis.json"])
def test_the_answer_keeps_the_diagnosis_and_the_posterior_of_its_scenario(tmp_path, monkeypatch, given):
    monkeypatch.setattr(command, "_write_page", lambda *of: [])
    (tmp_path / "calib").mkdir()
    for folder in (tmp_path, tmp_path / "calib"):
        (folder / "diagnosis.json").write_text(json.dumps(content()))
    rows = "".join(f"{mass}\n" for mass in range(570, 590))
    (tmp_path / "calib" / "posterior.csv").write_text(f"blocks.box.mass_kg\n{rows}")
    unknown = "uncertainty: {sites: 4, releases: 20, posterior: calib/posterior.csv}"
    scenario = undiagnosed(tmp_path, f"{{diagnosis: {given}}}", more=unknown)
    question = (scenario.document.file, PLACE, (4.0, 6.0), Target("crest", 0.99, 0.5), tmp_path / "out")
    run_design(*question, tolerance=3.0, progress=False, report=lambda line: None)
    least = load_scenario(tmp_path / "out" / "least.yaml")
    assert least.diagnosed.fingerprint == scenario.diagnosed.fingerprint
    assert (least.posterior.draws == scenario.posterior.draws).all()


def check_slider(page: str, answer) -> None:
    """A slider of the page goes over all sizes that were judged, each with its own ground and releases."""
    live = json.loads(re.search(r'id="live-data">(.*?)</script>', page, re.DOTALL)[1])
    sizes = [float(run["name"]) for run in live["runs"]]
    assert sizes == pytest.approx([judged.size for judged in answer.judgements], rel=1e-3)
    assert f'max="{len(sizes) - 1}"' in re.search(r'<input type="range" id="live-view"[^>]*>', page)[0]
    assert answer.judgements[live["shown"]].size == answer.least
    tops = [max(y for x, y in run["ground"] if 20.0 < x < 40.0) for run in live["runs"]]
    assert np.diff(tops) == pytest.approx(np.diff(sizes), abs=0.02)
    for run, judged in zip(live["runs"], answer.judgements, strict=True):
        assert ("not met" in run["note"]) is (not judged.meets) and run["paths"]["release"]


@pytest.mark.parametrize(("engine", "processes"), [("batch", 2), ("point_mass", 1)])
def test_workers_and_those_of_a_scheduler_write_the_same_bytes(tmp_path, monkeypatch, engine, processes):
    """Processes, which hold the shared descents of `batch` between the sizes; not the page, which this process draws
    from the answer."""
    monkeypatch.setattr(command, "_write_page", lambda *of: [])
    small_site(tmp_path, engine=engine)

    def written(name, **workers):
        out, options = tmp_path / name, {"tolerance": 1.0, "progress": False, "report": lambda line: None}
        run_design(tmp_path / "small.yaml", PLACE, (0.5, 8.0), TARGET, out, **workers, **options)
        return {path.name: path.read_bytes() for path in out.iterdir()}

    here = written("threads")
    assert here.keys() == {"design.csv", "design.json", "least.yaml", "rock2d_result.json"}
    assert written("processes", workers=Workers(processes)) == here
    with cluster(2) as dask:
        assert written("scheduler", workers=Workers(scheduler=dask.scheduler_address)) == here
        answer = json.loads(here["design.json"])
        sizes, sites = len(answer["judgements"]), answer["sites"]
        assert sum(own.state.executed_count for own in dask.workers.values()) == sizes * sites


def test_a_search_whose_scheduler_does_not_answer_is_refused(tmp_path, monkeypatch):
    monkeypatch.setattr("rock2d.cluster.CONNECT_S", 1)
    small_site(tmp_path)
    gone = Workers(scheduler="tcp://localhost:1")
    with pytest.raises(InputError, match="no Dask scheduler answers"):
        run_design(tmp_path / "small.yaml", PLACE, (0.5, 8.0), TARGET, tmp_path / "out", progress=False, workers=gone)


def test_an_interrupted_search_goes_on_to_the_same_answer(tmp_path, monkeypatch):
    monkeypatch.setattr(command, "_write_page", lambda *of: [])
    small_site(tmp_path, UNKNOWN.replace("releases: 40", "releases: 20"))
    question = (tmp_path / "small.yaml", PLACE, (0.5, 8.0), TARGET)
    whole = run_design(*question, tmp_path / "whole", tolerance=1.0, progress=False, report=lambda line: None)
    asked: list[float] = []

    judge_one = Search.judge

    def counted(self, size, *others):
        if len(asked) == 2:
            raise KeyboardInterrupt
        asked.append(size)
        return judge_one(self, size)

    monkeypatch.setattr(Search, "judge", counted)
    with pytest.raises(KeyboardInterrupt, match="2 sizes are judged"):
        run_design(*question, tmp_path / "cut", tolerance=1.0, progress=False)
    before = list(asked)
    monkeypatch.setattr(Search, "judge", lambda *given: asked.append(given[1]) or judge_one(*given))
    again = run_design(*question, tmp_path / "cut", tolerance=1.0, progress=False, report=lambda line: None)
    assert again == whole
    assert not set(before) & set(asked[2:])


def test_an_answer_that_sampling_decides_says_so(tmp_path):
    scenario = small_site(tmp_path)

    def text(bound: float, unresolved: float = 0.0) -> str:
        passes = Judgement(4.0, {"ball": 0.0}, {"ball": 0.0}, {"ball": bound}, True, {"ball": unresolved})
        fails = Judgement(1.0, {"ball": 0.4}, {"ball": 0.3}, {"ball": 0.5}, False)
        return answer_text(Answer(PLACE, TARGET, 4.0, 0.1, (fails, passes)), search(scenario))

    assert "more releases" in text(0.08)
    assert "more releases" not in text(0.01)
    assert "3 % of the releases of ball were cut short or buried" in text(0.01, 0.03)
    assert "buried" not in text(0.01)
