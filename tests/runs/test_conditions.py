"""What varies from release to release: the draws follow their distributions, act, and do not depend on each other."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import shapely
from scipy import stats

import rock2d
from rock2d.errors import InputError
from rock2d.files.scenario import Scenario
from rock2d.files.scenario_reading import load_scenario
from rock2d.laws.contact import K_UL
from rock2d.runs.campaigns.campaign import CampaignOptions, run_campaign
from rock2d.runs.conditions import Conditions, starts
from tests.programs import refusal
from tests.scenarios_of_tests import ONE_BALL, SLOPE, scenario_file

GROUND = SLOPE + "  measure_lines: {foot: [[21, 0], [21, 9]]}"
BOX = "blocks: {box: {shape: rectangle, length_m: 1.0, height_m: 0.6, mass_kg: 900, inertia: uniform}}"
FALL = "fixed: {x_m: 3.0, y_m: 19.0, vx_m_s: 2.0, vy_m_s: 0.0}"
POPULATION = """
populations:
  boulders:
    size_m: {lognormal: {median: 0.5, cv: 0.4}}
    density_kg_m3: {uniform: {low: 2500, high: 2700}}
    families: [{shape: rectangle, aspect: {uniform: {low: 1, high: 2}}, weight: 3}, {shape: circle}]
