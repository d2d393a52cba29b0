"""Scenario files: they say what they mean, mistakes get their place, what ships runs as it stands."""

import itertools
import re
import time

import numpy as np
import pytest

from rock2d.errors import InputError, OldKeyWarning
from rock2d.files.scenario_reading import load_scenario
from rock2d.files.scenario_variants import scenario_text, variant
from rock2d.runs.conditions import Conditions, starts
from tests.programs import place_of, refusal
from tests.scenarios_of_tests import SHIPPED, scenario_file

OF_MEASURED_DATA = ("real_squares", "tschamut")
WITHOUT_DATA = sorted(path for path in SHIPPED.glob("*.yaml") if path.stem not in OF_MEASURED_DATA)

SMALL = """\
name: small
gravity_m_s2: 9.81
engine: pymunk
releases: 5
cross_section:
  points_m: [[-1, 0.5], [0, 0], [1, 0]]
  zones: [slope, ditch]
blocks:
  sphere: {shape: circle, diameter_m: 0.025, mass_kg: 0.022, inertia: solid_sphere}
  cube: {shape: square, side_m: 0.019, mass_kg: 0.0233}
model:
  deterministic:
    default: {k_l_N_m: 1.0e4, k_ul_N_m: 6.0e4, k_t_N_m: 2.5e3, friction_angle_deg: 30, k_r_Nm_rad: 0.025}
    ditch: {friction_angle_deg: 20}
  probabilistic:
    default:
      default: {friction_angle_deg: 0, momentum_half_kg_m_s: 0.025, tangential_restitution: 0.85}
      ditch: {friction_angle_deg: 11}
    cube:
      default: {slope_reduction_deg: 6, slope_reduction: uniform}
      ditch: {momentum_half_kg_m_s: 0.04}
incident:
  sphere:
    fixed: {x_m: 0.5, y_m: 0.3, vx_m_s: 1.0, vy_m_s: 0}
  default:
    distribution: {x_m: 0.1, y_m: {normal: {mean: 0.4, sd: 0.01}}, vx_m_s: {uniform: {low: 1, high: 2}}, vy_m_s: 0}
outputs: {fps: 100}
"""
FILMED = """\
name: filmed
model: {deterministic: {default: {k_l_N_m: 1.0e4, k_ul_N_m: 6.0e4, k_t_N_m: 0, friction_angle_deg: 30, k_r_Nm_rad: 0}}}
incident: {default: {from_experiment: {folder: set-up/drops, frames: 4}}}
"""
DROPS = """\
name: drops
gravity_m_s2: 9.7
camera: {fps: 100, position_noise_m: 0, angle_noise_rad: 0}
cross_section: {points_m: [[-1, 0], [1, 0]], zones: [floor]}
blocks: {ball: {shape: circle, diameter_m: 0.1, mass_kg: 1}}
trajectories: t.csv
"""


@pytest.fixture
def write(put):
    return lambda text, name="scenario.yaml": put(text, name)


def refused(path, **options) -> str:
    return str(refusal(load_scenario, path, **options))


def test_parameters_a_zone_does_not_give_come_from_the_defaults(write):
    scenario = load_scenario(write(SMALL))
    blocks = scenario.make_blocks()
    contact = scenario.contact_parameters(blocks["cube"])
    assert (contact["ditch"].friction_angle_deg, contact["ditch"].k_ul_N_m) == (20, 6.0e4)
    assert (contact["default"].friction_angle_deg, contact["default"].rolling_cap) == (30, False)
    sphere, cube = (scenario.rebound_parameters(blocks[name]) for name in ("sphere", "cube"))
    assert sphere["ditch"].friction_angle_deg == cube["ditch"].friction_angle_deg == 11
    assert (sphere["ditch"].momentum_half_kg_m_s, cube["ditch"].momentum_half_kg_m_s) == (0.025, 0.04)
    assert (sphere["ditch"].slope_reduction_deg, cube["ditch"].slope_reduction_deg) == (0, 6)
    assert (sphere["default"].slope_reduction, cube["default"].slope_reduction) == ("constant", "uniform")


def test_incident_states_are_drawn_as_described(write):
    scenario = load_scenario(write(SMALL))
    generator = np.random.default_rng(0)
    assert scenario.incident_of("sphere").draw(generator, 2).tolist() == [[0.5, 0.3, 0, 1, 0, 0]] * 2
    drawn = scenario.incident_of("cube").draw(generator, 4000)
    assert np.ptp(drawn[:, [0, 2, 4, 5]], axis=0).max() == 0
    assert drawn[:, 1].mean() == pytest.approx(0.4, abs=0.001)
    assert drawn[:, 1].std() == pytest.approx(0.01, rel=0.1)
    assert 1 <= drawn[:, 3].min() < 1.01 and 1.99 < drawn[:, 3].max() <= 2


