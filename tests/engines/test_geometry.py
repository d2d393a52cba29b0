"""Depths and directions of contact points against brute force and against their own derivatives."""

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from rock2d.engines.contact_search import find_features
from rock2d.engines.contact_state import DEPTH, SMOOTH_CONTACTS, new_contacts
from rock2d.engines.geometry import (
    CORNER_FACET,
    CORNER_VERTEX,
    SMOOTH_FACET,
    SMOOTH_VERTEX,
    VERTEX_FACE,
    WorldArrays,
    block_arrays,
    contact_point,
    facet_intersects,
    facet_range,
    ground_arrays,
    half_of_ellipse,
    nearest_on_ellipse,
    point_depth,
    pose_of,
)
from rock2d.scene.blocks import make_block
from rock2d.scene.cross_section import CrossSection

GROUND = CrossSection([[-3, 1], [0, 0], [1, 0], [0.8, 0.9], [1.8, 1], [1.8, 0.2], [4, 0]], list("abcdef"))
EGG = make_block("egg", "ellipse", 1.0, length_m=0.6, height_m=0.3)
SLAB = make_block("slab", "rectangle", 1.0, length_m=0.6, height_m=0.3)


def signed_depth(cross_section, x, y):
    """Depth below a polyline by shapely: distance to it, positive where the ground is."""
    line = shapely.LineString(cross_section.points_m)
    soil = shapely.Polygon([*cross_section.points_m, [4, -50], [-3, -50]])
    distance = shapely.distance(line, shapely.Point(x, y))
    return distance if soil.contains(shapely.Point(x, y)) else -distance


@given(st.floats(-2, 3), st.floats(-0.5, 1.8))
@settings(deadline=None, max_examples=200)
def test_depth_of_a_point_is_its_distance_to_the_surface_also_under_an_overhang(x, y):
    arrays = ground_arrays(GROUND)
    depth, _, _ = point_depth(x, y, arrays.facets, 0, 6)
    assert depth == pytest.approx(signed_depth(GROUND, x, y), abs=1e-12)
    fine = ground_arrays(GROUND.subdivided(10))
    assert point_depth(x, y, fine.facets, 0, 60)[0] == pytest.approx(depth, abs=1e-12)


@given(st.floats(-3, 4), st.floats(0, 1))
@settings(deadline=None, max_examples=100)
def test_the_facet_range_of_an_interval_holds_every_facet_that_overlaps_it(x, width):
    f0, f1 = facet_range(ground_arrays(GROUND), x, x + width)
    ends = np.sort(np.stack([GROUND.points_m[:-1, 0], GROUND.points_m[1:, 0]]), axis=0)
    for f in np.flatnonzero((ends[0] <= x + width) & (ends[1] >= x)):
        assert f0 <= f < f1


@given(st.floats(0, 2 * np.pi), st.floats(0.9, 1.6), st.floats(0.3, 1.0))
@settings(deadline=None, max_examples=100)
def test_the_nearest_point_of_an_ellipse_is_the_nearest(angle, scale, b):
    px, py = scale * np.cos(angle), scale * b * np.sin(angle)
    x, y = nearest_on_ellipse(px, py, 1.0, b, half_of_ellipse(px, py, 1.0, b))
    assert x * x + (y / b) ** 2 == pytest.approx(1.0)
    t = np.linspace(0, 2 * np.pi, 20001)
    best = np.hypot(np.cos(t) - px, b * np.sin(t) - py).min()
    assert np.hypot(x - px, y - py) <= best + 1e-12


@given(st.floats(0.01, 0.5), st.floats(0.05, 0.7))
@settings(deadline=None, max_examples=100)
def test_a_half_of_an_ellipse_is_followed_beyond_its_longer_axis(along, b):
    """The depth of a point that crosses the axis deep inside goes on smoothly on its half; the other half is nearer."""
    px, step = along * (1.0 - b * b), 1e-3 * b
    depths = []
    for py in (step, 0.0, -step):
        x, y = nearest_on_ellipse(px, py, 1.0, b, 0)
        assert y > 0.0
        depths.append(np.hypot(x - px, y - py))
    assert depths[0] < depths[1] < depths[2]
    assert depths[2] - depths[1] == pytest.approx(depths[1] - depths[0], rel=0.05)
    assert half_of_ellipse(px, -step, 1.0, b) == 1
    assert np.hypot(*np.subtract(nearest_on_ellipse(px, -step, 1.0, b, 1), (px, -step))) < depths[2]


