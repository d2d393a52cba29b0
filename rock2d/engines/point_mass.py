"""The point-mass engine: exact ballistic flights between rebounds of the probabilistic law.

The point is the centroid of the block and meets the surface itself, as in other point-mass codes: the size of the block
enters only through its mass, the radius of its spin and the slope reduction. Between impacts the point flies on a
parabola and the block turns freely. The next impact is the first root of a quadratic equation among the facets
(`parabola_intersection`).

One release and an ensemble of releases use the same kernel, so a release has the same bits in both, in any order and on
any number of threads."""

from collections.abc import Collection, Mapping
from typing import NamedTuple

import numpy as np

from rock2d.arrays import Array
from rock2d.compiled import in_threads, njit
from rock2d.engines.parabola_intersection import (
    ALONG_X,
    ALONG_Y,
    FACET_LENGTH,
    START_X,
    START_Y,
    lifted_to_surface,
    make_surface,
    next_impact,
)
from rock2d.laws.rebound import (
    ALPHA,
    BALL_INERTIA_FACTOR,
    M_HALF,
    R_T,
    SLOPE_REDUCTION_DRAWN,
    TAN_PHI,
    ReboundParameters,
    rebound,
    rebound_table,
    slope_reduction,
)
from rock2d.records.columns import (
    N_INSTANT,
    N_POSE,
    N_STATE,
    OMEGA,
    STOP_EXIT,
    STOP_REST,
    STOP_TIME,
    STOPS,
    THETA,
    TIME,
    VX,
    VY,
    X,
    Y,
)
from rock2d.records.track import Track, impact_mappings
from rock2d.scene.blocks import Block
from rock2d.scene.cross_section import CrossSection

# columns of a rebound: the instant before, the velocities after, the facet
VX_AFTER, VY_AFTER, OMEGA_AFTER, FACET = range(N_INSTANT, N_INSTANT + 4)
VELOCITIES = slice(VX_AFTER, OMEGA_AFTER + 1)
N_REBOUND = FACET + 1
# columns of a measure line: start, vector to its end, unit normal, length², range of x
(LINE_X, LINE_Y, LINE_ALONG_X, LINE_ALONG_Y, LINE_NORMAL_X, LINE_NORMAL_Y, LINE_SQUARE, LINE_LOW, LINE_HIGH) = range(9)
N_LINE = LINE_HIGH + 1

FIRST_IMPACTS = 128  # room for the impacts of one track
MOST_ON_ONE_THREAD = 500  # so few releases take less time than starting busy threads
CHATTER_IMPACTS = 1000  # impacts between two checks whether the block still moves on


class Releases(NamedTuple):
    """Start states and seeds of n releases."""

    states: Array  # (n, 6)
    seeds: Array  # (n,) uint64


class Inputs(NamedTuple):
    """Block, law and limits as `point_mass_release` reads them, in SI."""

    mass: float
    radius: float  # radius of the spin, see `spin_radius_m`
    size: float
    table: Array  # (zones, columns) rows of the rebound law
    gravity: float
    time_limit: float
    stop_speed: float


class PointMassResult(NamedTuple):
    """Results of an ensemble of n releases, as `point_mass_release` writes them.

    Attributes
    ----------
    stop : (n,) index into STOPS
    first_and_last : (n, 2, 7) t and state at the start and at the end of each release
    impact_count : (n,) number of impacts of each release
    crossings : (n, lines, 7) t and state at the first crossing of each measure line, NaN if there is none
    impacts : (n, room, 11) t and state before, velocities after, facet; rows beyond the last impact are NaN"""

    stop: Array
    first_and_last: Array
    impact_count: Array
    crossings: Array
    impacts: Array

    @property
    def ends(self) -> Array:
        """(n, 7) t and state at the end of each release."""
        return self.first_and_last[:, 1]


def spin_radius_m(block: Block) -> float:
    """Radius in m of the ball whose spin the point has: that of a circle, else of the circle of equal area."""
    return block.semi_axes_m[0] if block.shape == "circle" else 0.5 * block.size_m


