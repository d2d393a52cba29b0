"""States of the block in every flight, fitted in a given world, and the residuals of the flights.

The view of the world transforms recorded poses to true ones. Each flight is then the free motion in this world (a
parabola, with air forces if there are any) from a state that is fitted by least squares. Residuals are coefficients of
orthonormal polynomials in time of degree 2 and higher; degree 2 is an acceleration, degree 3 a jerk."""

from __future__ import annotations

import itertools
from collections.abc import Hashable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from rock2d.arrays import Array
from rock2d.compiled import copy, njit
from rock2d.engines.free_flight import fly
from rock2d.engines.geometry import BlockArrays
from rock2d.kinematics.flights import Film, Flights
from rock2d.records.columns import VX, VY, X, Y
from rock2d.scene.blocks import poses_at
from rock2d.scene.world import World

RESIDUAL_DEGREES = 5  # polynomial degrees 2 to 6 of the residuals of a flight
FRAMES_PER_DEGREE = 6  # a short flight has fewer degrees
FREE_MOTION_STEP_S = 0.01  # time step of a flight through air; its error is far below the noise of the states
AIR_ROUNDS = 12  # most iterations of the fit of a flight through air, whose forces depend on the state
CONVERGED_SLOPE = 1e-3  # remaining slope at which the iteration ends, as a share of the noise of a frame
LEAST_EFFECT = 0.03  # smallest effect of a step along itself, as a share of it, from which the fit learns


@dataclass
class Basis:
    """Orthonormal polynomials of each flight on its frames. They are the same in every world.

    Attributes
    ----------
    frames : (m,) frames of all flights, one flight after the other
    start : (n + 1,) index in `frames` at which each flight begins
    values : (m, 2 + RESIDUAL_DEGREES) polynomials of degree 0, 1, 2 ...; 0 beyond the degrees that a flight has
    middle : (n,) mean instant, in s as recorded
    slope : (n,) value of degree 1 per s
    level : (n,) value of degree 0
    degrees : (n,) number of degrees beyond 1 of each flight"""

    frames: Array
    start: Array
    values: Array
    middle: Array
    slope: Array
    level: Array
    degrees: Array

    def only(self, keep: Array) -> Basis:
        """The basis of some of the flights, given as a mask."""
        lengths = np.diff(self.start)
        rows = np.repeat(keep, lengths)
        start = np.concatenate([[0], np.cumsum(lengths[keep])])
        own = (a[keep] for a in (self.middle, self.slope, self.level, self.degrees))
        return Basis(self.frames[rows], start, self.values[rows], *own)


