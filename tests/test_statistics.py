"""Confidence intervals against published values and simulated coverage."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rock2d.statistics import Estimate, least_count, percentile_estimate, wilson_interval


@pytest.mark.parametrize(
    ("passed", "releases", "low", "high"),  # Newcombe (1998), table I, method 3
    [(81, 263, 0.2553, 0.3662), (15, 148, 0.0624, 0.1605), (0, 20, 0.0, 0.1611), (1, 29, 0.0061, 0.1718)],
)
def test_wilson_intervals_as_published(passed, releases, low, high):
    assert wilson_interval(passed, releases) == pytest.approx((low, high), abs=5e-5)


@pytest.mark.parametrize(("percentile", "n"), [(95, 72), (95, 500), (99, 368), (99, 2000)])
def test_percentile_intervals_cover_the_true_percentile(percentile, n):
    rng, runs = np.random.default_rng(n), 2000
    true = -np.log(1 - percentile / 100)
    ranked = np.sort([rng.exponential(size=n) for _ in range(runs)], axis=1)
    bounds = np.array([percentile_estimate(own, n, percentile) for own in ranked])
    covered = np.mean((bounds[:, 1] <= true) & (true <= bounds[:, 2]))
    assert covered > 0.95 - 3 * np.sqrt(0.95 * 0.05 / runs)


@pytest.mark.parametrize(("percentile", "least"), [(5.0, 72), (50.0, 6), (95.0, 72), (99.0, 368)])
def test_a_percentile_is_given_from_the_count_on_that_its_interval_needs(percentile, least):
    """P(no value above the percentile) = p^n, and P(none below), must each be at most 2.5 %."""
    p = percentile / 100
    assert least_count(percentile) == least == np.ceil(np.log(0.025) / np.log(max(p, 1 - p)))


@given(st.floats(-1e9, 1e9), st.floats(-1e9, 1e9), st.floats(0, 1e9))
def test_an_estimate_lies_in_its_interval(value, low, width):
    found = Estimate.within(value, low, low + width)
    assert found.low <= found.value <= found.high
    assert Estimate.within(value, np.nan, np.nan).value == value