def run_point_mass(
    block: Block,
    cross_section: CrossSection,
    parameters: Mapping[str, ReboundParameters],
    state6: Array,
    *,
    release: int = 0,
    gravity_m_s2: float = 9.81,
    time_limit_s: float,
    seed: int | None = None,
    stop_speed_m_s: float | None = None,
) -> Track:
    """Run one release from `state6` (x, y, theta, vx, vy, omega of the centroid; SI) to its end.

    `parameters` maps zones, or "default", to the parameters of the law. A start below the surface (a measured block may
    have sunk in) is lifted vertically onto it. A block that starts on the surface and moves into it rebounds at once.
    The release ends as

    - "rest": after an impact on ground that faces upward, √(v² + 2/5 r² ω²) is below `stop_speed_m_s` (default
      0.1 √(g size)); or within 1000 impacts and 1000 stop_speed / g, the block moved by less than its size (bouncing
      decays into flights of millimetres without end);
    - "exit": it flew beyond the left- or rightmost point, or started there;
    - "time": the time limit.

    `seed` (in [0, 2^64)) is the seed of the random stream of the release; only slope reductions drawn from U(0, α) need
    it. Penetration and force of impacts are NaN, because this law does not know them.

    Raises ValueError if the state is not six finite numbers; if gravity, time limit or stop speed is not
    positive; if a zone has no parameters; or if a slope reduction is to be drawn without `seed`."""
    state = np.array(state6, float)  # contiguous, whatever is given: the kernel is compiled once
    if state.shape != (N_STATE,) or not np.isfinite(state).all():
        raise ValueError(f"the start must be six finite numbers (x, y, theta, vx, vy, omega), got {state6}")
    if seed is None and any(p.random for p in parameters.values()):
        raise ValueError("slope_reduction is uniform: a seed is needed")

    room = FIRST_IMPACTS
    while True:
        found = run_point_mass_batch(
            block, cross_section, parameters, state[None], np.array([seed or 0], np.uint64), gravity_m_s2=gravity_m_s2,
            time_limit_s=time_limit_s, impact_room=room, stop_speed_m_s=stop_speed_m_s,
        )  # fmt: skip
        count = int(found.impact_count[0])
        if count <= room:
            break
        room = count  # repeat the release with room for all impacts
    impacts, ends, stop = found.impacts[0, :count], found.first_and_last[0], STOPS[found.stop[0]]
    return _track(block, cross_section, release, impacts, ends, stop, float(gravity_m_s2))


def run_point_mass_batch(
    block: Block,
    cross_section: CrossSection,
    parameters: Mapping[str, ReboundParameters],
    states: Array,
    seeds: Array,
    *,
    gravity_m_s2: float = 9.81,
    time_limit_s: float,
    impact_room: int = 0,
    stop_speed_m_s: float | None = None,
) -> PointMassResult:
    """Run n releases from `states` (n, 6: x, y, theta, vx, vy, omega of the centroid; SI); see `run_point_mass`.

    `seeds` (n,) are whole numbers in [0, 2^64), each the `seed` of its release in `run_point_mass`; `impact_room` is
    the largest number of impacts that are recorded of a release.

    Raises ValueError if states are not finite, if seeds are not n such numbers, if `impact_room` is negative, if
    gravity, time limit or stop speed is not positive, or if a zone has no parameters."""
    states = np.ascontiguousarray(np.atleast_2d(states), float)
    n = len(states)
    if states.shape != (n, 6) or not np.isfinite(states).all():
        raise ValueError("states must be an (n, 6) array of finite numbers")
    given = np.asarray(seeds)
    if given.shape != (n,) or given.dtype.kind not in "iu" or (given < 0).any():
        raise ValueError(f"seeds must be {n} whole numbers in [0, 2^64), one for each release")
    if impact_room < 0:
        raise ValueError(f"impact_room must not be negative, got {impact_room}")
    if stop_speed_m_s is None:
        stop_speed_m_s = 0.1 * float(np.sqrt(max(gravity_m_s2, 0.0) * block.size_m))
    for name, value in (
        ("gravity_m_s2", gravity_m_s2),
        ("time_limit_s", time_limit_s),
        ("stop_speed_m_s", stop_speed_m_s),
    ):
        if not 0 < value < np.inf:
            raise ValueError(f"{name} must be positive, got {value}")
    inputs = Inputs(
        block.mass_kg, spin_radius_m(block), block.size_m, rebound_table(parameters, cross_section.zone_names),
        float(gravity_m_s2), float(time_limit_s), float(stop_speed_m_s),
    )  # fmt: skip
    surface = make_surface(cross_section)
    lines = line_rows(cross_section.measure_lines.values(), surface.reach_m)
    outputs = PointMassResult(
        np.zeros(n, np.int64), np.empty((n, 2, N_INSTANT)), np.zeros(n, np.int64),
        np.full((n, len(lines), N_INSTANT), np.nan), np.full((n, impact_room, N_REBOUND), np.nan),
    )  # fmt: skip
    releases = Releases(states, np.ascontiguousarray(given, np.uint64))
    in_threads(_run_releases, n, (releases, inputs, surface, lines, outputs), MOST_ON_ONE_THREAD + 1)
    return outputs


