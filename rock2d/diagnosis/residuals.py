"""The residuals of a model."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

Array = np.ndarray


@dataclass
class Residuals:
    """Impacts (n, d) in SI; flights (m, 3, degrees) in units of noise. NaN where an impact cannot be simulated.

    d = 6 on film: along the ground and across it (m) and angle (rad), then their rates; in an impact table the rates
    alone.
    """

    impacts: Array
    flights: Array

    def beyond(self, other: Residuals) -> Residuals:
        """By how much they are larger than others; 0 where an impact cannot be simulated."""
        return Residuals(np.nan_to_num(self.impacts - other.impacts), self.flights - other.flights)
