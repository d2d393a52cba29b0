"""Likelihood of the published counts and of the statements on first impacts, given simulated releases.

Both are counts of 50 filmed releases, compared with counts of simulated releases. With Jeffreys' prior for the
frequencies, the probability of the filmed counts given the simulated counts is Dirichlet-multinomial. It includes the
sampling error of the simulation."""

import numpy as np
from scipy.special import gammaln, logsumexp, xlogy

from rock2d.arrays import Array
from rock2d.reproduction import published
from rock2d.reproduction.outcomes import DITCH_ID, FACING_ID, Outcome


def log_counts(simulated: Array, filmed: Array) -> Array:
    """(k,) log-probability of `filmed` counts (c,) by category, given `simulated` counts (k, c) of each hypothesis.

    Dirichlet-multinomial with 1/2 added to each simulated count."""
    return _log_dirichlet_multinomial(simulated + 0.5, filmed)


def log_counts_without_line(line: int, simulated: Array, filmed: Array) -> Array:
    """(k,) as `log_counts` if the number that passed one line (0, 1, 2) is unknown.

    The releases that ended between the previous and this line, and those that ended between this and the next line,
    form one category; 1 is added to its simulated count."""
    return _log_dirichlet_multinomial(_merge_around_line(simulated + 0.5, line), _merge_around_line(filmed, line))


def highest_log_counts(filmed: Array) -> float:
    """Upper bound of `log_counts`: the multinomial log-probability of `filmed` under its own frequencies, because a
    Dirichlet-multinomial is a mixture of multinomials."""
    total = filmed.sum()
    return float(gammaln(total + 1.0) + (xlogy(filmed, filmed / total) - gammaln(filmed + 1.0)).sum())


def _merge_around_line(counts: Array, line: int) -> Array:
    both = counts[..., line] + counts[..., line + 1]
    return np.concatenate([counts[..., :line], both[..., None], counts[..., line + 2 :]], axis=-1)


def _log_dirichlet_multinomial(alpha: Array, counts: Array) -> Array:
    total, a = counts.sum(axis=-1), alpha.sum(axis=-1)
    one_each = gammaln(alpha + counts) - gammaln(alpha) - gammaln(counts + 1.0)
    return gammaln(total + 1.0) + gammaln(a) - gammaln(a + total) + one_each.sum(axis=-1)


def passing_log_likelihood(outcome: Outcome, block: str) -> Array:
    """(k,) log-likelihood of the block's cells of Table 2."""
    filmed = published.counts_by_last_line(published.EXPERIMENT, block)
    return _exclude_impossible(outcome, log_counts(outcome.by_last_line, filmed))


def first_impact_log_likelihood(outcome: Outcome, block: str) -> Array:
    """(k,) log-likelihood of the statements on the block's first impacts."""
    n = outcome.first_zone.shape[1]
    of = published.RELEASES
    if block == "sphere":
        likely = _log_between(outcome.first_in(DITCH_ID), n, published.SPHERE_IN_DITCH, of)
    else:
        arrived = _log_between(outcome.first_in(DITCH_ID) + outcome.first_in(FACING_ID), n, of, of)
    if block == "cube":
        likely = arrived + _log_between(outcome.first_in(FACING_ID), n, *published.CUBE_ON_FACING)
    elif block == "parallelepiped":
        likely = arrived + _log_between(outcome.first_in(FACING_ID), n, published.PARALLELEPIPED_ON_FACING, of)
        on_facing = outcome.first_zone == FACING_ID
        angle = np.where(on_facing, outcome.off_normal_deg, 0.0).sum(axis=1) / np.maximum(on_facing.sum(axis=1), 1)
        beyond = np.maximum(angle - published.OFF_NORMAL_DEG, 0.0) / published.OFF_NORMAL_SD_DEG
        likely = likely - 0.5 * beyond**2
    return _exclude_impossible(outcome, likely)


def _log_between(simulated: Array, n: int, low: int, high: int) -> Array:
    """(k,) log-probability that `low` to `high` of the filmed RELEASES do what `simulated` (k,) of n releases did."""
    pairs = np.column_stack([simulated, n - simulated])
    counts = range(low, high + 1)
    of = published.RELEASES
    return logsumexp([log_counts(pairs, np.array([count, of - count])) for count in counts], axis=0)


def _exclude_impossible(outcome: Outcome, log_likelihood: Array) -> Array:
    return np.where(outcome.possible, log_likelihood, -np.inf)
