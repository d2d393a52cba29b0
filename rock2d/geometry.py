"""Contact geometry: how deep a block's contact points lie, compiled.

Five kinds of contact point, each with a depth δ (positive inside) whose rate is minus the normal velocity of
the block's material there, so that a force k δ along the normal is conservative:

- CORNER_FACET: a block corner below a facet; CORNER_VERTEX: the same where a re-entrant vertex is nearest
- VERTEX_FACE: a convex corner of the terrain inside a polygon, measured to the nearest block face
- SMOOTH_FACET, SMOOTH_VERTEX: a circle's or ellipse's lowest point against a facet, or a vertex against it

Depths come from the nearest feature only, so they are continuous over joints: a facet cut in ten is the same.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from rock2d.blocks import Block
from rock2d.compiled import njit
from rock2d.terrain import SMOOTH_TURN_RAD, Terrain

Array = np.ndarray

CORNER_FACET, CORNER_VERTEX, VERTEX_FACE, SMOOTH_FACET, SMOOTH_VERTEX = range(5)


class TerrainArrays(NamedTuple):
    """What compiled code reads of a cross-section; its end facets are prolonged."""

    points: Array  # (n + 1, 2)
    tangents: Array  # (n, 2)
    normals: Array  # (n, 2)
    lengths: Array  # (n,)
    zones: Array  # (n,) zone ids
    patches: Array  # (n,) facets joined by turns below SMOOTH_TURN_RAD share a patch
    convex: Array  # (n + 1,) 1 where the ground is a convex corner
    first: Array  # (bins,) lowest facet that overlaps this bin of x or a later one
    last: Array  # (bins,) highest facet that overlaps this bin of x or an earlier one
    x_start: float
    bins_per_m: float
    x_exit: Array  # (2,) the true ends of the cross-section


class BlockArrays(NamedTuple):
    """What compiled code reads of a block."""

    corners: Array  # (n, 2), empty if smooth
    face_normals: Array  # (n, 2) outward, of the face from corner i to i + 1
    face_offsets: Array  # (n,) distance of that face from the centroid
    semi_axes: Array  # (2,)
    mass: float
    inertia: float
    radius: float


def terrain_arrays(terrain: Terrain, prolong_m: float) -> TerrainArrays:
    """Arrays of a cross-section whose two end facets are prolonged by `prolong_m`."""
    points = terrain.points_m.copy()
    tangents, normals = terrain.tangents, terrain.normals
    points[0] -= tangents[0] * prolong_m
    points[-1] += tangents[-1] * prolong_m
    n = len(tangents)
    turns = terrain.turns_rad
    patches = np.concatenate([[0], np.cumsum(np.abs(turns[1:-1]) > SMOOTH_TURN_RAD)])
    low = np.minimum(points[:-1, 0], points[1:, 0])
    high = np.maximum(points[:-1, 0], points[1:, 0])
    x_start, bins = float(low.min()), max(8, 2 * n)
    bins_per_m = bins / (float(high.max()) - x_start)
    first, last = np.full(bins, n), np.full(bins, -1)
    begin = np.clip(((low - x_start) * bins_per_m).astype(int) - 1, 0, bins - 1)
    end = np.clip(((high - x_start) * bins_per_m).astype(int) + 1, 0, bins - 1)
    np.minimum.at(first, end, np.arange(n))
    np.maximum.at(last, begin, np.arange(n))
    first = np.minimum.accumulate(first[::-1])[::-1]
    last = np.maximum.accumulate(last)
    return TerrainArrays(
        points,
        np.ascontiguousarray(tangents),
        np.ascontiguousarray(normals),
        np.hypot(*np.diff(points, axis=0).T),
        terrain.zone_ids,
        patches.astype(np.int64),
        (turns < -SMOOTH_TURN_RAD).astype(np.int64),
        first.astype(np.int64),
        last.astype(np.int64),
        x_start,
        bins_per_m,
        np.array([terrain.points_m[0, 0], terrain.points_m[-1, 0]]),
    )


def block_arrays(block: Block) -> BlockArrays:
    """Arrays of a block."""
    corners = np.ascontiguousarray(block.corners_m, float).reshape(-1, 2)
    edge = np.roll(corners, -1, axis=0) - corners
    length = np.hypot(*edge.T)[:, None]
    normals = np.column_stack([edge[:, 1], -edge[:, 0]]) / np.where(length > 0, length, 1.0)
    return BlockArrays(
        corners,
        np.ascontiguousarray(normals),
        (normals * corners).sum(axis=1),
        np.array(block.semi_axes_m, float),
        block.mass_kg,
        block.inertia_kg_m2,
        block.radius_m,
    )


@njit
def facet_range(terrain, x_low, x_high):
    """First and one-past-last index of the facets that can lie in [x_low, x_high]."""
    bins = terrain.first.size
    b0 = min(max(int((x_low - terrain.x_start) * terrain.bins_per_m), 0), bins - 1)
    b1 = min(max(int((x_high - terrain.x_start) * terrain.bins_per_m), 0), bins - 1)
    return terrain.first[b0], terrain.last[b1] + 1


@njit
def point_depth(px, py, terrain, f0, f1):
    """Depth of a point below the surface (negative: height above it), and the nearest feature.

    Returns (depth in m, kind, index): CORNER_FACET with a facet, or CORNER_VERTEX with a vertex.
    """
    best, kind, index, sign = np.inf, CORNER_FACET, f0, 1.0
    for f in range(f0, f1):
        dx, dy = px - terrain.points[f, 0], py - terrain.points[f, 1]
        along = dx * terrain.tangents[f, 0] + dy * terrain.tangents[f, 1]
        above = dx * terrain.normals[f, 0] + dy * terrain.normals[f, 1]
        if 0.0 <= along <= terrain.lengths[f]:
            if abs(above) < best:
                best, kind, index = abs(above), CORNER_FACET, f
                sign = 1.0 if above >= 0.0 else -1.0
        else:
            v = f if along < 0.0 else f + 1
            dx, dy = px - terrain.points[v, 0], py - terrain.points[v, 1]
            distance = np.sqrt(dx * dx + dy * dy)
            if distance < best:
                best, kind, index = distance, CORNER_VERTEX, v
                # inside or outside by the mean normal of the two facets
                nx, ny = 0.0, 0.0
                if v > 0:
                    nx, ny = nx + terrain.normals[v - 1, 0], ny + terrain.normals[v - 1, 1]
                if v < terrain.lengths.size:
                    nx, ny = nx + terrain.normals[v, 0], ny + terrain.normals[v, 1]
                sign = 1.0 if nx * dx + ny * dy >= 0.0 else -1.0
    return -sign * best, kind, index


@njit
def polygon_depth(px, py, x, y, c, s, block):
    """Depth of a point inside a polygon at pose (x, y, cos, sin) and its nearest face; negative outside."""
    bx, by = c * (px - x) + s * (py - y), -s * (px - x) + c * (py - y)
    depth, face = np.inf, 0
    for k in range(block.corners.shape[0]):
        d = block.face_offsets[k] - block.face_normals[k, 0] * bx - block.face_normals[k, 1] * by
        if d < depth:
            depth, face = d, k
    return depth, face


@njit
def nearest_on_ellipse(px, py, a, b):
    """Nearest point of the ellipse x²/a² + y²/b² = 1 to (px, py), by curvature-centre iteration.

    Converges quadratically for points near the boundary, inside or outside (A. Kemper's method).
    """
    qx, qy = abs(px), abs(py)
    tx, ty = np.sqrt(0.5), np.sqrt(0.5)
    for _ in range(30):
        ex, ey = (a * a - b * b) * tx**3 / a, (b * b - a * a) * ty**3 / b
        rx, ry = a * tx - ex, b * ty - ey
        dx, dy = qx - ex, qy - ey
        r, d = np.sqrt(rx * rx + ry * ry), np.sqrt(dx * dx + dy * dy)
        if d == 0.0:
            break
        nx, ny = max(0.0, (dx * r / d + ex) / a), max(0.0, (dy * r / d + ey) / b)
        norm = np.sqrt(nx * nx + ny * ny)
        nx, ny = nx / norm, ny / norm
        change = abs(nx - tx) + abs(ny - ty)
        tx, ty = nx, ny
        if change < 1e-15:
            break
    return np.copysign(a * tx, px), np.copysign(b * ty, py)


@njit
def contact_point(kind, index, part, x, y, c, s, block, terrain):
    """Depth δ, direction of the force on the block (nx, ny) and arm from the centroid (rx, ry) of a feature.

    `part` is the block's corner or face; `index` the terrain's facet or vertex; (x, y, c, s) the pose.
    """
    if kind in (CORNER_FACET, CORNER_VERTEX):
        bx, by = block.corners[part, 0], block.corners[part, 1]
        rx, ry = c * bx - s * by, s * bx + c * by
        dx, dy = x + rx - terrain.points[index, 0], y + ry - terrain.points[index, 1]
        if kind == CORNER_FACET:
            nx, ny = terrain.normals[index, 0], terrain.normals[index, 1]
            return -(dx * nx + dy * ny), nx, ny, rx, ry
        distance = np.sqrt(dx * dx + dy * dy)
        if distance == 0.0:
            return 0.0, 0.0, 1.0, rx, ry
        return distance, -dx / distance, -dy / distance, rx, ry
    px, py = terrain.points[index, 0], terrain.points[index, 1]
    if kind == VERTEX_FACE:
        mx, my = block.face_normals[part, 0], block.face_normals[part, 1]
        nx, ny = -(c * mx - s * my), -(s * mx + c * my)
        rx, ry = px - x, py - y
        return block.face_offsets[part] + nx * rx + ny * ry, nx, ny, rx, ry
    a, b = block.semi_axes[0], block.semi_axes[1]
    if kind == SMOOTH_FACET:
        nx, ny = terrain.normals[index, 0], terrain.normals[index, 1]
        if a == b:
            rx, ry = -a * nx, -a * ny
        else:
            mx, my = -(c * nx + s * ny), -(-s * nx + c * ny)
            h = np.sqrt(a * a * mx * mx + b * b * my * my)
            bx, by = a * a * mx / h, b * b * my / h
            rx, ry = c * bx - s * by, s * bx + c * by
        return -((x + rx - px) * nx + (y + ry - py) * ny), nx, ny, rx, ry
    dx, dy = px - x, py - y
    if a == b:
        distance = np.sqrt(dx * dx + dy * dy)
        nx, ny = -dx / distance, -dy / distance
        return a - distance, nx, ny, -a * nx, -a * ny
    qx, qy = c * dx + s * dy, -s * dx + c * dy
    bx, by = nearest_on_ellipse(qx, qy, a, b)
    mx, my = bx / (a * a), by / (b * b)
    norm = np.sqrt(mx * mx + my * my)
    mx, my = mx / norm, my / norm
    depth = (bx - qx) * mx + (by - qy) * my
    return depth, -(c * mx - s * my), -(s * mx + c * my), c * bx - s * by, s * bx + c * by
