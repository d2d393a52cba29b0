"""The outline of a block in pixels and its blurred edge in the image.

The grey value of a pixel is B + (F - B) C, with the background B, the block F and the share C of the pixel that the
blurred block covers. For a half-plane C = Φ(-d / s), where d is the distance beyond its edge and s the blur. For a
convex polygon C is the product over its edges, which is exact at right angles. For an ellipse C = Φ(-d / s) with the
distance to first order, for a circle with the true distance."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from rock2d.arrays import Array
from rock2d.compiled import kernel, njit
from rock2d.scene.blocks import Block

FIT_U, FIT_V, FIT_ANGLE, FIT_GREY, FIT_BLUR, FIT_GREY_U, FIT_GREY_V = range(7)  # parameters of `fit_pose`
N_FIT = 7
SHARP_EDGE_BLURS = 4.0  # distance from an edge, in blurs, beyond which a pixel is all block or all background
SMALLEST_BLUR_PX = 0.3  # a pixel is a square and blurs by itself
TUKEY_SIGMAS = 4.685  # misfit in standard deviations beyond which nothing has weight (Tukey's biweight)
GREY_ROUGHNESS = 0.06  # standard deviation of the grey of block and soil, over the contrast
COARSE_ROUNDS = 3  # first rounds, in which misfits three times as large still have weight
CONVERGED_STEP_PX = 2e-3  # the fit ends at a smaller step


class Patch(NamedTuple):
    """A piece of a frame around a block.

    Attributes
    ----------
    image, background : (h, w) float32 grey values, with the block and without; for `fit_edges` also (h, w, 3)
    visible : (h, w) uint8, 0 where soil may hide the block
    noise : 1 sigma of a pixel in grey levels"""

    image: Array
    background: Array
    visible: Array
    noise: float


@dataclass(frozen=True)
class Outline:
    """A convex outline.

    Attributes
    ----------
    edges : (n, 3) outward normal (2) and distance in px of each edge of a polygon; (0, 3) of an ellipse
    semi_axes_px : (2,) of an ellipse, (0, 0) of a polygon
    symmetry_rad : angle by which it can be turned without a change; 0 of a circle, which can be turned by any"""

    edges: Array
    semi_axes_px: Array
    symmetry_rad: float

    @cached_property
    def area_px2(self) -> float:
        """Area in px²."""
        if len(self.edges) == 0:
            return float(np.pi * self.semi_axes_px.prod())
        normals, h = self.edges[:, :2], self.edges[:, 2]
        turn = np.arctan2(normals[:, 1], normals[:, 0])
        ahead, behind = np.roll(turn, -1) - turn, turn - np.roll(turn, 1)
        ahead, behind = ahead % (2 * np.pi), behind % (2 * np.pi)
        sides = (np.roll(h, -1) - h * np.cos(ahead)) / np.sin(ahead) + (np.roll(h, 1) - h * np.cos(behind)) / np.sin(
            behind
        )
        return float(0.5 * (sides * h).sum())

    @cached_property
    def corners_px(self) -> Array:
        """(n, 2) corners of a polygon about its centroid, the one where edge k begins at k."""
        normals, h = self.edges[:, :2], self.edges[:, 2]
        before, hb = np.roll(normals, 1, axis=0), np.roll(h, 1)
        cross = before[:, 0] * normals[:, 1] - before[:, 1] * normals[:, 0]
        return np.column_stack(
            [(hb * normals[:, 1] - h * before[:, 1]) / cross, (h * before[:, 0] - hb * normals[:, 0]) / cross]
        )

    @property
    def radius_px(self) -> float:
        """Radius of the circle of its area."""
        return float(np.sqrt(self.area_px2 / np.pi))

    def distance_px(self, place: Array, turn: float) -> Array:
        """(...) distance in px of places (..., 2) about the centre from the outline, turned by `turn`; negative inside.

        It is exact beside straight sides and for a circle."""
        c, s = np.cos(turn), np.sin(turn)
        own = place @ np.array([[c, -s], [s, c]])
        if len(self.edges):
            return np.asarray((own @ self.edges[:, :2].T - self.edges[:, 2]).max(axis=-1))
        return np.asarray((np.hypot(*np.moveaxis(own / self.semi_axes_px, -1, 0)) - 1.0) * self.semi_axes_px.min())

    def scaled(self, factor: float) -> Outline:
        """The outline, `factor` times as large."""
        return Outline(self.edges * [1.0, 1.0, factor], self.semi_axes_px * factor, self.symmetry_rad)

    @cached_property
    def reach_px(self) -> float:
        """Radius of the circle about the centroid that holds it."""
        if len(self.edges) == 0:
            return float(self.semi_axes_px.max())
        return float(np.hypot(*self.corners_px.T).max())


def outline_of(block: Block, metres_per_pixel: float, up: int) -> Outline:
    """The outline of a block in the image; `up` as in `PixelMap`."""
    if block.smooth:
        a, b = np.array(block.semi_axes_m) / metres_per_pixel
        return Outline(np.empty((0, 3)), np.array([a, b]), 0.0 if a == b else math.pi)
    corners = block.corners_m / metres_per_pixel * [1.0, up]
    if up < 0:
        corners = corners[::-1]  # mirrored, so that they still run counter-clockwise
    side = np.roll(corners, -1, axis=0) - corners
    normals = np.column_stack([side[:, 1], -side[:, 0]]) / np.hypot(*side.T)[:, None]
    return Outline(np.column_stack([normals, (normals * corners).sum(axis=1)]), np.zeros(2), _symmetry(corners))


def _symmetry(corners: Array) -> float:
    """Smallest rotation that maps a polygon onto itself."""
    n = len(corners)
    z = corners[:, 0] + 1j * corners[:, 1]
    for shift in range(1, n):
        turned = np.roll(z, -shift)
        turn = np.angle(turned[0] / z[0]) % (2 * math.pi)
        if np.abs(turned - z * np.exp(1j * turn)).max() < 1e-6 * np.abs(z).max():
            return float(turn)
    return 2 * math.pi


@kernel
def _phi(z):
    return 0.5 * math.erfc(-z / math.sqrt(2.0))


@kernel
def _bell(z):
    return math.exp(-0.5 * z * z) / math.sqrt(2.0 * math.pi)


@kernel
def cover(qx, qy, edges, semi_a, semi_b, s, slope):
    """Covered share of a pixel at (qx, qy) in the block's axes; `slope` (3,) gets its derivatives by qx, qy and s."""
    slope[0] = slope[1] = slope[2] = 0.0
    n = edges.shape[0]
    if n == 0:
        if semi_a == semi_b:
            r = math.sqrt(qx * qx + qy * qy)
            d, gx, gy = r - semi_a, qx / max(r, 1e-9), qy / max(r, 1e-9)
        else:
            f = (qx / semi_a) ** 2 + (qy / semi_b) ** 2
            gx, gy = 2.0 * qx / semi_a**2, 2.0 * qy / semi_b**2
            length = max(math.sqrt(gx * gx + gy * gy), 1e-9)
            root = math.sqrt(max(f, 1e-12))
            d, gx, gy = 2.0 * (root - 1.0) * root / length, gx / length, gy / length
        z = d / s
        if z > SHARP_EDGE_BLURS:
            return 0.0
        if z < -SHARP_EDGE_BLURS:
            return 1.0
        b = _bell(z) / s
        slope[0], slope[1], slope[2] = -b * gx, -b * gy, b * z
        return _phi(-z)
    c = 1.0
    for k in range(n):
        z = (edges[k, 0] * qx + edges[k, 1] * qy - edges[k, 2]) / s
        if z > SHARP_EDGE_BLURS:
            slope[0] = slope[1] = slope[2] = 0.0
            return 0.0
        if z < -SHARP_EDGE_BLURS:
            continue
        own, b = _phi(-z), _bell(z) / s
        slope[0] = slope[0] * own - c * b * edges[k, 0]
        slope[1] = slope[1] * own - c * b * edges[k, 1]
        slope[2] = slope[2] * own + c * b * z
        c *= own
    return c


