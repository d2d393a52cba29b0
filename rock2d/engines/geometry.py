"""Contact geometry: depths of contact points, compiled.

There are five kinds of contact point. The rate of each depth δ (positive inside) is minus the normal velocity of the
material of the block there, so that a force k δ along the normal is conservative:

- CORNER_FACET: a corner of the block below a facet; CORNER_VERTEX: the same where a vertex is nearest (a re-entrant
  one, or a convex one if the corner is rounded)
- VERTEX_FACE: a convex corner of the ground inside a polygon, measured to the nearest face of the block
- SMOOTH_FACET, SMOOTH_VERTEX: the lowest point of a circle or ellipse below a facet, or a vertex inside the profile

Only the nearest feature gives the depth. Depths are continuous at joints, so dividing a facet changes nothing. A
rounded corner is a circle; a convex ground corner touches it or the flat part of a face, never both."""

from functools import lru_cache
from typing import NamedTuple

import numpy as np

from rock2d.arrays import Array
from rock2d.compiled import kernel
from rock2d.records.columns import OMEGA, THETA, VX, VY, X, Y
from rock2d.scene.blocks import Block
from rock2d.scene.cross_section import SMOOTH_TURN_RAD, CrossSection

CORNER_FACET, CORNER_VERTEX, VERTEX_FACE, SMOOTH_FACET, SMOOTH_VERTEX = range(5)
# numbers of a loaded feature (see `load_feature`): ground point (2), facet normal (2), shape of the block there (4)
F_POINT, F_NORMAL, F_SHAPE, N_FEATURE = 0, 2, 4, 8


MOST_FACETS_UNSORTED = 8  # with more facets, a search uses only those near the point
CACHED_ARRAYS = 64  # number of blocks and of cross-sections whose arrays are cached
RUN_TURN_RAD = 0.01  # joints with a smaller turn are no events: a contact passes them within a step
# columns of a row of GroundArrays.facets
(POINT_X, POINT_Y, TANGENT_X, TANGENT_Y, NORMAL_X, NORMAL_Y, LENGTH, ZONE_ID, PATCH, CONVEX, RUN_FIRST, RUN_LAST) = (
    range(12)
)
# columns of a row of BlockArrays.sides
CORNER_X, CORNER_Y, FACE_X, FACE_Y, FACE_OFFSET = range(5)


class GroundArrays(NamedTuple):
    """A cross-section as compiled code reads it; its end facets are extended.

    All facets are in one array, because passing and indexing many arrays costs more than the arithmetic."""

    # (n + 1, 12): start point, tangent, normal, length, zone id, patch, start is a convex corner, first and last facet
    # of the run of facets that are nearly in line
    facets: Array
    first: Array  # (bins,) lowest facet that overlaps this bin of x or a later one
    last: Array  # (bins,) highest facet that overlaps this bin of x or an earlier one
    x_start: float
    bins_per_m: float
    x_low: float  # the true ends of the cross-section
    x_high: float
    facet_m: float  # mean length of a facet along x


class BlockArrays(NamedTuple):
    """A block as compiled code reads it; the origin of its axes is the centre of mass.

    The corners of a polygon are circles of radius `rounding` (0: sharp) that touch the faces from inside."""

    sides: Array  # (n, 5) centre of a corner, outward normal and distance from the centre of mass of the face behind it
    air: Array  # columns of the laws of flight; empty if no air acts
    semi_a: float
    semi_b: float
    mass: float
    inertia: float
    radius: float  # radius of the smallest circle about the centre of mass that contains the block
    rounding: float
    centre_x: float  # centre of a smooth profile, in the block's axes
    centre_y: float


