"""Energies of a release."""

from __future__ import annotations

import numpy as np
import pytest

from rock2d.graphics.energies import energy_figure
from tests.graphics.flights import BLOCKS, flight


def test_energy_of_a_free_flight_is_level():
    axis = energy_figure(flight("ball", 0), BLOCKS["ball"]).axes[0]
    total = next(line for line in axis.lines if line.get_label() == "sum").get_ydata()
    assert total == pytest.approx(np.full(len(total), total[0]), rel=1e-12)
    assert total[0] > 0
