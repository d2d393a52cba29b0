"""Significance of a gain in log likelihood that is summed over releases."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rock2d.arrays import Array
from rock2d.statistics import student

# Limit of the gain in log likelihood of a release. Without it, the releases that show an effect most would increase the
# spread so much that the effect is not significant.
LARGEST_GAIN = 4.0
SMALLEST_ERROR = 1.0  # log likelihood; a smaller standard error counts as this
LEAST_GAIN, LEAST_GAIN_Z = 3.0, 2.0  # log likelihood, and standard errors, of a significant gain


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
    by_means : (releases,) the same with equal covariances in both models; None if unknown or not meaningful"""

    gain: Array
    by_means: Array | None = None

    @property
    def significance(self) -> float:
        """Significance of the gain, in standard errors; of `by_means` if it is known. The covariances of two fits
        differ by chance, which adds more to the spread over releases than a weak effect."""
        return significance(self.gain if self.by_means is None else self.by_means)

    def plus(self, further: Array) -> Gain:
        """The gain plus a `further` gain (releases,) with equal covariances."""
        return Gain(self.gain + further, None if self.by_means is None else self.by_means + further)

    @property
    def significant(self) -> bool:
        """Whether the gain is larger than expected by chance."""
        return self.total > LEAST_GAIN and self.significance > LEAST_GAIN_Z


def significance(per_release: Array) -> float:
    """Sum of the gains (releases,), each clipped to ±LARGEST_GAIN, in standard errors; for few releases these are
    enlarged by Student's distribution."""
    gain = np.clip(per_release, -LARGEST_GAIN, LARGEST_GAIN)
    return float(gain.sum()) / (max(standard_error(gain), SMALLEST_ERROR) * student(len(gain) - 1))


def standard_error(per_release: Array) -> float:
    """Standard error of a sum over releases."""
    return float(per_release.std() * np.sqrt(len(per_release)))