def flight_basis(film: Film, flights: Flights) -> Basis:
    """The basis of all flights of a film."""
    lengths = flights.last - flights.first
    start = np.concatenate([[0], np.cumsum(lengths)])
    frames = np.concatenate(
        [np.empty(0, np.int64), *(np.arange(a, b) for a, b in zip(flights.first, flights.last, strict=True))]
    )
    values = np.zeros((len(frames), 2 + RESIDUAL_DEGREES))
    middle, slope, level = np.empty(len(lengths)), np.empty(len(lengths)), 1.0 / np.sqrt(lengths)
    degrees = np.clip(lengths // FRAMES_PER_DEGREE, 1, RESIDUAL_DEGREES)
    for i, (a, b) in enumerate(itertools.pairwise(start)):
        t = film.t_s[frames[a:b]]
        middle[i] = t.mean()
        span = np.ptp(t)
        polynomials, r = np.linalg.qr(np.vander((t - middle[i]) / span, 2 + degrees[i], increasing=True))
        polynomials *= np.sign(np.diag(r))
        values[a:b, : 2 + degrees[i]] = polynomials
        slope[i] = 1.0 / (r[1, 1] * np.sign(r[1, 1]) * span)
    return Basis(frames, start, values, middle, slope, level, degrees)


@dataclass
class States:
    """Fitted flights: true state at the middle instant, and residuals.

    Attributes
    ----------
    middle : (n, 6) state of the centre of mass at the basis' middle instant
    residuals : (n, 3, RESIDUAL_DEGREES) coefficients of x, y, theta in units of the noise of a frame"""

    middle: Array
    residuals: Array


class _Frames(NamedTuple):
    """Frames of all flights, one flight after the other: true time from the middle of the flight (m,), true poses of
    the centre of mass (m, 3); flight i has the frames start[i] to start[i + 1]."""

    t_s: Array
    pose: Array
    start: Array


class _Polynomials(NamedTuple):
    """`Basis.values`, `slope` per true second, `level`."""

    values: Array
    slope: Array
    level: Array


class _Bodies(NamedTuple):
    """Per flight: coefficients of the air (n, k), mass and moment of inertia (n, 2); gravity in m/s²."""

    air: Array
    mass: Array
    gravity: float


def _bodies(world: World, blocks: Array) -> _Bodies:
    own = list(world.blocks.values())
    air = np.array([b.air for b in own], float).reshape(len(own), -1)[blocks]
    mass = np.array([[b.mass_kg, b.inertia_kg_m2] for b in own])[blocks]
    return _Bodies(air, mass, world.gravity_m_s2)


def free_motion_key(world: World) -> Hashable:
    """Key of everything in a world on which `fit_states` depends."""
    bodies = [(*b.air, b.mass_kg, b.inertia_kg_m2, *b.centre_of_mass_m) for b in world.blocks.values()]
    return world.view, world.gravity_m_s2, tuple(bodies)


def fit_states(world: World, film: Film, flights: Flights, basis: Basis) -> States:
    """Fit every flight in a world."""
    pose = np.ascontiguousarray(world.view.true(film.pose[basis.frames]))
    offset = centres_of_mass(world, flights.block)
    if offset.any():
        pose = poses_at(pose, np.repeat(offset, np.diff(basis.start), axis=0))
    t = (film.t_s[basis.frames] - np.repeat(basis.middle, np.diff(basis.start))) * world.view.time_scale
    rows = 0.5 * (basis.start[:-1] + basis.start[1:])
    at = pose[rows.astype(int)]
    noise = np.tile(film.noise, (len(at), 1))
    for c, axis in ((X, (1.0, 0.0)), (Y, (0.0, 1.0))):
        noise[:, c] *= world.view.true_per_recorded(at, np.array(axis))
    frames = _Frames(t, pose, basis.start)
    polynomials = _Polynomials(basis.values, basis.slope / world.view.time_scale, basis.level)
    return States(*_fit(frames, polynomials, _bodies(world, flights.block), noise))


def centroid_poses(world: World, block: Array, poses: Array) -> Array:
    """Poses (n, k, 3) of the tracked centroid from those of the centre of mass."""
    offset = centres_of_mass(world, block)
    return poses_at(poses, -offset[:, None]) if offset.any() else poses


def centres_of_mass(world: World, block: Array) -> Array:
    """(n, 2) centres of mass of blocks, relative to the tracked centroid, in the axes of each block."""
    return np.array([b.centre_of_mass_m for b in world.blocks.values()])[block]


def move_freely(world: World, blocks: Array, states: Array, dt: Array) -> Array:
    """States (n, 6) of the free motion dt (n,) later (or earlier, if negative)."""
    out = np.ascontiguousarray(states, float).copy()
    _move_all_freely(out, np.ascontiguousarray(dt, float), _bodies(world, blocks))
    return out


@njit
def _move_all_freely(states, dt, bodies):
    for i in range(len(states)):
        _move_freely(states[i], dt[i], bodies, i)


@njit
def _move_freely(q, dt, bodies, i):
    """Free motion of the state q of body i in place; an empty row of `air` means none."""
    mass, inertia = bodies.mass[i, 0], bodies.mass[i, 1]
    block = BlockArrays(np.empty((0, 5)), bodies.air[i], 0.0, 0.0, mass, inertia, 0.0, 0.0, 0.0, 0.0)
    steps = int(np.ceil(abs(dt) / FREE_MOTION_STEP_S))
    for _ in range(steps):
        fly(q, dt / steps, bodies.gravity, block)


@njit
def _follow(track, middle, q, t, bodies, i):
    """Integrate body i from its state q at the first instant to the last one, in place; write its poses at the instants
    t into the rows of `track`, and its state at t = 0 into `middle`. Backward integration would amplify errors by
    drag."""
    now = t[0]
    for f in range(t.size):
        if now < 0.0 <= t[f]:
            _move_freely(q, -now, bodies, i)
            copy(q, middle)
            now = 0.0
        _move_freely(q, t[f] - now, bodies, i)
        now = t[f]
        copy(q[:3], track[f])


@njit
def _update_inverse(inverse, step, left):
    """Update, in place, the inverse (3, 3) of the change of the slopes with the first velocity after a `step` that has
    `left` these slopes; all in noise of a frame. Air couples the directions (lift turns the path), so the update is
    that of Broyden (1965, Math. Comput. 19(92), 577-593): exact after six steps if the air is linear."""
    undone = inverse @ left
    along = step @ (step - undone)
    if abs(along) > LEAST_EFFECT * (step @ step):
        inverse += np.outer(undone, step @ inverse) / along


@njit
def _fit(frames, polynomials, bodies, noise):
    """States at the middle (n, 6) and residuals (n, 3, degrees) of every flight."""
    t, pose, start = frames
    basis = polynomials.values
    n, degrees = start.size - 1, basis.shape[1] - 2
    middle, residuals = np.zeros((n, 6)), np.zeros((n, 3, degrees))
    q, begin, inverse, step = np.empty(6), np.empty(6), np.empty((3, 3)), np.empty(3)
    longest = 0
    for i in range(n):
        longest = max(longest, start[i + 1] - start[i])
    track = np.empty((longest, 3))
    for i in range(n):
        rounds = AIR_ROUNDS if bodies.air[i].any() else 1
        early = t[start[i]]
        for round in range(rounds):
            coefficient = np.zeros((3, degrees + 2))
            if round > 0:
                copy(begin, q)
                _follow(track, middle[i], q, t[start[i] : start[i + 1]], bodies, i)
            for f in range(start[i], start[i + 1]):
                if round == 0:
                    for c in range(3):
                        q[c] = 0.0
                    q[Y] = -0.5 * bodies.gravity * t[f] * t[f]
                else:
                    copy(track[f - start[i]], q)
                for c in range(3):
                    d = pose[f, c] - q[c]
                    for k in range(degrees + 2):
                        coefficient[c, k] += d * basis[f, k]
            slope = coefficient[:, 1] * polynomials.slope[i]
            if round == 0:
                inverse, begin = np.eye(3), np.zeros(6)
                begin[Y] = -0.5 * bodies.gravity * early * early
                begin[VY] = -bodies.gravity * early
            for c in range(3):
                middle[i, c] += coefficient[c, 0] * polynomials.level[i]
                middle[i, VX + c] += slope[c]
                begin[c] += coefficient[c, 0] * polynomials.level[i] + slope[c] * early
            if round > 1:
                _update_inverse(inverse, step, slope / noise[i])
            step = inverse @ (slope / noise[i])
            for c in range(3):
                begin[VX + c] += step[c] * noise[i, c]
            if round > 0 and (np.abs(coefficient[:, 1]) < CONVERGED_SLOPE * noise[i]).all():
                break
        for c in range(3):
            for k in range(degrees):
                residuals[i, c, k] = coefficient[c, 2 + k] / noise[i, c]
    return middle, residuals