def _track(
    block: Block, cross_section: CrossSection, release: int, impacts: Array, ends: Array, stop: str, gravity_m_s2: float
) -> Track:
    before = impacts[:, :N_INSTANT]
    after = np.column_stack([impacts[:, : TIME + 1 + N_POSE], impacts[:, VELOCITIES]])
    knots = np.vstack([ends[:1], np.stack([before, after], axis=1).reshape(-1, N_INSTANT), ends[1:]])
    flight = np.ones(len(knots), bool)
    flight[1::2] = False  # from before to after an impact, and behind the last knot
    if stop == "rest":  # it ended with the last impact
        knots, flight = knots[:-1], flight[:-1]
    flight[-1] = False
    unknown = np.full((len(impacts), 2), np.nan)  # penetration and force
    rows = np.column_stack([impacts[:, FACET], before, after, unknown])
    events = impact_mappings(rows, cross_section.zones)
    return Track(release, block.name, knots, flight, events, stop, gravity_m_s2)


def line_rows(lines: Collection[Array], reach_m: float) -> Array:
    """(n, N_LINE) measure lines (2, 2) as `point_mass_release` reads them, columns LINE_X to LINE_HIGH.

    The range of x is extended by `reach_m`, so that rounding cannot hide a crossing."""
    rows = []
    for line in lines:
        along = line[1] - line[0]
        normal = np.array([-along[1], along[0]]) / np.hypot(*along)
        low, high = line[:, 0].min() - reach_m, line[:, 0].max() + reach_m
        rows.append([*line[0], *along, *normal, along[0] * along[0] + along[1] * along[1], low, high])
    return np.array(rows).reshape(-1, N_LINE)


@njit
def point_mass_release(i, releases, inputs, surface, lines, outputs):
    """Run release `i` and write its results at [i]; allocates only one small stack.

    `releases`: Releases; `inputs`: Inputs; `surface` from `make_surface`; `lines` from `line_rows`;
    `outputs`: PointMassResult, with crossings that are NaN.
    An instant is a tuple (t, x, y, θ, vx, vy, ω)."""
    mass, radius, size, table, gravity, time_limit, stop_speed = inputs
    impacts, crossings, ends = outputs.impacts, outputs.crossings, outputs.first_and_last
    states, seed = releases.states, releases.seeds[i]
    stack = np.empty(64, np.int64)
    facets, zones = surface.facets, surface.zones
    x, y, theta = states[i, X], states[i, Y], states[i, THETA]
    vx, vy, omega = states[i, VX], states[i, VY], states[i, OMEGA]
    t, current = 0.0, -1
    y = lifted_to_surface(surface, stack, x, y)
    _store(ends, i, 0, (t, x, y, theta, vx, vy, omega))
    count, stop = 0, STOP_EXIT
    mark_t, mark_x, mark_y = t, x, y
    while surface.x_low_m <= x <= surface.x_high_m:
        tau, facet = next_impact(surface, stack, (x, y, vx, vy), gravity, current, time_limit - t)
        if facet < 0:
            edge = surface.x_high_m if vx > 0.0 else surface.x_low_m
            leave = (edge - x) / vx if vx != 0.0 else np.inf
            stop = STOP_EXIT if leave < tau else STOP_TIME
            tau = min(leave, tau)
        _note_crossings(lines, crossings, i, (t, x, y, theta, vx, vy, omega), t + tau - t, gravity)
        x, y = x + vx * tau, y + (vy - 0.5 * gravity * tau) * tau
        vy -= gravity * tau
        theta += omega * tau
        t += tau
        if facet < 0:
            break

        x0, y0 = facets[facet, START_X], facets[facet, START_Y]
        tx, ty = facets[facet, ALONG_X], facets[facet, ALONG_Y]
        along = min(max((x - x0) * tx + (y - y0) * ty, 0.0), facets[facet, FACET_LENGTH])
        x, y = x0 + along * tx, y0 + along * ty
        k = zones[facet]
        p = (table[k, TAN_PHI], table[k, M_HALF], table[k, R_T], table[k, ALPHA], table[k, SLOPE_REDUCTION_DRAWN])
        alpha = slope_reduction(p, uniform(seed, count))
        vx1, vy1, omega1 = rebound((vx, vy, omega), (tx, ty), alpha, (mass, radius), p)
        if count < impacts.shape[1]:
            _store(impacts, i, count, (t, x, y, theta, vx, vy, omega))
            impacts[i, count, VX_AFTER], impacts[i, count, VY_AFTER] = vx1, vy1
            impacts[i, count, OMEGA_AFTER], impacts[i, count, FACET] = omega1, facet
        count += 1
        vx, vy, omega, current = vx1, vy1, omega1, facet

        if tx > 0.0 and vx * vx + vy * vy + BALL_INERTIA_FACTOR * (radius * omega) ** 2 < stop_speed * stop_speed:
            stop = STOP_REST
            break
        if count % CHATTER_IMPACTS == 0:
            near = (x - mark_x) ** 2 + (y - mark_y) ** 2 < size * size
            if near and t - mark_t < CHATTER_IMPACTS * stop_speed / gravity:
                stop = STOP_REST
                break
            mark_t, mark_x, mark_y = t, x, y
    _store(ends, i, 1, (t, x, y, theta, vx, vy, omega))
    outputs.impact_count[i], outputs.stop[i] = count, stop


