"""The cross-section: what is allowed, what is refused, and which way is up."""

import numpy as np
import pytest

from rock2d.scene.cross_section import CrossSection, site_time_limit_s

OVERHANG = [[0, 0], [2, 0], [1.5, 1], [3, 1], [3, 0], [4, 0]]


def test_overhangs_and_upright_walls_are_allowed_and_every_normal_points_into_the_air():
    cross_section = CrossSection(OVERHANG, list("abcde"))
    np.testing.assert_allclose(np.hypot(*cross_section.normals.T), 1.0)
    middles = 0.5 * (cross_section.points_m[1:] + cross_section.points_m[:-1])
    import shapely

    ground = shapely.Polygon([*OVERHANG, [4, -5], [0, -5]])
    assert not shapely.contains_xy(ground, *(middles + 1e-3 * cross_section.normals).T).any()
    assert shapely.contains_xy(ground, *(middles - 1e-3 * cross_section.normals).T).all()


def test_the_height_is_that_of_the_highest_surface_and_unknown_beside_the_section():
    cross_section = CrossSection(OVERHANG, list("abcde"))
    np.testing.assert_allclose(cross_section.height_m([1.0, 1.75, 2.5, 3.0, 3.5]), [0, 1, 1, 1, 0])
    assert np.isnan(cross_section.height_m([-0.1, 4.1])).all()


def test_the_ground_turns_negative_at_convex_corners_and_positive_in_hollows():
    cross_section = CrossSection([[0, 0], [1, 0], [2, 1], [3, 1]], list("abc"))
    np.testing.assert_allclose(np.rad2deg(cross_section.turns_rad), [0, 45, -45, 0], atol=1e-12)


def test_cutting_facets_leaves_surface_and_zones_as_they_were():
    cross_section = CrossSection(OVERHANG, list("abaca"), {"line": [[0, 0], [0, 1]]})
    fine = cross_section.subdivided(7)
    assert len(fine.zones) == 35 and fine.zone_names == cross_section.zone_names
    np.testing.assert_array_equal(fine.points_m[::7], cross_section.points_m)
    x = np.linspace(0.01, 3.99, 97)
    np.testing.assert_allclose(fine.height_m(x), cross_section.height_m(x), atol=1e-12)
    assert [fine.zones[7 * i + 3] for i in range(5)] == list("abaca")


@pytest.mark.parametrize(
    "points, zones, message",
    [
        ([[0, 0]], [], "at least two"),
        ([[0, 0], [2, 0], [2, 1], [1, -1], [3, -1]], list("abcd"), "crosses itself: facets 0 and 2"),
        ([[0, 0], [2, 0], [1, 0], [3, 1]], list("abc"), "folds back"),
        ([[0, 0], [1, 0]], [" "], "facet 0 has no zone"),
        ([[0, 0], [1, np.nan]], ["a"], "finite"),
    ],
)
def test_bad_cross_sections_are_refused_with_the_reason(points, zones, message):
    with pytest.raises(ValueError, match=message):
        CrossSection(points, zones)


def test_a_cross_section_does_not_change_with_the_array_that_it_was_made_of():
    points = np.array([[-1.0, 0.5], [0.0, 0.0], [2.0, 0.0]])
    ground = CrossSection(points, ["slope", "ditch"])
    points[0, 1] = 7.0
    assert ground.points_m[0, 1] == 0.5


def test_the_time_limit_is_similar_for_similar_sites():
    """Times of similar motions under gravity go with the square root of the size."""
    site, small = (CrossSection([[0, 40 * k], [60 * k, 0], [110 * k, 0]], ["slope", "ditch"]) for k in (1.0, 0.04))
    assert site_time_limit_s(site, 9.81) == pytest.approx(5.0 * site_time_limit_s(small, 9.81))
    assert site_time_limit_s(site, 9.81) == pytest.approx(site_time_limit_s(small, 9.81 / 25.0))
    with pytest.raises(ValueError, match="gravity"):
        site_time_limit_s(site, 0.0)
