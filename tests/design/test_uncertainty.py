"""Intervals over possible sites hold the truth as often as they say, and the shares of the variance are right."""

import numpy as np
import pandas as pd
import pytest
from scipy import special

from rock2d.design.assessment import Assessment
from rock2d.design.possible_sites import PossibleSites, SiteResults, draw_sites, simulate_sites, variants_of
from rock2d.design.uncertainty import sensitivity_table, uncertain_table
from rock2d.files.scenario_variants import variant
from tests.scenarios_of_tests import small_site


def saltelli(n: int, d: int, seed: int) -> PossibleSites:
    """A design of d uniform values."""
    from SALib.sample import sobol

    problem = {"num_vars": d, "names": list("abcdef")[:d], "bounds": [[0.0, 1.0]] * d}
    return PossibleSites(tuple("abcdef"[:d]), sobol.sample(problem, n, calc_second_order=False, seed=seed))


def drawn(
    frequency: np.ndarray, releases: int, rng: np.random.Generator, energy_J: np.ndarray, step: int
) -> SiteResults:
    """What one block does at one line: each release passes with its site's frequency (sites,), with an exponential
    energy of its site's mean. None is seen to arrive: a share of the arriving blocks is not asked for."""
    groups = np.repeat(np.arange(len(frequency) // step), step)  # whose sites share their releases
    u, energies = rng.random((groups[-1] + 1, releases)), rng.exponential(1.0, (groups[-1] + 1, releases))
    passed = (u[groups] < frequency[:, None])[:, None, None, :]
    energy = energies[groups] * energy_J[:, None]
    crossed = np.where(passed, energy[:, None, None, :], np.nan)
    none = np.zeros_like(passed)
    return SiteResults(("ball",), ("crest",), passed, none, none, {"kinetic_J": crossed})


def test_sites_are_independent_but_for_those_that_share_all_values_but_one():
    sites = saltelli(8, 3, 1)
    first, last = sites.values[0::5], sites.values[4::5]
    for i in range(3):
        between = sites.values[1 + i :: 5]
        changed = [k for k in range(3) if not np.array_equal(between[:, k], first[:, k])]
        assert changed == [i] and np.array_equal(between[:, i], last[:, i])
    assert np.array_equal(sites.values[sites.independent], first)
    seeds = [sites.release_seed(i) for i in range(len(sites.values))]
    assert len(set(seeds)) == 8 and all(len(set(seeds[5 * g : 5 * g + 5])) == 1 for g in range(8))


def test_the_intervals_hold_the_truth_in_95_of_100_sites():
    """Truths: sites drawn from the same distribution as the possible ones, their frequencies and percentiles exact.
    Each of 100 intervals is held to 200 truths: their share is known to half a per cent."""
    rng = np.random.default_rng(7)
    held = {"frequency": [], "kinetic_J_95": []}

    def frequency(u: np.ndarray) -> np.ndarray:
        return special.expit(-1.0 + 0.8 * special.ndtri(u[:, 0]))

    def mean_J(u: np.ndarray) -> np.ndarray:
        return 100.0 * np.exp(0.5 * special.ndtri(u[:, 1]))

    for trial in range(100):
        sites = saltelli(32, 2, trial)
        results = drawn(frequency(sites.values), 200, rng, mean_J(sites.values), 4)
        table = uncertain_table(sites, results, trial).set_index("quantity")
        truth = rng.random((200, 2))
        exact = {"frequency": frequency(truth), "kinetic_J_95": mean_J(truth) * np.log(20.0)}
        for quantity, values in exact.items():
            low, high = table.loc[quantity, ["low95", "high95"]]
            held[quantity].append(np.mean((low <= values) & (values <= high)))
    for quantity, shares in held.items():
        assert 0.92 <= np.mean(shares) <= 0.98, (quantity, np.mean(shares))


@pytest.mark.parametrize("spread", [0.0, 0.3])
def test_what_is_not_known_and_sampling_are_told_apart(spread):
    """Var(P) = spread²/12 between the sites; sampling makes P (1 - P) / n."""
    rng = np.random.default_rng(1)
    shares = []
    for trial in range(20):
        sites = saltelli(64, 1, trial)
        frequency = 0.3 + spread * (sites.values[:, 0] - 0.5)
        passed = rng.random((len(frequency), 1, 1, 100)) < frequency[:, None, None, None]
        results = SiteResults(("ball",), ("crest",), passed, np.zeros_like(passed), passed, {})
        shares.append(uncertain_table(sites, results, trial)["share_not_known"][0])
    not_known, sampling = spread**2 / 12.0, (0.3 * 0.7 - spread**2 / 12.0) / 100.0
    assert np.mean(shares) == pytest.approx(not_known / (not_known + sampling), abs=0.06)


def test_unresolved_releases_widen_the_upper_bound_alone():
    sites = saltelli(16, 1, 1)
    passed = np.zeros((len(sites.values), 1, 1, 100), bool)
    cut = passed.copy()
    cut[..., :20] = True
    sure, unsure = (
        uncertain_table(sites, SiteResults(("ball",), ("crest",), passed, c, passed, {}), 1).iloc[0]
        for c in (passed, cut)
    )
    assert sure["low95"] == 0.0 and sure["high95"] < 0.03 and 0.2 < unsure["high95"] < 0.35
    assert unsure["low95"] == sure["low95"]


def test_sobol_indices_of_a_linear_result():
    """P = 0.5 + 0.3 (u_a - 0.5) + 0.1 (u_b - 0.5): a makes 9/10 of the variance, b 1/10, c nothing; sampling nothing,
    with as many releases as are evenly spread."""
    sites = saltelli(512, 3, 4)
    frequency = 0.5 + 0.3 * (sites.values[:, 0] - 0.5) + 0.1 * (sites.values[:, 1] - 0.5)
    passed = ((np.arange(4000) + 0.5) / 4000 < frequency[:, None])[:, None, None, :]
    table = sensitivity_table(sites, SiteResults(("ball",), ("crest",), passed, passed & False, passed, {}), 1)
    for column in ("first_order", "total"):
        assert table.set_index("parameter")[column].to_numpy() == pytest.approx([0.9, 0.1, 0.0], abs=0.02)


@pytest.mark.parametrize("engine", ["batch", "point_mass"])
def test_the_same_site_twice_has_the_same_releases(tmp_path, engine):
    scenario = small_site(tmp_path, "", engine)
    same = variant(scenario, {})
    results = simulate_sites([same, same], engine, [3, 3], 30)
    assert results.passed.any() and np.array_equal(results.passed[0], results.passed[1])
    assert np.array_equal(results.crossings["kinetic_J"][0], results.crossings["kinetic_J"][1], equal_nan=True)
    other = simulate_sites([same], engine, [4], 30)
    assert not np.array_equal(other.crossings["kinetic_J"], results.crossings["kinetic_J"][:1], equal_nan=True)


def test_drawn_sites_are_scenarios_with_these_values(tmp_path):
    scenario = small_site(tmp_path)
    sites = draw_sites(scenario, 5)
    assert sites.values.shape == (4 * (2 + 2), 2)
    assert np.array_equal(sites.values, draw_sites(scenario, 5).values)
    assert sites.values[:, 0].min() > 0.7 * 2.4e7 and sites.values[:, 0].max() < 1.3 * 2.4e7
    for i, own in enumerate(variants_of(scenario, sites)):
        law = own.contact_parameters(next(iter(own.make_blocks().values())))["default"]
        assert [law.k_ul_N_m, law.friction_angle_deg] == sites.values[i].tolist()


def test_releases_that_are_not_resolved_are_told(tmp_path):
    passed, cut = np.zeros((8, 1, 1, 50), bool), np.zeros((8, 1, 1, 50), bool)
    cut[3, 0, 0, :10] = True
    sites = PossibleSites(("a",), np.zeros((24, 1)))
    passed, cut = np.repeat(passed, 3, axis=0), np.repeat(cut, 3, axis=0)
    whole = SiteResults(("ball",), ("crest",), passed, cut, passed, {})
    table = uncertain_table(sites, whole, 1)
    assert table["unresolved"].iloc[0] == pytest.approx(10 / 400)
    told = Assessment(table, sensitivity_table(sites, whole, 1), pd.DataFrame()).text()
    assert "2.5 % of the releases of ball were cut short or buried" in told
    none = uncertain_table(
        sites, SiteResults(("ball",), ("crest",), whole.passed, whole.unresolved & False, whole.passed, {}), 1
    )
    assert "buried" not in Assessment(none, sensitivity_table(sites, whole, 1), pd.DataFrame()).text()
