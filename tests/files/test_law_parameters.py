"""Soil classes in scenario files: scaled for each block, overridden where the file says more; mistakes have a place."""

from dataclasses import replace

import pytest

from rock2d.errors import InputError
from rock2d.files.scenario_reading import load_scenario
from rock2d.files.scenario_variants import variant
from rock2d.laws.soil_scaling import soil_contact, soil_rebound
from rock2d.scene.soils import SOIL_CLASSES
from tests.laws import closed_forms
from tests.programs import refusal

HEAD = """\
name: classes
engine: {engine}
releases: 4
cross_section:
  points_m: [[-10, 10], [0, 0], [10, 0], [20, 0]]
  zones: [rock, scree, road]
{line}blocks:
  small: {{shape: circle, diameter_m: 0.6, mass_kg: 300, inertia: solid_sphere}}
  large: {{shape: square, side_m: 2.0, mass_kg: 21600}}
incident: {{default: {{fixed: {{x_m: 5, y_m: 4, vx_m_s: 1, vy_m_s: 0}}}}}}
model:
"""
CONTACT = "{k_l_N_m: 1.0e7, k_ul_N_m: 9.0e7, k_t_N_m: 2.5e6, friction_angle_deg: 33, k_r_Nm_rad: 4.0e4}"


@pytest.fixture
def load(put):
    def load(model: str, engine: str = "batch", line: str = ""):
        return load_scenario(put(HEAD.format(engine=engine, line=line) + model, "scenario.yaml"))

    return load


def contact(scenario, zone, block="small"):
    return scenario.contact_parameters(scenario.make_blocks()[block])[zone]


def rebound(scenario, zone, block="small"):
    return scenario.rebound_parameters(scenario.make_blocks()[block])[zone]


@pytest.mark.parametrize("engine", ["batch", "point_mass"])
def test_a_class_gives_the_parameters_of_both_laws_for_each_block(load, engine):
    scenario = load("  soils: {default: medium_scree, rock: bedrock}\n", engine)
    for name, block in scenario.make_blocks().items():
        for zone, soil in (("default", "medium_scree"), ("rock", "bedrock")):
            given = SOIL_CLASSES[soil], block.mass_kg, block.size_m
            assert contact(scenario, zone, name) == soil_contact(*given)
            assert rebound(scenario, zone, name) == soil_rebound(*given)
    assert contact(scenario, "rock", "large").k_l_N_m > 10 * contact(scenario, "rock", "small").k_l_N_m


def test_numbers_of_a_zone_then_its_class_then_default_numbers_then_the_default_class(load):
    scenario = load(
        "  soils: {default: medium_scree, rock: bedrock, road: asphalt}\n"
        "  deterministic: {default: {friction_angle_deg: 21}, road: {friction_angle_deg: 44}}\n"
        "  probabilistic: {default: {default: {friction_angle_deg: 21}, road: {friction_angle_deg: 44}}}\n"
    )
    for law in (contact, rebound):
        assert law(scenario, "road").friction_angle_deg == 44  # the zone's number
        assert law(scenario, "rock").friction_angle_deg == SOIL_CLASSES["bedrock"].friction_angle_deg
        assert law(scenario, "default").friction_angle_deg == 21  # the default's number
    scree, asphalt = SOIL_CLASSES["medium_scree"], SOIL_CLASSES["asphalt"]
    block = scenario.make_blocks()["small"]
    assert contact(scenario, "default").k_l_N_m == soil_contact(scree, block.mass_kg, block.size_m).k_l_N_m
    assert contact(scenario, "road").k_l_N_m == soil_contact(asphalt, block.mass_kg, block.size_m).k_l_N_m


def test_numbers_of_a_block_come_before_every_class(load):
    scenario = load(
        "  soils: {default: medium_scree, rock: bedrock}\n"
        "  probabilistic: {large: {default: {slope_reduction_deg: 9, tangential_restitution: 0.5}}}\n"
    )
    for zone in ("default", "rock"):
        assert rebound(scenario, zone, "large").slope_reduction_deg == 9
        assert rebound(scenario, zone, "large").tangential_restitution == 0.5
    for zone, soil in (("default", "medium_scree"), ("rock", "bedrock")):
        assert rebound(scenario, zone, "small").slope_reduction_deg == SOIL_CLASSES[soil].slope_reduction_deg
    assert rebound(scenario, "rock", "small").tangential_restitution == 0.9


