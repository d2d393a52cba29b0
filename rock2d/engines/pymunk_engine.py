"""The reference engine: block and cross-section as pymunk bodies, with the contact law instead of pymunk's impulses.

Pymunk holds the bodies and shapes, finds the facets near a block, and steps. The elasto-plastic law replaces its
impulses (`process_collision = False`), the exact parabola its first-order integration of gravity. Collision handlers
only record the facets; forces are applied once a step, in a fixed order and in one compiled call, so that results are
bit-identical on all machines. Pymunk ignores exceptions in callbacks; they are kept and raised after the step."""

import math
from collections.abc import Callable, Mapping
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
import pymunk

from rock2d.compiled import copy, njit
from rock2d.effects.columns import engine_rows
from rock2d.engines import contact_state, contact_step, rest
from rock2d.engines.energy_balance import energy_balance
from rock2d.engines.free_flight import air_acts, air_stride, fly
from rock2d.engines.geometry import Body, WorldArrays, block_arrays, centroid_depth, ground_arrays
from rock2d.engines.recording import close_impact, end_impact, note_pressure, open_impact
from rock2d.laws.contact import ContactParameters, contact_table
from rock2d.records.columns import (
    EFFECTS,
    ELASTIC,
    GROUND_SHIFT,
    I_ZONE,
    INSTANT_OMEGA,
    INSTANT_STATE,
    INSTANT_VX,
    INSTANT_X,
    N_AUDIT,
    N_IMPACT,
    N_INSTANT,
    N_STATE,
    STATE_NAMES,
    TIME,
    VX,
    VY,
    X,
    Y,
)
from rock2d.records.track import Track, impact_mappings
from rock2d.scene.blocks import Block
from rock2d.scene.cross_section import CrossSection

BLOCK, GROUND = 1, 2
MARGIN = 0.25  # distance from a facet within which pymunk reports it, in block radii
LONGEST_FLIGHT_STRIDE = 2.0  # longest step in flight, in √(radius / g)
ROOM = 64  # rows for the knots and the impacts of one call
# columns of a knot: instant and state, number of active contacts, sum of forces in N, whether the block flew freely
# since the knot before
KNOT_ACTIVE, KNOT_FORCE, KNOT_FLEW = range(N_INSTANT, N_INSTANT + 3)
N_ROW = KNOT_FLEW + 1


class Impacts(NamedTuple):
    """The open impact, and those that a call has closed."""

    current: np.ndarray  # (N_IMPACT,)
    closed: np.ndarray  # (ROOM, N_IMPACT)
    flags: np.ndarray  # (2,) whether an impact is open, whether the block has lifted off in it


OPEN, LIFTED = range(2)


class Stride(NamedTuple):
    """A step of pymunk, and the facets near the block."""

    start: float  # s
    length: float  # s
    gone: float  # s, part of it that earlier calls have computed
    first: int  # index of the first facet near
    last: int  # one past the last


class CallbackError(RuntimeError):
    """An exception inside a pymunk callback, raised after the step."""


