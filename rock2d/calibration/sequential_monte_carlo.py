"""Calibration as a posterior: tempered sequential Monte Carlo over hypotheses in the unit cube.

The sampler starts with draws of the prior and raises the power of the likelihood from 0 to 1 in steps. Each step
weights, resamples and moves the hypotheses (Del Moral, Doucet & Jasra 2006, Sequential Monte Carlo samplers; the
effective sample size determines the steps). The search is global and needs no derivatives. All final hypotheses explain
the data; their spread shows which unknowns are identified."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from rock2d.arrays import Array

EFFECTIVE_SHARE = 0.5  # effective sample size after a step, over the number of hypotheses
WALK_SCALES = (1.0, 0.3)  # factors on the optimal random walk, 2.38 / sqrt(d) (Roberts, Gelman & Gilks 1997)
SHRINKAGE = 0.05  # relative increase of variances, which reduces correlations by chance


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
    """Equally weighted hypotheses `u` (n, d) of the posterior, their log-likelihoods (n,), and the log of the
    evidence."""

    u: Array
    log_likelihood: Array
    log_evidence: float

    @property
    def best(self) -> int:
        """Index of the likeliest hypothesis."""
        return int(np.argmax(self.log_likelihood))

    @classmethod
    def joined(cls, runs: Sequence[Sample]) -> Sample:
        """The hypotheses of independent runs of the same size."""
        return cls(
            np.concatenate([run.u for run in runs]),
            np.concatenate([run.log_likelihood for run in runs]),
            float(np.mean([run.log_evidence for run in runs])),
        )


@dataclass(frozen=True)
class Factor:
    """A factor of the likelihood that depends on some unknowns only.

    Attributes
    ----------
    log_likelihood : (n, d) -> (n,), -inf if a hypothesis is impossible
    columns : columns of the hypotheses on which it depends
    highest : upper bound of the log-likelihood; proposals that fail even with this bound are rejected without
        computing the factor"""

    log_likelihood: Callable[[Array], Array]
    columns: Array
    highest: float = np.inf


@dataclass(frozen=True)
class Moves:
    """Metropolis-Hastings moves of all hypotheses at each step.

    Attributes
    ----------
    count : rounds of moves at each step; at least 2 with `redrawn` columns
    redrawn : columns that every other move draws from the prior instead of walking, for example a choice among models
    groups : columns that walk together, one group after the other in each round (default: all others together).
        Only the factors of the likelihood that depend on a group are computed again.
    every_round : keep the hypotheses after each round, instead of those after the last one. Then `count` times fewer of
        them move (waste-free sequential Monte Carlo, Dau & Chopin 2022)."""

    count: int = 3
    redrawn: Array | None = None
    groups: Sequence[Array] = ()
    every_round: bool = False


def prior_draws(count: int, dimensions: int, rng: np.random.Generator) -> Array:
    """(count, dimensions) scrambled Sobol points of the unit cube."""
    from scipy.stats import qmc

    power = int(np.ceil(np.log2(max(count, 1))))
    return qmc.Sobol(dimensions, seed=rng).random_base2(power)[:count]


def posterior(
    log_likelihood: Callable[[Array], Array] | Sequence[Factor],
    start: Array,
    count: int,
    rng: np.random.Generator,
    moves: Moves | None = None,
    *,
    finer: tuple[float, Sequence[Factor]] | None = None,
    on_progress: Callable[[float], None] | None = None,
) -> Sample:
    """Equally weighted hypotheses of the posterior.

    Parameters
    ----------
    log_likelihood : (n, d) -> (n,), -inf if a hypothesis is impossible; or its factors
    start : (m, d) draws of the prior
    count : number of hypotheses of the posterior; with `Moves.every_round`, the next lower multiple of the rounds, and
        at least two of each round
    moves : moves of the hypotheses at each step (default `Moves()`)
    finer : a power of the likelihood in (0, 1), and more precise factors, which are used from this power on. At a low
        power, errors of the likelihood hardly matter
    on_progress : called with the power of the likelihood reached so far, in (0, 1]

    Raises ValueError if no draw of the prior is possible."""
    moves = Moves() if moves is None else moves
    if callable(log_likelihood):
        log_likelihood = [Factor(log_likelihood, np.arange(start.shape[1]))]
    known = _Hypotheses.of(start, log_likelihood)
    if not np.isfinite(known.total).any():
        raise ValueError("no draw of the prior is possible under the likelihood")
    moving = max(2, count // moves.count) if moves.every_round else count  # at least two, for a covariance
    power, evidence = 0.0, 0.0
    while power < 1.0:
        ll, goal = known.total, 1.0 if finer is None else finer[0]
        if finer is not None and power == goal:
            known, finer = _Hypotheses.of(known.u, finer[1]), None
            gain = power * (known.total - ll)
        else:
            step = _next_step(ll, goal - power, EFFECTIVE_SHARE * count)
            power = goal if power + step >= goal - 1e-9 else power + step
            gain = step * ll
        weight = np.exp(gain - gain.max())
        evidence += float(gain.max()) + float(np.log(weight.mean()))
        known.keep(resampled(weight, moving, rng))
        rounds = []
        for move in range(moves.count):
            known.move(moves, move, power, rng)
            rounds.append((known.u.copy(), known.by_factor.copy()))
        if moves.every_round:
            known.u, known.by_factor = (np.concatenate(part) for part in zip(*rounds, strict=True))
        if on_progress is not None:
            on_progress(power)
    return Sample(known.u, known.total, evidence)


def resampled(weight: Array, count: int, rng: np.random.Generator) -> Array:
    """(count,) indices of hypotheses, drawn by their weights (systematic resampling)."""
    at = (rng.random() + np.arange(count)) / count
    return np.searchsorted(np.cumsum(weight) / weight.sum(), at).clip(0, len(weight) - 1)


@dataclass
class _Hypotheses:
    """Hypotheses (n, d) and the logarithms (n, factors) of the factors of their likelihoods."""

    u: Array
    by_factor: Array
    factors: Sequence[Factor]

    @classmethod
    def of(cls, u: Array, factors: Sequence[Factor]) -> _Hypotheses:
        """Compute the factors in turn, each only for hypotheses that are possible under the factors before."""
        by_factor = np.zeros((len(u), len(factors)))
        possible = np.ones(len(u), bool)
        for k, factor in enumerate(factors):
            by_factor[possible, k] = factor.log_likelihood(u[possible])
            possible &= np.isfinite(by_factor[:, k])
        return cls(u.copy(), by_factor, factors)

    @property
    def total(self) -> Array:
        """(n,) log-likelihoods."""
        return np.asarray(self.by_factor.sum(axis=1))

    def keep(self, chosen: Array) -> None:
        """Keep only the hypotheses of these indices."""
        self.u, self.by_factor = self.u[chosen], self.by_factor[chosen]

    def move(self, moves: Moves, round: int, power: float, rng: np.random.Generator) -> None:
        """One round of moves under the likelihood to this power."""
        redrawn = moves.redrawn
        columns = np.arange(self.u.shape[1])
        walking = columns if redrawn is None else np.setdiff1d(columns, redrawn)
        if redrawn is not None and round % 2:
            proposed = self.u.copy()
            proposed[:, redrawn] = rng.random((len(proposed), len(redrawn)))
            self._accept(proposed, redrawn, power, rng)
            return
        for group in moves.groups or [walking]:
            self._accept(_walk(self.u, group, rng), group, power, rng)

    def _accept(self, proposed: Array, columns: Array, power: float, rng: np.random.Generator) -> None:
        """Accept or reject the proposed hypotheses, which differ in these columns, by the rule of Metropolis and
        Hastings.

        The random number is drawn first, so that few factors of rejected hypotheses are computed."""
        changed = [k for k, f in enumerate(self.factors) if np.isin(f.columns, columns).any()]
        proposed_factors = self.by_factor.copy()
        proposed_factors[:, changed] = [self.factors[k].highest for k in changed]
        needed = np.log(rng.random(len(proposed))) / power + self.by_factor[:, changed].sum(axis=1)
        accepted = np.arange(len(proposed))
        for k in changed:
            if len(accepted):
                proposed_factors[accepted, k] = self.factors[k].log_likelihood(proposed[accepted])
                accepted = accepted[np.isfinite(proposed_factors[accepted, k])]
                total = proposed_factors[np.ix_(accepted, changed)].sum(axis=1)
                accepted = accepted[total > needed[accepted]]
        self.u[accepted], self.by_factor[accepted] = proposed[accepted], proposed_factors[accepted]


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
    """Random walk of some columns along their covariance, reflected at the walls of the cube (symmetric); the others do
    not change."""
    d = len(columns)
    stride = 2.38 / np.sqrt(d) * rng.choice(WALK_SCALES, len(u))
    out = u.copy()
    steps = rng.standard_normal((len(u), d)) @ np.linalg.cholesky(_covariance(u, columns)).T
    out[:, columns] += stride[:, None] * steps
    folded = np.abs(out[:, columns]) % 2.0
    out[:, columns] = np.where(folded > 1.0, 2.0 - folded, folded)
    return out


def _covariance(u: Array, columns: Array) -> Array:
    """(d, d) covariance of some columns, given the others: the inverse of their block of the precision matrix."""
    every = np.atleast_2d(np.cov(u.T)) + 1e-6 * np.eye(u.shape[1])
    if len(columns) == u.shape[1]:
        return every[np.ix_(columns, columns)]
    shrunk = every + SHRINKAGE * np.diag(np.diag(every))
    return np.asarray(np.linalg.inv(np.linalg.inv(shrunk)[np.ix_(columns, columns)]))
