"""The point-mass engine: exact ballistic flights between rebounds of the probabilistic law.

The point is the block's centroid and meets the surface itself, as point-mass codes have it: the block's
extent enters through its mass, the radius of its spin and the slope reduction only. Between impacts the point
flies on a parabola and the block turns freely; the next impact is the first root of a quadratic among the
facets, found through a tree of boxes along the ground, so that a long cross-section costs little more than a
short one.

No block gets through the ground: the facet just left counts as touched exactly (its root is 2 v_n / (g n_y),
no distance is compared), every impact puts the point back onto its facet, and facets reach `Surface.reach_m`
(1e-12 of the coordinates: rounding, not physics) past their ends and to their rear, so a parabola through
a joint meets one of the two.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from rock2d.blocks import Block
from rock2d.compiled import njit
from rock2d.rebound import BALL, ReboundParameters, rebound, rebound_table, slope_reduction
from rock2d.terrain import Terrain
from rock2d.track import IMPACT_COLUMNS, Track

Array = np.ndarray

STOPS = ("rest", "exit", "time")
REST, EXIT, TIME = range(3)

# columns of an impact row: time, state before, velocities after, facet
N_IMPACT = 11

LEAF = 4  # facets in a leaf of the tree
CHATTER = 1000  # impacts between two looks at whether the block still gets anywhere


class Surface(NamedTuple):
    """A cross-section as the compiled core reads it.

    facets : (n, 5) start x, y, unit tangent x, y, length; zones : (n,) zone ids
    boxes : (2 leaves - 1, 5) x_low, x_high, slope m, and the least and greatest y - m x in them: boxes that
        lie along the ground. The children of box i are 2i+1 and 2i+2; the last `leaves` hold LEAF facets each
    x_low_m, x_high_m : beyond them a block has left; reach_m : see the module
    """

    facets: Array
    zones: Array
    boxes: Array
    x_low_m: float
    x_high_m: float
    reach_m: float


def make_surface(terrain: Terrain) -> Surface:
    """Prepare a cross-section for the compiled core."""
    points = terrain.points_m
    length = np.hypot(*np.diff(points, axis=0).T)
    facets = np.ascontiguousarray(np.column_stack([points[:-1], terrain.tangents, length]))
    reach = 1e-12 * max(float(np.abs(points).max()), float(np.ptp(points, axis=0).max()))
    leaves = 1
    while leaves * LEAF < len(facets):
        leaves *= 2
    left, right = float(points[:, 0].min()) - reach, float(points[:, 0].max()) + reach
    return Surface(facets, terrain.zone_ids, _tree(points, leaves, reach), left, right, reach)


@njit
def _tree(points, leaves, reach):
    """The boxes of a Surface; those beyond the last facet are empty."""
    boxes = np.empty((2 * leaves - 1, 5))
    held, first = leaves * LEAF, 0  # facets a box holds, first box of the level
    while held >= LEAF:
        for i in range(first, 2 * first + 1):
            start = (i - first) * held
            stop = min(start + held, len(points) - 1)
            box = boxes[i]
            box[0], box[1], box[2], box[3], box[4] = np.inf, -np.inf, 0.0, np.inf, -np.inf
            if start >= stop:
                continue
            across, rise = points[stop, 0] - points[start, 0], points[stop, 1] - points[start, 1]
            slope = rise / across if abs(rise) < 4.0 * across else 0.0
            for j in range(start, stop + 1):
                height = points[j, 1] - slope * points[j, 0]
                box[0], box[1] = min(box[0], points[j, 0]), max(box[1], points[j, 0])
                box[3], box[4] = min(box[3], height), max(box[4], height)
            margin = 2.0 * (1.0 + abs(slope)) * reach
            box[0], box[1], box[2] = box[0] - margin, box[1] + margin, slope
            box[3], box[4] = box[3] - margin, box[4] + margin
        held, first = held // 2, 2 * first + 1
    return boxes


def spin_radius_m(block: Block) -> float:
    """Radius of the ball whose spin the point carries: a circle's own, else that of the equal-area circle."""
    return block.semi_axes_m[0] if block.shape == "circle" else 0.5 * block.size_m


