"""Significance of a gain in log likelihood that is summed over releases."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.special import ndtr  # scipy.stats takes over a second to import

from rock2d.arrays import Array
from rock2d.statistics import student

# Limit of the gain in log likelihood of a release. Without it, the releases that show an effect most would increase the
# spread so much that the effect is not significant.
LARGEST_GAIN = 4.0
SMALLEST_ERROR = 1.0  # log likelihood; a smaller standard error counts as this
LEAST_GAIN, LEAST_GAIN_Z = 3.0, 2.0  # log likelihood, and standard errors, of a significant gain
# Probability that unusual releases make the gain of an addition, and share of it that counts if they do not: the
# likelihood of residuals is not exact.
UNUSUAL, TRUSTED_SHARE = 0.25, 0.5
PRIOR_ODDS = 1.0 / 8.0  # a gain that chance exceeds in 1 % of films gives a probability of 0.5
LEAST_CHANCE = 1e-6  # smallest p value
FORM_STEEPNESS = 3.0  # slope of the logarithm of the odds over that of a gain over what the forms of laws may leave
TRIED_DEPENDENCES = 60  # number of dependences that are tried; the best one is learnt
LEAST_OUTSIDE_PROBABILITY = 0.03  # probability that something acts that the data do not show


class SummedGain:
    """A gain (releases,) in log likelihood, with its sum over the releases, standard error and significance."""

    gain: Array

    @property
    def total(self) -> float:
        """Gain over all releases."""
        return float(self.gain.sum())

    @property
    def error(self) -> float:
        """Standard error of the total, over releases."""
        return standard_error(self.gain)

    @property
    def significance(self) -> float:
        """Significance of the gain, in standard errors."""
        return significance(self.gain)


@dataclass
class Gain(SummedGain):
    """Gain of one model over another in the prediction of held-out releases.

    Attributes
    ----------
    gain : (releases,) difference in log likelihood
    by_means : (releases,) the same with equal covariances in both models; None if unknown or not meaningful
    shared_error : standard deviation of the sum by slow errors of the track that all releases may share"""

    gain: Array
    by_means: Array | None = None
    shared_error: float = 0.0

    @property
    def comparable(self) -> Array:
        """(releases,) `by_means` if it is known, else the gain. The covariances of two fits differ by chance, which
        adds more to the spread over releases than a weak effect."""
        return self.gain if self.by_means is None else self.by_means

    @property
    def significance(self) -> float:
        """Significance of the gain, in standard errors."""
        return significance(self.comparable, self.shared_error)

    @property
    def p_of_addition(self) -> float:
        """p value of the gain over a model that this one contains.

        An effect may act in few releases. These spread the gains, so that it has few standard errors. But chance gives
        a gain G to an addition in a share exp(-G) of films at most (Ville's inequality for likelihood ratios), unless
        it acts through unusual releases, of which only the number counts."""
        p = float(ndtr(-self.significance))
        sure = float(_clipped(self.comparable).sum()) - 2.0 * self.shared_error
        of_ratio = math.exp(-TRUSTED_SHARE * max(sure, 0.0))
        return min(p, UNUSUAL * p + of_ratio)

    def plus(self, further: Array) -> Gain:
        """The gain plus a `further` gain (releases,) with equal covariances."""
        by_means = None if self.by_means is None else self.by_means + further
        return Gain(self.gain + further, by_means, self.shared_error)

    @property
    def significant(self) -> bool:
        """Whether the gain is larger than expected by chance."""
        return self.total > LEAST_GAIN and self.significance > LEAST_GAIN_Z

    @property
    def significant_addition(self) -> bool:
        """The same over a model that this one contains."""
        return self.total > LEAST_GAIN and self.p_of_addition < ndtr(-LEAST_GAIN_Z)


def significance(per_release: Array, shared_error: float = 0.0) -> float:
    """Sum of the gains (releases,), each clipped to ±LARGEST_GAIN, in standard errors; for few releases these are
    enlarged by Student's distribution. `shared_error`: of the sum, by errors that all releases share."""
    gain = _clipped(per_release)
    error = max(standard_error(gain), SMALLEST_ERROR) * student(len(gain) - 1)
    return float(gain.sum()) / math.hypot(error, shared_error)


def _clipped(per_release: Array) -> Array:
    return np.clip(per_release, -LARGEST_GAIN, LARGEST_GAIN)


def standard_error(per_release: Array) -> float:
    """Standard error of a sum over releases."""
    return float(per_release.std() * np.sqrt(len(per_release)))


def largest_bayes_factor(p: float) -> float:
    """The largest Bayes factor that a p value allows, -1 / (e p ln p): Sellke, Bayarri and Berger (2001, The American
    Statistician 55(1), 62-71)."""
    p = min(max(p, LEAST_CHANCE), np.exp(-1.0))
    return float(-1.0 / (math.e * p * np.log(p)))


def probability_from_p_value(p: float) -> float:
    """Probability of a cause from the p value of its gain, with `PRIOR_ODDS`."""
    odds = PRIOR_ODDS * largest_bayes_factor(p)
    return odds / (1.0 + odds)


def chance_p_value(gain: float, draws: Array) -> float:
    """Share of the chance gains `draws` (draws,) that reach `gain`; beyond the draws, by an exponential tail fitted to
    their upper half."""
    middle = float(np.median(draws))
    tail = float(np.mean(draws[draws > middle] - middle)) if (draws > middle).any() else 1.0
    share = float(np.mean(draws >= gain))
    return share if share > 0.05 else min(0.5 * float(np.exp(-(gain - middle) / max(tail, 1e-9))), 0.05)


def logistic(ratio: float, steepness: float, bayes_factor: float = 1.0) -> float:
    """Probability from odds that grow as a power, the `steepness`, of a ratio."""
    odds = bayes_factor * min(ratio, 1e3) ** steepness
    return odds / (1.0 + odds)


def outside_probability(learnt: SummedGain, left: float, tried: int = TRIED_DEPENDENCES) -> float:
    """Probability that something outside the catalogue acts.

    `learnt`: gain of the learnt changes, or of a moving frame, over the causes; `left`: log likelihood that they may
    gain because the forms of the laws are not exact; `tried`: number of changes of which this is the best."""
    if learnt.total <= 0.0:
        return LEAST_OUTSIDE_PROBABILITY
    p = probability_from_p_value(tried * float(ndtr(-learnt.significance)))
    p *= logistic(learnt.total / max(left, 1e-9), FORM_STEEPNESS)
    return max(p, LEAST_OUTSIDE_PROBABILITY)
