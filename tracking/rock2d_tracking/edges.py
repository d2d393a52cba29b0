"""Fit of the outline of a block to its edge in the picture, independent of the appearance of the block.

Along the normal of each point of the outline, the picture changes from the block to the known background. The position
of the edge on this line is the integral of the block's share (I - B)·(F - B) / |F - B|², with the picture I, the
background B and the block's colour F just inside the edge. Shading, texture, highlights and colours of the block
therefore do not matter. The edge is unknown only where the block has the colour of the background."""

from typing import NamedTuple

import numpy as np

from rock2d.arrays import Array
from rock2d.statistics import MAD_TO_SD, weighted_median
from rock2d_tracking.outline import TUKEY_SIGMAS, Outline, Patch

POINT_SPACING_PX = 1.5  # spacing of the points on the outline
FEWEST_POINTS, MOST_POINTS = 24, 120
CORNER_SHARE = 0.12  # share of a side next to a corner that has no points: there is no single normal
SAMPLES_PER_PX = 2.0  # along a normal
# half the width of the search for the edge, over the inner radius, in the first and in the last rounds
WIDE_SHARE, NARROW_SHARE = 0.75, 0.45
NARROWEST_PX, WIDEST_PX = 3.0, 4.5  # limits of the narrow search
INNER_SHARE = 0.45  # share of the inner half of a normal from which the block's colour is taken
LEAST_SHADING_PX = 4.0  # half a normal; on a shorter one, blur looks like shading
SHADING_POINTS = 7  # neighbours on the outline that share a slope of colour
SHADING_SHARE = 0.5  # largest change of colour over the edge, over the colour
WIDE_ROUNDS, NARROW_ROUNDS = 3, 5
FAINTEST_EDGE_SIGMAS = 4.0  # contrast of an edge point in noise below which it is not seen
# least strength of an edge point that counts, and least share of such points
STRONG, ENOUGH_STRONG = 0.25, 0.6
FOUND_PX, FOUND_RADII = 0.7, 0.04  # distance from the outline within which an edge point counts as seen
SMALLEST_SCATTER_PX = 0.03
JACKKNIFE_PARTS = 8  # parts of an outline
NO_SMEAR = np.zeros(2)
SMEAR_SHARE = 0.2  # of the width of a smeared edge, within which its points count as seen
DEEPEST_SHARE = 0.9  # length of a normal inside the block, over its inner radius
EDGE_SHIFT_PX = 0.15  # 1 sigma, by which a whole edge looks too far out or in


class EdgePoints(NamedTuple):
    """Points on an outline about its centroid, their outward normals, and the inner radius: (n, 2), (n, 2), px."""

    points: Array
    normals: Array
    inner_px: float


class EdgeFit(NamedTuple):
    """The result of `fit_edges`.

    Attributes
    ----------
    pose : (3,) u, v in px and angle in rad
    error : (3,) standard errors
    size : factor on the outline
    seen : share of the outline with contrast whose edge was found on the outline"""

    pose: Array
    error: Array
    size: float
    seen: float


def edge_points(outline: Outline) -> EdgePoints:
    """Evenly spaced points on an outline, none near a corner."""
    if len(outline.edges) == 0:
        a, b = outline.semi_axes_px
        perimeter = np.pi * (3 * (a + b) - np.sqrt((3 * a + b) * (a + 3 * b)))
        n = int(np.clip(perimeter / POINT_SPACING_PX, FEWEST_POINTS, MOST_POINTS))
        turn = 2 * np.pi * np.arange(n) / n
        points = np.column_stack([a * np.cos(turn), b * np.sin(turn)])
        normals = np.column_stack([np.cos(turn) / a, np.sin(turn) / b])
        normals /= np.hypot(*normals.T)[:, None]
        return EdgePoints(points, normals, float(min(a, b)))
    corners = outline.corners_px
    ends = np.roll(corners, -1, axis=0)
    lengths = np.hypot(*(ends - corners).T)
    count = np.clip(lengths.sum() / POINT_SPACING_PX, FEWEST_POINTS, MOST_POINTS)
    places: list[Array] = []
    outward: list[Array] = []
    for start, end, normal, length in zip(corners, ends, outline.edges[:, :2], lengths, strict=True):
        n = max(3, round(count * length / lengths.sum()))
        share = np.linspace(CORNER_SHARE, 1 - CORNER_SHARE, n)[:, None]
        places.append(start + share * (end - start))
        outward.append(np.tile(normal, (n, 1)))
    return EdgePoints(np.concatenate(places), np.concatenate(outward), float(outline.edges[:, 2].min()))


