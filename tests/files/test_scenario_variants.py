"""A variant is the scenario with other numbers, checked as if it stood in a file."""

import numpy as np
import pytest
from scipy import stats

from rock2d.files.distributions import quantiles
from rock2d.files.places import number_at
from rock2d.files.scatter_keys import Uncertainty
from rock2d.files.scenario_reading import load_scenario
from rock2d.files.scenario_variants import scenario_text, variant
from tests.programs import refusal
from tests.scenarios_of_tests import UNKNOWN, small_site


def test_a_variant_has_the_new_numbers_and_the_scenario_keeps_its_own(tmp_path):
    scenario = small_site(tmp_path)
    other = variant(scenario, {"embankment.height_m": 3.0, "cross_section.points_m.2.0": 70.0, "releases": 5})
    assert other.embankment.height_m == 3.0 and scenario.embankment.height_m == 2.0
    assert other.make_cross_section().points_m[-1, 0] == 70.0
    assert other.releases == 5 and other.uncertainty is None


def test_the_text_of_a_variant_is_a_scenario_that_is_the_same(tmp_path):
    other = variant(small_site(tmp_path), {"model.deterministic.default.k_l_N_m": 3.3e6})
    (tmp_path / "other.yaml").write_text(scenario_text(other))
    again = load_scenario(tmp_path / "other.yaml")
    assert again.model_dump() == other.model_dump()
    assert list(again.model_dump()["model"]["deterministic"]) == list(other.model_dump()["model"]["deterministic"])


@pytest.mark.parametrize(
    ("values", "code"),
    [
        ({"embankment.hight_m": 3.0}, "unknown_name"),
        ({"name": 3.0}, "unknown_name"),
        ({"cross_section.points_m.9.0": 3.0}, "unknown_name"),
        ({"embankment.height_m": -1.0}, "bad_value"),
        ({"model.deterministic.default.k_ul_N_m": 1.0e6}, "bad_parameter"),
    ],
)
def test_values_that_make_no_sense_are_refused(tmp_path, values, code):
    error = refusal(variant, small_site(tmp_path), values)
    assert error.code == code and error.line


def test_unknown_places_and_what_cannot_be_uncertain_are_refused_with_their_line(tmp_path):
    for old, new, said in (
        ("default.k_ul_N_m", "defualt.k_ul_N_m", "no number at this place"),
        ("sd: 2", "sd: -2", "expected"),
        ("{times: {uniform: {low: 0.7, high: 1.3}}}", "{time: 3}", "found key 'time'.*did you mean 'times'"),
    ):
        assert refusal(small_site, tmp_path, UNKNOWN.replace(old, new), said=said).line


def test_quantiles_are_those_of_the_distributions():
    u = np.linspace(0.01, 0.99, 37)
    keys = Uncertainty.model_validate(
        {
            "site": {
                "a": {"normal": {"mean": 5.0, "sd": 2.0}},
                "b": {"uniform": {"low": 1.0, "high": 3.0}},
                "c": {"lognormal": {"median": 4.0, "cv": 0.5}},
                "d": {"times": {"uniform": {"low": 0.8, "high": 1.2}}},
            }
        }
    ).site
    assert quantiles(keys["a"], u, 0.0) == pytest.approx(stats.norm(5, 2).ppf(u))
    assert quantiles(keys["b"], u, 0.0) == pytest.approx(1 + 2 * u)
    drawn = stats.lognorm(np.sqrt(np.log1p(0.25)), scale=4.0)
    assert quantiles(keys["c"], u, 0.0) == pytest.approx(drawn.ppf(u))
    assert drawn.std() / drawn.mean() == pytest.approx(0.5)
    assert quantiles(keys["d"], u, 10.0) == pytest.approx(8 + 4 * u)


def test_number_at_finds_numbers_only():
    data = {"a": {"b": [1, 2.5]}, "on": True, "name": "x"}
    assert number_at(data, "a.b.1") == 2.5 and number_at(data, "a.b.0") == 1.0
    assert [number_at(data, place) for place in ("a.b", "on", "name", "a.c", "a.b.2", "name.0")] == [None] * 6