def test_classes_of_single_zones_stand_beside_default_numbers(load):
    scenario = load(f"  soils: {{rock: bedrock}}\n  deterministic: {{default: {CONTACT}}}\n")
    assert contact(scenario, "default").k_l_N_m == contact(scenario, "default", "large").k_l_N_m == 1.0e7
    assert contact(scenario, "rock") != contact(scenario, "rock", "large")
    with pytest.raises(InputError, match="zone 'scree' has no soil class"):
        scenario.rebound_parameters(scenario.make_blocks()["small"])


def test_classes_of_all_zones_need_no_default(load):
    scenario = load("  soils: {rock: bedrock, scree: medium_scree, road: asphalt}\n")
    assert set(scenario.contact_parameters(scenario.make_blocks()["small"])) == {"rock", "scree", "road"}


@pytest.mark.parametrize(
    ("model", "line", "column", "words"),
    [
        ("  soils: {default: medium_scee}\n", 12, 20, "did you mean 'medium_scree'"),
        ("  soils: {default: x, rock: bedrock}\n", 12, 20, "soil classes: swamp, deep_soil"),
        ("  soils: {default: bedrock, rok: bedrock}\n", 12, 29, "unknown zone (did you mean 'rock'?)"),
        ("  soils: {default: 3}\n", 12, 20, "expected the name of a soil class or a mapping with the key like"),
        ("  soils: {default: {like: medium_scee}}\n", 12, 27, "did you mean 'medium_scree'"),
        ("  soils: {default: {restitution: 0.3}}\n", 12, 11, "missing key 'like'"),
        ("  soils: {default: {like: bedrock, restitution: 1.2}}\n", 12, 49, "less than 1, found 1.2"),
        ("  soils: {default: {like: bedrock, stifness: 99}}\n", 12, 36, "did you mean 'stiffness'"),
        ("  soils: {}\n", 12, 10, "at least 1"),
        ("  soils: {rock: bedrock}\n", 12, 3, "zone 'scree' has no soil class, neither its own nor a default"),
        ("  soils: {default: swamp}\n  deterministic: {default: {k_l_N_m: 1e14}}\n", 13, 38, "k_l_N_m <= k_ul"),
        (f"  deterministic: {{rock: {CONTACT}}}\n", 12, 3, "missing key 'default'"),
        ("  probabilistic: {small: {}}\n", 12, 3, "missing key 'default'"),
    ],
)
def test_a_mistake_is_one_message_with_its_place(load, model, line, column, words):
    error = refusal(load, model)
    assert words in str(error) and "\n" not in str(error)
    assert (error.line, error.column) == (line, column)


def test_own_numbers_of_a_class_scale_with_the_block(load):
    scenario = load("  soils: {default: {like: medium_scree, restitution: 0.3, stiffness: 500}}\n")
    soil = replace(SOIL_CLASSES["medium_scree"], restitution=0.3, stiffness=500.0)
    for name, block in scenario.make_blocks().items():
        assert contact(scenario, "default", name) == soil_contact(soil, block.mass_kg, block.size_m)
        assert rebound(scenario, "default", name) == soil_rebound(soil, block.mass_kg, block.size_m)


def test_a_number_of_a_class_can_be_uncertain(load):
    """A possible site has another restitution of the rock, for all blocks; nothing else changes."""
    low, high = SOIL_CLASSES["bedrock"].restitution_range
    scenario = load(
        "  soils: {default: medium_scree, rock: {like: bedrock, restitution: 0.53}}\n"
        f"uncertainty: {{site: {{model.soils.rock.restitution: {{uniform: {{low: {low}, high: {high}}}}}}}}}\n",
        line="  measure_lines: {end: [[15, 0.1], [15, 9]]}\n",
    )
    site = variant(scenario, {"model.soils.rock.restitution": low})
    for name in scenario.make_blocks():
        law = contact(site, "rock", name)
        assert closed_forms.restitution(law) == pytest.approx(low)
        assert law.k_l_N_m == contact(scenario, "rock", name).k_l_N_m
        assert contact(site, "default", name) == contact(scenario, "default", name)


def test_a_scenario_with_classes_runs_with_every_engine(load):
    from rock2d.runs.run import run

    scenario = load("  soils: {default: medium_scree, rock: bedrock}\n")
    for engine in ("batch", "point_mass", "pymunk"):
        result = run(scenario, engine=engine, releases=1, workers=1, progress=False)
        assert {track.stop for track in result.tracks} <= {"rest", "exit"}
