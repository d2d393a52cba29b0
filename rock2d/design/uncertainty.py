"""Uncertainty of results: what is not known about the site and the error of sampling, separately."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from rock2d.arrays import Array
from rock2d.design.possible_sites import PossibleSites, SiteResults
from rock2d.design.site_frequencies import further_site_quantile
from rock2d.statistics import DESIGN_PERCENTILE, Estimate

if TYPE_CHECKING:
    import pandas as pd

UNCERTAIN_COLUMNS = (
    "block", "line", "quantity", "sites", "releases", "value", "low95", "high95", "share_not_known", "share_sampling",
    "unresolved",
)  # fmt: skip
SENSITIVITY_COLUMNS = (
    "block", "line", "quantity", "parameter", "first_order", "first_order_error95", "total", "total_error95",
)  # fmt: skip
FREQUENCY, PER_ARRIVING = "frequency", "per_arriving"
SHARES = {FREQUENCY: "passing frequency", PER_ARRIVING: "passing, of arriving blocks"}
FEWEST_CROSSINGS = 5  # fewest crossings at a site for a percentile
FURTHER_SITES = 4000  # draws of a further site, for the bounds of a percentile
DRAWS_PER_SITE = 200  # draws of the sampling error of the percentile of a site


def uncertain_table(sites: PossibleSites, results: SiteResults, seed: int) -> pd.DataFrame:
    """Passing frequencies of the released and of the arriving blocks, and 95th percentiles of energy, passing height
    and speed over all possible sites; UNCERTAIN_COLUMNS.

    - value: median over the sites
    - low95, high95: bounds for a further site, such as the real one; the upper bound of a frequency counts unresolved
      releases as passed
    - share_not_known, share_sampling: shares of the variance; NaN without variance
    - unresolved: share of unresolved releases over all sites"""
    import pandas as pd

    rng = np.random.default_rng(np.random.SeedSequence(seed))
    own = sites.independent
    rows = []
    for b, block in enumerate(results.blocks):
        for k, line in enumerate(results.lines):
            passed, unresolved = results.passed[own, b, k], results.unresolved[own, b, k]
            head, share = (block, line), float(unresolved.mean())
            size = (len(own), passed.shape[1])
            arrived = results.arrived[own, b, k]
            for quantity, of in ((FREQUENCY, np.ones_like(passed)), (PER_ARRIVING, arrived)):
                rows.append((*head, quantity, *size, *_frequency(passed, unresolved, of), share))
            for quantity, values in results.crossings.items():
                found = _percentile(values[own, b, k], rng)
                rows.append((*head, f"{quantity}_{DESIGN_PERCENTILE:g}", *size, *found, share))
    return pd.DataFrame(rows, columns=list(UNCERTAIN_COLUMNS))


def _frequency(passed: Array, unresolved: Array, of: Array) -> tuple[float, ...]:
    """(median, low, high, share not known, share of sampling) of the share of the releases `of` that pass; arrays
    (sites, releases) bool. NaN if there are no such releases. Unresolved releases may belong to them, too.

    If no release passes at more than 2.5 % of the sites, the lower bound is 0; if all pass at more than 2.5 %, the
    upper bound is 1. A posterior never reaches these values, but a site can."""
    some = of.any(axis=1)
    if not some.any():
        return (np.nan,) * 5
    passed, unresolved, of = passed[some], unresolved[some], of[some]
    n, n_most = of.sum(axis=1), (of | unresolved).sum(axis=1)
    k, k_most = (passed & of).sum(axis=1), (passed & of | unresolved).sum(axis=1)

    lowest = 0.0 if (k == 0).mean() > 0.025 else further_site_quantile(k, n_most, 0.025)
    highest = 1.0 if (k_most == n_most).mean() > 0.025 else further_site_quantile(k_most, n_most, 0.975)
    shares = _shares(_between(passed, of), float((k / n * (1 - k / n) / n).mean()))
    median = float(np.median(k / n))
    return median, min(lowest, median), max(median, highest), *shares


def _between(passed: Array, of: Array) -> float:
    """Variance of the frequency between sites, without the error of sampling: the covariance of two halves of the
    releases."""
    counts = [((passed & of)[:, i::2].sum(axis=1), of[:, i::2].sum(axis=1)) for i in (0, 1)]
    both = np.all([n > 0 for _, n in counts], axis=0)
    if both.sum() < 2:
        return 0.0
    halves = [k[both] / n[both] for k, n in counts]
    return max(float(np.cov(*halves)[0, 1]), 0.0)


def _shares(not_known: float, sampling: float) -> tuple[float, float]:
    total = not_known + sampling
    return (not_known / total, sampling / total) if total > 0.0 else (np.nan, np.nan)


def _percentile(values: Array, rng: np.random.Generator) -> tuple[float, ...]:
    """As `_frequency`, for the percentile of `values` (sites, releases), NaN if a release did not cross.

    The percentile of a small sample is biased low. Of m values it has the rank p (m - 1) + 1, so its level is a Beta
    variable with mean (p (m - 1) + 1) / (m + 1) and m + 1 values. The values of all sites together, whose tail is known
    much better, give its deviation from the true percentile. Sites with few crossings are not used.

    The bounds are those of a further site, which is normally distributed. The error of the mean is the spread over
    sqrt(n). The variance between the n sites is a draw from the posterior of the total variance, (n - 1) s² / chi²,
    minus the variance of sampling (Gelman et al., Bayesian Data Analysis, 3rd ed. 2013, section 3.2)."""
    share = DESIGN_PERCENTILE / 100.0
    crossed = [row[np.isfinite(row)] for row in values]
    crossed = [at_site for at_site in crossed if len(at_site) >= FEWEST_CROSSINGS]
    if not crossed:
        return (np.nan,) * 5
    together = np.concatenate(crossed)
    true = np.quantile(together, share)
    draws = []
    for at_site in crossed:
        m = len(at_site)
        rank = share * (m - 1) + 1.0
        levels = rng.beta(rank, m + 1 - rank, DRAWS_PER_SITE)
        draws.append(np.quantile(at_site, share) + true - np.quantile(together, levels))
    at = np.mean(draws, axis=1)
    error = np.array(draws) - at[:, None]
    sampling = float(error.var(axis=1).mean())
    shares = _shares(max(float(np.var(at)) - sampling, 0.0), sampling)
    n = len(at)
    total = np.var(at, ddof=1) * (n - 1) / rng.chisquare(n - 1, FURTHER_SITES) if n > 1 else np.zeros(FURTHER_SITES)
    between = np.maximum(total - sampling, 0.0)
    mean = at.mean() + np.sqrt(np.maximum(total, sampling) / n) * rng.standard_normal(FURTHER_SITES)
    further = mean + np.sqrt(between) * rng.standard_normal(FURTHER_SITES)
    low, high = np.quantile(further, (0.025, 0.975))
    return *Estimate.within(float(np.median(at)), float(low), float(high)), *shares


def sensitivity_table(sites: PossibleSites, results: SiteResults, seed: int) -> pd.DataFrame:
    """Sobol indices of the passing frequencies; SENSITIVITY_COLUMNS.

    first_order: share of a parameter alone in the variance between sites; total: share with its interactions. Lines
    whose frequency is the same at all independent sites are left out, because they have no variance."""
    import warnings

    import pandas as pd
    from SALib.analyze import sobol

    names = list(sites.places)
    problem = {"num_vars": len(names), "names": names, "bounds": [[0.0, 1.0]] * len(names)}
    rows: list[tuple[Any, ...]] = []
    for b, block in enumerate(results.blocks):
        for k, line in enumerate(results.lines):
            frequency = results.passed[:, b, k].mean(axis=1)
            if np.ptp(frequency[sites.independent]) == 0.0:
                continue
            with warnings.catch_warnings():  # bootstrap samples of few sites can be constant
                warnings.simplefilter("ignore")
                found = sobol.analyze(problem, frequency, calc_second_order=False, seed=seed)
            for i, name in enumerate(names):
                values = (float(found[key][i]) for key in ("S1", "S1_conf", "ST", "ST_conf"))
                rows.append((block, line, FREQUENCY, name, *values))
    return pd.DataFrame(rows, columns=list(SENSITIVITY_COLUMNS))