class PymunkRelease:
    """One block on one cross-section in a pymunk space.

    `parameters`: contact law by zone, or rows (zones, columns) with effects (`World.contact`). `state` is
    (x, y, θ, vx, vy, ω) of the centre of mass in SI. A block that starts inside the ground starts in an indentation of
    that depth, without force.

    `impacts` (rows of IMPACT_NAMES): an impact begins at the first touch and ends when the ground last presses before
    the block is clear of it. Then the block may still be in its indentation, where only gravity acts."""

    def __init__(
        self,
        block: Block,
        cross_section: CrossSection,
        parameters: Mapping[str, ContactParameters] | ContactParameters | np.ndarray,
        state: np.ndarray,
        *,
        gravity_m_s2: float = 9.81,
        contact_step_s: float | None = None,
    ) -> None:
        self.block, self.cross_section = block, cross_section
        self.gravity = float(gravity_m_s2)
        if not isinstance(parameters, np.ndarray):
            parameters = contact_table(parameters, cross_section.zone_names)
        self.table = engine_rows(parameters)
        self.contact_step = contact_step_s or contact_step.contact_steps_s(block, self.table)[1]
        self.q = np.array(state, float)
        if self.q.shape != (N_STATE,) or not np.isfinite(self.q).all():
            raise ValueError(f"state must be six finite numbers {STATE_NAMES}, got {state!r}")
        self.time = 0.0
        self.audit = np.zeros(N_AUDIT)
        self._block, self._ground = block_arrays(block), ground_arrays(cross_section)
        self._world = WorldArrays(self._block, self._ground, self.table, self.gravity)
        count = contact_state.contact_count(block)
        self._memory, self._found = contact_state.new_contacts(count), contact_state.new_contacts(count)
        self._contacts = (self._memory, self._found, contact_state.new_loaded(count))
        self._rows = np.empty((ROOM, N_ROW))
        self._reach = block.reach_m
        # facets that pymunk reports as near, and their range at the last step
        self._near_facets: set[int] = set()
        self._near: tuple[int, int] | None = None
        self._watch = np.empty(rest.N_WATCH)
        rest.forget_rest(self._watch)
        self._error: BaseException | None = None
        self._knots: list[np.ndarray] = []  # of the present step
        self.impacts: list[np.ndarray] = []
        self._impacts = Impacts(np.full(N_IMPACT, np.nan), np.empty((ROOM, N_IMPACT)), np.zeros(2, np.int64))
        self._build_space()
        self._start = self.q.copy()
        self._start_kinetic = float(contact_state.kinetic_energy(self.q, self._block))
        self._find_near_ground()
        stride = Stride(0.0, 0.0, 0.0, 0, 0)
        self._advance = advance.like(self.q, stride, self._world, self._contacts, self.audit, self._impacts, self._rows)
        self._depth_and_rest = depth_and_rest.like(self.q, 0.0, False, self._world, self._watch)
        self._growth = contact_state.step_growth.like(0.0, self._block, self._memory, self.table)
        self.centroid_depth_m, self.at_rest = self._check_depth_and_rest(False)

    def _build_space(self) -> None:
        margin = MARGIN * self.block.radius_m
        space = pymunk.Space()
        space.collision_slop = 0.0
        points = [(float(x), float(y)) for x, y in self._ground.facets[:, :2]]
        self._facet_of: dict[pymunk.Shape, int] = {}
        for i, (a, b) in enumerate(pairwise(points)):
            facet = pymunk.Segment(space.static_body, a, b, margin)
            facet.collision_type = GROUND
            self._facet_of[facet] = i
        body = pymunk.Body(self.block.mass_kg, self.block.inertia_kg_m2)
        shape: pymunk.Shape
        offset = np.array(self.block.centre_of_mass_m)  # pymunk's bodies turn about their centre of mass
        if self.block.shape == "circle":
            shape = pymunk.Circle(body, self.block.radius_m, (float(-offset[0]), float(-offset[1])))
        else:
            shape = pymunk.Poly(body, [(float(x), float(y)) for x, y in self.block.outline() - offset])
        shape.collision_type = BLOCK
        shape.filter = pymunk.ShapeFilter(group=1)
        body.position_func = self._guarded(self._move)
        space.add(body, shape, *self._facet_of)
        space.on_collision(BLOCK, GROUND, begin=self._guarded(self._begin), separate=self._guarded(self._separate))
        self.space, self.body, self._shape = space, body, shape
        self._write_body()

    # callbacks of pymunk ----------------------------------------------------------------------------------

    def _guarded(self, callback: Callable[..., None]) -> Callable[..., None]:
        def call(*args: Any) -> None:
            try:
                callback(*args)
            except BaseException as error:  # pymunk would ignore it
                self._error = self._error or error

        return call

    def _begin(self, arbiter: pymunk.Arbiter, space: pymunk.Space, data: Any) -> None:
        """The block comes near a facet: suppress the impulse of pymunk and note the facet."""
        arbiter.process_collision = False
        self._near_facets.add(self._facet_of[arbiter.shapes[1]])

    def _separate(self, arbiter: pymunk.Arbiter, space: pymunk.Space, data: Any) -> None:
        """The block is no longer near a facet."""
        self._near_facets.discard(self._facet_of[arbiter.shapes[1]])

    def _move(self, body: pymunk.Body, dt: float) -> None:
        """Position update: free flight, or the contact law near the ground. The pymunk space has no gravity and no
        impulses, so it does not change velocities."""
        if self._near is not None:
            self._advance_contact(dt)
        else:
            self.audit[EFFECTS] += fly(self.q, dt, self.gravity, self._block)
        if not math.isfinite(sum(self.q.tolist())):
            raise FloatingPointError(f"the state is no longer finite at t = {self.time:.6f} s: {self.q}")
        self._write_body()

    # ------------------------------------------------------------------------------------------------------

    def _write_body(self) -> None:
        x, y, theta, vx, vy, omega = self.q.tolist()
        self.body.position, self.body.angle = (x, y), theta
        self.body.velocity, self.body.angular_velocity = (vx, vy), omega

    def _find_near_ground(self) -> None:
        """Find the facets near the start pose with pymunk, and begin contacts there."""
        self.space.reindex_shapes_for_body(self.body)
        near = {self._facet_of[hit.shape] for hit in self.space.shape_query(self._shape) if hit.shape}
        self._near = _range(near)
        if self._near is not None:
            active = contact_step.begin_contacts(self.q, self._near, self._world, self._memory, self._found)
            open_if_touching(0.0, self.q, active, self._memory, self._impacts)

    def _advance_contact(self, dt: float) -> None:
        assert self._near is not None
        gone = 0.0
        while dt - gone > 1e-12 * dt:
            stride = Stride(self.time, dt, gone, *self._near)
            used, closed, gone = self._advance(
                self.q, stride, self._world, self._contacts, self.audit, self._impacts, self._rows
            )
            if closed:
                self.impacts += list(self._impacts.closed[:closed].copy())
            self._knots.append(self._rows[:used].copy())

    def stride(self) -> float:
        """The longest step in s in which the block cannot pass through the ground undetected."""
        if self._near is not None:
            growth = self._growth(self._start_kinetic, self._block, self._memory, self.table)
            return self.contact_step * float(growth)
        longest, extra = air_stride(self.q, self.gravity, self._block)
        limit = min(longest, LONGEST_FLIGHT_STRIDE * math.sqrt(self.block.radius_m / max(self.gravity, 1e-3)))
        margin = MARGIN * self.block.radius_m
        speed = math.hypot(self.q[VX], self.q[VY])
        far = limit * (speed + 0.5 * (self.gravity + extra) * limit) + 2 * self._reach
        hit = self.space.point_query_nearest((self.q[X], self.q[Y]), far, pymunk.ShapeFilter(group=1))
        if hit is None:
            return limit
        # distance to the margin of the facets, minus a tenth of it, so that pymunk calls the handler in time
        clear = hit.distance - self._reach + 0.9 * margin
        if clear <= 0:
            return self.contact_step
        g = max(self.gravity + extra, 1e-9)
        return min(limit, max(self.contact_step, (math.sqrt(speed**2 + 2 * g * clear) - speed) / g))

    def step(self) -> np.ndarray:
        """Make one pymunk step. Returns the knots at its end and at the events of the law within it, (n, N_ROW) with
        the columns of this module.

        Raises CallbackError (with its cause) if anything fails inside a pymunk callback."""
        dt = self.stride()
        self._knots.clear()
        self.space.step(dt)
        if self._error is not None:
            error, self._error = self._error, None
            if isinstance(error, KeyboardInterrupt):
                raise error
            raise CallbackError(f"in a pymunk callback at t = {self.time:.6f} s: {error}") from error
        self.time += dt
        knots = (
            np.concatenate(self._knots) if self._knots else _flight_knot(self.time, self.q, self.audit[GROUND_SHIFT])
        )
        self._near = _range(self._near_facets)
        self.centroid_depth_m, self.at_rest = self._check_depth_and_rest(bool(knots[-1, KNOT_ACTIVE] > 0))
        return knots

    def _check_depth_and_rest(self, touching: bool) -> tuple[float, bool]:
        """(depth of the centroid below the surface nearby in m, whether the block has come to rest)."""
        return self._depth_and_rest(self.q, self.time, touching, self._world, self._watch)

    def close(self) -> None:
        """End the release; the state after an impact that has not ended is NaN."""
        if self._impacts.flags[OPEN]:
            close_impact(self._impacts.current, self._impacts.flags[LIFTED] != 0, self._impacts.closed, 0)
            self.impacts.append(self._impacts.closed[0].copy())

    def energy_balance(self) -> dict[str, float]:
        """The present energy balance in J, by ENERGY_NAMES; see `energy_balance.energy_balance`."""
        self.audit[ELASTIC] = contact_state.stored_energy(self._memory, self.table)
        return energy_balance(self.block, self.cross_section, self.gravity, self._start, self.q, self.audit)