@njit(nogil=True)
def _run_releases(low, high, releases, inputs, surface, lines, outputs):
    for i in range(low, high):
        point_mass_release(i, releases, inputs, surface, lines, outputs)


@njit
def _store(rows, i, k, instant):
    t, x, y, theta, vx, vy, omega = instant
    rows[i, k, 0], rows[i, k, 1], rows[i, k, 2], rows[i, k, 3] = t, x, y, theta
    rows[i, k, 4], rows[i, k, 5], rows[i, k, 6] = vx, vy, omega


@njit
def _note_crossings(lines, crossings, i, instant, span, gravity):
    """Note the lines that release `i` crosses for the first time in a flight of `span` (s) that starts at `instant`.

    The same operations as in `Track.crossings`, so that both give the same bits."""
    t, x, y, theta, vx, vy, omega = instant
    end = x + vx * span
    for k in range(lines.shape[0]):
        crossed = crossings[i, k, TIME] == crossings[i, k, TIME]
        if crossed or max(x, end) < lines[k, LINE_LOW] or min(x, end) > lines[k, LINE_HIGH]:
            continue
        x0, y0, ax, ay = lines[k, LINE_X], lines[k, LINE_Y], lines[k, LINE_ALONG_X], lines[k, LINE_ALONG_Y]
        nx, ny = lines[k, LINE_NORMAL_X], lines[k, LINE_NORMAL_Y]
        a, b, c = -0.5 * gravity * ny, vx * nx + vy * ny, (x - x0) * nx + (y - y0) * ny
        square = b * b - 4.0 * a * c
        if a == 0.0:
            first = second = -c / b if b != 0.0 else -1.0
        elif square > 0.0:
            q = -0.5 * (b + np.copysign(np.sqrt(square), b))
            first, second = (q / a, c / q) if q != 0.0 else (0.0, 0.0)
        else:
            continue
        for tau in (min(first, second), max(first, second)):
            if 0.0 < tau <= span:
                x1, y1 = x + vx * tau, y + vy * tau - 0.5 * gravity * (tau * tau)
                at = ((x1 - x0) * ax + (y1 - y0) * ay) / lines[k, LINE_SQUARE]
                if 0.0 <= at <= 1.0:
                    then = (t + tau, x1, y1, theta + omega * tau, vx, vy - gravity * tau, omega)
                    _store(crossings, i, k, then)
                    break


@njit
def uniform(seed, k):
    """The k-th number in [0, 1) of the stream `seed` (uint64): SplitMix64 (Steele, Lea & Flood 2014)."""
    z = seed + np.uint64(k + 1) * np.uint64(0x9E3779B97F4A7C15)
    z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    z = z ^ (z >> np.uint64(31))
    return np.float64(z >> np.uint64(11)) * 2.0**-53