"""
STIFFNESS = "scatter: {model.deterministic.default.k_ul_N_m: {times: {lognormal: {median: 1, cv: 0.3}}}}\n"
MASS = "scatter: {blocks.ball.mass_kg: {normal: {mean: 300, sd: 20}}}\n"
ROUGH = "roughness: {slope: {sd_deg: 8, length_m: 0.5}}\n"


def site(
    folder: Path, *parts: str, blocks: str = ONE_BALL, incident: str = FALL, engine: str = "batch", releases: int = 30
) -> Scenario:  # fmt: skip
    options = {"engine": engine, "releases": releases, "ground": GROUND, "incident": incident}
    path = scenario_file(folder, "scattered", blocks=blocks, more="".join(parts), **options)
    return load_scenario(path)


@pytest.mark.parametrize("engine", ["batch", "point_mass"])
def test_a_campaign_meets_the_conditions_of_a_run(tmp_path, engine):
    scenario = site(tmp_path, POPULATION, STIFFNESS if engine == "batch" else "", ROUGH, engine=engine, releases=12)
    run_campaign(scenario, tmp_path / "campaign", CampaignOptions(chunk_releases=5), progress=False, report=str)
    chunks = sorted((tmp_path / "campaign" / "chunks" / "crossings").glob("*.parquet"))
    other = pd.concat([pd.read_parquet(path) for path in chunks]).set_index("release")["t_s"]
    own = rock2d.run(scenario).to_pandas("crossings").set_index("release")["t_s"]
    assert len(own) > 12
    assert other.sort_index().to_numpy() == pytest.approx(own.sort_index().to_numpy(), rel=1e-12)


def test_draws_of_a_release_do_not_depend_on_how_many_there_are(tmp_path):
    drawn = "distribution: {x_m: 3, y_m: {uniform: {low: 18, high: 19}}, vx_m_s: 2, vy_m_s: 0}"
    scenario = site(tmp_path, POPULATION, STIFFNESS, ROUGH, blocks="", incident=drawn)
    few, many = (starts(Conditions(scenario, "batch", 3), n) for n in (3, 20))
    for (one, met), (other, met_too) in zip(few, many, strict=False):
        assert np.array_equal(one.state, other.state)
        assert met.drawn == met_too.drawn
        assert np.array_equal(met.cross_section.points_m, met_too.cross_section.points_m)
    (other_seed,) = starts(Conditions(scenario, "batch", 4), 1)
    assert not np.array_equal(few[0][0].state, other_seed[0].state)
    assert many[0][1].drawn != many[1][1].drawn
    assert not np.array_equal(many[0][1].cross_section.points_m, many[1][1].cross_section.points_m)


def test_drawn_stiffness_follows_its_distribution(tmp_path):
    conditions = Conditions(site(tmp_path, STIFFNESS), "batch", 3)
    k_ul = np.array([met.parameters[0, K_UL] for met in conditions.of_releases(0, 0, 3000)])
    sigma = np.sqrt(np.log1p(0.3**2))
    assert stats.kstest(np.log(k_ul / 2.4e7) / sigma, "norm").pvalue > 0.01


def test_a_crossing_has_the_energy_of_the_drawn_mass(tmp_path):
    run = rock2d.run(site(tmp_path, MASS))
    rows = run.to_pandas("crossings")
    mass = np.array([run.drawn[release]["blocks.ball.mass_kg"] for release in rows["release"]])
    assert len(rows) == 30
    assert np.std(mass) == pytest.approx(20, rel=0.5)
    assert rows["translational_J"].to_numpy() == pytest.approx(0.5 * mass * rows["speed_m_s"].to_numpy() ** 2)
    inertia = 0.4 * mass * 0.3**2
    assert rows["rotational_J"].to_numpy() == pytest.approx(0.5 * inertia * rows["omega_rad_s"].to_numpy() ** 2)


def test_blocks_of_a_population_have_the_volume_of_a_ball_and_the_shares_of_their_families(tmp_path):
    blocks = [
        met.block for met in Conditions(site(tmp_path, POPULATION, blocks=""), "batch", 3).of_releases(0, 0, 2000)
    ]
    size = np.array([block.size_m for block in blocks])
    density = np.array([block.mass_kg for block in blocks]) / (np.pi / 6 * size**3)
    assert np.median(size) == pytest.approx(0.5, rel=0.04)
    assert np.std(size) / np.mean(size) == pytest.approx(0.4, rel=0.12)
    assert density.min() >= 2500 and density.max() <= 2700
    round_ones = [block for block in blocks if block.shape == "circle"]
    assert len(round_ones) / len(blocks) == pytest.approx(0.25, abs=0.04)
    aspects = [np.ptp(block.corners_m[:, 0]) / np.ptp(block.corners_m[:, 1]) for block in blocks if not block.smooth]
    assert 1 <= min(aspects) < 1.05 and 1.95 < max(aspects) <= 2


def test_a_run_of_a_population_is_an_experiment_of_its_own_blocks(tmp_path):
    run = rock2d.run(site(tmp_path, POPULATION, blocks="", releases=3))
    run.write(tmp_path / "out")
    found = rock2d.load_experiment(tmp_path / "out")
    assert set(found.blocks) == {"boulders_0", "boulders_1", "boulders_2"}
    for release, block in run.own_blocks.items():
        assert found.blocks[f"boulders_{release}"].mass_kg == pytest.approx(block.mass_kg)


@pytest.mark.parametrize("block", [ONE_BALL, BOX])
@pytest.mark.parametrize("rough", ["", ROUGH])
def test_a_block_starts_at_its_clearance_above_the_ground(tmp_path, block, rough):
    scenario = site(
        tmp_path, rough, blocks=block,
        incident="above_ground: {x_m: {uniform: {low: 2, high: 30}}, clearance_m: 0.25, "
        "theta_rad: {uniform: {low: -3, high: 3}}, vx_m_s: 0, vy_m_s: 0}",
    )  # fmt: skip
    for start, met in starts(Conditions(scenario, "batch", 3), 30):
        c, s = np.cos(start.state[2]), np.sin(start.state[2])
        outline = met.block.outline(512) @ np.array([[c, s], [-s, c]]) + start.state[:2]
        ground = shapely.LineString(met.cross_section.points_m)
        lowered = shapely.Polygon(outline - [0, 0.25])
        assert not shapely.Polygon(outline - [0, 0.249]).intersects(ground)
        assert lowered.distance(ground) < 1e-4
        assert shapely.Polygon(outline - [0, 0.2502]).intersects(ground)


@pytest.mark.parametrize(
    "incident, said",
    [
        ("above_ground: {x_m: 3, clearance_m: {normal: {mean: 0.1, sd: 0.2}}", "the ground: its clearance_m is -"),
        ("above_ground: {x_m: {uniform: {low: 59, high: 62}}, clearance_m: 1", "outside the cross-section"),
        ("distribution: {x_m: 3, y_m: {uniform: {low: 12, high: 19}}", "would start below the ground"),
    ],
)  # fmt: skip
def test_a_start_in_the_ground_or_beside_it_is_refused(tmp_path, incident, said):
    scenario = site(tmp_path, incident=f"{incident}, vx_m_s: 0, vy_m_s: 0}}")
    error = refusal(rock2d.run, scenario, said=said)
    assert error.code == "bad_state" and error.line is not None


def test_releases_along_a_line_spread_over_its_length(tmp_path):
    scenario = site(tmp_path, incident="along: {points_m: [[1, 30], [4, 30], [4, 29]], vx_m_s: 1, vy_m_s: 0}")
    places = Conditions(scenario, "batch", 3).group(0, 0, 2000).states[:, :2]
    share = np.where(places[:, 1] == 30, places[:, 0] - 1, 3 + 30 - places[:, 1]) / 4
    assert stats.kstest(share, "uniform").pvalue > 0.01


def test_slight_roughness_hardly_moves_the_first_rebound(tmp_path):
    rough = rock2d.run(site(tmp_path, "roughness: {slope: {sd_deg: 1e-4, length_m: 0.5}}\n", releases=1))
    smooth = rock2d.run(site(tmp_path, releases=1))
    for name in ("vx_after_m_s", "vy_after_m_s", "omega_after_rad_s"):
        first, other = (run.to_pandas("impacts")[name].iloc[0] for run in (rough, smooth))
        assert first == pytest.approx(other, rel=1e-4, abs=1e-3)


def test_slopes_under_a_place_spread_over_the_releases_as_stated(tmp_path):
    conditions = Conditions(site(tmp_path, "roughness: {slope: {sd_deg: 4, length_m: 0.5}}\n"), "batch", 3)
    slopes = []
    for met in conditions.of_releases(0, 0, 1000):
        points = met.cross_section.points_m
        i = int(np.searchsorted(points[:, 0], 7.3)) - 1
        slopes.append(np.degrees(np.arctan2(*(points[i + 1] - points[i])[::-1])))
    assert stats.kstest((np.array(slopes) + 45) / 4, "norm").pvalue > 0.01


@pytest.mark.parametrize(
    "text, said",
    [
        ("roughness: {slop: {sd_deg: 3, length_m: 1}}\n", "20:13.*did you mean 'slope'"),
        ("roughness: {slope: {sd_deg: 40, length_m: 1}}\n", "sd_deg"),
        ("scatter: {model.deterministic.default.k_x: {times: {uniform: {low: 1, high: 2}}}}\n", "no number"),
        ("scatter: {gravity_m_s2: {normal: {mean: 9.8, sd: 1}}}\n", "only numbers under model and blocks"),
        ("scatter: {model.deterministic.default.k_l_N_m: {time: 3}}\n", "did you mean 'times'"),
        ("populations: {ball: {size_m: 1}}\n", "ball is also under blocks"),
        ("populations: {boulders: {size_m: {normal: {mean: 1, sd: 1}}}}\n", "size_m: expected values between 0"),
        ("populations: {boulders: {size_m: 1, families: [{shape: circle, aspect: 2}]}}\n", "have an aspect"),
    ],
)  # fmt: skip
def test_what_cannot_vary_is_refused_with_its_place(tmp_path, text, said):
    with pytest.raises(InputError, match=said):
        site(tmp_path, text)


def test_a_draw_that_makes_no_sense_names_the_release(tmp_path):
    scenario = site(tmp_path, "scatter: {model.deterministic.default.k_ul_N_m: {times: {uniform: {low: 0.01, "
                    "high: 0.2}}}}\n")  # fmt: skip
    with pytest.raises(InputError, match=r"need 0 < k_l_N_m <= k_ul_N_m.*in release \d+ of block ball with"):
        rock2d.run(scenario)
