"""How much depends on the model: the same releases with one change at a time."""

import pytest

from rock2d.design.model_range import AS_IN_FILE, other_models, range_remarks, range_table, short_ranges, shown_lines
from rock2d.files.scenario_reading import load_scenario
from rock2d.runs.run import run
from rock2d.scene.soils import SOIL_CLASSES
from tests.scenarios_of_tests import scenario_file

RELEASES = 150
SOILS = "{soils: {default: covered_bedrock}}"
ROUGH = "roughness:\n  slope: {sd_deg: 3, length_m: 0.6}\n"


@pytest.fixture(scope="module")
def scenario(tmp_path_factory):
    folder = tmp_path_factory.mktemp("models")
    return load_scenario(scenario_file(folder, "site", model=SOILS, more=ROUGH))


@pytest.fixture(scope="module")
def table(scenario):
    return range_table(scenario, "batch", 3, RELEASES)


def test_one_thing_changes_at_a_time(scenario):
    found = {model.name: model for model in other_models(scenario, "batch")}
    assert set(found) == {
        "probabilistic law", "smooth ground", "softer soil", "harder soil", "square blocks", "rectangle blocks",
    }  # fmt: skip
    assert found["probabilistic law"].engine == "point_mass"
    assert not found["smooth ground"].scenario.roughness and found["softer soil"].scenario.roughness
    restitution = [
        SOIL_CLASSES[found[name].scenario.model.soils["default"]].restitution for name in ("softer soil", "harder soil")
    ]
    assert restitution[0] < SOIL_CLASSES["covered_bedrock"].restitution < restitution[1]
    ball, cube = (own.make_blocks()["ball"] for own in (scenario, found["square blocks"].scenario))
    assert (cube.shape, cube.mass_kg) == ("square", ball.mass_kg)
    assert cube.area_m2 == pytest.approx(ball.area_m2)


def test_what_a_change_removes_neither_varies_nor_is_unknown(tmp_path):
    vary = "{times: {uniform: {low: 0.9, high: 1.1}}}"
    diameter, sd, mass = "blocks.ball.diameter_m", "roughness.slope.sd_deg", "blocks.ball.mass_kg"
    more = f"{ROUGH}scatter: {{{diameter}: {vary}, {mass}: {vary}}}\n"
    more += f"uncertainty: {{sites: 4, releases: 20, site: {{{diameter}: {vary}, {sd}: {vary}}}}}\n"
    scenario = load_scenario(scenario_file(tmp_path, "site", model=SOILS, more=more))
    found = {model.name: model.scenario for model in other_models(scenario, "batch")}
    assert list(found["square blocks"].scatter) == [mass]
    assert list(found["smooth ground"].scatter) == [diameter, mass]
    assert set(range_table(scenario, "batch", 3, 10)["model"]) == {AS_IN_FILE, *found}


def test_the_first_model_is_the_run_itself(scenario, table):
    passing = run(scenario, engine="batch", seed=3, releases=RELEASES).to_pandas("passing").set_index("line")
    own = table[table["model"] == AS_IN_FILE].set_index("line")
    for column in ("frequency", "low95", "high95", "per_arriving"):
        assert own[column].to_dict() == pytest.approx(passing[column].to_dict(), nan_ok=True)


def test_the_range_is_that_of_the_table(table):
    crest = table[table["line"] == "crest"]["frequency"]
    (said,) = [text for text in range_remarks(table) if "crest, passes, % of released" in text]
    least, most = (f"{100 * value:.3g}" for value in (crest.min(), crest.max()))
    assert least in said and most in said
    assert short_ranges(table)["crest", "frequency"].endswith("over 7 models")
    assert {line for line, _ in shown_lines(table)} == {"crest", "arrival"}
