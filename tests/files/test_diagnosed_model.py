"""diagnosis.json in a scenario: which of its answers is used, how its intervals become distributions, bad files."""

import json

import numpy as np
import pytest
from scipy import stats

from rock2d.errors import InputError
from rock2d.files.diagnosed_model import CauseDraw, FittedValue
from rock2d.files.scenario_variants import variant
from rock2d.runs.diagnosis_remarks import diagnosis_remarks
from tests.diagnosed_files import GAIN, JOINT, SOIL, content, diagnosed, effect, numbers, undiagnosed
from tests.programs import refusal

AIR = effect(drag_per_mass_1_m=(0.01, 0.004, 0.016))
SPIN = effect(base=SOIL, rate_1_s=(0.1, 0.05, 0.15))
LIFT = {"lift_per_mass": {"value": 0.01, "ci95": [0.0, 0.02], "unit": "1"}}
NO_SHARE = {"closes": None, "closes_ci95": None}
UNCERTAIN = "uncertainty: {sites: 4, releases: 20}"
SHARES = (np.arange(4000) + 0.5) / 4000


@pytest.mark.parametrize(
    "own",
    [
        FittedValue(2.0, 1.0, 3.0),
        FittedValue(0.5, 0.25, 1.0),
        FittedValue(-1.0, -1.2, -0.5),
        FittedValue(0.3, 0.1, 0.4),
    ],
    ids=["symmetric", "factor", "lopsided", "lopsided and positive"],
)
def test_a_distribution_has_the_interval_of_the_diagnosis(own):
    assert own.quantiles(np.array([0.025, 0.5, 0.975])) == pytest.approx([own.low95, own.value, own.high95])


def test_a_symmetric_interval_is_normal_and_that_of_a_factor_lognormal():
    normal, factor = (FittedValue(2.0, 1.0, 3.0).quantiles(SHARES), FittedValue(0.5, 0.25, 1.0).quantiles(SHARES))
    assert normal == pytest.approx(stats.norm.ppf(SHARES, 2.0, 1.0 / 1.959964), rel=1e-6)
    assert factor == pytest.approx(stats.lognorm.ppf(SHARES, np.log(2.0) / 1.959964, scale=0.5), rel=1e-6)


def test_distributions_end_at_the_bounds_of_the_effect():
    cut = FittedValue(0.5, -1.0, 2.0, lowest=0.0, highest=1.0).quantiles(SHARES)
    whole = stats.norm(0.5, 1.5 / 1.959964)
    low, high = whole.cdf(0.0), whole.cdf(1.0)
    assert cut.min() >= 0.0 and cut.max() <= 1.0
    # truncated, not piled up at the ends
    assert cut == pytest.approx(whole.ppf(low + (high - low) * SHARES), abs=1e-6)


def test_a_member_of_a_group_is_drawn_with_its_probability():
    drawn = CauseDraw((0.6, 0.1, 0.3)).quantiles(SHARES)
    assert np.bincount(drawn.astype(int)) / len(drawn) == pytest.approx([0.6, 0.1, 0.3], abs=1e-3)


def test_one_effect_acts_on_the_soil_that_was_fitted_with_it(tmp_path):
    own = diagnosed(tmp_path, content("air_drag", {"air_drag": AIR})).diagnosed
    assert own.model.soil.k_ul_N_m == JOINT["k_ul_N_m"] and own.before.soil.k_ul_N_m == SOIL["k_ul_N_m"]
    assert own.model.values("air_drag") == (0.01,) and not own.before.effects
    assert list(own.unknown()) == ["diagnosis.air_drag.drag_per_mass_1_m"]


@pytest.mark.parametrize("verdict", ["none", "unknown"])
def test_without_an_effect_only_the_soil_is_used(tmp_path, verdict):
    own = diagnosed(tmp_path, content(verdict, {"air_drag": AIR})).diagnosed
    assert not own.model.effects and own.model.soil == own.before.soil


def test_a_group_is_a_choice_of_models(tmp_path):
    given = content("air_drag", {"air_drag": AIR, "flight_damping": SPIN}, group=["air_drag", "flight_damping"])
    given["probabilities"] = {"air_drag": 0.6, "flight_damping": 0.2}
    scenario = diagnosed(tmp_path, given, more=UNCERTAIN)
    own = scenario.diagnosed
    assert not own.model.effects and [m.p for m in own.alternatives] == pytest.approx([0.75, 0.25])
    other = variant(scenario, {"diagnosis.cause": 1.0, "diagnosis.flight_damping.rate_1_s": 0.12}).diagnosed.model
    assert other.values("flight_damping") == (0.12,) and other.soil.k_ul_N_m == SOIL["k_ul_N_m"]