@lru_cache(CACHED_ARRAYS)
def ground_arrays(ground: CrossSection) -> GroundArrays:
    """Arrays of a cross-section. Its two end facets are extended by ten times its width, far beyond any block.

    Facets with turns below SMOOTH_TURN_RAD between them form a patch; facets of one zone with turns below RUN_TURN_RAD
    form a run."""
    points = ground.points_m.copy()
    x_low, x_high = float(points[0, 0]), float(points[-1, 0])
    prolong_m = 10.0 * (x_high - x_low)
    points[0] -= ground.tangents[0] * prolong_m
    points[-1] += ground.tangents[-1] * prolong_m
    n = len(points) - 1
    turns = ground.turns_rad
    facets = np.zeros((n + 1, 12))
    facets[:, :2] = points
    facets[:n, 2:4], facets[:n, 4:6] = ground.tangents, ground.normals
    facets[:n, LENGTH] = np.hypot(*np.diff(points, axis=0).T)
    facets[:n, ZONE_ID] = ground.zone_ids
    facets[:n, PATCH] = np.concatenate([[0], np.cumsum(np.abs(turns[1:-1]) > SMOOTH_TURN_RAD)])
    facets[:, CONVEX] = turns < -SMOOTH_TURN_RAD
    broken = (np.abs(turns[1:-1]) > RUN_TURN_RAD) | (np.diff(ground.zone_ids) != 0)
    begins = np.concatenate([[0], np.flatnonzero(broken) + 1])
    run = np.concatenate([[0], np.cumsum(broken)])
    facets[:n, RUN_FIRST], facets[:n, RUN_LAST] = begins[run], np.append(begins[1:], n)[run] - 1
    low = np.minimum(points[:-1, 0], points[1:, 0])
    high = np.maximum(points[:-1, 0], points[1:, 0])
    x_start, bins = float(ground.points_m[:, 0].min()), max(8, 2 * n)
    bins_per_m = bins / float(np.ptp(ground.points_m[:, 0]))
    first, last = np.full(bins, n), np.full(bins, -1)
    begin = np.clip(((low - x_start) * bins_per_m).astype(int) - 1, 0, bins - 1)
    end = np.clip(((high - x_start) * bins_per_m).astype(int) + 1, 0, bins - 1)
    np.minimum.at(first, end, np.arange(n))
    np.maximum.at(last, begin, np.arange(n))
    first = np.minimum.accumulate(first[::-1])[::-1]
    last = np.maximum.accumulate(last)
    return GroundArrays(
        facets, first.astype(np.int64), last.astype(np.int64), x_start, bins_per_m, x_low, x_high, (x_high - x_low) / n
    )


@lru_cache(CACHED_ARRAYS)
def block_arrays(block: Block) -> BlockArrays:
    """Arrays of a block."""
    ex, ey = block.centre_of_mass_m
    corners = np.asarray(block.corners_m, float).reshape(-1, 2) - np.array([ex, ey])
    edge = np.roll(corners, -1, axis=0) - corners
    normals = np.column_stack([edge[:, 1], -edge[:, 0]]) / np.maximum(np.hypot(*edge.T), 1e-300)[:, None]
    before = np.roll(normals, 1, axis=0)
    inward = -(before + normals) / (1.0 + (before * normals).sum(axis=1))[:, None]
    centres = corners + block.rounding_m * inward if block.rounding_m > 0.0 else corners
    sides = np.column_stack([centres, normals, (normals * corners).sum(axis=1)])
    a, b = block.semi_axes_m
    air = np.array(block.air if any(block.air) else (), float)
    return BlockArrays(sides, air, a, b, block.mass_kg, block.inertia_kg_m2, block.reach_m, block.rounding_m, -ex, -ey)


class WorldArrays(NamedTuple):
    """One block on one cross-section as compiled code reads them."""

    block: BlockArrays
    ground: GroundArrays
    law: Array  # (zones, columns of `effects.columns.engine_rows`)
    gravity: float  # m/s²


class Body(NamedTuple):
    """A block and gravity, for calls in every step that do not need the ground."""

    block: BlockArrays
    gravity: float  # m/s²


@kernel(forceinline=True)
def pose_of(q):
    """(x in m, y in m, cos θ, sin θ) of a state."""
    return q[X], q[Y], np.cos(q[THETA]), np.sin(q[THETA])