def fit_edges(
    patch: Patch,
    edge: EdgePoints,
    start: Array,
    *,
    symmetric: bool,
    free_size: bool = False,
    smear_px: Array = NO_SMEAR,
) -> EdgeFit | None:
    """Fit position, angle and, if `free_size`, size of an outline to its edge in a patch of a frame; None if it fails.

    start : (3,) u, v in px and angle in rad in the patch
    symmetric : whether the outline is a circle, which has no angle
    smear_px : (2,) displacement of the block while the shutter is open"""
    p = np.array([start[0], start[1], start[2], 1.0])
    free = np.array([True, True, not symmetric, free_size])
    reach = float(np.hypot(*edge.points.T).max())
    for round_ in range(WIDE_ROUNDS + NARROW_ROUNDS):
        wide = round_ < WIDE_ROUNDS
        if wide:
            half = max(WIDE_SHARE * edge.inner_px, NARROWEST_PX)
        else:
            half = min(max(NARROW_SHARE * edge.inner_px, NARROWEST_PX), WIDEST_PX)
        offset, strength, wide_px = _offsets(patch, edge, p, half, smear_px)
        if (strength > 0).sum() < FEWEST_POINTS // 3:
            return None
        turned, normals = _placed(edge, p)
        columns = np.column_stack([
            normals, turned[:, 0] * normals[:, 1] - turned[:, 1] * normals[:, 0], (turned * normals).sum(axis=1) / p[3]
        ])[:, free if not wide else free & [True, True, True, False]]  # fmt: skip
        weight = strength.copy()
        for _ in range(3):
            root = np.sqrt(weight)[:, None]
            step, *_ = np.linalg.lstsq(columns * root, offset * root[:, 0], rcond=None)
            left = offset - columns @ step
            spread = MAD_TO_SD * weighted_median(np.abs(left), strength)
            scatter = max(spread, SMALLEST_SCATTER_PX)
            limit = TUKEY_SIGMAS * max(scatter, 0.1) * (2.0 if wide else 1.0)
            weight = strength * np.clip(1 - (left / limit) ** 2, 0, None) ** 2
        full = np.zeros(4)
        full[free if not wide else free & [True, True, True, False]] = step
        length = float(np.hypot(*full[:2]))
        full[:2] *= min(1.0, 0.6 * half / max(length, 1e-9))
        full[2] = np.clip(full[2], -0.3, 0.3)
        full[3] = np.clip(full[3], -0.1, 0.1)
        p += full
        if not np.isfinite(p).all() or not 0.5 < p[3] < 2.0:
            return None
        near = np.abs(left) < max(FOUND_PX, FOUND_RADII * reach) + SMEAR_SHARE * wide_px
        strong = strength > STRONG
        # where the block has the colour of the background, its edge is unknown
        seen = float((strong & near).sum() / max(strong.sum(), ENOUGH_STRONG * len(strong)))
        if not wide and length < 0.01 and abs(full[3]) * reach < 0.01 and round_ > WIDE_ROUNDS:
            break
    errors = np.full(4, np.inf)
    errors[free] = _errors(columns, weight, left)
    if not np.isfinite(errors[:2]).all():
        return None
    if symmetric:
        errors[2] = np.nan
    return EdgeFit(p[:3], errors[:3], float(p[3]), seen)


def _errors(columns: Array, weight: Array, left: Array) -> Array:
    """(k,) standard errors of a fit; infinite if one part of the outline determines a parameter alone.

    Highlights, shadows and compression shift the edge equally along a part of the outline and in every frame. The
    scatter of edge points or frames does not show this, but the fit without this part does (delete-a-group jackknife;
    Shao and Tu 1995, The Jackknife and Bootstrap, section 2.3). Blur before the gamma correction shifts the whole edge
    in or out; this moves a block of which only one side is seen."""
    parts = np.arange(len(left)) * JACKKNIFE_PARTS // len(left) == np.arange(JACKKNIFE_PARTS)[:, None]
    targets = np.column_stack([left, np.ones_like(left)])
    curves = np.einsum("gn,n,nj,nk->gjk", parts, weight, columns, columns)
    pulls = np.einsum("gn,n,nj,nt->gjt", parts, weight, columns, targets)
    try:
        own = np.linalg.solve(curves.sum(axis=0) - curves, pulls.sum(axis=0) - pulls)[..., 0]
        shift = np.linalg.solve(curves.sum(axis=0), pulls.sum(axis=0))[:, 1]
    except np.linalg.LinAlgError:
        return np.full(columns.shape[1], np.inf)
    return np.asarray(np.sqrt(jackknife_variance(own) + (EDGE_SHIFT_PX * shift) ** 2))


