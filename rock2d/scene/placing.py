"""Place a block so that it just touches the ground from above."""

import numpy as np

from rock2d.arrays import Array
from rock2d.scene.blocks import Block
from rock2d.scene.cross_section import CrossSection

SIDES_OF_A_SMOOTH_PROFILE = 256


def touching_height_m(block: Block, cross_section: CrossSection, x_m: Array, theta_rad: Array) -> Array:
    """(n,) height in m of the centroid at which the block touches the ground if it is lowered at x_m (n,) with
    orientations theta_rad (n,).

    A smooth profile is replaced by a polygon around it, which is 1e-4 of its size larger. Raises ValueError if the
    whole width of a block is outside the cross-section."""
    outline = block.outline(SIDES_OF_A_SMOOTH_PROFILE)
    if block.smooth:
        outline = outline / np.cos(np.pi / SIDES_OF_A_SMOOTH_PROFILE)
    x, theta = np.atleast_1d(np.asarray(x_m, float)), np.atleast_1d(np.asarray(theta_rad, float))
    c, s = np.cos(theta)[:, None], np.sin(theta)[:, None]
    ahead, up = c * outline[:, 0] - s * outline[:, 1], s * outline[:, 0] + c * outline[:, 1]
    below_corners = cross_section.height_m(x[:, None] + ahead) - up
    heights = np.nanmax(np.where(np.isnan(below_corners), -np.inf, below_corners), axis=1)
    back, front = ahead.min(axis=1), ahead.max(axis=1)
    vertices = cross_section.points_m
    near = (vertices[:, 0] > (x + back).min()) & (vertices[:, 0] < (x + front).max())
    for vertex_x, vertex_y in vertices[near]:
        under = vertex_x - x
        for i in np.flatnonzero((under > back) & (under < front)):
            heights[i] = max(heights[i], vertex_y - _underside(ahead[i], up[i], under[i]))
    if not np.isfinite(heights).all():
        raise ValueError("a block is outside the cross-section")
    return heights


def _underside(ahead: Array, up: Array, at: float) -> float:
    """Height of the lower side of a convex polygon at a distance ahead of its centroid."""
    other_ahead, other_up = np.roll(ahead, -1), np.roll(up, -1)
    crosses = (np.minimum(ahead, other_ahead) <= at) & (at <= np.maximum(ahead, other_ahead))
    a, b, p, q = ahead[crosses], other_ahead[crosses], up[crosses], other_up[crosses]
    width = np.where(a == b, 1.0, b - a)
    return float(np.where(a == b, np.minimum(p, q), p + (at - a) / width * (q - p)).min())
