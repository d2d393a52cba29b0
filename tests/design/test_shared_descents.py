"""Sizes that share the descent upslope of an earthwork find what each would find alone."""

from __future__ import annotations

import numpy as np
import pytest

from rock2d.design.least_size import Target, judge_size, shared_descents
from rock2d.design.shared_descents import parting_m
from rock2d.scene.cross_section import CrossSection
from tests.design.small_site import UNKNOWN, small_site

PLACE, BOUNDS, TARGET = "embankment.height_m", (0.6, 3.0), Target("crest", 0.1, 0.95)


def frequencies(scenario, place, size, descents=None):
    found = judge_size(scenario, place, size, TARGET, "batch", 1, descents=descents)
    return np.array([found.median["ball"], found.low["ball"], found.high["ball"]])


@pytest.mark.parametrize("rough", ["", "roughness:\n  slope: {sd_deg: 3, length_m: 0.6}\n"])
def test_a_size_is_judged_as_it_would_be_alone(tmp_path, rough):
    scenario = small_site(tmp_path, UNKNOWN + rough)
    descents = shared_descents(scenario, PLACE, BOUNDS, "batch", 1)
    assert descents is not None
    for size in (*BOUNDS, 1.7):
        shared, alone = frequencies(scenario, PLACE, size, descents), frequencies(scenario, PLACE, size)
        assert shared == pytest.approx(alone, abs=0.03)  # a release in 40 may stand on a knife edge
    assert alone[0] > 0.05


def test_a_size_whose_ground_differs_upslope_is_simulated_whole(tmp_path):
    """Descents of other bounds do not serve it, and change nothing."""
    scenario = small_site(tmp_path)
    descents = shared_descents(scenario, PLACE, BOUNDS, "batch", 1)
    place = "embankment.x_m"
    assert (frequencies(scenario, place, 15.0, descents) == frequencies(scenario, place, 15.0)).all()


@pytest.mark.parametrize(("place", "engine"), [("blocks.ball.mass_kg", "batch"), (PLACE, "point_mass")])
def test_nothing_is_shared_where_more_than_the_ground_differs(tmp_path, place, engine):
    assert shared_descents(small_site(tmp_path), place, BOUNDS, engine, 1) is None


def test_where_grounds_part():
    def ground(*points, zones=None):
        return CrossSection(points, zones or ["soil"] * (len(points) - 1))

    low = ground((0, 5), (10, 0), (12, 1), (20, 0))
    assert parting_m(low, ground((0, 5), (10, 0), (12, 3), (20, 0))) == 10.0
    assert parting_m(low, low) == 20.0
    assert parting_m(low, ground((0, 6), (10, 0), (12, 1), (20, 0))) == 0.0
    other = ground((0, 5), (10, 0), (12, 1), (20, 0), zones=["soil", "rock", "soil"])
    assert parting_m(low, other) == 10.0
    assert parting_m(low, ground((0, 5), (10, 0), (9, 3), (20, 0))) == 9.0  # an overhang
