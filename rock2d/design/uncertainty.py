"""How sure results are: what is not known about the site, and the error of sampling, apart in every number."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from rock2d.design.possible_sites import PossibleSites, SiteResults
from rock2d.design.site_frequencies import further_site_draws
from rock2d.statistics import DESIGN_PERCENTILE, Estimate

if TYPE_CHECKING:
    import pandas as pd

Array = np.ndarray

UNCERTAIN_COLUMNS = (
    "block", "line", "quantity", "sites", "releases", "value", "low95", "high95", "share_not_known", "share_sampling",
    "unresolved",
)  # fmt: skip
SENSITIVITY_COLUMNS = (
    "block", "line", "quantity", "parameter", "first_order", "first_order_error95", "total", "total_error95",
)  # fmt: skip
FREQUENCY, PER_ARRIVING = "frequency", "per_arriving"
SHARES = {FREQUENCY: "passing frequency", PER_ARRIVING: "passing, of arriving blocks"}
FEWEST_CROSSINGS = 5  # crossings that a site must have for a percentile of them
FURTHER_SITES = 4000  # draws of a further site, for the bounds of a percentile
DRAWS_PER_SITE = 200  # draws of the sampling error of a site's percentile


def uncertain_table(sites: PossibleSites, results: SiteResults, seed: int) -> pd.DataFrame:
    """Passing frequencies of the released and of the arriving blocks, and 95th percentiles of energy, passing height
    and speed over all possible sites; UNCERTAIN_COLUMNS.

    value: median over the sites. low95, high95: bounds for a further site, as the real one is. share_not_known and
    share_sampling: shares of the variance of what is written here. A frequency's upper bound counts unresolved
    releases as passed; unresolved: their share over all sites.
    """
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
                rows.append((*head, quantity, *size, *_frequency(passed, unresolved, of, rng), share))
            for quantity, values in results.crossings.items():
                found = _percentile(values[own, b, k], rng)
                rows.append((*head, f"{quantity}_{DESIGN_PERCENTILE:g}", *size, *found, share))
    return pd.DataFrame(rows, columns=list(UNCERTAIN_COLUMNS))


def _frequency(passed: Array, unresolved: Array, of: Array, rng: np.random.Generator) -> tuple[float, ...]:
    """(median, low, high, share not known, share of sampling) of the frequency with which releases `of` a kind pass;
    arrays (sites, releases) bool. NaN if there are none.

    Where no release passes at more than 2.5 % of the sites the lower bound is 0, and where all pass the upper is 1:
    a posterior never reaches either, a site can.
    """
    some = of.any(axis=1)
    if not some.any():
        return (np.nan,) * 5
    passed, unresolved, of = passed[some], unresolved[some], of[some]
    n = of.sum(axis=1)
    k, k_most = (passed & of).sum(axis=1), ((passed | unresolved) & of).sum(axis=1)

    def bound(counts: Array, level: float) -> float:
        return float(np.quantile(further_site_draws(counts, n, rng), level))

    lowest = 0.0 if (k == 0).mean() > 0.025 else bound(k, 0.025)
    highest = 1.0 if (k_most == n).mean() > 0.025 else bound(k_most, 0.975)
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
    return (not_known / total, sampling / total) if total > 0.0 else (0.0, 0.0)


def _percentile(values: Array, rng: np.random.Generator) -> tuple[float, ...]:
    """As `_frequency`, of the percentile of `values` (sites, releases), NaN where a release did not cross.

    Of few values the sample percentile lies too low: of m values it has the rank p (m - 1) + 1, a level of (p (m - 1)
    + 1) / (m + 1) on average, and its level is a Beta variable with that mean and m + 1 values. How far that is from
    the true percentile follows from the values of all sites together, whose tail is known much better than that of a
    single site. Sites with few crossings say nothing of it. The percentiles of n sites spread by their sampling
    error, too. The bounds are those of a further site: normal about a mean that is known to the spread over sqrt(n),
    with the variance between the sites that is left of a variance drawn from its posterior ((n - 1) s² / chi²) after
    that of sampling (Gelman et al., Bayesian Data Analysis, 3rd ed. 2013, section 3.2).
    """
    share = DESIGN_PERCENTILE / 100.0
    crossed = [row[np.isfinite(row)] for row in values]
    crossed = [own for own in crossed if len(own) >= FEWEST_CROSSINGS]
    if not crossed:
        return (np.nan,) * 5
    together = np.concatenate(crossed)
    true = np.quantile(together, share)
    known = []
    for own in crossed:
        m = len(own)
        rank = share * (m - 1) + 1.0
        levels = rng.beta(rank, m + 1 - rank, DRAWS_PER_SITE)
        known.append(np.quantile(own, share) + true - np.quantile(together, levels))
    at = np.mean(known, axis=1)
    error = np.array(known) - at[:, None]
    sampling = float(error.var(axis=1).mean())
    shares = _shares(max(float(np.var(at)) - sampling, 0.0), sampling)
    n = len(at)
    total = (
        np.var(at, ddof=1) * (n - 1) / rng.chisquare(n - 1, FURTHER_SITES)
        if n > 1
        else np.zeros(FURTHER_SITES)
    )
    between = np.maximum(total - sampling, 0.0)
    mean = at.mean() + np.sqrt(np.maximum(total, sampling) / n) * rng.standard_normal(FURTHER_SITES)
    further = mean + np.sqrt(between) * rng.standard_normal(FURTHER_SITES)
    low, high = np.quantile(further, (0.025, 0.975))
    return *Estimate.within(float(np.median(at)), float(low), float(high)), *shares


def sensitivity_table(sites: PossibleSites, results: SiteResults, seed: int) -> pd.DataFrame:
    """Sobol indices of the passing frequencies; SENSITIVITY_COLUMNS.

    first_order: the share of the variance between sites that a parameter makes alone; total: with its interactions.
    Lines are left out whose frequency is the same at all independent sites: there is no variance to share.
    """
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
            with warnings.catch_warnings():  # resamples of few sites can be constant: they widen the errors
                warnings.simplefilter("ignore")
                found = sobol.analyze(problem, frequency, calc_second_order=False, seed=seed)
            for i, name in enumerate(names):
                values = (float(found[key][i]) for key in ("S1", "S1_conf", "ST", "ST_conf"))
                rows.append((block, line, FREQUENCY, name, *values))
    return pd.DataFrame(rows, columns=list(SENSITIVITY_COLUMNS))
