"""Confidence intervals of frequencies and percentiles, the counts that they need, and a weighted median.

Sources: E. B. Wilson, Probable inference, the law of succession, and statistical inference, J. Am. Stat. Assoc. 22
(1927) 209-212; H. A. David and H. N. Nagaraja, Order Statistics, 3rd ed., Wiley 2003, section 7.1."""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from collections.abc import Mapping, Sequence
from functools import cache
from typing import NamedTuple

import numpy as np

from rock2d.arrays import Array

DESIGN_PERCENTILE = 95.0  # that structures are designed by
NORMAL_95 = 1.959964  # standard errors of a 95 % interval
MAD_TO_SD = 1.4826  # standard deviation over median absolute deviation of a normal distribution


class Estimate(NamedTuple):
    """A value with its 95 % interval; a bound that is not known is NaN."""

    value: float
    low: float
    high: float

    @staticmethod
    def within(value: float, low: float, high: float) -> Estimate:
        """The estimate, with the value moved into its interval.

        Value and bounds can come from different estimators: an interpolated percentile and order statistics."""
        return Estimate(float(np.fmin(np.fmax(value, low), high)), low, high)

    def times(self, factor: float) -> Estimate:
        """The estimate times a positive number."""
        return Estimate(*(factor * each for each in self))

    def plus(self, term: float) -> Estimate:
        """The estimate plus a number."""
        return Estimate(*(each + term for each in self))


def wilson_interval(passed: int, releases: int) -> tuple[float, float]:
    """Wilson's 95 % score interval of a frequency. Raises ValueError unless 0 <= passed <= releases > 0."""
    from scipy.special import ndtri  # scipy.stats takes over a second to import

    if not 0 <= passed <= releases or releases < 1:
        raise ValueError(f"no frequency: {passed} of {releases}")
    z = float(ndtri(0.975))
    centre, n = passed + 0.5 * z**2, releases + z**2
    half = z * np.sqrt(passed * (releases - passed) / releases + 0.25 * z**2)
    low = 0.0 if passed == 0 else (centre - half) / n
    high = 1.0 if passed == releases else (centre + half) / n
    return float(low), float(high)


def wilson_share(hits: Sequence[bool]) -> list[float]:
    """Share of the hits with its 95 % interval: [share, low, high, count]; a share of NaN without any."""
    count, total = sum(map(bool, hits)), len(hits)
    if total == 0:
        return [float("nan"), 0.0, 1.0, 0]
    return [count / total, *wilson_interval(count, total), total]


def share_text(share: Sequence[float]) -> str:
    """A `wilson_share` in words."""
    if share[3] == 0:
        return "no case"
    return f"{100 * share[0]:.1f} % [{100 * share[1]:.1f}, {100 * share[2]:.1f}] of {share[3]:.0f}"


@cache
def student(freedom: float) -> float:
    """By how much few degrees of freedom (at least 1) widen a 95 % interval: Student's quantile over the normal one."""
    from scipy.special import stdtrit

    return float(stdtrit(max(freedom, 1.0), 0.975)) / NORMAL_95


def weighted_median(values: Array, weights: Array) -> float:
    """Median of values (n,) that count by their weights (n,); infinite if all weights are 0."""
    order = np.argsort(values)
    passed = np.cumsum(weights[order])
    return float(values[order][np.searchsorted(passed, 0.5 * passed[-1])]) if passed[-1] > 0 else np.inf


def noise_of_path(rows: Array) -> float:
    """Noise, 1 sigma, of the rows (n, k) of a smooth path, from their second differences; few jumps do not count."""
    return float(MAD_TO_SD / np.sqrt(6.0) * np.median(np.abs(np.diff(rows, 2, axis=0))))


@cache
def least_count(percentile: float) -> int:
    """The least number of values of which a percentile has a 95 % interval: 6, 72 and 368 for 50, 95 and 99 %."""
    n = 1
    while _interval_ranks(n, percentile)[0] < 0 or _interval_ranks(n, percentile)[1] >= n:
        n += 1
    return n


def percentile_ranks(n: int, percentile: float) -> list[int]:
    """Ranks (from 0, of n > 0 values) of the sorted values that `percentile_estimate` looks at."""
    if n < least_count(percentile):
        return []
    below, _ = _percentile_rank(n, percentile)
    ranks = {below, min(below + 1, n - 1), *_interval_ranks(n, percentile)}
    return sorted(rank for rank in ranks if 0 <= rank < n)


def percentile_estimate(ranked: Mapping[int, float] | Array, n: int, percentile: float) -> Estimate:
    """A percentile, linear between the two nearest of n sorted values, with its distribution-free 95 % interval from
    order statistics; NaN where n is less than `least_count`. `ranked` gives the value of each of `percentile_ranks`.

    Of n values the number below the p-quantile is Binomial(n, p); the bounds are the sorted values X(l), X(u)
    (from 1) with the largest l and smallest u for which P(B < l) and P(B >= u) are each at most 2.5 %."""
    if n < least_count(percentile):
        return Estimate(np.nan, np.nan, np.nan)
    below, weight = _percentile_rank(n, percentile)
    a, b = ranked[below], ranked[min(below + 1, n - 1)]
    low, high = (ranked[rank] for rank in _interval_ranks(n, percentile))
    value = a + (b - a) * weight if weight < 0.5 else b - (b - a) * (1.0 - weight)  # as numpy rounds it
    return Estimate.within(value, low, high)


def _percentile_rank(n: int, percentile: float) -> tuple[int, float]:
    """Rank (from 0) below which, and how far above which, the percentile lies among n sorted values."""
    at = (n - 1) * (percentile / 100.0)
    return int(at), at - int(at)


@cache
def _interval_ranks(n: int, percentile: float) -> tuple[int, int]:
    """Ranks (from 0) of the bounds of the interval of a percentile; -1 and n where there is none."""
    from scipy.special import bdtr

    def below(k: int) -> float:
        return float(bdtr(k, n, percentile / 100.0))  # P(B <= k)

    lower = bisect_right(range(n), 0.025, key=below)  # how many l have P(B < l) <= 2.5 %
    upper = bisect_left(range(n), 0.975, key=below) + 1  # smallest u with P(B < u) >= 97.5 %
    return lower - 1, upper - 1
