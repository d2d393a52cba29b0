"""How significant a gain in log likelihood is that is summed over releases."""

from __future__ import annotations

import numpy as np

Array = np.ndarray

SMALLEST_ERROR = 1.0  # log likelihood; a smaller standard error counts as this


class OverReleases:
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


def standard_error(per_release: Array) -> float:
    """Standard error of a sum over releases."""
    return float(per_release.std() * np.sqrt(len(per_release)))


def significance(gain: OverReleases) -> float:
    """Gain in standard errors."""
    return gain.total / max(gain.error, SMALLEST_ERROR)
