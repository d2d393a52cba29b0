"""Wrong units and sites that cannot be do not pass in silence; usual sites get no remark."""

import re
import warnings
from pathlib import Path

import numpy as np
import pytest

import rock2d
from rock2d.design.possible_sites import draw_sites
from rock2d.errors import UnusualWarning
from rock2d.files import scenario_checks
from rock2d.scene.blocks import make_block
from rock2d.scene.cross_section import CrossSection
from rock2d.scene.plausibility import contact_doubts, density_kg_m3, highest_speed_m_s, line_remarks, start_doubts
from tests.programs import commanded, refusal
from tests.scenarios_of_tests import SHIPPED

SLOPE = SHIPPED / "slope_embankment.yaml"
GROUND = CrossSection(
    [[0.0, 50.0], [60.0, 0.0], [66.0, 0.0], [69.0, 4.0], [71.0, 4.0], [75.0, 0.0], [90.0, 0.0]],
    ["slope", "ditch", "face", "crest", "back", "out"],
)
BALL = make_block("ball", "circle", 1400, diameter_m=1.0)
SLAB = make_block("slab", "rectangle", 5400, length_m=2.0, height_m=1.0)


def said(path: Path) -> list[str]:
    """What loading a scenario warns of."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        rock2d.load_scenario(path)
    return [str(each.message) for each in caught if issubclass(each.category, UnusualWarning)]


def changed(folder: Path, old: str, new: str) -> Path:
    text = SLOPE.read_text(encoding="utf-8")
    assert old in text
    path = folder / "site.yaml"
    path.write_text(text.replace(old, new), encoding="utf-8")
    return path


@pytest.mark.parametrize("name", ["slope_embankment", "design_site", "paper_setup", "rough_slope", "flat_floor"])
def test_the_shipped_scenarios_are_plausible(name):
    assert said(SLOPE.with_stem(name)) == []


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("mass_kg: 2700", "mass_kg: 270", "density of 270 kg/m³ .*usual: 1,500 to 4,000"),
        ("mass_kg: 2700", "mass_kg: 2.7e+4", "density of .*e\\+04 kg/m³"),
        ("diameter_m: 1.0, mass_kg: 1414", "diameter_m: 8.0, mass_kg: 724000", "level ground before .*, 7 m wide"),
        ("low: 0.0, high: 4.0", "low: 100.0, high: 104.0", "starts behind the crest"),
        ("forest_edge: [[50.0, 16.0], [50.0, 40.0]]", "forest_edge: [[50.0, 200.0], [50.0, 240.0]]",
         "no block .* reaches measure line forest_edge: it begins 200 m high"),
        ("default: {k_l_N_m: 1.0e7, k_ul_N_m: 9.0e7", "default: {k_l_N_m: 1.0e4, k_ul_N_m: 9.0e7", "m deep into"),
        ("default: {k_l_N_m: 1.0e7, k_ul_N_m: 9.0e7", "default: {k_l_N_m: 1.0e14, k_ul_N_m: 9.0e14", "m deep into"),
        ("vx_m_s: {normal: {mean: 1.5, sd: 0.5}}", "vx_m_s: 150", "starts with up to 150 m/s"),
        ("gravity_m_s2: 9.81", "gravity_m_s2: 98.1", "gravity is 98.1"),
        ("friction_angle_deg: 30", "friction_angle_deg: 0.52", "is 0.52 degrees.*Is it in rad"),
        ("theta_rad: {uniform: {low: -3.14159, high: 3.14159}}", "theta_rad: 45",
         "angles of up to 45 rad; usual: up to a full turn, 6.28 rad. Is theta_rad in degrees"),
        ("omega_rad_s: {normal: {mean: -1.0, sd: 0.5}}", "omega_rad_s: -360",
         "spin of up to 360 rad/s, 180 m/s at its rim.* Is omega_rad_s in degrees per second"),
        ("vx_m_s: {normal: {mean: 1.5, sd: 0.5}}", "vx_m_s: -3", "starts to the left, with -3 m/s"),
        ("low: 66.0, high: 69.0", "low: 260.0, high: 261.0", "m above the highest ground; usual: up to 10 m"),
        ("[92.10, 4.5]", "[89.70, 4.5]", "meets a crest 0.1 m wide"),
        ("diameter_m: 1.0, mass_kg: 1414", "diameter_m: 0.02, mass_kg: 0.0113", "of 0.02 m on a site of 144 m"),
    ],
)  # fmt: skip
def test_what_is_unusual_is_told_with_its_place(tmp_path, old, new, words):
    told = said(changed(tmp_path, old, new))
    assert any(re.search(words, text) for text in told), told
    assert all(re.search(r"site\.yaml:\d+", text) for text in told)


def test_a_number_of_sites_that_is_rounded_is_told(tmp_path):
    text = SLOPE.with_stem("design_site").read_text(encoding="utf-8")
    path = tmp_path / "site.yaml"
    path.write_text(text.replace("sites: 16", "sites: 12"), encoding="utf-8")
    assert re.search(r"site\.yaml:\d+:.* 12 sites count as 16, the next power of two", *said(path))
    scenario = rock2d.load_scenario(path)
    assert len(draw_sites(scenario, 1).independent) == 16


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("mass_kg: 2700", "mass_kg: 2.7", "density of 2.7 kg/m³ .* Is the mass in t instead of kg"),
        ("mass_kg: 2700", "mass_kg: 2.7e-3", "density of .* Is the size in cm instead of m"),
        ("mass_kg: 2700", "mass_kg: 2.7e+6", "density of .* Is the mass in g instead of kg"),
        ("diameter_m: 1.0, mass_kg: 1414", "diameter_m: 800, mass_kg: 7.2e+11", "on a site of 144 m"),
        ("[140.0, -2.0]]", "[140000.0, -2.0]]", "Are its points in mm"),
    ],
)
def test_what_is_impossible_is_refused(tmp_path, old, new, words):
    refused = refusal(rock2d.load_scenario, changed(tmp_path, old, new), said=words)
    assert refused.line and refused.code == "implausible"


def test_a_population_is_named_with_its_place(tmp_path):
    stones = "populations:\n  stones: {size_m: 1.0}\nblocks:\n  ball_1m:"
    text = SLOPE.read_text(encoding="utf-8").replace("blocks:\n  ball_1m:", stones)
    (path := tmp_path / "site.yaml").write_text(text.replace("{size_m: 1.0}", "{size_m: 1.0, density_kg_m3: 2.7}"))
    refused = refusal(rock2d.load_scenario, path, said="populations.stones: .* or the density in t/m³")
    assert refused.line == text[: text.index("  stones")].count("\n") + 1
    path.write_text(text.replace("{size_m: 1.0}", "{size_m: 8.0}"))
    assert any("populations.stones: block stones of 8 m is larger than the level" in each for each in said(path))


def test_a_density_is_that_of_the_sphere_and_of_the_cube():
    ball = make_block("ball", "circle", 2.0, diameter_m=1.0)
    cube = make_block("cube", "square", 2.0, side_m=1.0)
    assert np.allclose(density_kg_m3(ball), 2.0 / (np.pi / 6.0))
    assert np.isclose(density_kg_m3(cube)[1], 2.0)


def test_depth_and_reach_follow_from_energy():
    ball = make_block("ball", "circle", 1400.0, diameter_m=1.0)
    states = np.array([[0.0, 60.0, 0.0, 3.0, -4.0, 0.0]])
    speed = highest_speed_m_s(states, GROUND, 9.81)
    assert np.isclose(0.5 * speed**2, 0.5 * 25.0 + 9.81 * 60.0)
    stiffness = 1400.0 * speed**2 / 10.0**2  # 10 m deep: k d² / 2 = m v² / 2
    (doubt,) = contact_doubts(ball, {"slope": stiffness}, speed)
    assert "10 m deep into slope" in doubt.text
    head = 60.0 + 25.0 / (2 * 9.81)
    for above, doubts in ((-0.1, 0), (0.1, 1)):
        line = {"line": [[50.0, head + above], [50.0, head + 10.0]]}
        ground = CrossSection(GROUND.points_m, GROUND.zones, line)
        assert len(list(start_doubts(ball, states, ground, 9.81, ()))) == doubts


ROUGH = """name: rough
engine: point_mass
cross_section: {points_m: [[0, 40], [30, 20], [80, 0]], zones: [rock, scree]}
blocks: {ball: {shape: circle, diameter_m: 1, mass_kg: 1414, inertia: solid_sphere}}
model: {soils: {default: medium_scree, rock: ROCK}}
incident: {default: {above_ground: {x_m: 2, clearance_m: 0.5, vx_m_s: 1, vy_m_s: 0}}}
roughness: {rock: {sd_deg: 8, length_m: 0.5}}
"""


def test_point_masses_on_rough_ground_without_a_slope_reduction_are_told(tmp_path):
    path, words = tmp_path / "site.yaml", "without a slope reduction in rock: many stop early"
    path.write_text(ROUGH.replace("ROCK", "{like: bedrock, slope_reduction_deg: 0}"))
    (found,) = said(path)
    assert re.search(rf"site.yaml:7:1: roughness: .*{words}", found)
    path.write_text(ROUGH.replace("ROCK", "bedrock"))
    assert said(path) == []
    path.write_text(ROUGH.replace("ROCK", "{like: bedrock, slope_reduction_deg: 0}").replace("point_mass", "batch"))
    assert said(path) == []  # the contact law has no slope reduction
    run = commanded("run", path, "--engine", "point_mass", "--releases", 2, "--quiet", "--out", tmp_path / "out")
    assert re.search(f"warning: point_mass: .*{words}", run.output)


def test_a_slope_reduction_in_rad_is_told(tmp_path):
    path, words = tmp_path / "site.yaml", "slope reduction in rock is 0.1 degrees; usual: 1 to 45. Is it in rad?"
    # the contact law has no slope reduction
    for engine, degrees, doubts in (
        ("point_mass", 0, 0),
        ("point_mass", 0.1, 1),
        ("point_mass", 5, 0),
        ("batch", 0.1, 0),
    ):
        rock = f"{{like: bedrock, slope_reduction_deg: {degrees}}}"
        path.write_text(ROUGH.replace("ROCK", rock).replace("point_mass", engine))
        assert sum(words in each for each in said(path)) == doubts


def test_ground_that_is_stated_rough_and_stays_smooth_is_told(tmp_path):
    path = tmp_path / "site.yaml"
    text = ROUGH.replace("point_mass", "batch").replace("ROCK", "bedrock")
    points = "".join(f"[{x}, {40 - x}], " for x in np.arange(0.0, 30.0, 0.5)) + "[30, 10], [80, 0]"
    fine = text.replace("[0, 40], [30, 20], [80, 0]", points).replace("[rock,", f"[{'rock, ' * 60}")
    for words, said_of in (
        (text, ()),
        (fine, ()),  # facets of 0.71 m are cut into two pieces
        (fine.replace("length_m: 0.5", "length_m: 0.8"), ("100 % of rock stay smooth, in facets shorter than",)),
        (text.replace("length_m: 0.5", "length_m: 500"), ("100 % of rock stay smooth",)),
        (text.replace("sd_deg: 8", "sd_deg: 0.14"), ("vary by 0.14 degrees; usual: 1 to 20. Is sd_deg in rad?",)),
    ):
        path.write_text(words)
        told = [each for each in said(path) if "roughness.rock" in each]
        assert len(told) == len(said_of) and all(of in each for of, each in zip(said_of, told, strict=True))


def test_a_friction_angle_of_point_masses_in_rad_is_told_once_for_all_blocks(tmp_path):
    path = tmp_path / "site.yaml"
    ball = "{shape: circle, diameter_m: 1, mass_kg: 1414, inertia: solid_sphere}"
    two = ROUGH.replace(f"{{ball: {ball}}}", f"{{ball: {ball}, other: {ball}}}")
    path.write_text(two.replace("ROCK", "{like: bedrock, friction_angle_deg: 0.6}"))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        scenario = rock2d.load_scenario(path)
    for engine in ("point_mass", "batch"):
        (doubt,) = scenario_checks.doubts(scenario, engine)
        assert "friction angle in rock is 0.6 degrees; usual: 5 to 60. Is it in rad?" in doubt.text


def site(**lines) -> CrossSection:
    """A site with an embankment of 4 m with vertical faces, and these measure lines."""
    points = [[0, 40], [60, 0], [80, 0], [80, 4], [83, 4], [83, 0], [110, 0]]
    return CrossSection(points, ["slope", "ditch", "facing", "crest", "back", "run_out"], lines)


def test_a_line_close_before_a_vertical_facing_cannot_be_crossed():
    ground = site(close=[[79.9, 0], [79.9, 4]], off=[[79.0, 0], [79.0, 4]])
    (remark,) = line_remarks(ground, [BALL])
    assert "block ball cannot cross measure line close" in remark and "0.5 m" in remark


def test_a_line_that_can_be_crossed_above_the_facing_only_says_how_high():
    """0.3 m before the facing a centroid 0.5 m from the surface is at the crest's height plus √(0.5² - 0.3²) m."""
    (remark,) = line_remarks(site(close=[[79.7, 0], [79.7, 30]]), [SLAB])
    assert "block slab can cross measure line close only 4.4 m or more above its foot" in remark


def test_usual_lines_are_not_remarked():
    """Upright from the ground, up a facing of 60 degrees, from above the ground, and a sloping one."""
    lines = {"ditch": [[70, 0], [70, 20]], "crest": [[80, 4], [80, 20]], "high": [[79.9, 6], [79.9, 20]],
             "slope": [[30, 20], [30, 40]], "across": [[30, 20], [40, 40]]}  # fmt: skip
    assert not line_remarks(site(**lines), [BALL, SLAB])
    points = [[0, 0], [10, 0], [12, 2 * np.sqrt(3)], [14, 2 * np.sqrt(3)]]
    inclined = CrossSection(points, ["ditch", "facing", "crest"], {"low": [[11, np.sqrt(3)], [11, 9]]})
    assert not line_remarks(inclined, [BALL, SLAB])