def _flight_knot(time_s: float, q: np.ndarray, shift_m: float = 0.0) -> np.ndarray:
    """A knot without contacts, (1, N_ROW); `shift_m`: by which ground has recoiled."""
    knot = np.zeros((1, N_ROW))
    knot[0, :N_INSTANT] = time_s, *q
    knot[0, INSTANT_X] += shift_m
    knot[0, KNOT_FLEW] = 1.0
    return knot


def _range(facets: set[int]) -> tuple[int, int] | None:
    """First and one past the last index of facets; None if there are none."""
    return (min(facets), max(facets) + 1) if facets else None


def run_pymunk(
    block: Block,
    cross_section: CrossSection,
    parameters: Mapping[str, ContactParameters] | ContactParameters | np.ndarray,
    state: np.ndarray,
    *,
    release: int = 0,
    gravity_m_s2: float = 9.81,
    time_limit_s: float = 5.0,
    contact_step_s: float | None = None,
    impact_limit: int | None = None,
) -> Track:
    """Run one release until it rests, leaves the cross-section, sinks in to its centroid ("buried": the ground is too
    soft for the law), or reaches a limit.

    Parameters
    ----------
    parameters : contact law by zone, key "default" for all other zones; or rows (zones, columns) with effects
    state : (6,) x_m, y_m, theta_rad, vx_m_s, vy_m_s, omega_rad_s of the centre of mass at t = 0
    contact_step_s : contact step; default 0.03 rad of the stiffest contact oscillation
    impact_limit : number of impacts after which the release stops

    Raises CallbackError (with its cause) if anything fails inside a pymunk callback."""
    sim = PymunkRelease(
        block, cross_section, parameters, state, gravity_m_s2=gravity_m_s2, contact_step_s=contact_step_s
    )
    x_exit = (cross_section.points_m[0, 0], cross_section.points_m[-1, 0])
    strides = [_flight_knot(0.0, sim.q)]
    stop = "time"
    if sim.centroid_depth_m > 0:
        stop, time_limit_s = "buried", 0.0
    while sim.time < time_limit_s:
        strides.append(sim.step())
        if not x_exit[0] <= sim.q[X] <= x_exit[1]:
            stop = "exit"
            break
        if sim._near is not None and sim.centroid_depth_m > 0:
            stop = "buried"
            break
        if impact_limit is not None and len(sim.impacts) >= impact_limit:
            stop = "impacts"
            break
        if sim.at_rest:
            stop = "rest"
            break
    sim.close()
    knots = np.concatenate(strides)
    flew = np.roll(knots[:, KNOT_FLEW] > 0, -1)  # of the time that follows a knot
    return Track(
        release,
        block.name,
        knots[:, :N_INSTANT],
        flew & (not air_acts(sim._block)),
        impact_mappings(sim.impacts, cross_section.zone_names),
        stop,
        gravity_m_s2,
        sim.energy_balance(),
    )


