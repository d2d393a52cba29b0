"""Design values against sums by hand."""

import numpy as np
import pandas as pd
import pytest

from rock2d.design.norms import (
    NORM_NUMBERS,
    ONR,
    SOURCES,
    UNI,
    characteristic_values,
    demands,
    design_table,
    norm_remarks,
    norm_table,
    onr_24810,
    uni_11211_4,
)  # fmt: skip
from rock2d.files.scenario_keys import OnrKeys, UniKeys
from rock2d.statistics import Estimate
from tests.scenarios_of_tests import small_site

AT_LINE = {
    "speed_m_s": Estimate(20.0, 18.0, 22.0),
    "passing_height_m": Estimate(2.0, 1.5, 2.5),
    "kinetic_J": Estimate(1.0e6, 0.9e6, 1.2e6),
}


def test_uni_11211_4_multiplies_speed_mass_and_energy():
    factors = UniKeys(gamma_tr=1.02, gamma_dp=1.10, gamma_vol=1.05, gamma_gamma=1.0, gamma_r=1.2)
    speed, mass, energy, height = uni_11211_4(AT_LINE, 1000.0, 0.8, factors)
    assert speed.design == pytest.approx(np.array([20, 18, 22]) * 1.02 * 1.10)
    assert mass.design.value == pytest.approx(1050.0)
    assert energy.characteristic.value == pytest.approx(0.5 * 1000 * 20**2)
    assert energy.design.value == pytest.approx(1.2 * 0.5 * 1050 * (20 * 1.02 * 1.10) ** 2)
    assert height.design == pytest.approx(np.array([2.0, 1.5, 2.5]) * 1.02 * 1.10 + 0.5)
    assert "gamma_Tr 1.02" in speed.factors and "gamma_R 1.2" in energy.factors


def test_the_freeboard_is_the_radius_of_a_large_block_and_half_a_metre_at_least():
    large = uni_11211_4(AT_LINE, 1000.0, 3.0, UniKeys())[-1].design.value
    small = uni_11211_4(AT_LINE, 1000.0, 0.2, UniKeys())[-1].design.value
    assert large - small == pytest.approx(1.0)


def test_onr_24810_multiplies_energy_and_height():
    energy, height = onr_24810(AT_LINE, OnrKeys(gamma_e=1.15, gamma_h=1.30))
    assert energy.design.high == pytest.approx(1.38e6)
    assert height.design.value == pytest.approx(2.6)


def percentiles(scale: float = 1.0) -> pd.DataFrame:
    return pd.DataFrame(
        [("ball", "arrival", q, p, 40, *(scale * v for v in AT_LINE[q])) for q in AT_LINE for p in (95.0, 99.0)],
        columns=["block", "line", "quantity", "percentile", "passed", "value", "low95", "high95"],
    )  # fmt: skip


def test_what_is_not_known_takes_the_place_of_sampling(tmp_path):
    uncertain = percentiles(1.1)[lambda table: table["percentile"] == 95.0]
    uncertain = uncertain.assign(quantity=uncertain["quantity"] + "_95")
    plain, wide = (characteristic_values(percentiles(), u)["ball", "arrival"] for u in (None, uncertain))
    assert plain == AT_LINE
    assert wide["speed_m_s"] == pytest.approx((22.0, 19.8, 24.2))
    table = design_table(small_site(tmp_path), percentiles()).set_index(["norm", "quantity"])
    assert table.loc[("UNI 11211-4", "mass_kg"), "characteristic"] == 305.0


def test_the_embankment_must_take_what_the_worst_block_brings():
    other = percentiles(0.5).assign(block="pebble")
    found = demands(pd.concat([percentiles(), other]))
    assert found[None, "kinetic_J"] == ("ball", AT_LINE["kinetic_J"])
    assert demands(percentiles().assign(line="crest")) == {}


def test_a_number_of_a_norm_is_verified_by_two_named_sources():
    stated = {(number.norm, number.name): number for number in NORM_NUMBERS}
    assert all(set(number.sources) <= set(SOURCES) for number in NORM_NUMBERS)
    assert stated[UNI, "percentile"].verified and not stated[UNI, "gamma_tr"].verified
    factors = {*UniKeys.model_fields, *OnrKeys.model_fields}
    assert factors <= {number.name for number in NORM_NUMBERS}  # no factor without a word about its source


def test_what_is_not_verified_stays_marked_until_the_scenario_sets_it(tmp_path):
    site = small_site(tmp_path)
    unsure = design_table(site, percentiles()).set_index(["norm", "quantity"])["not_verified"]
    assert unsure[UNI, "speed_m_s"] == "gamma_tr, gamma_dp"
    assert unsure[UNI, "height_m"] == "gamma_tr, gamma_dp, freeboard"
    assert unsure[ONR, "energy_J"] == "percentile, gamma_e"
    (line,) = norm_remarks(site)
    assert "not verified" in line and "gamma_r, freeboard; ONR 24810: percentile, gamma_e, gamma_h" in line
    keys = site.design_values.model_copy(update={"onr_24810": OnrKeys(gamma_e=1.15)})
    own = site.model_copy(update={"design_values": keys})
    unsure = design_table(own, percentiles()).set_index(["norm", "quantity"])["not_verified"]
    assert unsure[ONR, "energy_J"] == "percentile"
    states = {row[:2]: row[-1] for row in norm_table(own)}
    assert states[ONR, "gamma_e"] == "set in the scenario" and states[ONR, "gamma_h"] == "not verified"
    assert states[UNI, "percentile"] == "verified"