@pytest.mark.parametrize(
    ("old", "new", "at", "words"),
    [
        ("engine: pymunk", "engin: pymunk", "engin", "did you mean 'engine'"),
        ("engine: pymunk", "engine: pymunc", "pymunc", "did you mean 'pymunk'"),
        ("releases: 5", "releases: 5.5", "5.5", "expected a whole number"),
        ("releases: 5", "releases: true", "true", "expected a whole number, found true"),
        ("releases: 5", "releases: 1e3", "1e3", "found 1000; write 1000, without point or exponent"),
        ("gravity_m_s2: 9.81", "gravity_m_s2: 9,81", "9,81", "expected a number, found '9,81'; write 9.81"),
        ("releases: 5", "releases:\t5", "\t5", "; write plain spaces for the tab in line 4"),
        ("name: small", "name: ../small", "../small", "expected a name of letters"),
        ("    ditch: {friction_angle_deg: 20}", "    dich: {}", "dich", "did you mean 'ditch'"),
        ("    cube:\n", "    cub:\n", "cub:", "did you mean 'cube'"),
        ("      ditch: {mom", "      ditsch: {mom", "ditsch", "did you mean 'ditch'"),
        ("  sphere:\n", "  spher:\n", "spher:\n", "did you mean 'sphere'"),
        ("k_ul_N_m: 6.0e4", "k_ul_N_m: 6.0e3", "1.0e4", "k_l_N_m <= k_ul_N_m"),
        ("k_ul_N_m: 6.0e4, ", "", "default: {k_l", "k_ul_N_m is given neither here nor under default"),
        ("    default: {k_l", "    defualt: {k_l", "defualt", "did you mean 'default'"),
        (", tangential_restitution: 0.85", "", "default: {friction_angle_deg: 0", "restitution is given"),
        ("restitution: 0.85", "restitution: 1.85", "1.85", "less than or equal to 1, found 1.85"),
        ("slope_reduction: uniform", "slope_reduction: unifrom", "unifrom", "did you mean 'uniform'"),
        ("x_m: 0.5, ", "", "fixed", "missing key 'x_m'"),
        ("x_m: 0.5", "x_m: 5", "5, y_m", "outside the cross-section"),
        ("y_m: 0.3", "y_m: -0.3", "-0.3", "below the ground"),
        ("{normal: {mean", "{norml: {mean", "{norml", "did you mean 'normal'"),
        ("sd: 0.01", "sd: -0.01", "-0.01", "greater than or equal to 0"),
        ("high: 2", "high: 0.5", "0.5}}", "high must not be below low"),
        ("    fixed:", "    from_experiment: {folder: x}\n    fixed:", "sphere:\n", "exactly one of"),
        ("  default:\n    distribution", "  sphere2:\n    distribution", "sphere2", "did you mean 'sphere'"),
        ("outputs: {fps: 100}", "outputs: {fps: 100, fsp: 3}", "fsp", "unknown key"),
        ("[slope, ditch]", "[slope, default]", "[slope, default]", "must not be called default"),
    ],
)  # fmt: skip
def test_a_mistake_gets_its_place_and_what_was_expected(write, old, new, at, words):
    assert old in SMALL
    damaged = SMALL.replace(old, new, 1)
    file = write(damaged)
    message = refused(file)
    assert words in message and message.startswith(f"{file}:{place_of(at, damaged)}: "), message


def test_long_and_unprintable_names_are_shortened_on_one_line(write):
    for old, new in (("engine:", f"{'k' * 1000}:"), ("engine:", '"a\\n\\e[31mb":'), ("  sphere:", f"  {'s' * 1000}:")):
        message = refused(write(SMALL.replace(old, new)))
        assert len(message) < 450 and message.isprintable(), message
    message = refused(write(SMALL.replace("cube", "c" * 1000)))
    assert "at most 100 characters" in message and len(message) < 300


