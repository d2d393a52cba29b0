"""The frequency at a further site, from what is known of many."""

import numpy as np
import pytest
from scipy import stats

from rock2d.design.site_frequencies import further_site_quantile


@pytest.mark.parametrize("level", [0.025, 0.5, 0.975])
def test_a_single_site_has_the_posterior_with_jeffreys_prior(level):
    assert further_site_quantile(np.array([7]), 50, level) == pytest.approx(stats.beta(7.5, 43.5).ppf(level))


def test_sites_that_agree_support_each_other():
    """None of 200 at each of 32 sites: the pooled bound for none of 6,400 is 0.03 %, that of one site 0.95 %."""
    assert further_site_quantile(np.zeros(32), 200, 0.95) < 0.002
    assert further_site_quantile(np.zeros(1), 200, 0.95) == pytest.approx(stats.beta(0.5, 200.5).ppf(0.95))


def test_a_further_site_can_be_as_any_of_those_that_differ():
    k = np.array([0] * 16 + [100] * 16)
    assert further_site_quantile(k, 200, 0.05) < 0.01 and further_site_quantile(k, 200, 0.95) > 0.5


@pytest.mark.parametrize(("mean", "strength"), [(0.003, 30.0), (0.02, 3000.0), (0.3, 2.0)])
def test_the_bound_of_a_further_site_holds_as_often_as_it_says(mean, strength):
    """A further site of the same population is below the 95 % bound of 32 others in about 95 of 100 worlds; where
    nearly no block passes at most sites, more often. The exact share below each of 100 bounds: a bound that holds in
    88 of 100 is seen with 99 %."""
    population, rng = stats.beta(mean * strength, (1 - mean) * strength), np.random.default_rng(3)
    below = []
    for _ in range(100):
        passed = rng.binomial(200, population.rvs(32, random_state=rng))
        below.append(population.cdf(further_site_quantile(passed, 200, 0.95)))
    assert 0.92 <= np.mean(below) <= (0.975 if mean > 0.01 else 1.0)
