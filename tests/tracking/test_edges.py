"""The edge of a block, whatever the block looks like."""

import cv2
import numpy as np
import pytest
from rock2d_tracking.edges import edge_points, fit_edges
from rock2d_tracking.outline import Patch, outline_of
from rock2d_tracking.synthetic.scene import coverage

from rock2d.scene.blocks import make_block

SHAPES = {
    "ball": make_block("ball", "circle", 1.0, "solid_sphere", diameter_m=40.0),
    "cube": make_block("cube", "square", 1.0, side_m=36.0),
    "slab": make_block("slab", "rectangle", 1.0, length_m=50.0, height_m=30.0),
}


def picture(name: str, pose: tuple[float, float, float], size: float) -> tuple[np.ndarray, np.ndarray]:
    """A block lit from the left, with a highlight and a dark spot, before a wall with a dark half."""
    block = SHAPES[name]
    c, s = np.cos(pose[2]), np.sin(pose[2])
    corners = block.outline(400) * [1.0, -1.0] * size @ np.array([[c, s], [-s, c]]) + pose[:2]
    cover = coverage([corners], (0, 0, 120, 120))
    wall = np.full((120, 120), 60.0)
    wall[:, 70:] = 90.0
    v, u = np.mgrid[0:120, 0:120]
    own = 190.0 - 1.2 * (u - pose[0])
    own += 60.0 * (np.hypot(u - pose[0] + 5, v - pose[1] + 4) < 4) - 80.0 * (
        np.hypot(u - pose[0] - 3, v - pose[1] - 6) < 3
    )
    image = wall + cover * (own - wall)
    return cv2.GaussianBlur(image, (0, 0), 0.8).astype(np.float32), cv2.GaussianBlur(wall, (0, 0), 0.8).astype(
        np.float32
    )


@pytest.mark.parametrize("name", SHAPES)
@pytest.mark.parametrize("size", [0.97, 1.0, 1.03])
def test_shaded_blocks_are_found_and_measured(name, size):
    outline = outline_of(SHAPES[name], 1.0, -1)
    pose = (58.3, 61.6, 0.4 if name != "ball" else 0.0)
    image, wall = picture(name, pose, size)
    found = fit_edges(
        Patch(image, wall, np.ones(image.shape, np.uint8), 1.0), edge_points(outline), np.array([60.5, 60.0, 0.3]),
        symmetric=name == "ball", free_size=True,
    )  # fmt: skip
    assert found is not None and found.seen > 0.9
    assert np.hypot(*(found.pose[:2] - pose[:2])) < 0.15
    assert found.size == pytest.approx(size, abs=0.006)
    if name != "ball":
        assert abs(found.pose[2] - pose[2]) < 0.02


def test_where_nothing_stands_out_there_is_no_edge():
    _, wall = picture("ball", (60.0, 60.0, 0.0), 1.0)
    outline = outline_of(SHAPES["ball"], 1.0, -1)
    visible = np.ones(wall.shape, np.uint8)
    start = np.array([60.0, 60.0, 0.0])
    assert fit_edges(Patch(wall, wall, visible, 1.0), edge_points(outline), start, symmetric=True) is None


@pytest.mark.parametrize("smear_px", [(0.0, 12.0), (8.0, -8.0)])
def test_a_ball_that_smears_is_found_in_the_middle_of_its_smear(smear_px):
    outline = outline_of(SHAPES["ball"], 1.0, -1)
    poses = [(60.0 + share * smear_px[0], 60.0 + share * smear_px[1], 0.0) for share in np.linspace(-0.5, 0.5, 25)]
    image = np.mean([picture("ball", pose, 1.0)[0] for pose in poses], axis=0).astype(np.float32)
    wall = picture("ball", poses[0], 1.0)[1]
    start, visible = np.array([62.0, 58.0, 0.0]), np.ones(wall.shape, np.uint8)
    sharp, smeared = (
        fit_edges(Patch(image, wall, visible, 1.0), edge_points(outline), start, symmetric=True, smear_px=np.array(own))
        for own in ((0.0, 0.0), smear_px)
    )
    assert smeared is not None and smeared.seen > 0.95
    assert sharp is None or sharp.seen < smeared.seen
    assert np.hypot(*(smeared.pose[:2] - 60.0)) < 0.4