def run_point_mass(
    block: Block,
    terrain: Terrain,
    parameters: Mapping[str, ReboundParameters],
    state6: Array,
    *,
    release: int = 0,
    gravity_m_s2: float = 9.81,
    time_limit_s: float,
    rng: np.random.Generator | None = None,
    stop_speed_m_s: float | None = None,
) -> Track:
    """Run one release from `state6` (x, y, theta, vx, vy, omega of the centroid; SI) to its end.

    `parameters` maps zones, or "default", to the law's parameters. A start below the surface (a measured
    block may have sunk in) is lifted vertically onto it; one on the surface and moving into it rebounds at
    once; one beside the cross-section has left it. The release ends as

    - "rest": after an impact on ground that faces upward, √(v² + 2/5 r² ω²) is below `stop_speed_m_s`
      (default 0.1 √(g size)); or 1000 impacts in a row took the block less than its size away in less than
      1000 stop_speed / g, the flights of millimetres into which bouncing dies out without ever ending (each
      one multiplies the motion along the facet by r_t);
    - "exit": it flew beyond the left- or rightmost point;
    - "time": the time limit.

    `rng` gives a single number, the seed of the release's own stream; only slope reductions drawn from
    U(0, α) need it. Impacts carry NaN penetration and force, which this law does not know.

    Raises ValueError if the state is not six finite numbers; if gravity, time limit or stop speed is not
    positive; if a zone has no parameters; or if a slope reduction is to be drawn without `rng`.
    """
    state = np.asarray(state6, float)
    if state.shape != (6,) or not np.isfinite(state).all():
        raise ValueError(f"the start must be six finite numbers (x, y, theta, vx, vy, omega), got {state6}")
    if stop_speed_m_s is None:
        stop_speed_m_s = 0.1 * float(np.sqrt(max(gravity_m_s2, 0.0) * block.size_m))
    for name, value in (
        ("gravity_m_s2", gravity_m_s2),
        ("time_limit_s", time_limit_s),
        ("stop_speed_m_s", stop_speed_m_s),
    ):
        if not 0 < value < np.inf:
            raise ValueError(f"{name} must be positive, got {value}")
    table = rebound_table(parameters, terrain.zone_names)
    if rng is None and any(p.random for p in parameters.values()):
        raise ValueError("slope_reduction is uniform: a random generator is needed")
    seed = np.uint64(0) if rng is None else rng.integers(2**64, dtype=np.uint64)

    surface, ends = make_surface(terrain), np.empty((2, 7))
    radius, size = spin_radius_m(block), block.size_m
    room = 128
    while True:
        impacts = np.empty((room, N_IMPACT))
        count, stop = descend(
            state, block.mass_kg, radius, size, surface, table, float(gravity_m_s2), float(time_limit_s),
            float(stop_speed_m_s), seed, impacts, ends,
        )  # fmt: skip
        if count <= room:
            break
        room = count  # the same release once more, with room for all
    return _track(block, terrain, release, impacts[:count], ends, STOPS[stop], float(gravity_m_s2))


def _track(
    block: Block, terrain: Terrain, release: int, impacts: Array, ends: Array, stop: str, gravity_m_s2: float
) -> Track:
    before = impacts[:, :7]
    after = np.column_stack([impacts[:, :4], impacts[:, 7:10]])
    knots = np.vstack([ends[:1], np.stack([before, after], axis=1).reshape(-1, 7), ends[1:]])
    flight = np.ones(len(knots), bool)
    flight[1::2] = False  # from before to after an impact, and behind the last knot
    if stop == "rest":  # it ended with the last impact
        knots, flight = knots[:-1], flight[:-1]
    flight[-1] = False
    events = []
    for row in impacts:
        values = [*row[:7], row[0], *row[1:4], *row[7:10], np.nan, np.nan]
        event = dict(zip(IMPACT_COLUMNS[3:], map(float, values), strict=True))
        events.append({"zone": terrain.zones[int(row[10])], **event})
    return Track(release, block.name, knots, flight, events, stop, gravity_m_s2)