def test_aliases_that_repeat_each_other_are_refused_before_they_are_repeated(write):
    bomb = "a: &a [1, 1, 1, 1, 1, 1, 1, 1, 1, 1]\n"
    for name, below in itertools.pairwise("abcdefgh"):
        bomb += f"{below}: &{below} [{', '.join(10 * [f'*{name}'])}]\n"
    begin = time.perf_counter()
    assert "aliases repeat more than" in refused(write(bomb))
    assert time.perf_counter() - begin < 1.0
    once = SMALL.replace("half_kg_m_s: 0.025", "half_kg_m_s: &m 0.025").replace("half_kg_m_s: 0.04", "half_kg_m_s: *m")
    scenario = load_scenario(write(once))
    law = scenario.rebound_parameters(scenario.make_blocks()["cube"])
    assert law["ditch"].momentum_half_kg_m_s == 0.025


def test_a_former_key_is_read_with_a_warning_that_names_its_place_and_the_key(write):
    file = write(SMALL.replace("ditch: {friction_angle_deg: 20}", "ditch: {rolling_in_crater: true}"))
    with pytest.warns(OldKeyWarning) as caught:
        scenario = load_scenario(file)
    contact = scenario.contact_parameters(scenario.make_blocks()["cube"])
    assert contact["ditch"].rolling_in_indentation and not contact["default"].rolling_in_indentation
    (warning,) = (entry.message for entry in caught)
    line = SMALL[: SMALL.index("    ditch: {friction")].count("\n") + 1
    assert (warning.file, warning.line, warning.key) == (file, line, "rolling_in_indentation")
    assert str(warning).startswith(f"{file}:{line}: ")


def test_a_mistake_under_a_former_key_keeps_its_place(write):
    text = SMALL.replace("ditch: {friction_angle_deg: 20}", "ditch: {rolling_in_crater: 7}")
    with pytest.warns(OldKeyWarning):
        message = refused(write(text))
    assert "rolling_in_indentation: expected true or false, found 7" in message
    both = SMALL.replace(
        "ditch: {friction_angle_deg: 20}", "ditch: {rolling_in_crater: true, rolling_in_indentation: true}"
    )
    assert "former name" in refused(write(both))


@pytest.mark.parametrize(
    ("old", "new", "code", "fields"),
    [
        ("engine: pymunk", "engin: pymunk", "unknown_key", {"key": "engin"}),
        ("x_m: 0.5, ", "", "missing_key", {"key": "x_m"}),
        ("    cube:\n", "    cub:\n", "unknown_name", {"name": "cub"}),
        ("k_ul_N_m: 6.0e4", "k_ul_N_m: 6.0e3", "bad_parameter", {"key": "k_l_N_m"}),
        ("[0, 0], [1, 0]", "[0, 0], [0, 0]", "bad_cross_section", {"facet": 1, "line_name": None}),
        ("y_m: 0.3", "y_m: -0.3", "bad_state", {"key": "y_m"}),
        ("side_m: 0.019", "side_m: 0.019, inertia: solid_sphere", "bad_block", {}),
        ("releases: 5", "releases: 5.5", "bad_value", {}),
        ("releases: 5", "releases: 5\nreleases: 6", "duplicate", {"key": "releases"}),
        ("name: small", "name: [small", "not_yaml", {}),
    ],
)
def test_a_mistake_has_a_code_and_fields(write, old, new, code, fields):
    assert old in SMALL
    error = refusal(load_scenario, write(SMALL.replace(old, new, 1)))
    assert (error.code, error.fields) == (code, fields)


def test_a_block_without_an_incident_state_is_refused(write):
    start = SMALL.index("  default:\n    distribution")
    assert "block 'cube' has no incident state" in refused(write(SMALL[:start]))


def test_where_a_soil_class_stands_the_message_says_what_to_write(write):
    text = (SHIPPED / "rough_slope.yaml").read_text(encoding="utf-8")
    assert "    rock: bedrock\n" in text
    varied = "scatter:\n  model.soils.rock: {times: {uniform: {low: 0.5, high: 2}}}\n"
    message = refused(write(re.sub(r"scatter:.*\n", varied, text, count=1)))
    assert "Write rock: {like: bedrock, stiffness: ...} there, and vary model.soils.rock.stiffness" in message


def test_the_engine_of_the_scenario_needs_its_law(write):
    start, end = SMALL.index("  probabilistic:"), SMALL.index("incident:")
    only_deterministic = SMALL[:start] + SMALL[end:]
    scenario = load_scenario(write(only_deterministic))
    with pytest.raises(InputError, match=r"probabilistic.*point_mass"):
        scenario.rebound_parameters(scenario.make_blocks()["cube"])
    assert "point_mass" in refused(write(only_deterministic.replace("engine: pymunk", "engine: point_mass")))