@kernel(forceinline=True)
def along_and_above(px, py, f, facets):
    """(distance in m of a point from the start of facet f along it, height in m above its line)."""
    dx, dy = px - facets[f, POINT_X], py - facets[f, POINT_Y]
    along = dx * facets[f, TANGENT_X] + dy * facets[f, TANGENT_Y]
    return along, dx * facets[f, NORMAL_X] + dy * facets[f, NORMAL_Y]


@kernel(forceinline=True)
def corner_place(i, pose, sides):
    """(x, y) in m of the centre of corner i of a polygon."""
    x, y, c, s = pose
    px = x + c * sides[i, CORNER_X] - s * sides[i, CORNER_Y]
    return px, y + s * sides[i, CORNER_X] + c * sides[i, CORNER_Y]


@kernel(forceinline=True)
def depth_rate(q, nx, ny, rx, ry):
    """Rate in m/s at which the depth of a contact point grows: normal (nx, ny), arm (rx, ry)."""
    return -((q[VX] - q[OMEGA] * ry) * nx + (q[VY] + q[OMEGA] * rx) * ny)


@kernel(forceinline=True)
def is_ball(block):
    """Whether the profile is a circle about the centre of mass."""
    centred = block.centre_x == 0.0 and block.centre_y == 0.0
    return block.sides.shape[0] == 0 and block.semi_a == block.semi_b and centred


@kernel(forceinline=True)
def profile_bend(block):
    """Bound in m/rad of the motion of the lowest point of a smooth profile, relative to the centre of mass, when the
    block turns.

    The point lies h = √(a² u² + b² w²) below the centre of the profile, where (u, w) is the normal of the ground in
    body axes; h'' = a² b² / h³ - h is at most (a² - b²) / b, with the longer semi-axis a."""
    a, b = block.semi_a, block.semi_b
    off = np.sqrt(block.centre_x * block.centre_x + block.centre_y * block.centre_y)
    return off + abs(a * a - b * b) / min(a, b)


@kernel
def facet_range(ground, x_low, x_high):
    """First and one-past-last index of the facets that can lie in [x_low, x_high]."""
    bins = ground.first.size
    b0 = min(max(int((x_low - ground.x_start) * ground.bins_per_m), 0), bins - 1)
    b1 = min(max(int((x_high - ground.x_start) * ground.bins_per_m), 0), bins - 1)
    return ground.first[b0], ground.last[b1] + 1


@kernel
def point_depth(px, py, facets, f0, f1):
    """Depth of a point below the surface (negative: height above it), and the nearest feature.

    Returns (depth in m, kind, index): CORNER_FACET with a facet, or CORNER_VERTEX with a vertex."""
    best, kind, index, sign = np.inf, CORNER_FACET, f0, 1.0
    for f in range(f0, f1):
        along, above = along_and_above(px, py, f, facets)
        if above * above >= best:
            continue
        if 0.0 <= along <= facets[f, LENGTH]:
            best, kind, index = above * above, CORNER_FACET, f
            sign = 1.0 if above >= 0.0 else -1.0
            continue
        v = f if along < 0.0 else f + 1
        dx, dy = px - facets[v, POINT_X], py - facets[v, POINT_Y]
        if dx * dx + dy * dy < best:
            best, kind, index = dx * dx + dy * dy, CORNER_VERTEX, v
            # inside or outside by the mean normal of the two facets
            nx, ny = facets[v, NORMAL_X], facets[v, NORMAL_Y]  # zero behind the last facet
            if v > 0:
                nx, ny = nx + facets[v - 1, NORMAL_X], ny + facets[v - 1, NORMAL_Y]
            sign = 1.0 if nx * dx + ny * dy >= 0.0 else -1.0
    return -sign * np.sqrt(best), kind, index


@kernel
def centroid_depth(q, world):
    """Depth in m of the centroid of a block below the surface nearby."""
    reach = 2.0 * world.block.radius
    f0, f1 = facet_range(world.ground, q[X] - reach, q[X] + reach)
    return point_depth(q[X], q[Y], world.ground.facets, f0, f1)[0]