@njit
def descend(
    state, mass, radius, size, surface, table, gravity, time_limit, stop_speed, seed, impacts, ends
):  # fmt: skip
    """(number of impacts, index into STOPS) of one release; allocates next to nothing, for ensembles too.

    `impacts` (room, 11) takes as many rows as it has room for (none, if only the end matters), `ends` (2, 7)
    the first and the last knot. `seed` (uint64) is the release's own: results do not depend on the order or
    the thread in which releases run.
    """
    stack = np.empty(64, np.int64)
    x, y, theta, vx, vy, omega = state[0], state[1], state[2], state[3], state[4], state[5]
    t, current = 0.0, -1
    y = _lifted(surface, stack, x, y)
    _store(ends[0], t, x, y, theta, vx, vy, omega)
    count, stop = 0, EXIT
    mark_t, mark_x, mark_y = t, x, y
    while surface.x_low_m <= x <= surface.x_high_m:
        tau, facet = _next_impact(surface, stack, x, y, vx, vy, gravity, current, time_limit - t)
        if facet < 0:
            edge = surface.x_high_m if vx > 0.0 else surface.x_low_m
            leave = (edge - x) / vx if vx != 0.0 else np.inf
            stop = EXIT if leave < tau else TIME
            tau = min(leave, tau)
        x, y = x + vx * tau, y + (vy - 0.5 * gravity * tau) * tau
        vy -= gravity * tau
        theta += omega * tau
        t += tau
        if facet < 0:
            break

        f = surface.facets[facet]
        x0, y0, tx, ty, length = f[0], f[1], f[2], f[3], f[4]
        along = min(max((x - x0) * tx + (y - y0) * ty, 0.0), length)
        x, y = x0 + along * tx, y0 + along * ty
        p = table[surface.zones[facet]]
        alpha = slope_reduction(p, uniform(seed, count))
        vx1, vy1, omega1 = rebound(vx, vy, omega, tx, ty, alpha, mass, radius, p)
        if count < len(impacts):
            row = impacts[count]
            _store(row, t, x, y, theta, vx, vy, omega)
            row[7], row[8], row[9], row[10] = vx1, vy1, omega1, facet
        count += 1
        vx, vy, omega, current = vx1, vy1, omega1, facet

        if tx > 0.0 and vx * vx + vy * vy + BALL * (radius * omega) ** 2 < stop_speed * stop_speed:
            stop = REST
            break
        if count % CHATTER == 0:
            near = (x - mark_x) ** 2 + (y - mark_y) ** 2 < size * size
            if near and t - mark_t < CHATTER * stop_speed / gravity:
                stop = REST
                break
            mark_t, mark_x, mark_y = t, x, y
    _store(ends[1], t, x, y, theta, vx, vy, omega)
    return count, stop


@njit
def _store(row, t, x, y, theta, vx, vy, omega):
    row[0], row[1], row[2], row[3], row[4], row[5], row[6] = t, x, y, theta, vx, vy, omega


@njit
def uniform(seed, k):
    """The k-th number in [0, 1) of the stream `seed` (uint64): SplitMix64 (Steele, Lea & Flood 2014)."""
    z = seed + np.uint64(k + 1) * np.uint64(0x9E3779B97F4A7C15)
    z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    z = z ^ (z >> np.uint64(31))
    return np.float64(z >> np.uint64(11)) * 2.0**-53


@njit
def _next_impact(surface, stack, x, y, vx, vy, gravity, current, limit):
    """(time to the next impact, facet), or (limit, -1) if there is none within `limit`.

    `current` is the facet on which the point sits, -1 if it starts in the air.
    """
    facets, boxes = surface.facets, surface.boxes
    first_leaf = len(boxes) // 2
    best, found = limit, -1
    best_v_n = 0.0
    per_vx = 1.0 / vx if abs(vx) > 1e-300 else 0.0
    stack[0], top = 0, 1
    while top > 0:
        top -= 1
        i = stack[top]
        if not _meets(boxes[i], x, y, vx, vy, per_vx, gravity, best):
            continue
        if i < first_leaf:  # look first where the flight gets first
            ahead = 1 if vx >= 0.0 else 2
            stack[top], stack[top + 1] = 2 * i + 3 - ahead, 2 * i + ahead
            top += 2
            continue
        start = (i - first_leaf) * LEAF
        for j in range(start, min(start + LEAF, len(facets))):
            tau, v_n = _facet_impact(facets[j], x, y, vx, vy, gravity, j == current, surface.reach_m)
            # of two facets met at once, at a joint, the one that is hit harder
            if 0.0 <= tau < best or (tau == best and (found < 0 or v_n < best_v_n)):
                best, found = tau, j
                best_v_n = v_n
    return best, found


