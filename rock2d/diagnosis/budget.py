"""The gap as a budget: the shares closed by each cause and by learnt changes, the unexplained rest, and the floor.

The size of a segment's residual is its root mean square over the channels, in standard deviations of noise and soil.
The *gap* of a model is the geometric mean of these sizes over all impacts and flights of held-out releases. So a few
outliers do not decide it, and the units of a segment cancel in every share.

Causes that overlap share what they close: the share of each is the mean over all orders in which they can be added
(Shapley 1953), given with the range over these orders. Intervals come from a bootstrap over releases. They include the
uncertainty of the floor: if the gap is small compared with this uncertainty, shares are hardly known."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from math import comb

import numpy as np

from rock2d.arrays import Array
from rock2d.diagnosis.cross_validation import Names
from rock2d.diagnosis.data import Data, Residuals
from rock2d.diagnosis.likelihood import chi_square, standard_deviations
from rock2d.diagnosis.replicates import Ratio
from rock2d.diagnosis.residual_regression import FLIGHT_DEGREES, RegressedResiduals

BOOTSTRAPS = 1000
# ratio of the gap that the true law would leave to the floor: median, and standard deviation of its logarithm; measured
# on films with null twins (`blind.true_closure`)
TRUE_FLOOR_RATIO, TRUE_FLOOR_SD = 0.97, 0.07
LARGEST_SD = 30.0  # largest residual; a larger one, or an impact that cannot be simulated, counts as this
SMALLEST_SD = 1e-3  # smallest root mean square of the residuals of an impact or flight
GAP_UNIT = "typical residual: geometric mean over impacts and flights, in standard deviations of noise and soil scatter"
LARGEST_CORRECTION = 2.0  # limit of the factor that makes shares sum to the whole


@dataclass
class Share:
    """A share of the gap with its 95 % interval, and its range over the orders in which causes are added."""

    closes: float
    ci95: tuple[float, float]
    range: tuple[float, float]


@dataclass
class Budget:
    """Shares of the gap of the base law.

    Attributes
    ----------
    base, learnt : gap of the base law, and of the model with the named causes and the learnt changes
    regression, replicates : both estimates of the floor
    used : gap that the true law would leave, estimated from the lower floor
    causes : name -> share that the cause closes
    outside : share that can be predicted, but is in no cause
    closed_by_learnt : share that the learnt changes close
    closed : share that named causes and learnt changes close together
    sets : causes -> gap of the law refitted with them, and the share that they close together"""

    base: float
    learnt: float
    regression: float
    replicates: float
    used: float
    causes: dict[str, Share]
    outside: Share
    closed_by_learnt: Share
    closed: Share
    sets: dict[Names, tuple[float, Share]]


class ResidualSizes:
    """Logarithms of the sizes of residuals, summed over each release, and their number."""

    def __init__(self, data: Data, covariance: Array) -> None:
        self._data, self._covariance = data, covariance
        self._sd = standard_deviations(covariance)
        n = len(data.order)
        self.impacts = np.bincount(data.impact_release, minlength=n).astype(float)
        self.count = self.impacts + np.bincount(data.flight_release[: data.flown], minlength=n)

    def z(self, residuals: Residuals) -> Array:
        """(n, d) residuals of impacts in standard deviations, at most LARGEST_SD."""
        return np.clip(np.nan_to_num(residuals.impacts / self._sd, nan=LARGEST_SD), -LARGEST_SD, LARGEST_SD)

    def of(self, residuals: Residuals) -> Array:
        """(releases,) sums of the logarithms of the sizes."""
        return self._summed(_log_size(self.z(residuals)), self._of_flights(residuals))

    def of_joint_channels(self, residuals: Residuals) -> Array:
        """(releases,) the same with the correlations of the channels of an impact: a change that shows only in a
        combination of channels is small in each of them."""
        square = chi_square(residuals.impacts, self._covariance) / residuals.impacts.shape[1]
        logs = 0.5 * np.log(np.clip(square, SMALLEST_SD**2, LARGEST_SD**2))
        return self._summed(logs, self._of_flights(residuals))

    def of_remaining(self, found: RegressedResiduals) -> Array:
        """(releases,) sums of the logarithms of the sizes that remain after a regression."""
        return self._summed(_log_size(found.impacts_remaining), _log_size(found.flights_remaining))

    def _of_flights(self, residuals: Residuals) -> Array:
        flights = np.clip(residuals.flights[: self._data.flown, :, :FLIGHT_DEGREES], -LARGEST_SD, LARGEST_SD)
        return _log_size(flights.reshape(len(flights), 3 * FLIGHT_DEGREES))

    def _summed(self, impacts: Array, flights: Array) -> Array:
        n, data = len(self.count), self._data
        of_flights = np.bincount(data.flight_release[: data.flown], flights, n)
        return np.asarray(np.bincount(data.impact_release, impacts, n) + of_flights)


def _log_size(z: Array) -> Array:
    """(n,) logarithm of the root mean square over the channels of z (n, d)."""
    return np.log(np.maximum(np.sqrt((z**2).mean(axis=1)), SMALLEST_SD)) if z.size else np.zeros(len(z))


class GapBootstrap:
    """Bootstrap over releases: the gap of a model in all draws. The first draw is the releases themselves."""

    def __init__(self, sizes: ResidualSizes, seed: int) -> None:
        n = len(sizes.count)
        own, self._seed, floor_seed = np.random.SeedSequence(seed).spawn(3)
        rng = np.random.default_rng(own)
        weights = rng.multinomial(n, np.full(n, 1.0 / n), size=BOOTSTRAPS)
        self._weights = np.vstack([np.ones(n), weights])
        self._count = np.maximum(self._weights @ sizes.count, 1.0)
        doubt = TRUE_FLOOR_SD * np.random.default_rng(floor_seed).normal(size=BOOTSTRAPS)
        self._true_floor = TRUE_FLOOR_RATIO * np.exp(np.concatenate([[0.0], doubt]))

    def floor(self, floors: Sequence[Array], models: Sequence[Array]) -> Array:
        """(1 + draws,) gap that the true law would leave: from the lowest of floors and models, at most that of any
        model."""
        known = self._true_floor * np.minimum.reduce([*floors, *models])
        return np.asarray(np.minimum.reduce([known, *models]))

    def gap_after_reduction(self, logs: Array, impacts: Array, ratio: Ratio) -> Array:
        """(1 + draws,) gap if the mean square of the residuals of impacts fell by a factor; `impacts` (releases,):
        their number."""
        ratios = ratio.draws(np.random.default_rng(self._seed), BOOTSTRAPS)
        return np.asarray(self.gap(logs) * ratios ** (0.5 * (self._weights @ impacts) / self._count))

    def gap(self, logs: Array) -> Array:
        """(1 + draws,) gap of sums of logarithms (releases,)."""
        return np.asarray(np.exp(self._weights @ logs / self._count))


def budget(
    sets: Mapping[Names, Array], named: Names, learnt: Array, floors: tuple[Array, Array], draws: GapBootstrap
) -> Budget:
    """The budget of the gap.

    Parameters
    ----------
    sets : effects of a model -> (releases,) sums of logarithms: no effect, all `named` ones, each alone, and all but
        one; for up to three effects all subsets
    named : the effects that are named
    learnt : (releases,) sums of logarithms of the model with learnt changes
    floors : (1 + draws,) gaps of the floors by regression and by replicates
    draws : the bootstrap"""
    gaps = {names: draws.gap(logs) for names, logs in sets.items()}
    base, with_named, with_learnt = gaps[frozenset()], gaps[named], draws.gap(learnt)
    floor = draws.floor(floors, [with_learnt, with_named])
    open_gap = base - floor

    causes = {name: share(gap, open_gap, ends) for name, (gap, ends) in _shapley_closures(gaps, named).items()}
    predicted = np.minimum(with_learnt, floors[0])
    return Budget(
        float(base[0]), float(with_learnt[0]), float(floors[0][0]), float(floors[1][0]), float(floor[0]), causes,
        share(np.maximum(with_named - predicted, 0.0), open_gap),
        share(with_named - with_learnt, open_gap), share(base - with_learnt, open_gap),
        {names: (float(gap[0]), share(base - gap, open_gap)) for names, gap in gaps.items()},
    )  # fmt: skip


def share(closed: Array, open_gap: Array, spread: tuple[Array, Array] | None = None) -> Share:
    """Share of the gap `open_gap` (1 + draws,) that is `closed` (1 + draws,), both in units of the gap.

    `spread`: smallest and largest closed gap over the orders of causes, (1 + draws,) each."""
    if np.quantile(open_gap[1:], 0.025) <= 0.0 or open_gap[0] <= 0.0:  # there is no gap to close
        return Share(0.0, (0.0, 0.0), (0.0, 0.0))
    of = closed / np.maximum(open_gap, 1e-12)
    low, high = np.quantile(of[1:], [0.025, 0.975])
    least, most = (float(end[0] / open_gap[0]) for end in spread or (closed, closed))
    return Share(float(of[0]), (float(low), float(high)), (least, most))


def _shapley_closures(gaps: Mapping[Names, Array], named: Names) -> dict[str, tuple[Array, tuple[Array, Array]]]:
    """Name -> (1 + draws,) gap that the cause closes: mean over all orders, and the smallest and largest."""
    closed = {}
    for name in sorted(named):
        steps = [
            # share of the orders of the causes in which this one follows exactly these
            (1.0 / (len(named) * comb(len(named) - 1, len(names))), gaps[names] - gaps[names | {name}])
            for names in _subsets(named - {name})
            if names in gaps and names | {name} in gaps
        ]
        weight = np.array([w for w, _ in steps])
        values = np.array([v for _, v in steps])
        closed[name] = (weight @ values / weight.sum(), (values.min(axis=0), values.max(axis=0)))
    closed_together = gaps[frozenset()] - gaps[named]
    total = np.sum([mean for mean, _ in closed.values()], axis=0) if closed else closed_together
    # where not all subsets are known the means do not sum to the whole exactly
    factor = np.divide(closed_together, total, out=np.ones_like(closed_together), where=np.abs(total) > 1e-12)
    factor = np.clip(factor, 1.0 / LARGEST_CORRECTION, LARGEST_CORRECTION)
    return {name: (mean * factor, ends) for name, (mean, ends) in closed.items()}


def _subsets(names: Names) -> list[Names]:
    return [frozenset(part) for k in range(len(names) + 1) for part in combinations(sorted(names), k)]