class FitSums(NamedTuple):
    """Sums over the pixels of a patch: of the outline's edge, seen and whole; of squared residuals and weights in the
    band of the edge; of the difference between block and background, and of the covered shares."""

    seen: float
    whole: float
    squares: float
    band: float
    difference: float
    covered: float


@njit
def _normal_equations(patch, edges, semi_axes, slope_scale, p, tukey, curve, grad):
    """Fill `curve` (7, 7; lower half) and `grad` (7,) of a Gauss-Newton step at `p`; returns `FitSums`.

    slope_scale : what a slope of the grey is multiplied with for the change per px; 0 if there is none
    tukey : residual in grey levels beyond which a pixel has no weight"""
    image, background, visible, _ = patch
    curve[:], grad[:] = 0.0, 0.0
    seen = whole = squares = band = difference = covered = 0.0
    turns = edges.shape[0] > 0 or semi_axes[0] != semi_axes[1]
    c, s = math.cos(p[FIT_ANGLE]), math.sin(p[FIT_ANGLE])
    slope, j = np.zeros(3), np.zeros(N_FIT)
    height, width = image.shape
    for v in range(height):
        for u in range(width):
            rx, ry = u - p[FIT_U], v - p[FIT_V]
            qx, qy = c * rx + s * ry, -s * rx + c * ry
            share = cover(qx, qy, edges, semi_axes[0], semi_axes[1], p[FIT_BLUR], slope)
            if share == 0.0:
                continue
            step = p[FIT_GREY] + slope_scale * (p[FIT_GREY_U] * rx + p[FIT_GREY_V] * ry) - background[v, u]
            edge = share * (1.0 - share)
            whole += edge
            if visible[v, u] == 0:
                continue
            r = image[v, u] - background[v, u] - step * share
            weight = 0.0
            if abs(r) < tukey:
                weight = (1.0 - (r / tukey) ** 2) ** 2
            seen += edge * weight
            squares += edge * weight * r * r
            band += edge * weight
            difference += abs(step) * share
            covered += share
            if weight == 0.0:
                continue
            j[FIT_GREY], j[FIT_GREY_U], j[FIT_GREY_V] = share, share * slope_scale * rx, share * slope_scale * ry
            if share == 1.0:  # inside, only the grey matters
                for a in (FIT_GREY, FIT_GREY_U, FIT_GREY_V):
                    grad[a] += weight * j[a] * r
                    for b in (FIT_GREY, FIT_GREY_U, FIT_GREY_V):
                        curve[a, b] += weight * j[a] * j[b]
                continue
            # derivatives by the pose: the axes of the body move and turn
            j[FIT_U] = -step * (c * slope[0] - s * slope[1])
            j[FIT_V] = -step * (s * slope[0] + c * slope[1])
            j[FIT_ANGLE] = step * (slope[0] * qy - slope[1] * qx) if turns else 0.0
            j[FIT_BLUR] = step * slope[2]
            for a in range(N_FIT):
                grad[a] += weight * j[a] * r
                for b in range(a + 1):
                    curve[a, b] += weight * j[a] * j[b]
    return FitSums(seen, whole, squares, band, difference, covered)