@kernel
def near_depth(px, py, ground, f0, f1, reach):
    """`point_depth` from the facets near the point alone; beyond `reach` above the ground only a lower bound."""
    facets = ground.facets
    if f1 - f0 <= MOST_FACETS_UNSORTED:
        return point_depth(px, py, facets, f0, f1)
    g0, g1 = facet_range(ground, px, px)
    g0, g1 = max(f0, g0), min(f1, g1)
    depth, kind, index = point_depth(px, py, facets, g0, g1)
    width = min(-depth, reach) if depth < 0.0 else depth
    h0, h1 = facet_range(ground, px - width, px + width)
    h0, h1 = max(f0, h0), min(f1, h1)
    if h0 >= g0 and h1 <= g1:
        return depth, kind, index
    return point_depth(px, py, facets, h0, h1)


@kernel
def polygon_depth(px, py, pose, sides):
    """Depth in m of a point inside a polygon and its nearest face; negative outside."""
    x, y, c, s = pose
    bx, by = c * (px - x) + s * (py - y), -s * (px - x) + c * (py - y)
    depth, face = np.inf, 0
    for k in range(sides.shape[0]):
        d = sides[k, FACE_OFFSET] - sides[k, FACE_X] * bx - sides[k, FACE_Y] * by
        if d < depth:
            depth, face = d, k
    return depth, face


@kernel
def facet_intersects(f, pose, facets, sides):
    """Whether facet f intersects a polygon."""
    x, y, c, s = pose
    dx, dy = facets[f, POINT_X] - x, facets[f, POINT_Y] - y
    bx, by = c * dx + s * dy, -s * dx + c * dy
    tx = c * facets[f, TANGENT_X] + s * facets[f, TANGENT_Y]
    ty = -s * facets[f, TANGENT_X] + c * facets[f, TANGENT_Y]
    begin, end = 0.0, facets[f, LENGTH]  # ends of the part of the facet below all faces so far
    for k in range(sides.shape[0]):
        depth = sides[k, FACE_OFFSET] - sides[k, FACE_X] * bx - sides[k, FACE_Y] * by
        climb = sides[k, FACE_X] * tx + sides[k, FACE_Y] * ty
        if climb > 0.0:
            end = min(end, depth / climb)
        elif climb < 0.0:
            begin = max(begin, depth / climb)
        elif depth <= 0.0:
            return False
        if begin >= end:
            return False
    return True


@kernel
def under_face(face, px, py, pose, sides):
    """Whether a point's foot on a face of the polygon lies between the circles of its corners."""
    x, y, c, s = pose
    bx, by = c * (px - x) + s * (py - y), -s * (px - x) + c * (py - y)
    tx, ty = -sides[face, FACE_Y], sides[face, FACE_X]
    end = face + 1 if face + 1 < sides.shape[0] else 0
    from_start = (bx - sides[face, CORNER_X]) * tx + (by - sides[face, CORNER_Y]) * ty
    from_end = (bx - sides[end, CORNER_X]) * tx + (by - sides[end, CORNER_Y]) * ty
    return from_start >= 0.0 >= from_end


@kernel
def beyond_corner(i, px, py, pose, sides):
    """Distance in m of a point beyond the ends of the faces next to corner i (of two, the smaller one), and the
    direction in body axes in which it grows. If it is positive, the circle of the corner is nearest."""
    x, y, c, s = pose
    bx = c * (px - x) + s * (py - y) - sides[i, CORNER_X]
    by = -s * (px - x) + c * (py - y) - sides[i, CORNER_Y]
    before = i - 1 if i > 0 else sides.shape[0] - 1
    in_x, in_y = -sides[before, FACE_Y], sides[before, FACE_X]
    out_x, out_y = sides[i, FACE_Y], -sides[i, FACE_X]
    past, short = bx * in_x + by * in_y, bx * out_x + by * out_y
    if past < short:
        return past, in_x, in_y
    return short, out_x, out_y