def test_filmed_releases_bring_their_cross_section_blocks_and_gravity(write, tmp_path, monkeypatch):
    monkeypatch.delenv("ROCK2D_DATA", raising=False)
    file = write(FILMED)
    assert "--data or ROCK2D_DATA" in refused(file)
    assert "no folder 'set-up/drops'" in refused(file, data_root=tmp_path / "data")
    write(DROPS, "data/set-up/drops/experiment.yaml")
    rows = [f"{release},ball,{k / 100},0,{1 - k / 100},0" for release in (2, 5) for k in range(6)]
    write("release,block,t_s,x_m,y_m,theta_rad\n" + "\n".join(rows), "data/set-up/drops/t.csv")
    scenario = load_scenario(file, data_root=tmp_path / "data")
    assert scenario.gravity_m_s2 == 9.7 and scenario.releases == 2
    assert scenario.make_cross_section().zones == ("floor",) and list(scenario.make_blocks()) == ["ball"]
    assert scenario.experiment.trajectories["release"].nunique() == 2
    started = [start for start, _ in starts(Conditions(scenario, "batch", 1))]
    group = Conditions(scenario, "batch", 1).group(0, 0, 9)  # fewer were filmed
    assert np.array_equal(group.states, [start.state for start in started])
    assert group.seeds.tolist() == [start.seed for start in started]
    monkeypatch.setenv("ROCK2D_DATA", str(tmp_path / "data"))
    assert load_scenario(file).gravity_m_s2 == 9.7
    other = "escape.yaml"
    for escape in ("../data/set-up/drops", str(tmp_path / "data/set-up/drops"), "set-up/../../data/set-up/drops"):
        assert "inside" in refused(write(FILMED.replace("set-up/drops", escape), other))
    (tmp_path / "root").mkdir()
    (tmp_path / "root" / "set-up").symlink_to(tmp_path / "data" / "set-up")
    assert "leads out" in refused(file, data_root=tmp_path / "root")


@pytest.mark.parametrize("path", WITHOUT_DATA, ids=lambda path: path.stem)
def test_shipped_scenarios_are_whole_and_say_what_is_assumed(path):
    scenario = load_scenario(path)
    assert scenario.name == path.stem and scenario.about and scenario.assumed
    zones = set(scenario.make_cross_section().zone_names)
    assert len(zones) == 1 or {"ditch", "uphill_face", "crest"} <= zones
    for block in scenario.make_blocks().values():
        assert scenario.contact_parameters(block)
        assert scenario.rebound_parameters(block)


def test_real_squares_take_everything_measured_from_the_data(data_root):
    scenario = load_scenario(SHIPPED / "real_squares.yaml", data_root=data_root)
    assert scenario.releases == scenario.experiment.trajectories["release"].nunique() == 250
    assert scenario.make_cross_section().zones == ("floor",)
    assert scenario.make_blocks()["square"].mass_kg == 0.05


EMBANKMENT = """
embankment: {x_m: 2.5, height_m: 0.083, crest_m: 0.055, uphill_deg: 60, downhill_deg: 34}
ditch: {width_m: 0.2, depth_m: 0.02, uphill_deg: 45}
"""


def test_an_embankment_and_a_ditch_bring_points_zones_and_measure_lines(write):
    text = (SHIPPED / "flat_floor.yaml").read_text()
    scenario = load_scenario(write(text.replace("blocks:", EMBANKMENT + "blocks:", 1)))
    ground = scenario.make_cross_section()
    assert {"ditch", "uphill_face", "crest", "downhill_face"} < set(ground.zone_names)
    assert {"facing_1_3", "facing_2_3", "crest"} <= set(ground.measure_lines)
    assert ground.embankment is not None and ground.embankment.height_m == pytest.approx(0.083)


SEVERAL = """
embankment:
  1: {x_m: 2.0, height_m: 0.083, crest_m: 0.055, uphill_deg: 60, downhill_deg: 34}
  2: {x_m: 2.6, height_m: 0.05, crest_m: 0.055, uphill_deg: 60, downhill_deg: 34}
ditch:
  2: {width_m: 0.1, depth_m: 0.02, uphill_deg: 45}
"""


def with_several(text: str = SEVERAL) -> str:
    return (SHIPPED / "flat_floor.yaml").read_text().replace("blocks:", text + "blocks:", 1)