@njit
def fit_pose(patch, edges, semi_axes, start, rounds, sloped):
    """Fit position, angle, grey with its slope, and blur of an outline to a patch of a frame by robust Gauss-Newton
    steps.

    patch : `Patch`
    edges, semi_axes : of an `Outline`
    start : (7,) u, v in px and angle in rad in the patch, grey, blur in px, change of the grey from the centre to the
        edge along u and v, in the order FIT_U to FIT_GREY_V
    rounds : largest number of steps
    sloped : whether the grey of the block may change along u and v
    Returns (7,) the fit, (3,) standard errors of u, v, angle, share of the outline that is seen as fitted, and root
    mean square of the residuals in the band of the edge, over the contrast."""
    p = start.copy()
    curve, grad = np.zeros((N_FIT, N_FIT)), np.zeros(N_FIT)
    sums, contrast = FitSums(0.0, 0.0, 0.0, 0.0, 0.0, 0.0), 1.0
    turns = edges.shape[0] > 0 or semi_axes[0] != semi_axes[1]
    reach = max(semi_axes[0], 1.0) if edges.shape[0] == 0 else max(np.max(edges[:, 2]), 1.0)
    slope_scale = 1.0 / reach if sloped else 0.0
    for it in range(rounds):
        # larger misfits are no part of the block; in the first rounds, far from the solution, they are the signal
        scale = max(patch.noise, GREY_ROUGHNESS * contrast) if it > 0 else 1e9
        tukey = TUKEY_SIGMAS * scale * (3.0 if it < COARSE_ROUNDS else 1.0)
        sums = _normal_equations(patch, edges, semi_axes, slope_scale, p, tukey, curve, grad)
        contrast = max(sums.difference / max(sums.covered, 1e-9), 1e-9)
        for a in range(N_FIT):
            for b in range(a):
                curve[b, a] = curve[a, b]
            curve[a, a] = curve[a, a] * (1.0 + 1e-6) + 1e-9
        if not turns:
            curve[FIT_ANGLE, FIT_ANGLE] = 1.0
        step_p = np.linalg.solve(curve, grad)
        length = max(abs(step_p[FIT_U]), abs(step_p[FIT_V]), abs(step_p[FIT_ANGLE]) * reach)
        short = min(1.0, 0.5 * reach / max(length, 1e-9))
        for a in range(N_FIT):
            p[a] += short * step_p[a]
        p[FIT_BLUR] = min(max(p[FIT_BLUR], SMALLEST_BLUR_PX), 0.5 * reach)
        if length < CONVERGED_STEP_PX and it > COARSE_ROUNDS:
            break
    inverse = np.linalg.inv(curve)
    residual = math.sqrt(sums.squares / max(sums.band, 1e-9))
    sigma = max(patch.noise, residual)
    error = np.empty(3)
    for a in range(3):
        error[a] = sigma * math.sqrt(max(inverse[a, a], 0.0))
    return p, error, sums.seen / max(sums.whole, 1e-9), residual / contrast
