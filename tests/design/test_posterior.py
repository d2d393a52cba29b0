"""A calibration's posterior as what is not known: sites take its draws whole, each as likely as any other."""

import numpy as np
import pytest

from rock2d.design.assessment import assess
from rock2d.design.possible_sites import draw_sites, variants_of
from rock2d.errors import InputError
from tests.scenarios_of_tests import small_site

K_L, K_UL = "model.deterministic.default.k_l_N_m", "model.deterministic.default.k_ul_N_m"
UNKNOWN = """
uncertainty:
  sites: 16
  releases: 20
  posterior: fitted.csv
"""


def site(folder, table: str, unknown: str = UNKNOWN):
    (folder / "fitted.csv").write_text(table)
    return small_site(folder, unknown)


def draws(n: int = 40) -> np.ndarray:
    k_l = np.random.default_rng(1).uniform(2e6, 6e6, n)
    return np.column_stack([k_l, 6 * k_l])  # the restitution is known, the stiffness is not


def table(values: np.ndarray) -> str:
    return f"{K_L},{K_UL}\n" + "".join(",".join(map(repr, row)) + "\n" for row in values.tolist())


def test_sites_take_draws_whole_and_each_as_often(tmp_path):
    scenario = site(tmp_path, table(draws()))
    sites = draw_sites(scenario, 3, 1024)
    used = np.array([[sites[int(i)][place] for place in (K_L, K_UL)] for i in sites.independent])
    assert used[:, 1] == pytest.approx(6 * used[:, 0])
    _, counts = np.unique(used[:, 0], return_counts=True)
    assert len(counts) == 40
    assert counts.min() >= 24 and counts.max() <= 27  # 1024 / 40, evenly spread
    law = variants_of(scenario, draw_sites(scenario, 3))[5].contact_parameters(scenario.make_blocks()["ball"])
    assert law["default"].k_ul_N_m == pytest.approx(6 * law["default"].k_l_N_m)


def test_a_posterior_stands_beside_other_values(tmp_path):
    further = "  site: {model.deterministic.default.friction_angle_deg: {uniform: {low: 20, high: 40}}}\n"
    scenario = site(tmp_path, table(draws()), UNKNOWN.replace("sites: 16", "sites: 4") + further)
    found = assess(scenario, "batch", 3)
    assert list(found.sites.columns) == ["model.deterministic.default.friction_angle_deg", "posterior"]
    assert len(found.sites) == 4 * (2 + 2)
    assert found.sites["posterior"].between(0, 39).all()


@pytest.mark.parametrize(
    "text, said",
    [
        ("", "expected a first line"),
        (f"{K_L},{K_L}\n1,2\n", "different place"),
        (table(draws(5)), "10 to 100000 draws, found 5"),
        (table(draws()).replace("\n", "\nx,1\n", 1), "fitted.csv:2:1: expected numbers"),
        (table(draws()).replace("\n", "\n\n1,2\n\nx,1\n", 1), "fitted.csv:5:1: expected numbers"),
        (table(draws()).replace("\n", "\n1\n", 1), "expected 2 finite numbers"),
        (table(draws()).replace("k_ul_N_m", "k_x"), "small.yaml.*is not the place of a number in this file"),
    ],
)  # fmt: skip
def test_a_table_that_makes_no_sense_is_refused(tmp_path, text, said):
    with pytest.raises(InputError, match=said):
        site(tmp_path, text)


def test_the_table_lies_beside_the_scenario(tmp_path):
    with pytest.raises(InputError, match="posterior"):
        site(tmp_path, table(draws()), UNKNOWN.replace("fitted.csv", "../fitted.csv"))
    with pytest.raises(InputError, match=r"none\.csv"):
        site(tmp_path, table(draws()), UNKNOWN.replace("fitted.csv", "none.csv"))