@kernel
def repeats_corner(sides, i):
    """Whether corner i has the same circle as a corner before it, because rounding has removed the face between."""
    other = i - 1
    if i == 0:
        return False
    for _ in range(2):
        dx, dy = sides[i, CORNER_X] - sides[other, CORNER_X], sides[i, CORNER_Y] - sides[other, CORNER_Y]
        if dx * dx + dy * dy < 1e-18 * sides[i, FACE_OFFSET] ** 2:
            return True
        if i < sides.shape[0] - 1:
            break
        other = 0
    return False


@kernel
def contact_point(kind, index, part, pose, block, ground):
    """Depth δ, direction of the force on the block (nx, ny) and arm from the centre of mass (rx, ry) of a feature.

    `part` is the block's corner or face, or the half of an ellipse at a vertex; `index` the ground's facet or vertex;
    `pose` as `pose_of` gives it."""
    return place_feature(kind, load_feature(kind, index, part, block, ground.facets), pose)


@kernel(forceinline=True)
def load_feature(kind, index, part, block, facets):
    """The eight numbers of a feature for `place_feature`: ground point, facet normal, and four numbers of the block.

    The four numbers are: for a corner its centre, its radius and on which side of a vertex it lies; for a face its
    normal and offset; for a smooth profile semi-axes and centre. For a smooth profile at a vertex, the half of the
    ellipse, `part`, replaces the normal."""
    px, py, nx, ny = facets[index, POINT_X], facets[index, POINT_Y], 0.0, 0.0
    if kind in (CORNER_FACET, SMOOTH_FACET):
        nx, ny = facets[index, NORMAL_X], facets[index, NORMAL_Y]
    sides = block.sides
    if kind <= CORNER_VERTEX:
        side = 1.0
        if kind == CORNER_VERTEX and block.rounding > 0.0:
            side = vertex_side(facets, index)
        return px, py, nx, ny, sides[part, CORNER_X], sides[part, CORNER_Y], block.rounding, side
    if kind == VERTEX_FACE:
        return px, py, nx, ny, sides[part, FACE_X], sides[part, FACE_Y], sides[part, FACE_OFFSET], 0.0
    if kind == SMOOTH_VERTEX:
        nx = float(part)
    return px, py, nx, ny, block.semi_a, block.semi_b, block.centre_x, block.centre_y


@kernel
def vertex_side(facets, v):
    """-1 if a point nearest to vertex v lies outside the ground (the ground is convex there), 1 if inside."""
    if v == 0:
        return 1.0
    turn = facets[v - 1, TANGENT_X] * facets[v, TANGENT_Y] - facets[v - 1, TANGENT_Y] * facets[v, TANGENT_X]
    return -1.0 if turn < 0.0 else 1.0


