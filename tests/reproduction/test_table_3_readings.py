"""Readings of Table 3: what they bound, and which lines they exclude."""

import numpy as np
import pytest

from rock2d.reproduction import published
from rock2d.reproduction.calibrations import Effort
from rock2d.reproduction.hypotheses import table_3
from rock2d.reproduction.table_3_readings import READINGS, Reading, compute_readings, readings_table


def test_a_reading_bounds_its_own_unknowns_and_has_table_3():
    for reading in READINGS:
        values = reading.space.values(np.array([[0.0] * 13, [1.0] * 13]))
        assert tuple(values["facing_deg"]) == reading.facing_deg
        assert tuple(values["line_tilt_deg"]) == reading.line_tilt_deg
        law = table_3(values, reading.momentum_factor)
        assert law["ditch.momentum_half_kg_m_s"] == pytest.approx([0.025 * reading.momentum_factor] * 2)
        assert law["facing.tangential_restitution"] == pytest.approx([0.89] * 2)
        assert set(law) - set(values) == set(published.REBOUND_PARAMETERS)


def test_a_sphere_that_keeps_its_momentum_rises_and_one_that_loses_it_does_not():
    """With a very large threshold nearly nothing is lost at impacts, with a very small one all of it."""
    effort = Effort(hypotheses=96, releases=16, moves=2)
    readings = [Reading(str(factor), (55.0, 75.0), (0.0, 30.0), factor) for factor in (5.0, 0.02)]

    def computed():
        return compute_readings(effort, np.random.SeedSequence(1), lambda share: None, readings)

    found = computed()
    table = readings_table(found, readings)
    high, low = table["line_3"]
    assert high > 20.0 > low and table["excluded"][1] != "none"
    assert table["facing_deg_low95"].between(55, 75).all()
    assert table["line_tilt_deg_high95"].between(0, 30).all()
    again = computed()
    assert all((found[name] == again[name]).all() for name in found)
