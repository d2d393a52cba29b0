"""Heights on a cross-section: where they are added, and where not."""

import numpy as np
import pytest

from rock2d.scene.cross_section import CrossSection
from rock2d.scene.rough_ground import raised

WALL = CrossSection([[0, 4], [4, 0], [6, 0], [6, 2], [9, 2]], ["slope", "ditch", "wall", "crest"])


def test_a_raised_ground_lies_higher_by_the_heights_between_which_it_is_straight():
    x_m, height_m = np.array([1.0, 3.0, 5.0, 7.0]), np.array([0.0, 0.3, -0.2, 0.0])
    higher = raised(WALL, x_m, height_m)
    at = np.array([0.5, 1.7, 2.0, 3.5, 4.0, 5.5, 6.5, 8.0])
    assert higher.height_m(at) == pytest.approx(WALL.height_m(at) + np.interp(at, x_m, height_m))
    assert higher.zone_names == WALL.zone_names
    assert higher.zones[higher.points_m[:-1, 0].searchsorted(3.0)] == "slope"


def test_heights_of_zero_leave_the_surface_as_it_is():
    same = raised(WALL, np.linspace(-1, 10, 40), np.zeros(40))
    at = np.linspace(0, 9, 50)
    assert same.height_m(at) == pytest.approx(WALL.height_m(at), abs=1e-12)


def test_an_overhang_stays_an_overhang_whatever_the_heights():
    """Points above each other move alike, so that no surface can cross itself."""
    overhang = CrossSection([[0, 0], [4, 0], [3, 1], [9, 1]], ["floor", "face", "crest"])
    deep = raised(overhang, np.array([1.0, 2.0, 3.0, 9.0]), np.array([0.0, 5.0, -3.0, 0.0]))
    assert np.diff(deep.points_m[[deep.zones.index("face"), deep.zones.index("crest")], 0])[0] == -1.0
