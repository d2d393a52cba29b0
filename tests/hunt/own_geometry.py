"""Where a block touches a cross-section: a geometry of its own for `integrator`, which shares nothing with the engines.

Features of contact are tuples: ("corner", corner, segment), ("face", vertex, face), ("facet", facet),
("vertex", vertex, half of the ellipse). Blocks have sharp corners and their centre of mass in the centroid."""

from math import cos, hypot, pi, sin, sqrt
from typing import NamedTuple

import numpy as np
from scipy.optimize import brentq

from rock2d.scene.blocks import Block
from rock2d.scene.cross_section import SMOOTH_TURN_RAD, CrossSection

Array = np.ndarray
Feature = tuple
PROLONGED = 10.0  # widths of the cross-section by which its end facets go on


class LeftOutError(Exception):
    """An impact that is not compared, and why."""


class Place(NamedTuple):
    """Depth in m of a contact point, direction (2,) of the force on the block, arm (2,) in m from its centre."""

    depth: float
    nx: float
    ny: float
    rx: float
    ry: float


class Scene:
    """A block and a cross-section whose origin is moved to `origin` (2,) m, so that lengths are of the block's size."""

    def __init__(self, block: Block, ground: CrossSection, origin: Array) -> None:
        points = ground.points_m - origin
        width = PROLONGED * (points[-1, 0] - points[0, 0])
        points[0] -= width * ground.tangents[0]
        points[-1] += width * ground.tangents[-1]
        self.points, self.tangents, self.normals = points, ground.tangents, ground.normals
        self.lengths = np.hypot(*np.diff(points, axis=0).T)
        self.zones, self.block = ground.zones, block
        turns = ground.turns_rad
        self.convex = turns < -SMOOTH_TURN_RAD
        self.patch = np.concatenate([[0], np.cumsum(np.abs(turns[1:-1]) > SMOOTH_TURN_RAD)])
        self.mean_normals = np.vstack([self.normals, np.zeros(2)])
        self.mean_normals[1:] += self.normals
        self.corners = block.corners_m
        edge = np.roll(self.corners, -1, axis=0) - self.corners
        if len(edge):
            self.face_normals = np.column_stack([edge[:, 1], -edge[:, 0]]) / np.hypot(*edge.T)[:, None]
            self.face_offsets = (self.face_normals * self.corners).sum(axis=1)

    def zone(self, feature: Feature, before: str = "") -> str:
        """Zone of a feature; a vertex has that of the facet before it, unless the contact comes from the one after."""
        kind = feature[0]
        if kind in ("corner", "facet"):
            return self.zones[feature[-1]]
        v = feature[1]
        return before if v < len(self.zones) and before == self.zones[v] else self.zones[v - 1]

    # the search --------------------------------------------------------------------------------------------

    def search(self, x: float, y: float, theta: float) -> dict[object, tuple[Feature, float]]:
        """Key -> (feature, depth in m) of all that could touch. Keys are corners and vertices of a polygon's contacts;
        of a smooth profile 2 p for patch p and 2 p + 1 for the convex vertex behind it."""
        return self._search_polygon(x, y, theta) if len(self.corners) else self._search_smooth(x, y, theta)

    def _search_polygon(self, x: float, y: float, theta: float) -> dict[object, tuple[Feature, float]]:
        c, s = cos(theta), sin(theta)
        turn = np.array([[c, s], [-s, c]])
        found: dict[object, tuple[Feature, float]] = {}
        for i, nearest in enumerate(self._nearest_segments(self.corners @ turn + (x, y))):
            f, depth = nearest
            found["corner", i] = ("corner", i, f), depth
        vertices = np.flatnonzero(self.convex)
        inside = self.face_offsets - (self.points[vertices] - (x, y)) @ turn.T @ self.face_normals.T
        for v, depths in zip(vertices.tolist(), inside, strict=True):
            face = int(np.argmin(depths))
            found["face", v] = ("face", v, face), float(depths[face])
        return found

    def _nearest_segments(self, points: Array) -> list[tuple[int, float]]:
        """The segment nearest to each of the points (n, 2), its ends included, and the depth below it."""
        d = points[:, None] - self.points[:-1]
        along = np.clip((d * self.tangents).sum(axis=2), 0.0, self.lengths)
        nearest = ((d - along[..., None] * self.tangents) ** 2).sum(axis=2).argmin(axis=1)
        out = []
        for i, f in enumerate(nearest.tolist()):
            # where two segments share the nearest vertex, rounding must not choose: it is the first's
            own = f - 1 if f > 0 and along[i, f] == 0.0 else f
            out.append((own, self._below_segment(own, *points[i].tolist())[0]))
        return out

    def _below_segment(self, f: int, px: float, py: float) -> tuple[float, float, float]:
        """(depth, nx, ny) of a point below segment f, beyond its ends below the vertex."""
        (ax, ay), (tx, ty), (nx, ny) = self.points[f], self.tangents[f], self.normals[f]
        along = (px - ax) * tx + (py - ay) * ty
        if 0.0 <= along <= self.lengths[f]:
            return float(-(px - ax) * nx - (py - ay) * ny), float(nx), float(ny)
        v = f if along < 0.0 else f + 1
        dx, dy = px - self.points[v, 0], py - self.points[v, 1]
        outside = 1.0 if dx * self.mean_normals[v, 0] + dy * self.mean_normals[v, 1] >= 0.0 else -1.0
        distance = hypot(dx, dy)
        return -outside * distance, float(outside * dx / distance), float(outside * dy / distance)

    def _search_smooth(self, x: float, y: float, theta: float) -> dict[object, tuple[Feature, float]]:
        c, s = cos(theta), sin(theta)
        a, b = self.block.semi_axes_m
        n, t = self.normals, self.tangents
        across, upward = c * n[:, 0] + s * n[:, 1], -s * n[:, 0] + c * n[:, 1]
        support = np.hypot(a * across, b * upward)
        low = np.column_stack([-a * a * across / support, -b * b * upward / support])
        low = np.column_stack([c * low[:, 0] - s * low[:, 1] + x, s * low[:, 0] + c * low[:, 1] + y])
        front = ((np.array([x, y]) - self.points[:-1]) * n).sum(axis=1) > 0.0
        foot = ((low - self.points[:-1]) * t).sum(axis=1)
        depths = -((low - self.points[:-1]) * n).sum(axis=1)
        found: dict[object, tuple[Feature, float]] = {}

        def offer(key: int, feature: Feature, depth: float) -> None:
            if key not in found or depth > found[key][1]:
                found[key] = feature, depth

        for f in np.flatnonzero(front & (depths > -0.5 * min(a, b))).tolist():
            if 0.0 <= foot[f] <= self.lengths[f]:
                offer(2 * int(self.patch[f]), ("facet", f), float(depths[f]))
        for f in np.flatnonzero(np.where(front[:-1], foot[:-1] > self.lengths[:-1], front[1:])).tolist():
            v = f + 1
            if hypot(*(self.points[v] - (x, y))) > 1.2 * max(a, b):
                continue
            feature = ("vertex", v, self._half(v, x, y, theta))
            place = self.place(feature, x, y, theta)
            normal = np.array([place.nx, place.ny])
            if normal @ t[f] >= 0.0 >= normal @ t[v] and normal @ (n[f] + n[v]) > 0.0:
                offer(2 * int(self.patch[f]) + int(self.convex[v]), feature, place.depth)
        return found

    def _half(self, v: int, x: float, y: float, theta: float) -> int:
        """On which side of the longer axis of an ellipse a vertex lies; 0 of a circle."""
        a, b = self.block.semi_axes_m
        dx, dy = self.points[v] - (x, y)
        side = -sin(theta) * dx + cos(theta) * dy if a >= b else cos(theta) * dx + sin(theta) * dy
        return int(a != b and side < 0.0)

    def kept_vertex(self, feature: Feature, x: float, y: float, theta: float) -> Feature | None:
        """The vertex at which a smooth contact goes on if no feature near is its own; None if none is inside, or if it
        has passed into the other half."""
        v = feature[1]
        if feature[0] == "facet":
            place = self.place(feature, x, y, theta)
            foot = np.array([x + place.rx, y + place.ry]) - self.points[v]
            v += int(foot @ self.tangents[v] > 0.0)
        kept = ("vertex", v, self._half(v, x, y, theta))
        if feature[0] == "vertex" and kept != feature:
            return None
        inside = 0 < v < len(self.zones) and self.place(kept, x, y, theta).depth > 0.0
        return kept if inside else None

    # one feature --------------------------------------------------------------------------------------------

    def place(self, feature: Feature, x: float, y: float, theta: float) -> Place:
        """Where the contact at a feature is and which way it pushes."""
        c, s = cos(theta), sin(theta)
        kind, index = feature[0], feature[1]
        if kind == "corner":
            bx, by = self.corners[index]
            rx, ry = float(c * bx - s * by), float(s * bx + c * by)
            depth, nx, ny = self._below_segment(feature[2], x + rx, y + ry)
            return Place(depth, nx, ny, rx, ry)
        if kind == "face":
            (fx, fy), face = self.face_normals[feature[2]], feature[2]
            nx, ny = float(s * fy - c * fx), float(-s * fx - c * fy)
            rx, ry = float(self.points[index, 0] - x), float(self.points[index, 1] - y)
            return Place(float(self.face_offsets[face]) + nx * rx + ny * ry, nx, ny, rx, ry)
        a, b = self.block.semi_axes_m
        if kind == "facet":
            (px, py), (nx, ny) = self.points[index].tolist(), self.normals[index].tolist()
            across, upward = c * nx + s * ny, -s * nx + c * ny
            support = hypot(a * across, b * upward)
            bx, by = -a * a * across / support, -b * b * upward / support
            rx, ry = c * bx - s * by, s * bx + c * by
            return Place(-(x + rx - px) * nx - (y + ry - py) * ny, nx, ny, rx, ry)
        dx, dy = float(self.points[index, 0] - x), float(self.points[index, 1] - y)
        qx, qy = c * dx + s * dy, -s * dx + c * dy
        bx, by = nearest_on_ellipse(qx, qy, a, b)
        ux, uy = bx / a**2, by / b**2
        norm = hypot(ux, uy)
        ux, uy = ux / norm, uy / norm
        depth = (bx - qx) * ux + (by - qy) * uy
        return Place(depth, -(c * ux - s * uy), -(s * ux + c * uy), c * bx - s * by, s * bx + c * by)

    def centre_depth(self, x: float, y: float) -> float:
        """Depth in m of the block's centre below the nearest segment."""
        return self._nearest_segments(np.array([[x, y]]))[0][1]


