"""The score of named sets, on six cases whose numbers are known by hand."""

import hashlib
import json

import numpy as np
import pytest

from rock2d.blind.command import score
from rock2d.blind.reality.catalogue import KNOWN
from rock2d.blind.reality.cause import Scale
from rock2d.blind.scoring import (
    case_table,
    closures,
    found_closure,
    inclusion,
    prediction_scores,
    scored_case,
    scored_cases,
    summary,
)
from rock2d.blind.size_errors import MEANINGS, size_errors, size_summary
from rock2d.effects import catalogue
from rock2d.errors import InputError

EFFECTS = len(catalogue())


def trial_label(*, releases=100, **hidden):
    known = sorted(name for name in hidden if name in catalogue())
    return {
        "label": "+".join([*known, *["unknown"] * (len(known) < len(hidden))]) or "none",
        "hidden": [{"name": k, "form": 0, "values": {}, "signal_to_noise": z} for k, z in hidden.items()],
        "signal_to_noise": max(hidden.values(), default=0.0),
        "kind": "flat", "releases": releases, "fps": 500.0, "block_size_m": 0.02, "position_noise_m": 1e-4,
    }  # fmt: skip


def _result(causes, outside, claimed=None, true=None):
    p = dict.fromkeys(catalogue(), 0.8 / EFFECTS) | {"none": 0.05, "unknown": 0.15}
    diagnosis = {
        "probabilities": p, "where": [], "gap": {"closure": claimed},
        "causes": [
            {"effect": effect, "p": own, "parameters": {}, "group": [], "named": own >= 0.5}
            for effect, own in causes.items()
        ],
        "outside": {"p": outside, "share": 0.0, "depends_on": [], "learnt": None},
    }  # fmt: skip
    return {"diagnosis": diagnosis, "seconds": 1.0, "true_closure": true}


TRIAL = {
    "000": (
        trial_label(air_drag=20.0, releases=20),
        _result({"air_drag": 0.95, "adhesion": 0.6}, 0.1, claimed=0.9, true=0.8),
    ),
    "001": (
        trial_label(magnus_lift=3.0, adhesion=1.0, releases=80),
        _result({"magnus_lift": 0.7}, 0.2, claimed=0.5, true=0.9),
    ),
    "002": (trial_label(), _result({"camera_tilt": 0.92}, 0.85)),
    "003": (trial_label(), _result({}, 0.1, claimed=0.0)),
    "004": (
        trial_label(air_drag=60.0, spin_kick=10.0),
        _result({"inertia_error": 0.55, "air_drag": 0.4}, 0.8, claimed=0.3, true=0.2),
    ),
    "005": (trial_label(spin_kick=3.0), _result({}, 0.3)),
}


@pytest.fixture
def cases():
    return [scored_case(name, *own) for name, own in TRIAL.items()]


def test_inclusion_is_scored_over_all_cases_and_effects(cases):
    found = inclusion(cases)
    pairs = 6 * EFFECTS - 1  # adhesion of case 001 is undecidable
    assert (found["pairs"], found["present"], found["undecidable"]) == (pairs, 3, 1)
    squares = 0.05**2 + 0.6**2 + 0.3**2 + 0.92**2 + 0.55**2 + 0.6**2
    assert found["brier"] == pytest.approx(squares / pairs)
    # the present 0.95, 0.7 and 0.4 against the absent, three of which have 0.92, 0.6 and 0.55
    absent = pairs - 3
    assert found["auroc"] == pytest.approx((absent + absent - 1 + absent - 3) / (3 * absent))
    # all probabilities above 0 are in the last bin: 4.12 stated, 3 present
    assert found["ece"] == pytest.approx((4.12 - 3) / pairs)
    own = found["by_effect"]["air_drag"]
    assert (own["pairs"], own["present"]) == (6, 2)
    assert own["brier"] == pytest.approx((0.05**2 + 0.6**2) / 6) and own["ece"] == pytest.approx(0.65 / 6)
    assert found["by_effect"]["adhesion"]["pairs"] == 5


def test_a_hidden_effect_that_cannot_be_seen_counts_as_absent():
    found = inclusion([scored_case("000", trial_label(air_drag=0.4), _result({}, 0.0))])
    assert (found["pairs"], found["present"], found["undecidable"]) == (EFFECTS, 0, 0)


