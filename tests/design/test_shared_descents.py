"""Sizes that share the descent upslope of an earthwork find what each would find alone."""

import numpy as np
import pytest

from rock2d.design import least_size
from rock2d.design.least_size import Search, Target
from rock2d.design.shared_descents import Descent, equal_until_m, shares_descents
from rock2d.scene.cross_section import CrossSection
from tests.scenarios_of_tests import UNKNOWN, small_site

PLACE, BOUNDS, TARGET = "embankment.height_m", (0.6, 3.0), Target("crest", 0.1, 0.95)


def found_alone_and_shared(scenario, place, sizes, monkeypatch):
    """Median frequency and its bounds of each size: (sizes, 3) alone, and with shared descents."""

    def judged(search, size):
        found = search.judge(size)
        return [found.median["ball"], found.low["ball"], found.high["ball"]]

    search = Search(scenario, place, BOUNDS, TARGET, "batch", 1)
    shared = np.array([judged(search, size) for size in sizes])
    monkeypatch.setattr(least_size, "shares_descents", lambda *given: False)
    return np.array([judged(Search(scenario, place, BOUNDS, TARGET, "batch", 1), size) for size in sizes]), shared


@pytest.mark.parametrize("rough", ["", "roughness:\n  slope: {sd_deg: 3, length_m: 0.6}\n"])
def test_a_size_is_judged_as_it_would_be_alone(tmp_path, monkeypatch, rough):
    scenario, served = small_site(tmp_path, UNKNOWN + rough), []
    outcome = Descent.outcome
    monkeypatch.setattr(Descent, "outcome", lambda *given: served.append(1) or outcome(*given))
    alone, shared = found_alone_and_shared(scenario, PLACE, (*BOUNDS, 1.7), monkeypatch)
    assert shared == pytest.approx(alone, abs=0.03)  # a release in 40 may stand on a knife edge
    assert alone[:, 0].max() > 0.2 and len(served) == 3 * 8  # each size on each site


def test_a_size_whose_ground_differs_upslope_is_simulated_whole(tmp_path, monkeypatch):
    """Descents of other bounds do not serve it, and change nothing."""
    alone, shared = found_alone_and_shared(small_site(tmp_path), "embankment.x_m", (15.0,), monkeypatch)
    assert (shared == alone).all()


@pytest.mark.parametrize(("place", "engine"), [("blocks.ball.mass_kg", "batch"), (PLACE, "point_mass")])
def test_nothing_is_shared_where_more_than_the_ground_differs(tmp_path, place, engine):
    assert not shares_descents(small_site(tmp_path), place, engine)


def test_where_grounds_part():
    def ground(*points, zones=None):
        return CrossSection(points, zones or ["soil"] * (len(points) - 1))

    low = ground((0, 5), (10, 0), (12, 1), (20, 0))
    assert equal_until_m(low, ground((0, 5), (10, 0), (12, 3), (20, 0))) == 10.0
    assert equal_until_m(low, low) == 20.0
    assert equal_until_m(low, ground((0, 6), (10, 0), (12, 1), (20, 0))) == 0.0
    other = ground((0, 5), (10, 0), (12, 1), (20, 0), zones=["soil", "rock", "soil"])
    assert equal_until_m(low, other) == 10.0
    assert equal_until_m(low, ground((0, 5), (10, 0), (9, 3), (20, 0))) == 9.0  # an overhang
