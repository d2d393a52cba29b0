"""The model of an edge, and the fit of an outline to a picture of it."""

import math

import numpy as np
import pytest
from rock2d_tracking.fitting import with_veil
from rock2d_tracking.outline import Patch, cover, fit_pose, outline_of

from rock2d.scene.blocks import Block, make_block

BLOCKS = {
    "circle": make_block("a", "circle", 1.0, "uniform", diameter_m=0.024),
    "square": make_block("b", "square", 1.0, "uniform", side_m=0.02),
    "rectangle": make_block("c", "rectangle", 1.0, "uniform", length_m=0.034, height_m=0.014),
    "ellipse": make_block("d", "ellipse", 1.0, "uniform", length_m=0.03, height_m=0.02),
}
PIXEL_M = 6e-4
SIZE = 81


def picture(block: Block, pose: np.ndarray, fine: int = 12) -> np.ndarray:
    """Covered share of every pixel, by counting points within it, after a blur of 0.7 px."""
    import cv2

    outline = outline_of(block, PIXEL_M, -1)
    within = (np.arange(fine) + 0.5) / fine - 0.5
    v, u = np.mgrid[0:SIZE, 0:SIZE][:, :, :, None, None]
    x, y = u + within[:, None] - pose[0], v + within[None, :] - pose[1]
    c, s = np.cos(pose[2]), np.sin(pose[2])
    qx, qy = c * x + s * y, -s * x + c * y
    if block.smooth:
        a, b = outline.semi_axes_px
        inside = (qx / a) ** 2 + (qy / b) ** 2 <= 1.0
    else:
        inside = np.all([n[0] * qx + n[1] * qy <= n[2] for n in outline.edges], axis=0)
    return cv2.GaussianBlur(inside.mean(axis=(-1, -2)), (0, 0), 0.7)


@pytest.mark.parametrize("shape", BLOCKS)
def test_slopes_of_the_covered_share_are_its_derivatives(shape):
    outline = outline_of(BLOCKS[shape], PIXEL_M, -1)
    a, b = outline.semi_axes_px
    slope, none = np.zeros(3), np.zeros(3)
    rng = np.random.default_rng(0)
    for x, y in rng.uniform(-1.2, 1.2, (40, 2)) * outline.reach_px:
        cover(x, y, outline.edges, a, b, 1.3, slope)
        for k, (dx, dy, ds) in enumerate(1e-5 * np.eye(3)):
            ahead = cover(x + dx, y + dy, outline.edges, a, b, 1.3 + ds, none)
            behind = cover(x - dx, y - dy, outline.edges, a, b, 1.3 - ds, none)
            # the distance to an ellipse is a first-order approximation, and so is its slope
            assert slope[k] == pytest.approx((ahead - behind) / 2e-5, abs=0.05 if shape == "ellipse" else 1e-6)


@pytest.mark.parametrize(
    ("shape", "turn"), [("circle", 0.0), ("square", math.pi / 2), ("rectangle", math.pi), ("ellipse", math.pi)]
)
def test_symmetries(shape, turn):
    assert outline_of(BLOCKS[shape], PIXEL_M, -1).symmetry_rad == pytest.approx(turn)


@pytest.mark.parametrize("shape", ["circle", "square", "rectangle"])
def test_a_noisy_picture_gives_the_pose_within_its_stated_errors(shape):
    block = BLOCKS[shape]
    outline = outline_of(block, PIXEL_M, -1)
    rng = np.random.default_rng(1)
    behind = np.full((SIZE, SIZE), 150.0, np.float32)
    off, error = [], []
    for _ in range(20):
        pose = np.array([*rng.uniform(39, 41, 2), rng.uniform(-3, 3)])
        image = behind - 90.0 * picture(block, pose) + rng.normal(0.0, 2.0, behind.shape)
        start = np.array([*(pose + rng.uniform(-1, 1, 3) * [3.0, 3.0, 0.3]), 80.0, 1.0, 0.0, 0.0])
        patch = Patch(image.astype(np.float32), behind, np.ones(behind.shape, np.uint8), 2.0)
        found, se, seen, misfit = fit_pose(patch, outline.edges, outline.semi_axes_px, start, 25, False)
        assert seen > 0.95 and misfit < 0.05
        off.append(found[:3] - pose)
        error.append(se)
    off, error = np.array(off), np.array(error)
    known = 2 if shape == "circle" else 3
    assert np.sqrt((off[:, :2] ** 2).mean()) < 0.01
    assert np.sqrt(((off / error)[:, :known] ** 2).mean()) == pytest.approx(1.0, abs=0.35)
    if known == 3:
        assert np.rad2deg(np.sqrt((off[:, 2] ** 2).mean())) < 0.05


def test_half_a_block_that_soil_hides_is_still_found_where_it_is():
    block = BLOCKS["square"]
    outline = outline_of(block, PIXEL_M, -1)
    pose = np.array([40.3, 39.8, 0.35])
    behind = np.full((SIZE, SIZE), 150.0, np.float32)
    image = behind - 90.0 * picture(block, pose).astype(np.float32)
    image[44:] = behind[44:] = 110.0  # soil in front of it
    counts = np.ones(behind.shape, np.uint8)
    start = np.array([41.5, 38.5, 0.3, 70.0, 1.0, 0.0, 0.0])
    for mask in (counts, np.where(np.arange(SIZE)[:, None] < 44, 1, 0) * counts):  # unknown, surveyed
        patch = Patch(image, behind, mask.astype(np.uint8), 2.0)
        found, _, seen, _ = fit_pose(patch, outline.edges, outline.semi_axes_px, start, 25, False)
        np.testing.assert_allclose(found[:2], pose[:2], atol=0.1)
        assert found[2] == pytest.approx(pose[2], abs=0.01)
        assert 0.5 < seen < 0.75


@pytest.mark.parametrize("shape", ["circle", "square", "rectangle"])
@pytest.mark.parametrize("side", [(0.0, 14.0), (12.0, 6.0)])
@pytest.mark.parametrize("grey", [50.0, 160.0, 215.0])
def test_dust_over_a_block_is_measured_beside_it(shape, side, grey):
    """A cloud of 185 grey levels covers 30 % in its middle, before a ground of 120 and a block of another grey."""
    block, rng = BLOCKS[shape], np.random.default_rng(1)
    outline, pose = outline_of(block, PIXEL_M, -1), np.array([40.2, 39.9, 0.4])
    behind = np.full((SIZE, SIZE), 120.0, np.float32)
    v, u = np.mgrid[0:SIZE, 0:SIZE]
    cloud = 0.3 * np.exp(-0.5 * ((u - pose[0] - side[0]) ** 2 + (v - pose[1] - side[1]) ** 2) / 18.0**2)
    free, noise = behind + (grey - 120.0) * picture(block, pose), rng.normal(0.0, 2.0, behind.shape)
    veiled, plain = (
        Patch((own + noise).astype(np.float32), behind, np.ones(behind.shape, np.uint8), 2.0)
        for own in (free + cloud * (185.0 - free), free)
    )
    start = np.array([*pose, grey, 1.0, 0.0, 0.0])
    start[:3] += 1.0, -1.0, 0.05

    def miss_px(patch: Patch, sloped: bool = False) -> float:
        found = fit_pose(patch, outline.edges, outline.semi_axes_px, start, 25, sloped)[0]
        return float(np.hypot(*(found[:2] - pose[:2])))

    assert with_veil(plain, outline, pose) is plain
    assert miss_px(with_veil(veiled, outline, pose), sloped=True) < min(0.08, miss_px(veiled))
