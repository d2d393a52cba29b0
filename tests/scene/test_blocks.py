"""Block profiles: sizes, moments of inertia, refusals."""

from dataclasses import replace

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from rock2d.scene.blocks import make_block
from rock2d.scene.shapes import inertia_words, shapes
from tests.laboratory import CUBE, SLAB, SPHERE

VERTICES = [[0, 0], [0.02, 0], [0.03, 0.01], [0.01, 0.025], [-0.005, 0.015]]
SIZES = [
    ("circle", {"diameter_m": 0.03}),
    ("square", {"side_m": 0.019}),
    ("rectangle", {"length_m": 0.035, "height_m": 0.014}),
    ("ellipse", {"length_m": 0.035, "height_m": 0.02}),
]


def polar_moment_per_area(outline):
    """∫ r² dA / A about the centroid, from triangles with the mid-edge rule (exact for quadratics)."""
    centre = np.array(shapely.Polygon(outline).centroid.coords[0])
    p, q = outline - centre, np.roll(outline, -1, axis=0) - centre
    area = 0.5 * np.abs(p[:, 0] * q[:, 1] - p[:, 1] * q[:, 0])
    middles = [p / 2, q / 2, (p + q) / 2]
    return (area * sum((m**2).sum(axis=1) for m in middles) / 3).sum() / area.sum()


def test_the_paper_s_blocks_have_the_moments_of_inertia_of_table_1():
    assert SPHERE.inertia_kg_m2 == pytest.approx(1.375e-6)
    assert CUBE.inertia_kg_m2 == pytest.approx(0.0233 * (0.019**2 + 0.019**2) / 12)
    assert SLAB.inertia_kg_m2 == pytest.approx(0.0231 * (0.035**2 + 0.014**2) / 12)


@pytest.mark.parametrize(
    "shape, size", [*SIZES, ("polygon", {"vertices_m": VERTICES}), ("polygon", {"vertices_m": VERTICES[::-1]})]
)
def test_uniform_inertia_area_and_reach_agree_with_the_outline(shape, size):
    block = make_block("b", shape, 2.0, **size)
    outline = block.outline(20000)
    polygon = shapely.Polygon(outline)
    assert np.hypot(*polygon.centroid.coords[0]) < 1e-9
    assert block.area_m2 == pytest.approx(polygon.area, rel=1e-6)
    assert block.inertia_kg_m2 == pytest.approx(2.0 * polar_moment_per_area(outline), rel=1e-6)
    assert np.pi * block.size_m**2 / 4 == pytest.approx(polygon.area, rel=1e-6)
    assert block.radius_m == pytest.approx(np.hypot(*outline.T).max())
    angles = np.linspace(0, 7, 40)
    lowest = -(np.sin(angles)[:, None] * outline[:, 0] + np.cos(angles)[:, None] * outline[:, 1]).min(axis=1)
    np.testing.assert_allclose(block.height_above_lowest_point_m(angles), lowest, rtol=1e-6)


@given(st.lists(st.tuples(st.floats(-1, 1), st.floats(-1, 1)), min_size=4, max_size=12), st.floats(-50, 50))
@settings(deadline=None, max_examples=60)
def test_where_a_polygon_is_drawn_does_not_change_its_inertia(points, shift):
    hull = shapely.convex_hull(shapely.multipoints(np.round(points, 2)))
    if hull.geom_type != "Polygon" or hull.area < 1e-3:
        return
    corners = np.array(shapely.simplify(hull, 1e-3).exterior.coords[:-1])
    if len(corners) < 3:  # a sliver
        return
    here = make_block("b", "polygon", 1.0, vertices_m=corners)
    there = make_block("b", "polygon", 1.0, vertices_m=corners + shift)
    assert here.inertia_kg_m2 == pytest.approx(polar_moment_per_area(corners), rel=1e-9)
    assert there.inertia_kg_m2 == pytest.approx(here.inertia_kg_m2, rel=1e-6)


@pytest.mark.parametrize(
    "shape, inertia, size, message",
    [
        ("circle", "uniform", {}, "diameter_m"),
        ("circle", "uniform", {"diameter_m": -1}, "diameter_m"),
        ("square", "solid_sphere", {"side_m": 1}, "circle"),
        ("square", "hollow", {"side_m": 1}, "hollow"),
        ("star", "uniform", {}, "star"),
        ("polygon", "uniform", {"vertices_m": [[0, 0], [1, 0]]}, "three"),
        ("polygon", "uniform", {"vertices_m": [[0, 0], [2, 0], [1, 0.1], [0, 2]]}, "convex"),
        ("circle", -1.0, {"diameter_m": 1}, "inertia"),
    ],
)
def test_impossible_blocks_are_refused_with_the_reason(shape, inertia, size, message):
    with pytest.raises(ValueError, match=message):
        make_block("b", shape, 1.0, inertia, **size)


def test_a_block_without_mass_is_refused():
    with pytest.raises(ValueError, match="mass"):
        make_block("b", "circle", -1.0, diameter_m=1.0)


def test_every_file_of_a_shape_is_found_under_its_name():
    tested = {"polygon", *(shape for shape, _ in SIZES)}
    assert list(shapes()) == sorted(tested), "SIZES has one entry for each shape but the polygon"
    assert all(shape.name == name and shape.sizes for name, shape in shapes().items())
    assert inertia_words() == ("solid_sphere", "uniform")


@pytest.mark.parametrize("shape, size", [*SIZES, ("polygon", {"vertices_m": [[-1, -1], [2, -1], [-1, 2]]})])
def test_a_shape_gives_the_sizes_of_its_blocks_back(shape, size):
    block = make_block("b", shape, 2.0, **size)
    assert shapes()[shape].sizes_of(block.semi_axes_m, block.corners_m) == size


def test_blocks_are_compared_by_value():
    cube, same = (make_block("cube", "square", 1.0, side_m=0.5) for _ in range(2))
    assert cube == same and hash(cube) == hash(same)
    assert cube != replace(cube, mass_kg=1.1) and cube != make_block("cube", "square", 1.0, side_m=0.6)
