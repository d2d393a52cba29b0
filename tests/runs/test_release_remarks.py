"""No share without what it rests on: releases that were cut short could have passed or not."""

import pandas as pd
import pytest

from rock2d.commands.run import RunRequest, run_scenarios
from rock2d.errors import InputError
from rock2d.files.scenario_reading import load_scenario
from rock2d.runs.campaigns.campaign import CampaignOptions, Workers, run_campaign
from rock2d.runs.release_remarks import unresolved_remarks
from rock2d.runs.run import run
from tests.programs import refusal
from tests.scenarios_of_tests import scenario_file

# 80 m of slope, three blocks, an embankment of 4 m with a vertical facing
SITE = {
    "ground": """
  points_m: [[0, 44], [66, 0], [80, 0], [80, 4], [83, 4], [88, 0], [120, 0]]
  zones: [slope, ditch, facing, crest, back, run_out]
  measure_lines: {crest: [[80, 4], [80, 30]]}""",
    "blocks": """
blocks:
  ball: {shape: circle, diameter_m: 1.0, mass_kg: 1414, inertia: solid_sphere}
  cube: {shape: square, side_m: 1.0, mass_kg: 2700}
  slab: {shape: rectangle, length_m: 2.0, height_m: 1.0, mass_kg: 5400}""",
    "model": """
  deterministic:
    default: {k_l_N_m: 1.0e7, k_ul_N_m: 9.0e7, k_t_N_m: 2.5e6, friction_angle_deg: 30, k_r_Nm_rad: 4.0e4,
              rolling_cap: true}
  probabilistic:
    default: {default: {friction_angle_deg: 10, momentum_half_kg_m_s: 1.0e4, tangential_restitution: 0.85}}""",
    "incident": "distribution: {x_m: {uniform: {low: 1.0, high: 3.0}}, y_m: {uniform: {low: 46.0, high: 48.0}}, "
    "theta_rad: {uniform: {low: -3.1, high: 3.1}}, vx_m_s: 1.0, vy_m_s: 0.0}",
}  # fmt: skip


@pytest.fixture
def site(tmp_path):
    return lambda more="", releases=60: scenario_file(
        tmp_path, "site", releases=releases, seed=1, more=f"{more}\n", **SITE
    )


def simulated(path, out, lines, **options):
    request = RunRequest(out, workers=Workers(1), progress=False, report=lines.append, **options)
    return run_scenarios([path], request)


@pytest.mark.parametrize("engine", ["batch", "point_mass"])
def test_releases_that_ran_out_of_time_are_said_and_widen_the_interval(site, engine):
    cut = run(load_scenario(site("time_limit_s: 2")), engine=engine)
    tables = {name: cut.to_pandas(name) for name in ("passing", "stops")}
    passing = tables["passing"]
    assert (passing["unresolved"] > 30).all() and (passing["high95"] > 0.5).all()
    remarks = unresolved_remarks(tables, 2.0)
    assert len(remarks) == 3 and all("ran out of time (time_limit_s is 2)" in r for r in remarks)
    whole = run(load_scenario(site()), engine=engine)
    tables = {name: whole.to_pandas(name) for name in ("passing", "stops")}
    assert not tables["passing"]["unresolved"].any() and not unresolved_remarks(tables, 50.0)
    inside = tables["passing"]["frequency"].between(passing["low95"], passing["high95"])
    assert inside.all()


def test_the_command_says_whether_a_run_is_resolved(site, tmp_path):
    lines: list[str] = []
    assert not simulated(site("time_limit_s: 4", 10), tmp_path / "cut", lines)
    assert sum("NOT RESOLVED" in line for line in lines) == 3
    assert simulated(site(releases=10), tmp_path / "whole", lines := [])
    assert not any("NOT RESOLVED" in line for line in lines)


def test_blocks_that_sank_are_told_with_the_zones_that_are_too_soft():
    ends = pd.DataFrame({"block": "ball", "stop": ["buried", "buried", "rest"], "zone": ["face", "ditch", "foot"]})
    (said,) = unresolved_remarks({"stops": ends}, 1.0)
    assert "of 3 releases of ball 2 sank into the ground of ditch, face (too soft" in said
    counts = ends.assign(releases=[3, 4, 5])  # as a campaign counts them
    (same,) = unresolved_remarks({"stops": counts}, 1.0)
    assert "of 12 releases of ball 7 sank into the ground of ditch, face" in same


def test_results_are_replaced_only_when_asked_to(site, tmp_path):
    path, out = site(releases=2), tmp_path / "out"
    simulated(path, out, [])
    before = (out / "site_batch" / "run.json").stat().st_mtime_ns
    said = "earlier run; --overwrite replaces"
    assert refusal(simulated, path, out, [], said=said).code == "results_exist"
    assert (out / "site_batch" / "run.json").stat().st_mtime_ns == before
    simulated(path, out, [], overwrite=True)
    assert (out / "site_batch" / "run.json").stat().st_mtime_ns > before


def test_no_result_of_a_command_replaces_another(site, tmp_path):
    path, out = site(releases=2), tmp_path / "out"
    (tmp_path / "higher").mkdir()
    other = tmp_path / "higher" / path.name
    other.write_text(path.read_text())
    request = RunRequest(out, workers=Workers(1), progress=False, draw=False, overwrite=True)
    assert refusal(run_scenarios, [path, other], request, said=r"name: another scenario").file == other
    assert not out.exists()
    simulated(path, out, [], engines=("batch", "batch"), draw=False)


@pytest.mark.parametrize("keep", [(), ("crossings",)])
@pytest.mark.parametrize("engine", ["batch", "point_mass"])
def test_a_campaign_counts_what_was_cut_short_as_a_run_does(site, tmp_path, engine, keep):
    """Where only crossings are kept, a release that has not the energy for another line is resolved."""
    scenario = load_scenario(site("time_limit_s: 7", 40))
    options = CampaignOptions(engine=engine, keep=keep, chunk_releases=15)
    tables = run_campaign(scenario, tmp_path / "c", options, Workers(), progress=False, report=lambda line: None)
    same = run(scenario, engine=engine).to_pandas("passing")
    assert same["unresolved"].any()
    if keep and engine == "batch":
        assert (tables["passing"]["unresolved"] <= same["unresolved"]).all()
        assert tables["passing"]["passed"].tolist() == same["passed"].tolist()
    else:
        unknown = ["left_source"] if keep else []  # without ends nobody knows how far blocks went
        pd.testing.assert_frame_equal(tables["passing"].drop(columns=unknown), same.drop(columns=unknown))
    assert unresolved_remarks(tables, 7.0)


def test_without_gravity_the_time_limit_must_be_given(site, tmp_path):
    path = site("gravity_m_s2: 0")
    with pytest.raises(InputError, match="missing key 'time_limit_s'"):
        load_scenario(path)
    path.write_text(path.read_text() + "time_limit_s: 2.0\n")
    assert load_scenario(path).longest_release_s() == 2.0
