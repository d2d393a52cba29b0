"""The facet that is nearest to a point."""

import numpy as np
import pytest
import shapely

from rock2d.scene.nearest_facet import nearest_facets

SLOPE = [[0, 9], [2, 5], [5, 4], [5, 1], [9, 0], [12, 2], [14, 2]]
OVERHANG = [[0, 0], [3, 0], [1, 2], [6, 2], [4, 5], [9, 5]]


@pytest.mark.parametrize("points", [SLOPE, OVERHANG, OVERHANG[::-1]])
def test_no_facet_is_nearer_than_the_one_that_is_found(points):
    points = np.array(points, float)
    at = np.random.default_rng(5).uniform([-4, -4], [18, 13], (4000, 2))
    facets = shapely.linestrings([points[i : i + 2] for i in range(len(points) - 1)])
    distances = shapely.distance(facets[None], shapely.points(at)[:, None])
    found = nearest_facets(at, points)
    np.testing.assert_allclose(distances[range(len(at)), found], distances.min(axis=1), rtol=1e-12, atol=1e-12)
    assert len(np.unique(found)) == len(facets)


def test_of_facets_that_are_as_near_the_first_is_found():
    points = np.array(SLOPE, float)
    assert nearest_facets(points, points).tolist() == [0, 0, 1, 2, 3, 4, 5]