def test_several_causes_act_if_they_are_likely(tmp_path):
    causes = [
        {"effect": name, "p": p, "parameters": own["parameters"], **NO_SHARE}
        for name, p, own in (("air_drag", 0.9, AIR), ("flight_damping", 0.4, SPIN))
    ]
    scenario = diagnosed(tmp_path, content("air_drag", {"air_drag": AIR}, schema=2, causes=causes))
    assert list(scenario.diagnosed.model.effects) == ["air_drag"]
    assert scenario.diagnosed.model.soil.k_ul_N_m == JOINT["k_ul_N_m"]


def joint(p: dict[str, float], soil: dict[str, float] = JOINT, **more):
    """A diagnosis whose joint model has air_drag and flight_damping, with causes of these probabilities."""
    sizes = {"air_drag": AIR["parameters"], "flight_damping": SPIN["parameters"]}
    rivals = {"air_drag": [], "flight_damping": ["magnus_lift"]}
    causes = [
        {"effect": name, "p": own, "parameters": sizes.get(name, LIFT), "group": rivals.get(name, []), **NO_SHARE}
        for name, own in p.items()
    ]
    alone = {"air_drag": AIR, "flight_damping": SPIN}
    fits = {"model": {"base": soil, "parameters": sizes}, "causes": causes}
    return content("air_drag", alone, **{"schema": 3, **fits, **more})


@pytest.mark.parametrize(
    "p", [{"air_drag": 0.9, "flight_damping": 0.4, "magnus_lift": 0.4}, {"air_drag": 0.4, "flight_damping": 0.4}]
)
def test_all_causes_of_the_joint_model_act_with_its_soil_however_probable(tmp_path, p):
    scenario = diagnosed(tmp_path, joint(p, soil={**SOIL, "k_l_N_m": 3.0e6}))
    own = scenario.diagnosed
    assert not own.undecided and own.model.soil.k_l_N_m == 3.0e6
    assert own.model.values("air_drag") == (0.01,) and own.model.values("flight_damping") == (0.1,)
    said = [line for line in diagnosis_remarks(scenario) if "do not act" in line]
    assert len(said) == 1 and "magnus_lift (" in said[0] and "cannot tell it from flight_damping" in said[0]
    assert ("probability 0.40" in said[0]) == ("magnus_lift" in p)


def test_a_single_cause_that_shares_its_name_with_an_equal_rival_is_an_alternative(tmp_path):
    given = joint({"air_drag": 0.45, "flight_damping": 0.45}, group=["air_drag", "flight_damping"])
    given["model"]["parameters"] = {"air_drag": AIR["parameters"]}
    own = diagnosed(tmp_path, given).diagnosed
    assert own.undecided and not own.model.effects and len(own.alternatives) == 2


def test_what_was_found_beside_the_verdict_acts_too(tmp_path):
    both = {"air_drag": AIR["parameters"], "flight_damping": SPIN["parameters"]}
    beside = [{"effect": "flight_damping", "base": {**SOIL, "k_l_N_m": 3.0e6}, "parameters": both, **GAIN}]
    model = diagnosed(tmp_path, content("air_drag", {"air_drag": AIR}, beside=beside)).diagnosed.model
    assert list(model.effects) == ["air_drag", "flight_damping"] and model.soil.k_l_N_m == 3.0e6


def test_numbers_of_the_file_come_before_the_diagnosis(tmp_path):
    model = "{diagnosis: d.json, deterministic: {default: {friction_angle_deg: 12}, run_out: {k_t_N_m: 7.0e5}}}"
    scenario = diagnosed(tmp_path, content(), model=model)
    found = scenario.contact_parameters(scenario.make_blocks()["ball"])
    assert found["default"].friction_angle_deg == 12 and found["default"].k_l_N_m == SOIL["k_l_N_m"]
    assert found["run_out"].k_t_N_m == 7.0e5 and found["run_out"].friction_angle_deg == 12


def test_a_zone_with_a_soil_class_of_its_own_keeps_it(tmp_path):
    scenario = diagnosed(tmp_path, content(), model="{diagnosis: d.json, soils: {slope: bedrock}}")
    block = scenario.make_blocks()["ball"]
    alone = undiagnosed(tmp_path, "{soils: {default: bedrock}}").contact_parameters(block)["default"]
    found = scenario.contact_parameters(block)
    assert found["slope"].k_l_N_m == alone.k_l_N_m != found["default"].k_l_N_m == SOIL["k_l_N_m"]