@pytest.mark.parametrize(
    "kind, index, part, block, pose",
    [
        (CORNER_FACET, 1, 0, SLAB, (0.5, 0.15, 0.4)),
        (CORNER_VERTEX, 1, 0, SLAB, (0.2, 0.05, 0.1)),
        (VERTEX_FACE, 4, 0, SLAB, (1.75, 1.14, 0.2)),
        (SMOOTH_FACET, 1, 0, EGG, (0.5, 0.15, 0.7)),
        (SMOOTH_VERTEX, 4, 0, EGG, (1.85, 1.12, 0.3)),
        (SMOOTH_VERTEX, 4, 0, make_block("ball", "circle", 1.0, diameter_m=0.4), (1.85, 1.12, 0.3)),
    ],
)
def test_the_force_acts_along_the_gradient_of_the_depth_so_that_a_spring_conserves_energy(
    kind, index, part, block, pose
):
    cross_section, arrays = ground_arrays(GROUND), block_arrays(block)

    def point(p):
        return contact_point(kind, index, part, pose_of(np.asarray(p)), arrays, cross_section)

    _, nx, ny, rx, ry = point(pose)
    assert np.hypot(nx, ny) == pytest.approx(1.0)
    gradient = []
    for axis in range(3):
        shift = 1e-6 * np.eye(3)[axis]
        gradient.append((point(np.add(pose, shift))[0] - point(np.subtract(pose, shift))[0]) / 2e-6)
    np.testing.assert_allclose(gradient, [-nx, -ny, -(rx * ny - ry * nx)], atol=1e-7)


SPIKE = CrossSection([[-3, -2], [1, -2], [0, 0], [0.1, -0.05], [1.2, -2.2], [4, -2.2]], ["soil"] * 5)


def test_a_ball_lies_as_deep_in_the_ground_as_its_centre_is_near_it_also_at_a_spike():
    """The deepest feature of a ball whose centre is above the ground is the nearest point of the ground."""
    radius_m = 0.3
    ball = block_arrays(make_block("ball", "circle", 1.0, diameter_m=2 * radius_m))
    world = WorldArrays(ball, ground_arrays(SPIKE), np.zeros((1, 1)), 9.81)
    memory, found = new_contacts(SMOOTH_CONTACTS), new_contacts(SMOOTH_CONTACTS)
    for x, y in np.random.default_rng(1).uniform([-0.4, -0.6], [0.6, 0.3], (400, 2)):
        centre = signed_depth(SPIKE, x, y)
        if -radius_m < centre < 0.0:
            find_features(np.array([x, y, 0.0, 0.0, 0.0, 0.0]), radius_m, (0, 5), world, memory, found)
            assert found.reals[:, DEPTH].max() == pytest.approx(radius_m + centre, abs=1e-12), (x, y)


@given(st.floats(-1, 3), st.floats(-0.5, 1.5), st.floats(0, 6.3))
@settings(deadline=None, max_examples=200)
def test_a_facet_crosses_a_polygon_where_shapely_says_so(x, y, theta):
    arrays, slab = ground_arrays(GROUND), block_arrays(SLAB)
    pose = pose_of(np.array([x, y, theta, 0.0, 0.0, 0.0]))
    c, s = pose[2:]
    outline = shapely.Polygon(SLAB.corners_m @ np.array([[c, s], [-s, c]]) + [x, y])
    for f in range(1, 5):
        facet = shapely.LineString(GROUND.points_m[f : f + 2])
        inside = outline.buffer(-1e-9).intersects(facet)
        if inside == outline.buffer(1e-9).intersects(facet):  # not where it only touches the outline
            assert facet_intersects(f, pose, arrays.facets, slab.sides) == inside
