"""Confidence intervals against published values and simulated coverage."""

import numpy as np
import pytest

from rock2d.statistics import percentile_estimate, percentile_interval, wilson_interval


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
    bounds = np.array([percentile_interval(rng.exponential(size=n), percentile) for _ in range(runs)])
    covered = np.mean((bounds[:, 0] <= true) & (true <= bounds[:, 1]))
    assert covered > 0.95 - 3 * np.sqrt(0.95 * 0.05 / runs)


def test_too_few_passings_leave_the_upper_bound_open():
    values = np.arange(1.0, 368.0)
    assert np.isnan(percentile_interval(values, 99)[1])
    assert np.isnan(percentile_interval(values[:71], 95)[1])
    assert percentile_interval(values[:72], 95)[1] == 72.0
    assert np.isnan(percentile_interval(values[:1], 5)[0])


@pytest.mark.parametrize("percentile", [1.0, 5.0, 50.0, 95.0, 99.0])
def test_a_percentile_lies_in_its_interval(percentile):
    for n in range(1, 400):
        value, low, high = percentile_estimate(dict(enumerate(map(float, range(n)))), n, percentile)
        assert not (value < low or value > high), n