def test_two_soils_for_all_zones_are_refused(tmp_path):
    with pytest.raises(InputError, match=r"diagnosed.yaml:13:\d+: model.soils.default: the diagnosis gives the soil"):
        diagnosed(tmp_path, content(), model="{diagnosis: d.json, soils: {default: bedrock}}")


def test_the_rebound_law_is_refused(tmp_path):
    said = r"model.diagnosis: .* point_mass .* use batch or pymunk"
    error = refusal(diagnosed, tmp_path, content(), engine="point_mass", said=said)
    assert error.code == "wrong_kind" and error.line == 13


@pytest.mark.parametrize(
    "change, place, message",
    [
        ({"schema": 7}, '"schema"', "schema: expected a diagnosis of schema 1 to 3, found 7"),
        ({"base": {}}, '"base"', "no fitted law"),
        ({"base": {**SOIL, "k_l_N_m": -1.0}}, '"k_l_N_m": -1', "base.k_l_N_m: expected greater than 0"),
        ({"base": {**SOIL, "k_l_N_m": "4e6"}}, '"k_l_N_m": "4e6"', "base.k_l_N_m: expected a number"),
        ({"base": {**SOIL, "k_ul_N_m": 1.0}}, '"k_l_N_m": 4', "base.k_l_N_m: need 0 < k_l_N_m <= k_ul_N_m"),
        ({"verdict": "air_drga", "probabilities": {"air_drga": 1.0}}, '"verdict"', "verdict: no effect 'air_drga'"),
        ({"group": ["air_drag", "wind"]}, '"wind"', "group.1: no effect 'wind'"),
        ({"effects": {}}, '"effects"', "effects: the effect air_drag of the verdict is missing"),
        ({"effects": {"air_drag": {**AIR, "parameters": {}}}}, '"parameters"', "missing parameter 'drag_per"),
        ({"effects": []}, '"effects"', "effects: expected a mapping"),
        ({"verdict": ["air_drag"]}, '"verdict"', "verdict: expected text"),
        ({"series": {"cube": "1"}}, '"cube"', "series.cube: expected a whole number"),
        ({"law": 1}, '"law"', "law: expected a mapping"),
        ({"beside": [{"effect": "x", "parameters": {}}]}, "{", "beside.0: missing key 'base'"),
        ({"effects": {"air_drag": effect(drag_per_mass_1_m=(0.5, 0.1, 0.2))}}, '"ci95"', "holds the value 0.5"),
    ],
)  # fmt: skip
def test_a_bad_diagnosis_is_refused_with_its_place(tmp_path, change, place, message):
    error = refusal(diagnosed, tmp_path, {**content("air_drag", {"air_drag": AIR}), **change}, said=message)
    lines = (tmp_path / "d.json").read_text().split("\n")
    assert error.file.name == "d.json" and error.column
    assert place in lines[error.line - 1]


@pytest.mark.parametrize(
    "given, code", [("../d.json", "outside_folder"), ("/d.json", "outside_folder"), ("other.json", "missing_file")]
)
def test_a_bad_path_is_refused_in_the_scenario(tmp_path, given, code):
    inside = tmp_path / "inside"
    inside.mkdir()
    (tmp_path / "d.json").write_text(json.dumps(content()))
    error = refusal(undiagnosed, inside, f"{{diagnosis: {given}}}")
    assert (error.code, error.file.name, error.line) == (code, "diagnosed.yaml", 13)


def test_text_that_is_no_json_is_refused_in_its_file(tmp_path):
    (tmp_path / "d.json").write_text('{"schema": 1,')
    assert refusal(undiagnosed, tmp_path, "{diagnosis: d.json}").file.name == "d.json"


@pytest.mark.parametrize(("file", "given"), [("data/d.json", "d.json"), ("found/diagnosis.json", "found")])
def test_a_diagnosis_is_found_under_the_data_root_and_its_folder_stands_for_its_file(put, monkeypatch, file, given):
    folder = put(json.dumps(content()), file).parent.parent
    monkeypatch.setenv("ROCK2D_DATA", str(folder / "data"))
    assert undiagnosed(folder, f"{{diagnosis: {given}}}").diagnosed.verdict == "none"


def test_uncertainty_needs_something_uncertain(tmp_path):
    with pytest.raises(InputError, match="the diagnosis has no uncertain value that influences"):
        diagnosed(tmp_path, content(), more=UNCERTAIN)
    with pytest.raises(InputError, match="missing key 'site'"):
        undiagnosed(tmp_path, numbers(SOIL), more=UNCERTAIN)