@njit
def _meets(box, x, y, vx, vy, per_vx, gravity, limit):
    """Whether the flight can touch the box within `limit`; never wrongly no. `per_vx` is 1/vx, 0 for none."""
    t0, t1 = 0.0, limit
    if per_vx == 0.0:
        if x < box[0] or x > box[1]:
            return False
    else:
        a, b = (box[0] - x) * per_vx, (box[1] - x) * per_vx
        t0, t1 = max(t0, min(a, b)), min(t1, max(a, b))
        if not t0 <= t1:
            return False
    y, vy = y - box[2] * x, vy - box[2] * vx  # sheared, the flight is a parabola still
    y0, y1 = y + (vy - 0.5 * gravity * t0) * t0, y + (vy - 0.5 * gravity * t1) * t1
    if min(y0, y1) > box[4]:
        return False
    top = max(y0, y1)
    if t0 * gravity < vy < t1 * gravity:
        top = y + 0.5 * vy * vy / gravity
    return top >= box[3]


@njit
def _facet_impact(facet, x, y, vx, vy, gravity, touching, reach):
    """(time, v_n) at which the flight comes down onto the facet's front, (-1, 0) if it does not.

    The distance to its line is s = c + b τ - ½ a τ²; of the two roots the one with ds/dτ < 0.
    """
    x0, y0, tx, ty, length = facet[0], facet[1], facet[2], facet[3], facet[4]
    b = vy * tx - vx * ty
    a = gravity * tx
    if touching:
        c = 0.0
    else:
        c = (y - y0) * tx - (x - x0) * ty
        if -reach <= c < 0.0:
            c = 0.0
    square = b * b + 2.0 * a * c
    if square < 0.0:
        return -1.0, 0.0
    root = np.sqrt(square)
    if b < 0.0:
        tau = 2.0 * c / (root - b)
    elif a > 0.0:
        tau = (b + root) / a
    else:
        return -1.0, 0.0
    along = (x + vx * tau - x0) * tx + (y + (vy - 0.5 * gravity * tau) * tau - y0) * ty
    if tau < 0.0 or along < -reach or along > length + reach:
        return -1.0, 0.0
    return tau, -root


@njit
def _lifted(surface, stack, x, y):
    """`y`, or the height of the surface above (x, y) if that point lies in the ground.

    It does if, of the facets straight above, one more has the ground below it than above it.
    """
    facets, boxes = surface.facets, surface.boxes
    first_leaf = len(boxes) // 2
    inside, height = 0, np.inf
    stack[0], top = 0, 1
    while top > 0:
        top -= 1
        i = stack[top]
        if x < boxes[i, 0] or x > boxes[i, 1] or y - boxes[i, 2] * x > boxes[i, 4]:
            continue
        if i < first_leaf:
            stack[top], stack[top + 1] = 2 * i + 1, 2 * i + 2
            top += 2
            continue
        start = (i - first_leaf) * LEAF
        for j in range(start, min(start + LEAF, len(facets))):
            f = facets[j]
            x0, y0, tx, ty, length = f[0], f[1], f[2], f[3], f[4]
            x1 = x0 + length * tx
            if tx == 0.0 or not min(x0, x1) <= x < max(x0, x1):
                continue
            above = y0 + (x - x0) * ty / tx
            if above > y + surface.reach_m:
                inside += 1 if tx > 0.0 else -1
                if tx > 0.0:
                    height = min(height, above)
    return height if inside > 0 else y
