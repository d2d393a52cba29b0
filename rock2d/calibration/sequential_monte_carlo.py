"""Calibration as a posterior: tempered sequential Monte Carlo over hypotheses in the unit cube.

The sampler starts with draws of the prior and raises the power of the likelihood from 0 to 1 in steps. Each step
weights, resamples and moves the hypotheses (Del Moral, Doucet & Jasra 2006, Sequential Monte Carlo samplers; the
effective sample size determines the steps). The search is global and needs no derivatives. All final hypotheses explain
the data; their spread shows which unknowns are identified.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

Array = np.ndarray

EFFECTIVE_SHARE = 0.5  # effective sample size after a step, over the number of hypotheses
WALK_SCALES = (
    1.0,
    0.3,
)  # steps over those of the optimal random walk, 2.38 / sqrt(d) (Roberts, Gelman & Gilks 1997)


@dataclass(frozen=True)
class Quantity:
    """One unknown: name with unit, range of the prior (uniform, or uniform in the logarithm), source of the range."""

    name: str
    low: float
    high: float
    log: bool = False
    source: str = ""

    def value(self, u: Array) -> Array:
        """Values at `u` in [0, 1]."""
        if self.log:
            return self.low * (self.high / self.low) ** u
        return self.low + (self.high - self.low) * u


@dataclass(frozen=True)
class Space:
    """The unknowns; each is a column of the hypotheses (n, d) in the unit cube."""

    quantities: tuple[Quantity, ...]

    def values(self, u: Array) -> dict[str, Array]:
        """Name -> (n,) values."""
        return {q.name: q.value(u[:, i]) for i, q in enumerate(self.quantities)}

    def columns(self, names: Sequence[str]) -> Array:
        """Columns of these names. Raises KeyError for an unknown one."""
        index = {q.name: i for i, q in enumerate(self.quantities)}
        return np.array([index[name] for name in names], int)


@dataclass(frozen=True)
class Sample:
    """Equally weighted hypotheses (n, d) of the posterior, their log-likelihoods, and the log of the evidence."""

    u: Array
    log_likelihood: Array
    log_evidence: float

    @property
    def best(self) -> int:
        """Index of the likeliest hypothesis."""
        return int(np.argmax(self.log_likelihood))


@dataclass(frozen=True)
class Moves:
    """Metropolis-Hastings moves of all hypotheses at each step.

    Attributes
    ----------
    count : moves at each step; at least 2 with `redrawn` columns
    free : columns that moves may change (default: all); the others change by resampling alone
    redrawn : columns that every other move draws from the prior instead of walking: a choice among models
    """

    count: int = 3
    free: Array | None = None
    redrawn: Array | None = None


def prior_draws(count: int, dimensions: int, rng: np.random.Generator) -> Array:
    """(count, dimensions) scrambled Sobol points of the unit cube."""
    from scipy.stats import qmc

    power = int(np.ceil(np.log2(max(count, 1))))
    return qmc.Sobol(dimensions, seed=rng).random_base2(power)[:count]


def posterior(
    log_likelihood: Callable[[Array], Array],
    start: Array,
    count: int,
    rng: np.random.Generator,
    moves: Moves | None = None,
    *,
    on_progress: Callable[[float], None] | None = None,
) -> Sample:
    """Equally weighted hypotheses of the posterior.

    Parameters
    ----------
    log_likelihood : (n, d) -> (n,), -inf where a hypothesis is impossible
    start : (m, d) draws of the prior
    count : hypotheses of the posterior
    moves : how hypotheses move at each step (default `Moves()`)
    on_progress : called with the power of the likelihood reached so far, in (0, 1]

    Raises ValueError if no draw of the prior is possible.
    """
    moves = Moves() if moves is None else moves
    redrawn = moves.redrawn
    columns = np.arange(start.shape[1]) if moves.free is None else np.asarray(moves.free)
    walking = columns if redrawn is None else np.setdiff1d(columns, redrawn)
    u, ll = start.copy(), log_likelihood(start)
    if not np.isfinite(ll).any():
        raise ValueError("no draw of the prior is possible under the likelihood")
    power, evidence = 0.0, 0.0
    while power < 1.0:
        step = _next_step(ll, 1.0 - power, EFFECTIVE_SHARE * count)
        power = 1.0 if power + step >= 1.0 - 1e-9 else power + step
        weight = np.exp(step * (ll - ll.max()))
        evidence += step * float(ll.max()) + float(np.log(weight.mean()))
        at = (rng.random() + np.arange(count)) / count
        kept = np.searchsorted(np.cumsum(weight) / weight.sum(), at).clip(0, len(u) - 1)
        u, ll = u[kept], ll[kept]
        for move in range(moves.count):
            if redrawn is not None and move % 2:
                proposed = u.copy()
                proposed[:, redrawn] = rng.random((count, len(redrawn)))
            else:
                proposed = _walk(u, walking, rng)
            ahead = log_likelihood(proposed)
            taken = np.log(rng.random(count)) < power * (ahead - ll)
            u[taken], ll[taken] = proposed[taken], ahead[taken]
        if on_progress is not None:
            on_progress(power)
    return Sample(u, ll, evidence)


def _next_step(ll: Array, remaining: float, wanted: float) -> float:
    """Power of the likelihood to add so that the effective sample size falls to `wanted`, at most `remaining`."""
    from scipy.optimize import brentq

    above = ll - ll.max()

    def size(step: float) -> float:
        weight = np.exp(step * above)
        return float(weight.sum() ** 2 / (weight * weight).sum())

    if size(remaining) >= wanted:
        return remaining
    tiny = 1e-9 * remaining
    if size(tiny) <= wanted:  # most draws are impossible
        return tiny
    return float(brentq(lambda step: size(step) - wanted, tiny, remaining))


def _walk(u: Array, columns: Array, rng: np.random.Generator) -> Array:
    """Random walk along the covariance of the hypotheses, reflected at the walls of the cube (symmetric)."""
    d = len(columns)
    covariance = np.atleast_2d(np.cov(u[:, columns].T)) + 1e-6 * np.eye(d)
    stride = 2.38 / np.sqrt(d) * rng.choice(WALK_SCALES, len(u))
    out = u.copy()
    out[:, columns] += stride[:, None] * (rng.standard_normal((len(u), d)) @ np.linalg.cholesky(covariance).T)
    folded = np.abs(out[:, columns]) % 2.0
    out[:, columns] = np.where(folded > 1.0, 2.0 - folded, folded)
    return out
