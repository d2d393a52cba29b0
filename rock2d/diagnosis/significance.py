"""How significant a gain in log likelihood is that is summed over releases."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rock2d.statistics import student

Array = np.ndarray

# log likelihood of one release; more counts as this: the releases that show an effect most would else make the spread
# so large that the effect is lost in it
LARGEST_GAIN = 4.0
SMALLEST_ERROR = 1.0  # log likelihood; a smaller standard error counts as this
LEAST_GAIN, LEAST_GAIN_Z = 3.0, 2.0  # log likelihood, and standard errors, that are more than chance


class SummedGain:
    """What is known of a gain (releases,) in log likelihood: its sum over all releases, and the standard error."""

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
    """How much better one model predicts held-out releases than another.

    Attributes
    ----------
    gain : (releases,) log likelihood that it has more
    by_means : (releases,) the same if both had the same covariances; None if that is not known, or says nothing
    """

    gain: Array
    by_means: Array | None = None

    @property
    def significance(self) -> float:
        """In standard errors. By the means alone where that is known: the covariances that two fits find differ by
        chance, and that adds more to the spread over releases than a weak effect does."""
        return significance(self.gain if self.by_means is None else self.by_means)

    def plus(self, further: Array) -> Gain:
        """With a further gain (releases,), of the same covariances."""
        return Gain(self.gain + further, None if self.by_means is None else self.by_means + further)

    @property
    def significant(self) -> bool:
        """Whether it is more than chance gives."""
        return self.total > LEAST_GAIN and self.significance > LEAST_GAIN_Z


def significance(per_release: Array) -> float:
    """Sum of gains, each between ±LARGEST_GAIN, in its standard errors; few releases make these larger by Student's
    distribution."""
    gain = np.clip(per_release, -LARGEST_GAIN, LARGEST_GAIN)
    return float(gain.sum()) / (max(standard_error(gain), SMALLEST_ERROR) * student(len(gain) - 1))


def standard_error(per_release: Array) -> float:
    """Standard error of a sum over releases."""
    return float(per_release.std() * np.sqrt(len(per_release)))
