"""Frequency at a further site from counts at many possible sites, by a beta-binomial model.

The frequencies of the sites are Beta(mu nu, (1 - mu) nu), the counts binomial. mu has Jeffreys' prior, nu is uniform in
its logarithm. So sites that agree support each other: 0 of 200 blocks at each of 30 sites say more about a further site
than 0 of 200 at one. Source: Gelman et al., Bayesian Data Analysis, 3rd ed. 2013, section 5.3."""

import numpy as np

from rock2d.arrays import Array

SMALLEST_WEIGHT = 1e-8  # of a point of the grid, relative to the largest
PRECISION = 1e-8  # of a quantile
MEAN_VALUES = 120  # values of mu, equally spaced in arcsin sqrt mu, where Jeffreys' prior is uniform
LOWEST_STRENGTH, HIGHEST_STRENGTH, STRENGTH_VALUES = 1.0, 1.0e5, 16  # range and number of the values of nu


def further_site_quantile(passed: Array, of: Array | float, level: float) -> float:
    """The quantile of this level of the frequency at a further site, given `passed` (sites,) of `of` releases at each
    site, (sites,) or one number.

    The real site counts as a further one: its frequency is Beta(mu nu, (1 - mu) nu), with the posterior of mu and nu.
    With a single site, it has the posterior of that site with Jeffreys' prior."""
    from scipy.optimize import brentq
    from scipy.special import betainc, betaincinv

    k, n = np.broadcast_arrays(np.asarray(passed, float), np.asarray(of, float))
    if len(k) == 1:
        return float(betaincinv(k[0] + 0.5, n[0] - k[0] + 0.5, level))
    angle = (np.arange(MEAN_VALUES) + 0.5) / MEAN_VALUES * 0.5 * np.pi
    grid = _refined(k, n, angle)
    a, b, weight = _posterior(k, n, np.sin(grid) ** 2)
    kept = weight > SMALLEST_WEIGHT * weight.max()
    a, b, weight = a[kept], b[kept], weight[kept] / weight[kept].sum()
    return float(brentq(lambda share: weight @ betainc(a, b, share) - level, 0.0, 1.0, xtol=PRECISION))


def _refined(k: Array, n: Array, angle: Array) -> Array:
    """Equally spaced angles in the range where the posterior of mu has its weight."""
    for _ in range(2):
        _, _, weight = _posterior(k, n, np.sin(angle) ** 2)
        marginal = weight.reshape(-1, STRENGTH_VALUES).sum(axis=1)
        support = np.flatnonzero(marginal > 1e-6 * marginal.max())
        step = angle[1] - angle[0]
        low, high = max(angle[support[0]] - step, 0.0), min(angle[support[-1]] + step, 0.5 * np.pi)
        angle = low + (high - low) * (np.arange(MEAN_VALUES) + 0.5) / MEAN_VALUES
    return angle


def _posterior(k: Array, n: Array, mu: Array) -> tuple[Array, Array, Array]:
    """a, b and weight (with sum 1) at all points of the grid of mu and nu, one-dimensional."""
    from scipy.special import betaln

    nu = np.geomspace(LOWEST_STRENGTH, HIGHEST_STRENGTH, STRENGTH_VALUES)
    a, b = (np.outer(share, nu).reshape(-1) for share in (mu, 1.0 - mu))
    (counts, of), number = np.unique(np.stack([k, n]), axis=1, return_counts=True)
    each = betaln(a[:, None] + counts, b[:, None] + of - counts) - betaln(a, b)[:, None]
    log_weight = each @ number
    weight = np.exp(log_weight - log_weight.max())
    return a, b, weight / weight.sum()