def test_several_embankments_are_read_by_their_numbers_and_written_again(write):
    scenario = load_scenario(write(with_several()))
    zones = scenario.make_cross_section().zone_names
    assert {"uphill_face_1", "crest_2", "ditch_2"} < set(zones) and "ditch_1" not in zones
    higher = variant(scenario, {"embankment.2.height_m": 0.07})
    again = load_scenario(write(scenario_text(higher)))
    assert again.embankment["2"].height_m == 0.07 and again.model_dump() == higher.model_dump()
    error = refusal(variant, scenario, {"embankment.height_m": 0.07}, said="did you mean 'embankment.1.height_m'")
    assert error.line


@pytest.mark.parametrize(
    ("old", "new", "place", "said"),
    [
        ("x_m: 2.6", "x_m: 1.9", "embankment.2.x_m", "from uphill to downhill"),
        ("x_m: 2.6", "x_m: 2.1", "embankment.2.x_m", "before embankment 1 ends"),
        ("width_m: 0.1", "width_m: 0.5", "ditch.2.width_m", "before embankment 1 ends"),
        ("x_m: 2.6", "x_m: 99", "embankment.2.x_m", "outside the cross-section"),
        ("height_m: 0.05", "hight_m: 0.05", "embankment.2.hight_m", "did you mean 'height_m'"),
        ("  2: {x_m", "  3: {x_m", "embankment.3", "without a gap"),
        ("  2: {width_m", "  3: {width_m", "ditch.3", "no embankment '3'"),
        ("  2: {width_m: 0.1, depth_m: 0.02, uphill_deg: 45}", "  {width_m: 0.1, uphill_deg: 45}", "ditch",
         "before which of the embankments"),
    ],
)  # fmt: skip
def test_several_embankments_that_do_not_fit_are_refused_with_their_place(write, old, new, place, said):
    assert SEVERAL.count(old) == 1
    text = with_several(SEVERAL.replace(old, new))
    message = refused(write(text))
    assert said in message and f"{place}: " in message
    line = int(re.search(r"yaml:(\d+):\d+: ", message)[1])
    assert place.rsplit(".", 1)[-1] in text.splitlines()[line - 1]


def test_a_numbered_ditch_needs_numbered_embankments(write):
    text = EMBANKMENT.replace("ditch: {", "ditch: {1: {").replace("45}", "45}}")
    assert "ditch.1: there is no embankment '1'" in refused(write(with_several(text)))


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("x_m: 2.5", "x_m: 99", "embankment.x_m: the foot is outside"),
        ("downhill_deg: 34", "downhill_deg: 2", "embankment.downhill_deg: the downhill face does not meet"),
        ("height_m: 0.083", "height_m: 83", "embankment.height_m: the downhill face does not meet"),
        ("crest_m: 0.055", "crest_m: 55", "embankment.crest_m: the downhill face does not meet"),
        ("uphill_deg: 60", "uphill_deg: 91", "embankment.uphill_deg: expected"),
        ("uphill_deg: 60", "uphill_deg: 1.05", "expected greater than or equal to 2, found 1.05"),  # 60 degrees in rad
        ("x_m: 2.5", "x_m: 2,5", "a decimal comma? Write 2.5, not 2,5"),
        ("width_m: 0.2", "width_m: 200", "ditch.width_m: the uphill wall does not meet"),
        ("embankment: {x_m: 2.5, height_m: 0.083, crest_m: 0.055, uphill_deg: 60, downhill_deg: 34}", "",
         "ditch: a ditch lies before an embankment"),
    ],
)  # fmt: skip
def test_earthworks_that_do_not_fit_the_ground_are_refused_with_their_place(write, old, new, said):
    text = (SHIPPED / "flat_floor.yaml").read_text().replace("blocks:", EMBANKMENT + "blocks:", 1)
    assert old in text
    message = refused(write(text.replace(old, new)))
    assert said in message
    assert re.search(r"yaml:\d+:\d+: ", message)


@pytest.mark.parametrize(
    "keys, message",
    [("number: 12", "project.number: expected text, found 12; put it in quotes"),
     ("date: 31.3.2025", "project.date: expected a date as 2025-03-31, found '31.3.2025'"),
     ("date: 2025-02-30", "project.date: expected a date as 2025-03-31, found '2025-02-30'"),
     ("titel: a", "project.titel: unknown key (did you mean 'title'?)")],
)  # fmt: skip
def test_the_head_of_the_report_is_text_with_a_date(tmp_path, keys, message):
    path = scenario_file(tmp_path, "small", more=f"project: {{{keys}}}\n")
    with pytest.raises(InputError) as caught:
        load_scenario(path)
    line = next(i for i, text in enumerate(path.read_text().splitlines(), 1) if text.startswith("project:"))
    assert str(caught.value).startswith(f"{path}:{line}:") and message in str(caught.value)
