"""When a flying block can first touch the ground: never later than it does, and exact where that is known."""

from dataclasses import replace

import numpy as np
import pytest
import shapely
from scipy.optimize import brentq

from rock2d.engines.free_flight import facet_tree, time_to_ground
from rock2d.engines.geometry import block_arrays, ground_arrays
from rock2d.scene.blocks import make_block
from rock2d.scene.cross_section import CrossSection

G = 9.81
BALL = make_block("ball", shape="circle", diameter_m=0.5, mass_kg=100)
SLAB = make_block("slab", shape="rectangle", length_m=0.8, height_m=0.3, mass_kg=100)
OVAL = make_block("oval", shape="ellipse", length_m=0.8, height_m=0.3, mass_kg=100)
FLOOR = CrossSection([[0.0, 0.0], [40.0, 0.0]], ["rock"])
EGG = replace(OVAL, name="egg", centre_of_mass_m=(0.1, 0.05))


def rough_slope(seed: int) -> CrossSection:
    rng = np.random.default_rng(seed)
    x = np.linspace(0, 20, 301)
    return CrossSection(np.column_stack([x, -0.5 * x + rng.normal(0, 0.05, 301)]), ["rock"] * 300)


def bound(block, cross_section, q):
    arrays = ground_arrays(cross_section)
    tree = facet_tree(arrays.facets[:, :2].copy())
    return time_to_ground(q, G, block_arrays(block), arrays.facets, tree, np.empty(64, np.int64))


def outline(block, q, t):
    c, s = np.cos(q[2] + q[5] * t), np.sin(q[2] + q[5] * t)
    shape = shapely.Point(0, 0).buffer(block.radius_m, 256) if block.shape == "circle" else None
    points = np.array(shape.exterior.coords) if shape is not None else block.outline() - block.centre_of_mass_m
    centre = [q[0] + q[3] * t, q[1] + q[4] * t - 0.5 * G * t * t]
    return shapely.Polygon(points @ np.array([[c, s], [-s, c]]) + centre)


@pytest.mark.parametrize("block", [BALL, SLAB, OVAL, EGG], ids=lambda b: b.name)
def test_no_block_touches_before_the_bound(block):
    cross_section = rough_slope(3)
    line = shapely.LineString(cross_section.points_m)
    rng = np.random.default_rng(4)
    for _ in range(40):
        x = rng.uniform(3, 15)
        q = np.array([x, -0.5 * x + rng.uniform(0.8, 4), rng.uniform(0, 6), rng.normal(0, 6), rng.normal(0, 6),
                      rng.normal(0, 10)])  # fmt: skip
        tau = bound(block, cross_section, q)
        assert tau > 0
        for t in np.linspace(0, tau, 40)[:-1]:
            assert not outline(block, q, t).intersects(line)


def test_a_ball_above_a_plane_is_timed_exactly():
    slope = CrossSection(np.array([[0.0, 0.0], [40.0, -20.0]]), ["rock"])
    normal = slope.normals[0]
    q = np.array([5.0, 3.0, 0.0, 2.0, 1.0, 40.0])
    gap, rate = normal @ q[:2] - 0.25, normal @ q[3:5]
    exact = (rate + np.sqrt(rate**2 + 2 * G * normal[1] * gap)) / (G * normal[1])
    assert bound(BALL, slope, q) == pytest.approx(exact, rel=1e-12)


@pytest.mark.parametrize("block", [BALL, SLAB, OVAL], ids=lambda b: b.name)
def test_a_block_let_go_at_rest_finds_the_ground(block):
    """Without any speed, and inside the boxes of the tree: 0 / 0 once hid the ground, and the block fell through."""
    cross_section = rough_slope(3)
    bounds = [bound(block, cross_section, np.array([x, -0.5 * x + 1.5, 0.0, 0.0, 0.0, 0.0])) for x in (4.0, 9.0, 14.0)]
    falls = np.sqrt(2 * (1.5 + 0.3) / G)  # a little more than from the block's centre to the ground
    assert all(0 < tau < falls for tau in bounds)


def test_a_slab_that_does_not_turn_is_timed_exactly():
    q = np.array([5.0, 2.15, 0.0, 2.0, 0.0, 0.0])
    assert bound(SLAB, FLOOR, q) == pytest.approx(np.sqrt(2 * 2.0 / G), rel=1e-12)


def test_repeated_bounds_arrive_at_the_ground():
    """Each bound leaves an error of second order in the time flown, so a turning slab is there in a few."""
    q = np.array([5.0, 3.0, 0.3, 2.0, -1.0, 9.0])
    for count in range(1, 30):  # noqa: B007
        tau = bound(SLAB, FLOOR, q)
        if tau < 1e-6:
            break
        q[0] += q[3] * tau
        q[1] += q[4] * tau - 0.5 * G * tau**2
        q[2] += q[5] * tau
        q[4] -= G * tau
    assert count < 10
    assert outline(SLAB, q, 0.0).bounds[1] == pytest.approx(0.0, abs=1e-5)


@pytest.mark.parametrize("gap", [1e-3, 1e-12, 1e-18])
def test_a_ball_that_has_just_left_the_ground_comes_back(gap):
    """Rounding of a tiny gap must not hide the return."""
    ball = make_block("ball", shape="circle", diameter_m=1.0, mass_kg=100)
    q = np.array([5.0, 0.5 + gap, 0.0, 0.1, 2.0, 0.0])
    height = q[1] - 0.5
    expected = (2.0 + np.sqrt(4.0 + 2 * G * height)) / G if height > 0 else 0.0
    assert bound(ball, FLOOR, q) == pytest.approx(expected, rel=1e-12)


def test_a_turning_ellipse_near_the_ground_is_timed_closely():
    """Its lowest point is known to first order, so that near the ground hardly anything is left to the bound."""
    a, b = OVAL.semi_axes_m
    for omega in (-9.0, 4.0, 9.0):
        q = np.array([5.0, 0.0, 0.7, 2.0, -6.0, omega])

        def gap(t, q=q):
            angle = q[2] + q[5] * t
            return q[1] + q[4] * t - 0.5 * G * t * t - np.hypot(a * np.sin(angle), b * np.cos(angle))

        q[1] = 0.01 - gap(0.0)
        exact = brentq(gap, 0.0, 0.02)
        assert 0.95 * exact < bound(OVAL, FLOOR, q) <= exact