def first_touch(
    block: Block, ground: CrossSection, state: Array, gravity_m_s2: float, limit_s: float
) -> tuple[float, Array]:
    """Instant in s and state (6,) at which a flying block first touches the ground."""
    scene, r, (low, high) = Scene(block, ground, np.zeros(2)), block.reach_m, ground.points_m[[0, -1], 0]
    x, y, theta, vx, vy, omega = map(float, state)

    def at(t: float) -> Array:
        fallen = gravity_m_s2 * t
        return np.array([x + vx * t, y + (vy - fallen / 2) * t, theta + omega * t, vx, vy - fallen, omega])

    def deepest(t: float) -> float:
        return max((depth for _, depth in scene.search(*at(t)[:3].tolist()).values()), default=-r)

    if deepest(0.0) > 0.0:  # outside the cross-section, whose end facets go on
        raise LeftOutError("starts in the ground")
    t = 0.0
    while t < limit_s:
        now = at(t)
        if not low <= now[0] <= high:
            raise LeftOutError("leaves the cross-section")
        # a step is shorter than the way that is surely clear; a polygon's depths are bounds of that
        clear = -scene.centre_depth(now[0], now[1]) - 1.01 * r
        clear = max(clear, 0.0 if block.smooth else -deepest(t))
        pace = np.hypot(now[3], now[4]) + abs(omega) * r + np.sqrt(2.0 * gravity_m_s2 * clear)
        ahead = t + max(0.01 * r, 0.7 * clear) / pace
        if deepest(ahead) > 0.0:
            t = brentq(deepest, t, ahead, xtol=1e-16, rtol=1e-15)
            return t, at(t)
        t = ahead
    raise LeftOutError("touches nothing in time")


def nearest_on_ellipse(px: float, py: float, a: float, b: float) -> tuple[float, float]:
    """The point of the ellipse x²/a² + y²/b² = 1 that is nearest to (px, py): where, in the quadrant of the point, the
    derivative of the distance with respect to the eccentric angle has its root."""
    if a == b:
        distance = sqrt(px * px + py * py)
        return a * px / distance, a * py / distance
    qx, qy = abs(px), abs(py)

    def slope(phi: float) -> float:
        return (b * b - a * a) * sin(phi) * cos(phi) + a * qx * sin(phi) - b * qy * cos(phi)

    low, high = slope(0.0), slope(pi / 2)
    if low >= 0.0 and high >= 0.0:
        phi = 0.0
    elif high <= 0.0 and low <= 0.0:
        phi = pi / 2
    else:
        phi = brentq(slope, 0.0, pi / 2, xtol=1e-16, rtol=1e-15)
    return (a if px >= 0 else -a) * cos(phi), (b if py >= 0 else -b) * sin(phi)