@njit
def advance(q, stride, world, contacts, audit, impacts, rows):
    """Advance q through a stride with the contact law, with a knot at every event.

    impacts : Impacts; rows : (ROOM, N_ROW) for the knots

    Returns (number of knots, number of closed impacts, computed time of the stride in s). If the rows are full, the
    stride is not complete."""
    memory, found, _ = contacts
    current, closed, flags = impacts
    near = (stride.first, stride.last)
    used, count, gone, dt = 0, 0, stride.gone, stride.length
    while dt - gone > 1e-12 * dt and used + 2 <= len(rows):
        gone += contact_step.step(q, dt - gone, near, world, contacts, audit, False)
        t, (force, depth, active) = stride.start + gone, contact_state.pressure(memory, world.law)
        row = rows[used]
        _knot(row, t, q, audit[GROUND_SHIFT])
        row[KNOT_ACTIVE], row[KNOT_FORCE] = active, force
        row[KNOT_FLEW] = 1.0 if active == 0 and flags[OPEN] == 0 else 0.0
        used += 1
        if flags[OPEN] == 0:
            open_if_touching(t, q, active, memory, impacts)
            continue
        flags[LIFTED] = note_pressure(current, flags[LIFTED] != 0, force, depth, t, q)
        if active == 0:
            if end_impact(q, current, world.law[int(current[I_ZONE])], world.block, audit):
                contact_step.refresh_depths(q, near, world, memory, found)
            count, flags[OPEN] = close_impact(current, flags[LIFTED] != 0, closed, count), 0
            # an effect has changed the velocities at this instant
            if not _same(q[VX:], row[INSTANT_VX : INSTANT_OMEGA + 1]):
                _knot(rows[used], t, q, audit[GROUND_SHIFT])
                rows[used, KNOT_FLEW] = 1.0
                used += 1
    return used, count, gone


@njit
def open_if_touching(t, q, active, memory, impacts):
    """Begin an impact at time t (s) if there are active contacts."""
    if active > 0:
        open_impact(impacts.current, t, q, memory)
        impacts.flags[OPEN], impacts.flags[LIFTED] = 1, 0


@njit
def _knot(row, t, q, shift):
    """Write a knot without contacts; `shift`: in m, by which ground has recoiled."""
    for i in range(N_ROW):
        row[i] = 0.0
    row[TIME] = t
    copy(q, row[INSTANT_STATE])
    row[INSTANT_X] += shift


@njit
def depth_and_rest(q, t, touching, world, watch):
    """After a stride: (depth of the centroid below the surface nearby in m, whether the block has come to rest).

    touching : whether an impact is open"""
    depth = centroid_depth(q, world)
    if touching:
        return depth, rest.watch_rest(watch, t, q, Body(world.block, world.gravity))
    rest.forget_rest(watch)
    return depth, False


@njit
def _same(q, other):
    same = True
    for i in range(q.size):
        same = same and q[i] == other[i]
    return same
