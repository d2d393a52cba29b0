"""How sure results are: what is not known about the site, and the error of sampling, apart in every number."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from rock2d.design.possible_sites import PossibleSites, SiteResults
from rock2d.design.site_frequencies import frequency_draws

if TYPE_CHECKING:
    import pandas as pd

Array = np.ndarray

UNCERTAIN_COLUMNS = (
    "block", "line", "quantity", "sites", "releases", "value", "low95", "high95", "share_not_known", "share_sampling",
)  # fmt: skip
SENSITIVITY_COLUMNS = (
    "block", "line", "quantity", "parameter", "first_order", "first_order_error95", "total", "total_error95",
)  # fmt: skip
FREQUENCY = "frequency"
DESIGN_PERCENTILE = 95.0
FEWEST_CROSSINGS = 5  # of a site, for a percentile of what crosses there
DRAWS_PER_SITE = 200  # of the sampling error, for the bounds of the mixture over the sites


def uncertain_table(sites: PossibleSites, results: SiteResults, seed: int) -> pd.DataFrame:
    """Passing frequencies and 95th percentiles of energy and passing height over all possible sites;
    UNCERTAIN_COLUMNS.

    value: median over the sites. low95, high95: bounds of the mixture, over the sites, of what sampling leaves open
    about each. share_not_known and share_sampling: of the variance of what is written here. A frequency's upper bound
    counts unresolved releases as passed.
    """
    import pandas as pd

    rng = np.random.default_rng(np.random.SeedSequence(seed))
    own = sites.independent
    rows = []
    for b, block in enumerate(results.blocks):
        for k, line in enumerate(results.lines):
            passed, cut = results.passed[own, b, k], results.cut[own, b, k]
            head = (block, line)
            size = (len(own), passed.shape[1])
            rows.append((*head, FREQUENCY, *size, *_frequency(passed, cut, rng)))
            for quantity, values in results.crossings.items():
                found = _percentile(values[own, b, k], rng)
                rows.append((*head, f"{quantity}_{DESIGN_PERCENTILE:g}", *size, *found))
    return pd.DataFrame(rows, columns=list(UNCERTAIN_COLUMNS))


def _frequency(passed: Array, cut: Array, rng: np.random.Generator) -> tuple[float, ...]:
    """(median, low, high, share not known, share of sampling) of a passing frequency; arrays (sites, releases)."""
    n = passed.shape[1]
    k, k_most = passed.sum(axis=1), (passed | cut).sum(axis=1)
    low = frequency_draws(k, n, rng)
    high = frequency_draws(k_most, n, rng)
    sampling = float((k / n * (1 - k / n)).mean() / n)
    shares = _shares(_between(passed), sampling)
    return float(np.median(k / n)), float(np.quantile(low, 0.025)), float(np.quantile(high, 0.975)), *shares


def _between(passed: Array) -> float:
    """Variance of the frequency between sites, without the error of sampling: the covariance of two halves of the
    releases."""
    if len(passed) < 2:
        return 0.0
    halves = passed[:, 0::2].mean(axis=1), passed[:, 1::2].mean(axis=1)
    return max(float(np.cov(*halves)[0, 1]), 0.0)


def _shares(not_known: float, sampling: float) -> tuple[float, float]:
    total = not_known + sampling
    return (not_known / total, sampling / total) if total > 0.0 else (0.0, 0.0)


def _percentile(values: Array, rng: np.random.Generator) -> tuple[float, ...]:
    """As `_frequency`, of the percentile of `values` (sites, releases), NaN where a release did not cross.

    The sampling error of a site's percentile p of m values is that of the order statistic whose rank, over m + 1, is
    Beta(p (m + 1), (1 - p) (m + 1)). Sites with few crossings say nothing of it.
    """
    share = DESIGN_PERCENTILE / 100.0
    medians, draws = [], []
    for row in values:
        ranked = np.sort(row[np.isfinite(row)])
        m = len(ranked)
        if m >= FEWEST_CROSSINGS:
            u = rng.beta(share * (m + 1), (1 - share) * (m + 1), DRAWS_PER_SITE)
            draws.append(np.quantile(ranked, u))
            medians.append(np.quantile(ranked, share))
    if not draws:
        return (np.nan,) * 5
    drawn = np.array(draws)
    sampling = float(drawn.var(axis=1).mean())
    shares = _shares(max(float(np.var(medians)) - sampling, 0.0), sampling)
    return float(np.median(medians)), *np.quantile(drawn, (0.025, 0.975)).tolist(), *shares


def sensitivity_table(sites: PossibleSites, results: SiteResults, seed: int) -> pd.DataFrame:
    """Sobol indices of the passing frequencies; SENSITIVITY_COLUMNS.

    first_order: the share of the variance between sites that a parameter makes alone; total: with its interactions.
    Lines that every release, or none, passes at all sites are left out.
    """
    import pandas as pd
    from SALib.analyze import sobol

    names = list(sites.places)
    problem = {"num_vars": len(names), "names": names, "bounds": [[0.0, 1.0]] * len(names)}
    rows: list[tuple[Any, ...]] = []
    for b, block in enumerate(results.blocks):
        for k, line in enumerate(results.lines):
            frequency = results.passed[:, b, k].mean(axis=1)
            if np.ptp(frequency) == 0.0:
                continue
            found = sobol.analyze(problem, frequency, calc_second_order=False, seed=seed)
            for i, name in enumerate(names):
                values = (float(found[key][i]) for key in ("S1", "S1_conf", "ST", "ST_conf"))
                rows.append((block, line, FREQUENCY, name, *values))
    return pd.DataFrame(rows, columns=list(SENSITIVITY_COLUMNS))