def _counts(share):
    return None if share[3] == 0 else (round(share[0] * share[3]), share[3])


def test_recall_by_strength_number_and_company(cases):
    recall = summary(cases)["recall"]
    seen = {
        (beside, count, level): _counts(share)
        for beside, counts in recall.items()
        for count, levels in counts.items()
        for level, share in levels.items()
        if share[3]
    }
    assert seen == {
        ("without_outside", "1", "15 to 50"): (1, 1),
        ("without_outside", "2 to 4", "2 to 5"): (1, 1),
        ("without_outside", "2 to 4", "0 to 2"): (0, 1),
        ("with_outside", "1", "50 to inf"): (0, 1),
    }


def test_a_film_that_was_refused_names_nothing():
    refused = _result({}, 0.0)
    refused["diagnosis"] |= {"outside": None}
    found = scored_case("0", trial_label(spin_kick=20.0), refused)
    assert found.names == [] and found.p_outside == refused["diagnosis"]["probabilities"]["unknown"]


def test_named_effects_firsts_nulls_and_releases(cases):
    found = summary(cases)
    assert {k: _counts(v) for k, v in found["precision"].items()} == {
        "all": (2, 5), "without_outside": (2, 4), "with_outside": (0, 1),
    }  # fmt: skip
    assert found["precision"]["all"][:3] == pytest.approx([0.4, 0.1176, 0.7693], abs=1e-4)  # Wilson
    assert _counts(found["first_right_single"]["15 to 50"]) == (1, 1)
    assert sum(share[3] for share in found["first_right_single"].values()) == 1
    assert _counts(found["nulls_with_a_cause_named"]) == (1, 2)
    groups = {k: {name: _counts(v) for name, v in own.items()} for k, own in found["by_releases"].items()}
    assert groups == {
        "below 30": {"recall": (1, 1), "precision": (1, 2), "nulls_with_a_cause_named": None},
        "30 to 80": {"recall": (1, 1), "precision": (1, 1), "nulls_with_a_cause_named": None},
        "above 80": {"recall": (0, 1), "precision": (0, 2), "nulls_with_a_cause_named": (1, 2)},
    }


def test_the_first_place_counts_and_not_the_named_set():
    below = {"air_drag": 0.3, "adhesion": 0.2}
    found = summary([
        scored_case("0", trial_label(air_drag=20.0), _result(below, 0.0)),
        scored_case("1", trial_label(adhesion=20.0), _result(below, 0.0)),
        scored_case("2", trial_label(adhesion=20.0), _result({}, 0.0)),
    ])  # fmt: skip
    assert _counts(found["first_right_single"]["15 to 50"]) == (1, 3)
    assert _counts(found["recall"]["without_outside"]["1"]["15 to 50"]) == (0, 3)


def test_outside_causes_and_wrong_effects_named_surely(cases):
    found = summary(cases)
    # 0.8 against 0.1, 0.2, 0.85, 0.1; case 005 is weak
    assert found["outside"]["auroc"] == pytest.approx(3 / 4)
    assert _counts(found["outside"]["recall_clear"]) == (1, 1)
    assert _counts(found["outside"]["false_alarms"]) == (1, 4)
    wrong = {"case": "002", "effect": "camera_tilt", "p": 0.92, "hidden": {}, "outside": None}
    assert found["wrong_and_sure"] == [wrong]


def test_claimed_closure_is_compared_with_the_true_one_where_both_are_known(cases):
    found = closures(cases)
    assert found["all"]["median_claimed_less_true"] == pytest.approx(0.1)
    assert _counts(found["all"]["within_15_points"]) == (2, 3)
    assert _counts(found["all"]["claimed_too_much"]) == (0, 3)
    assert found["2 to 4 effects"]["median_claimed_less_true"] == pytest.approx(-0.4)
    assert {kind: own["within_15_points"][3] for kind, own in found.items()} == {
        "all": 3, "nothing": 0, "one effect": 1, "2 to 4 effects": 1, "outside cause": 1,
    }  # fmt: skip


