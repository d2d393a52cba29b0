"""States of the block in every flight, fitted in a given world, and the residuals of the flights.

The view of the world transforms recorded poses to true ones. Each flight is then the free motion in this world (a
parabola, with air forces if there are any) from a state that is fitted by least squares. Residuals are coefficients of
orthonormal polynomials in time of degree 2 and higher; degree 2 is an acceleration, degree 3 a jerk."""

from __future__ import annotations

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

FREE_MOTION_STEP_S = 0.01  # time step of a flight through air; its error is far below the noise of the states
AIR_ROUNDS = 12  # most iterations of the fit of a flight through air, whose forces depend on the state
CONVERGED_SLOPE = 1e-3  # remaining slope at which the iteration ends, as a share of the noise of a frame
LEAST_EFFECT = 0.03  # smallest effect of a step along itself, as a share of it, from which the fit learns


@dataclass
class States:
    """Fitted flights: true state at the middle instant, and residuals.

    Attributes
    ----------
    middle : (n, 6) state of the centre of mass at the middle instants of the flights
    residuals : (n, 3, RESIDUAL_DEGREES) coefficients of x, y, theta in units of the noise of a frame"""

    middle: Array
    residuals: Array


class _Frames(NamedTuple):
    """Frames of all flights in a world: true time from the middle of the flight (m,), true poses of the centre of mass
    (m, 3), and `start`, `values`, `slope` per true second and `level` of `Flights`."""

    t_s: Array
    pose: Array
    start: Array
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


def fit_states(world: World, film: Film, flights: Flights) -> States:
    """Fit every flight in a world."""
    start, pace = flights.start, world.view.time_scale
    pose = np.ascontiguousarray(world.view.true(film.pose[flights.frames]))
    offset = centres_of_mass(world, flights.block)
    if offset.any():
        pose = poses_at(pose, np.repeat(offset, np.diff(start), axis=0))
    t = (film.t_s[flights.frames] - np.repeat(flights.middle, np.diff(start))) * pace
    rows = 0.5 * (start[:-1] + start[1:])
    at = pose[rows.astype(int)]
    noise = np.tile(film.noise, (len(at), 1))
    for c, axis in ((X, (1.0, 0.0)), (Y, (0.0, 1.0))):
        noise[:, c] *= world.view.true_per_recorded(at, np.array(axis))
    frames = _Frames(t, pose, start, flights.values, flights.slope / pace, flights.level)
    return States(*_fit(frames, _bodies(world, flights.block), noise))


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
def _fit(frames, bodies, noise):
    """States at the middle (n, 6) and residuals (n, 3, degrees) of every flight."""
    t, pose, start, values, slopes, levels = frames
    n, degrees = start.size - 1, values.shape[1] - 2
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
                        coefficient[c, k] += d * values[f, k]
            slope = coefficient[:, 1] * slopes[i]
            if round == 0:
                inverse, begin = np.eye(3), np.zeros(6)
                begin[Y] = -0.5 * bodies.gravity * early * early
                begin[VY] = -bodies.gravity * early
            for c in range(3):
                middle[i, c] += coefficient[c, 0] * levels[i]
                middle[i, VX + c] += slope[c]
                begin[c] += coefficient[c, 0] * levels[i] + slope[c] * early
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