def jackknife_variance(own: Array) -> Array:
    """Variances of parameters that were fitted without each of JACKKNIFE_PARTS parts: rows of `own`."""
    return np.asarray((JACKKNIFE_PARTS - 1) / JACKKNIFE_PARTS * ((own - own.mean(axis=0)) ** 2).sum(axis=0))


def _placed(edge: EdgePoints, p: Array) -> tuple[Array, Array]:
    """Points relative to the centre, and normals, rotated and scaled."""
    c, s = np.cos(p[2]), np.sin(p[2])
    turn = np.array([[c, s], [-s, c]])
    return p[3] * edge.points @ turn, edge.normals @ turn


def _offsets(patch: Patch, edge: EdgePoints, p: Array, half: float, smear_px: Array) -> tuple[Array, Array, Array]:
    """(n,) distance in px from each edge point outward to the edge, (n,) its strength, 0 to 1, and (n,) width over
    which motion smears the edge there.

    A uniform smear makes the edge wider, but does not change the integral of the block's share. The normals must only
    be longer, and the block's colour be taken from farther inside."""
    import cv2

    turned, normals = _placed(edge, p)
    wide_px = np.abs(normals @ smear_px)
    # half the length of each normal
    reach = np.maximum(half, np.minimum(half + 0.5 * wide_px, DEEPEST_SHARE * p[3] * edge.inner_px))
    count = 2 * int(np.ceil(reach.max() * SAMPLES_PER_PX)) + 1
    along = np.linspace(-1.0, 1.0, count)
    t = reach[:, None] * along
    u = (p[0] + turned[:, :1] + normals[:, :1] * t).astype(np.float32)
    v = (p[1] + turned[:, 1:] + normals[:, 1:] * t).astype(np.float32)
    height, width = patch.image.shape[:2]
    inside = (u >= 0) & (v >= 0) & (u <= width - 1) & (v <= height - 1)
    n = len(turned)
    seen, behind, shown = (
        cv2.remap(values, u, v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        for values in (patch.image, patch.background, patch.visible.astype(np.float32))
    )
    seen, behind = seen.reshape(n, count, -1), behind.reshape(n, count, -1)
    # the part from which the block's colour is taken: inside, and outside the smear
    inner = (t < -np.maximum((1 - INNER_SHARE) * half, 0.5 * wide_px[:, None])) | (along <= along[2])
    ranked, own_count = np.sort(np.where(inner[..., None], seen, np.nan), axis=1), inner.sum(axis=1)  # NaN come last
    each = np.arange(n)
    own = (0.5 * (ranked[each, (own_count - 1) // 2] + ranked[each, own_count // 2]))[:, None]  # the median
    if LEAST_SHADING_PX <= half <= WIDEST_PX:
        middle = (t * inner).sum(axis=1, keepdims=True) / inner.sum(axis=1, keepdims=True)
        own = own + _shading(seen, t - middle, inner, own)[:, None] * (t - middle)[..., None]
    contrast = own - behind
    power = (contrast**2).sum(axis=2)
    share = ((seen - behind) * contrast).sum(axis=2) / np.maximum(power, 1e-6)
    offset = reach * (along[1] - along[0]) * (np.clip(share, -0.3, 1.3).sum(axis=1) - 0.5) - reach
    middle = np.abs(along) <= 0.6
    level = np.sqrt(power[:, middle].min(axis=1))
    faint = FAINTEST_EDGE_SIGMAS * patch.noise
    strength = np.where(level > faint, level**2 / (level**2 + (3 * faint) ** 2), 0.0)
    strength *= inside.all(axis=1) & (shown[:, middle].min(axis=1) > 0.5)
    return offset, strength, wide_px


def _shading(seen: Array, t: Array, inner: Array, own: Array) -> Array:
    """(n, colours) slope of the block's colour along the normals, alike at neighbouring points: it gets darker toward
    the edge of its lit side. `t`, `inner` (n, count): place from the middle of the inner part, and what is in it."""
    from scipy.ndimage import median_filter, uniform_filter1d

    line = t * inner
    slope = np.einsum("nt,ntc->nc", line / (line**2).sum(axis=1, keepdims=True), seen)
    slope = uniform_filter1d(
        median_filter(slope, (SHADING_POINTS, 1), mode="wrap"), SHADING_POINTS, axis=0, mode="wrap"
    )
    edge = (t[:, -1:] + t[:, :1]) / 2  # from the middle of the inner part to the outline
    most = SHADING_SHARE * np.abs(own[:, 0]) / edge
    return np.asarray(np.clip(slope, -most, most))
