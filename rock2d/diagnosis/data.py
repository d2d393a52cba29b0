"""The data of a fit (measured segments), and the residuals of a model."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

if TYPE_CHECKING:
    from rock2d.diagnosis.film_data import FilmData
    from rock2d.diagnosis.impact_table_data import TableData

Array = np.ndarray

Data: TypeAlias = "FilmData | TableData"  # measured segments that models are fitted to


@dataclass
class Residuals:
    """Impacts (n, d) in SI; flights (m, 3, degrees) in units of noise. NaN where an impact cannot be simulated.

    d = 6 on film: along the ground and across it (m) and angle (rad), then their rates; in an impact table the rates
    alone.
    """

    impacts: Array
    flights: Array