def write_trial(folder, trial):
    labels = json.dumps({name: label for name, (label, _) in trial.items()})
    (folder / "labels.json").write_text(labels)
    digest = hashlib.sha256(labels.encode()).hexdigest()
    index = {"count": len(trial), "seed": 1, "labels_sha256": digest}
    (folder / "cases.json").write_text(json.dumps(index))
    (folder / "results").mkdir()
    for name, (_, result) in trial.items():
        (folder / "results" / f"{name}.json").write_text(json.dumps(result))


def test_a_trial_is_scored_to_a_page_a_table_and_numbers(tmp_path):
    write_trial(tmp_path, TRIAL)
    score(tmp_path, report=lambda line: None)
    found = json.loads((tmp_path / "score.json").read_text(), parse_constant=pytest.fail)  # JSON has no NaN
    assert found["cases"] == 6 and found["precision"]["all"][3] == 5 and "by_base" not in found
    page = (tmp_path / "score.html").read_text()
    assert "case 002: camera_tilt (probability 0.92); hidden nothing" in page
    assert "40.0\N{NO-BREAK SPACE}% [11.8, 76.9] of 5" in page and "Claimed and true closure" in page
    assert page.count("<img ") == 2
    assert (tmp_path / "score.csv").read_text().count("\n") == 7


def test_what_a_record_holds_anyway_is_neither_right_nor_wrong():
    """Two names of the record, one that was put in, and one that nobody did."""
    label = trial_label(scale_error=20.0) | {"base": "drops", "of_record": ["flight_damping", "air_drag"]}
    named = {"flight_damping": 0.99, "air_drag": 0.95, "scale_error": 0.9, "adhesion": 0.92}
    cases = [scored_case("0", label, _result(named, 0.0)), scored_case("1", *TRIAL["000"])]
    assert [sorted(own) for own in cases[0].scored_names] == [["scale_error"], ["adhesion"]]
    found = summary(cases)
    assert _counts(found["by_base"]["drops"]["precision"]["all"]) == (1, 2)
    assert _counts(found["by_base"]["made"]["precision"]["all"]) == (1, 2)
    assert [wrong["effect"] for wrong in found["wrong_and_sure"]] == ["adhesion"]
    assert found["inclusion"]["pairs"] == 2 * EFFECTS - 2


def test_an_effect_of_the_record_does_not_take_the_place_of_the_hidden_one(tmp_path):
    """Neither in the order of the effects nor as the verdict; a trial of real cases alone has its base, too."""
    label = trial_label(scale_error=20.0) | {"base": "drops", "of_record": ["air_drag"]}
    result = _result({"air_drag": 0.99, "scale_error": 0.9}, 0.0)
    result["diagnosis"]["probabilities"] |= {"air_drag": 0.7}
    write_trial(tmp_path, {"000": (label, result), "001": (label | {"of_record": []}, result)})
    found = score(tmp_path, report=lambda line: None)
    assert _counts(found["first_right_single"]["15 to 50"]) == (1, 2)
    assert _counts(found["verdict"]["one_clear_effect"]) == (0, 1)
    assert list(found["by_base"]) == ["drops"]
    assert "<td>drops</td><td>2 of 2</td><td>1 of 2</td>" in (tmp_path / "score.html").read_text()


def test_predictions_of_heldout_films_are_compared_in_the_middle_and_in_the_tail():
    miss = {"base": 4.0, "base_tail": 10.0, "diagnosed": 1.0, "diagnosed_tail": 10.1, "floor": 1.0}
    worse = miss | {"diagnosed": 3.0, "diagnosed_tail": 12.0}
    cases = [
        scored_case(str(k), trial_label(air_drag=20.0), _result({}, 0.0) | {"heldout": own})
        for k, own in enumerate([miss, worse, {}, {"base": 4.0, "diagnosed": 1.0}])
    ]
    found = prediction_scores(cases)["one effect"]
    assert found["median_smaller"] == pytest.approx(0.5) and _counts(found["tail_not_worse"]) == (1, 2)