@kernel(forceinline=True)
def place_feature(kind, feature, pose):
    """`contact_point` of a loaded feature."""
    x, y, c, s = pose
    px, py, nx, ny, w1, w2, w3, w4 = feature
    if kind <= CORNER_VERTEX:
        rx, ry = c * w1 - s * w2, s * w1 + c * w2
        dx, dy = x + rx - px, y + ry - py
        if kind == CORNER_FACET:
            return w3 - (dx * nx + dy * ny), nx, ny, rx - w3 * nx, ry - w3 * ny
        distance = np.sqrt(dx * dx + dy * dy)
        if distance == 0.0:
            return w3, 0.0, 1.0, rx, ry - w3
        nx, ny = -w4 * dx / distance, -w4 * dy / distance
        return w3 + w4 * distance, nx, ny, rx - w3 * nx, ry - w3 * ny
    if kind == VERTEX_FACE:
        nx, ny = -(c * w1 - s * w2), -(s * w1 + c * w2)
        rx, ry = px - x, py - y
        return w3 + nx * rx + ny * ry, nx, ny, rx, ry
    a, b = w1, w2
    mx, my = 0.0, 0.0
    if w3 != 0.0 or w4 != 0.0:
        mx, my = c * w3 - s * w4, s * w3 + c * w4  # from the centre of mass to that of the profile
        x, y = x + mx, y + my
    if kind == SMOOTH_FACET:
        if a == b:
            rx, ry = -a * nx, -a * ny
        else:
            ux, uy = -(c * nx + s * ny), -(-s * nx + c * ny)
            h = np.sqrt(a * a * ux * ux + b * b * uy * uy)
            bx, by = a * a * ux / h, b * b * uy / h
            rx, ry = c * bx - s * by, s * bx + c * by
        return -((x + rx - px) * nx + (y + ry - py) * ny), nx, ny, mx + rx, my + ry
    dx, dy = px - x, py - y
    if a == b:
        distance = np.sqrt(dx * dx + dy * dy)
        nx, ny = -dx / distance, -dy / distance
        return a - distance, nx, ny, mx - a * nx, my - a * ny
    qx, qy = c * dx + s * dy, -s * dx + c * dy
    bx, by = nearest_on_ellipse(qx, qy, a, b, np.int64(nx))
    ux, uy = bx / (a * a), by / (b * b)
    norm = np.sqrt(ux * ux + uy * uy)
    ux, uy = ux / norm, uy / norm
    depth = (bx - qx) * ux + (by - qy) * uy
    return depth, -(c * ux - s * uy), -(s * ux + c * uy), mx + c * bx - s * by, my + s * bx + c * by


@kernel
def half_of_ellipse(px, py, a, b):
    """Half of the ellipse x²/a² + y²/b² = 1 that contains the point nearest to (px, py): 1 on the negative side of the
    longer axis, else 0."""
    return np.int64((py if a >= b else px) < 0.0)


@kernel
def nearest_on_ellipse(px, py, a, b, half):
    """Nearest point of the ellipse x²/a² + y²/b² = 1 to (px, py), by curvature-centre iteration (A. Kemper's method).

    half : half of the ellipse in which the search begins, see `half_of_ellipse`. Deep inside, each half has its own
        nearest point. If (px, py) crosses the longer axis, the point of the given half is followed, so that the depth
        of a contact is smooth. Near the ends of that axis, and outside, both halves give the same point."""
    upright = a < b
    if upright:
        px, py, a, b = py, px, b, a
    side = 1.0 - 2.0 * half
    qx, qy = abs(px), side * py
    tx, ty, change = np.sqrt(0.5), np.sqrt(0.5), 1.0
    for _ in range(30):
        ex, ey = (a * a - b * b) * tx**3 / a, (b * b - a * a) * ty**3 / b
        rx, ry = a * tx - ex, b * ty - ey
        dx, dy = qx - ex, qy - ey
        r, d = np.sqrt(rx * rx + ry * ry), np.sqrt(dx * dx + dy * dy)
        if d == 0.0:
            break
        nx, ny = max(0.0, (dx * r / d + ex) / a), (dy * r / d + ey) / b
        norm = np.sqrt(nx * nx + ny * ny)
        nx, ny = nx / norm, ny / norm
        change = abs(nx - tx) + abs(ny - ty)
        tx, ty = nx, ny
        if change < 1e-15:
            break
    if change > 1e-9 and qy >= 0.0:
        # near the centre of a thin ellipse the iteration can cycle
        tx, ty = _bisected(qx, qy, a, b)
    along, across = np.copysign(a * tx, px), side * b * ty
    return (across, along) if upright else (along, across)


@kernel
def _bisected(qx, qy, a, b):
    """(cos φ, sin φ) of the point (a cos φ, b sin φ) of an ellipse that is nearest to (qx, qy) in the first quadrant,
    by bisection of the derivative of the distance with respect to φ."""
    low, high = 0.0, 0.5 * np.pi
    for _ in range(55):
        phi = 0.5 * (low + high)
        c, s = np.cos(phi), np.sin(phi)
        if (b * b - a * a) * s * c + a * qx * s - b * qy * c > 0.0:
            high = phi
        else:
            low = phi
    return np.cos(phi), np.sin(phi)
