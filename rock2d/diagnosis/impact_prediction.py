"""From one flight to the next: every impact predicted from the measured flight before it.

An *impact* here is what happens between two flights: one touch of the ground or several in a row. It is simulated from
the state of the flight before, a little above the ground, and compared with the flight after: differences of pose and
velocity at the instant where that flight begins, along the ground and across it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rock2d.engines.batch import run_batch, world_ensemble
from rock2d.engines.geometry import block_arrays, ground_arrays
from rock2d.kinematics.flights import Cut, clearances
from rock2d.kinematics.states import Basis, States, drift
from rock2d.scene.cross_section import CrossSection
from rock2d.scene.world import World

Array = np.ndarray

ABOVE = 0.5  # block radii above the ground at which the simulation of an impact starts
WINDOW = 2.0  # of the flight after, in √(radius / g): how much of it is compared
SAMPLES = 5  # instants in that window


@dataclass
class Impacts:
    """Every pair of flights in a row: (n,) arrays.

    Attributes
    ----------
    before, after : index of the two flights
    start_s : recorded instant, from the middle of the flight before, at which the simulation starts
    begin_s : recorded instant, from the middle of the flight after, at which outcomes are compared
    wait_s : recorded time from the start to there; `window_s` how long the flight after is compared
    zone : zone of the nearest facet of the ground
    tangent : (n, 2) direction of that facet
    order : how many releases of the same block were filmed before
    """

    before: Array
    after: Array
    block: Array
    release: Array
    start_s: Array
    begin_s: Array
    wait_s: Array
    window_s: Array
    zone: Array
    tangent: Array
    order: Array

    def __len__(self) -> int:
        return len(self.before)


def start_instants(world: World, cut: Cut, basis: Basis, states: States) -> Array:
    """(flights,) recorded instant, from the middle of each flight, at which a simulation from it starts: the last one
    at which the block is well above the ground. NaN where it never is above it."""
    film, flights = cut.film, cut.flights
    blocks = list(world.blocks.values())
    ground = ground_arrays(world.cross_section, 10 * max(b.radius_m for b in blocks))
    start = np.full(len(flights), np.nan)
    for i in range(len(flights)):
        block = blocks[flights.block[i]]
        t = film.t_s[flights.first[i] : flights.last[i]] - basis.middle[i]
        path = drift(
            world, np.full(len(t), flights.block[i]), np.repeat(states.middle[i][None], len(t), 0), t
        )
        gap = clearances(block_arrays(block), ground, path[:, :3])
        high = np.flatnonzero(gap > ABOVE * block.radius_m)
        at = high[-1] if len(high) else int(np.argmax(gap))
        if gap[at] > 0.0:
            start[i] = t[at]
    return start


def find_impacts(world: World, cut: Cut, basis: Basis, states: States, start: Array) -> Impacts:
    """Impacts of a film between two flights, with the `start_instants` of the flights."""
    film, flights = cut.film, cut.flights
    after = np.flatnonzero((flights.follows >= 0) & np.isfinite(start[flights.follows]))
    before = flights.follows[after]
    blocks = list(world.blocks.values())
    ends = film.t_s[flights.last[before] - 1] - basis.middle[before]
    begin = film.t_s[flights.first[after]] - basis.middle[after]
    leaves = drift(world, flights.block[before], states.middle[before], ends)
    arrives = drift(world, flights.block[after], states.middle[after], begin)
    facet = nearest_facet(0.5 * (leaves + arrives)[:, :2], world.cross_section)
    wait = film.t_s[flights.first[after]] - (basis.middle[before] + start[before])
    length = film.t_s[flights.last[after] - 1] - film.t_s[flights.first[after]]
    size = np.array([b.radius_m for b in blocks])[flights.block[after]]
    window = np.minimum(length, WINDOW * np.sqrt(size / max(world.gravity_m_s2, 1e-3)))
    return Impacts(
        before, after, flights.block[after], flights.release[after], start[before], begin, wait, window,
        world.cross_section.zone_ids[facet], world.cross_section.tangents[facet],
        release_order(film.release_block)[flights.release[after]].astype(float),
    )  # fmt: skip


def release_order(release_block: Array) -> Array:
    """(releases,) how many releases of the same block came before each."""
    order = np.zeros(len(release_block), np.int64)
    for block in np.unique(release_block):
        own = release_block == block
        order[own] = np.arange(own.sum())
    return order


def nearest_facet(points: Array, cross_section: CrossSection) -> Array:
    """(n,) index of the facet nearest to each point (n, 2)."""
    start, edge = cross_section.points_m[:-1], np.diff(cross_section.points_m, axis=0)
    d = points[:, None] - start
    along = np.clip((d * edge).sum(-1) / (edge**2).sum(-1), 0.0, 1.0)
    return np.hypot(*np.moveaxis(d - along[..., None] * edge, -1, 0)).argmin(axis=1)


def simulate(world: World, impacts: Impacts, starts: Array, times_s: Array) -> Array:
    """Poses (n, k, 3) of the centre of mass at true instants `times_s` (n, k) after `starts` (n, 6); NaN where a start
    is not finite, as of a flight that an impossible drag has taken back."""
    ensemble, tables = world_ensemble(world)
    possible = np.isfinite(starts).all(axis=1)
    starts, times_s = np.where(possible[:, None], starts, 0.0), np.where(possible[:, None], times_s, 0.0)
    result = run_batch(
        ensemble, starts, block_ids=impacts.block, table_ids=tables, gravity_m_s2=world.gravity_m_s2,
        time_limit_s=times_s[:, -1] + 1e-9, times_s=times_s,
    )  # fmt: skip
    result.samples[~possible] = np.nan
    return result.samples


def tracked(world: World, block: Array, poses: Array) -> Array:
    """Poses (n, k, 3) of the tracked centroid from those of the centre of mass."""
    offset = np.array([b.centre_of_mass_m for b in world.blocks.values()])[block]
    if not offset.any():
        return poses
    out = poses.copy()
    c, s = np.cos(poses[..., 2]), np.sin(poses[..., 2])
    ex, ey = offset[:, :1], offset[:, 1:]
    out[..., 0] -= c * ex - s * ey
    out[..., 1] -= s * ex + c * ey
    return out


def outcomes(world: World, impacts: Impacts, states: States, shift: Array | None = None) -> Array:
    """(n, 6) simulated - measured: along the ground, across it (m), angle (rad) where the flight after begins, then
    the velocities. `shift` (6,) is added to the states before the impacts."""
    scale = world.view.time_scale
    starts = drift(world, impacts.block, states.middle[impacts.before], impacts.start_s * scale)
    if shift is not None:
        starts = starts + shift
    moments = np.linspace(0.0, 1.0, SAMPLES) * impacts.window_s[:, None]
    pivot = None
    if world.slope_rad.any():
        # the ground leans by this much there: seen from it, everything else leans the other way
        pivot = drift(world, impacts.block, states.middle[impacts.after], impacts.begin_s * scale)[:, :2]
        starts = _turned(starts, pivot, -world.slope_rad)
    simulated = simulate(world, impacts, starts, (impacts.wait_s[:, None] + moments) * scale)
    if pivot is not None:
        simulated = _turned(simulated, pivot[:, None], world.slope_rad[:, None])
    k = len(impacts)
    measured = drift(
        world,
        np.repeat(impacts.block, SAMPLES),
        np.repeat(states.middle[impacts.after], SAMPLES, axis=0),
        ((impacts.begin_s[:, None] + moments) * scale).ravel(),
    )[:, :3].reshape(k, SAMPLES, 3)
    gap = simulated - measured
    u = moments * scale
    centred = u - u.mean(axis=1, keepdims=True)
    rate = (centred[..., None] * gap).sum(axis=1) / (centred**2).sum(axis=1)[:, None]
    level = gap.mean(axis=1) - rate * u.mean(axis=1)[:, None]
    tx, ty = impacts.tangent.T
    return np.column_stack([
        tx * level[:, 0] + ty * level[:, 1], -ty * level[:, 0] + tx * level[:, 1], level[:, 2],
        tx * rate[:, 0] + ty * rate[:, 1], -ty * rate[:, 0] + tx * rate[:, 1], rate[:, 2],
    ])  # fmt: skip


def _turned(states: Array, pivot: Array, angle: Array) -> Array:
    """States or poses (..., 3 or 6) turned about a pivot (..., 2)."""
    out = states.copy()
    c, s = np.cos(angle), np.sin(angle)
    dx, dy = states[..., 0] - pivot[..., 0], states[..., 1] - pivot[..., 1]
    out[..., 0], out[..., 1] = pivot[..., 0] + c * dx - s * dy, pivot[..., 1] + s * dx + c * dy
    out[..., 2] += angle
    if states.shape[-1] == 6:
        vx, vy = states[..., 3], states[..., 4]
        out[..., 3], out[..., 4] = c * vx - s * vy, s * vx + c * vy
    return out