def test_the_claimed_closure_of_predictions_is_compared_with_that_in_the_heldout_film():
    miss = {"base": 4.0, "base_tail": 10.0, "diagnosed": 2.5, "diagnosed_tail": 10.0, "floor": 1.0}
    assert found_closure(miss) == pytest.approx(0.5)
    assert found_closure(miss | {"floor": 3.0}) == 1.0  # no model is better than a perfect one
    assert found_closure(miss | {"diagnosed": 5.5}) == pytest.approx(-0.5)
    assert found_closure(miss | {"diagnosed": 4.0, "floor": 4.5}) == 0.0  # there is no gap
    result = _result({}, 0.0) | {"heldout": miss}
    result["diagnosis"]["predicted"] = {"typical": {"closure": 0.75}}
    cases = [scored_case("0", trial_label(air_drag=20.0), result), scored_case("1", trial_label(), _result({}, 0.0))]
    found = prediction_scores(cases)["all"]
    assert found["median_claimed_less_true"] == pytest.approx(0.25)
    assert _counts(found["within_15_points"]) == (0, 1) and _counts(found["claimed_too_much"]) == (1, 1)


def test_a_true_closure_is_at_most_the_whole_gap():
    """The null twin may have a larger floor than the film with its causes."""
    assert scored_case("0", trial_label(air_drag=20.0), _result({}, 0.0, claimed=0.9, true=1.9)).true == 1.0


def test_the_single_verdict_is_right_if_what_it_says_is_hidden(cases):
    assert _counts(summary(cases)["verdict"]["nothing"]) == (0, 2)  # all say "unknown"
    assert _counts(summary(cases)["verdict"]["outside_cause_alone"]) == (1, 1)
    assert case_table(cases)["label"].tolist()[3:] == ["none", "air_drag+unknown", "unknown"]


def test_a_damaged_set_is_refused_with_its_file(tmp_path):
    trial = json.loads(json.dumps(TRIAL))
    trial["001"][1]["diagnosis"]["causes"] = [{"effect": "air_drag"}]
    write_trial(tmp_path, trial)
    with pytest.raises(InputError, match=r"001\.json"):
        scored_cases(tmp_path)


def _hidden(name, form=0, **values):
    return {"name": name, "form": form, "values": values, "signal_to_noise": 9.0}


def _cause(effect, parameter, value, low, high, p=0.9):
    return {
        "effect": effect,
        "p": p,
        "named": p >= 0.5,
        "parameters": {parameter: {"value": value, "ci95": [low, high], "unit": "1"}},
    }


def test_sizes_are_compared_where_both_mean_the_same():
    """A tilt that is 10 % too large, a frame rate whose logarithm is half of the hidden one; a form that means
    something else, an effect that is not hidden and one that is not named are not compared."""
    label = {
        "hidden": [
            _hidden("camera_tilt", turn_rad=-0.02),
            _hidden("frame_rate_error", factor=1.21),
            _hidden("air_drag", form=1, drag=0.1, power=1.7),
            _hidden("inertia_error", factor_0=0.8, factor_1=1.25),
            _hidden("geometry_error", turn_rad=0.05),
        ]
    }
    causes = [
        _cause("camera_tilt", "tilt_rad", -0.022, -0.025, -0.019),
        _cause("frame_rate_error", "time_scale", 1.1, 1.08, 1.12),
        _cause("air_drag", "drag_per_mass_1_m", 0.1, 0.0, 0.2),
        _cause("scale_error", "scale", 1.01, 1.0, 1.02),
        _cause("geometry_error", "facing_rad", 0.05, 0.04, 0.06, p=0.4),
    ]
    errors = size_errors(label, causes)
    assert [e.effect for e in errors] == ["camera_tilt", "frame_rate_error"]
    assert [e.relative for e in errors] == pytest.approx([0.1, -0.5])
    assert [e.covered for e in errors] == [True, False]
    found = size_summary(errors)
    assert found["all"]["count"] == 2 and found["all"]["median_absolute"] == pytest.approx(0.3)
    assert found["camera_tilt"]["within"][0] == 1.0 and found["frame_rate_error"]["within"][0] == 0.0
    assert "inertia_error" not in found


def test_every_compared_value_is_one_that_the_reality_engine_draws():
    """The table names parameters of the catalogue and values of forms that exist."""
    scale = Scale(0.03, 0.05, 9.81, 300.0, np.zeros(2), np.ones(2), n_blocks=2)
    for effect, meaning in MEANINGS.items():
        assert meaning.parameter in [p.name for p in catalogue()[effect].parameters]
        values = KNOWN[effect].sizes(meaning.form, 0.5, np.random.default_rng(0), scale)
        assert np.isfinite(meaning.of(values)) and meaning.of(values) != meaning.neutral
