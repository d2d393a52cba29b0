"""States of the block in every flight, fitted in a given world, and what the flight model leaves unexplained.

Recorded poses are taken back through the world's view to true ones; each flight is then the free motion of the world
(parabola, and air forces if it has any) from a state fitted by least squares. What is left is kept as coefficients of
orthonormal polynomials in time of degree 2 and higher: an acceleration is degree 2, a jerk degree 3.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np

from rock2d.compiled import njit
from rock2d.engines.free_flight import fly
from rock2d.engines.geometry import BlockArrays
from rock2d.kinematics.flights import Film, Flights
from rock2d.scene.world import World

Array = np.ndarray

DEGREES = 5  # polynomial degrees 2 to 6 of what is left of a flight
FRAMES_PER_DEGREE = 6  # a flight of fewer frames has fewer of them
STRIDE_S = 0.01  # of a flight through air; the states' noise is far coarser


@dataclass
class Basis:
    """Orthonormal polynomials of each flight on its frames: what does not change from world to world.

    Attributes
    ----------
    frames : (m,) frames of all flights, one flight after the other; `start` (n + 1,) where each begins
    values : (m, 2 + DEGREES) polynomials of degree 0, 1, 2 ...; 0 beyond the degrees that a flight has
    middle : (n,) mean instant, in s as recorded; `slope` (n,) value of degree 1 per s; `level` (n,) value of degree 0
    degrees : (n,) how many degrees beyond 1 each flight has
    """

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
    values = np.zeros((len(frames), 2 + DEGREES))
    middle, slope, level = np.empty(len(lengths)), np.empty(len(lengths)), 1.0 / np.sqrt(lengths)
    degrees = np.clip(lengths // FRAMES_PER_DEGREE, 1, DEGREES)
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
    """Fitted flights: true state at the middle instant, and the coefficients of what is left.

    Attributes
    ----------
    middle : (n, 6) state of the centre of mass at the basis' middle instant
    left : (n, 3, DEGREES) coefficients of x, y, theta in units of the noise of a frame
    """

    middle: Array
    left: Array


def fit_states(world: World, film: Film, flights: Flights, basis: Basis) -> States:
    """Fit every flight in a world."""
    blocks = list(world.blocks.values())
    pose = np.ascontiguousarray(world.view.true(film.pose[basis.frames]))
    offset = np.array([b.centre_of_mass_m for b in blocks])[flights.block]
    if offset.any():
        e = np.repeat(offset, np.diff(basis.start), axis=0)
        c, s = np.cos(pose[:, 2]), np.sin(pose[:, 2])
        pose[:, 0] += c * e[:, 0] - s * e[:, 1]
        pose[:, 1] += s * e[:, 0] + c * e[:, 1]
    air = np.array([b.air for b in blocks], float).reshape(len(blocks), -1)[flights.block]
    mass = np.array([[b.mass_kg, b.inertia_kg_m2] for b in blocks])[flights.block]
    t = (film.t_s[basis.frames] - np.repeat(basis.middle, np.diff(basis.start))) * world.view.time_scale
    rows = 0.5 * (basis.start[:-1] + basis.start[1:])
    at = pose[rows.astype(int)]
    noise = np.tile(film.noise, (len(at), 1))
    for c, axis in enumerate(np.eye(2)):
        noise[:, c] *= world.view.true_per_recorded(at, axis)
    middle, left = _fit(
        t, pose, basis.start, basis.values, basis.slope / world.view.time_scale, basis.level, world.gravity_m_s2,
        air, mass, noise,
    )  # fmt: skip
    return States(middle, left)


def drift(world: World, blocks: Array, states: Array, dt: Array) -> Array:
    """States (n, 6) of the free motion dt (n,) later (or earlier, if negative)."""
    own = list(world.blocks.values())
    air = np.array([b.air for b in own], float).reshape(len(own), -1)[blocks]
    mass = np.array([[b.mass_kg, b.inertia_kg_m2] for b in own])[blocks]
    out = np.ascontiguousarray(states, float).copy()
    _drift_all(out, np.ascontiguousarray(dt, float), world.gravity_m_s2, air, mass)
    return out


@njit
def _drift_all(states, dt, gravity, air, mass):
    for i in range(len(states)):
        _drift(states[i], dt[i], gravity, air[i], mass[i, 0], mass[i, 1])


@njit
def _drift(q, dt, gravity, air, mass, inertia):
    """Free motion of q in place; `air` () means none."""
    block = BlockArrays(np.empty((0, 5)), air, 0.0, 0.0, mass, inertia, 0.0, 0.0, 0.0, 0.0)
    steps = int(np.ceil(abs(dt) / STRIDE_S))
    for _ in range(steps):
        fly(q, dt / steps, gravity, block)


@njit
def _fit(t, pose, start, basis, slope, level, gravity, air, mass, noise):
    n, degrees = start.size - 1, basis.shape[1] - 2
    middle, left = np.zeros((n, 6)), np.zeros((n, 3, degrees))
    q = np.empty(6)
    for i in range(n):
        rounds = 3 if air[i].any() else 1
        for round in range(rounds):
            coefficient = np.zeros((3, degrees + 2))
            for f in range(start[i], start[i + 1]):
                if round == 0:
                    for c in range(3):
                        q[c] = 0.0
                    q[1] = -0.5 * gravity * t[f] * t[f]
                else:
                    q[:] = middle[i]
                    _drift(q, t[f], gravity, air[i], mass[i, 0], mass[i, 1])
                for c in range(3):
                    d = pose[f, c] - q[c]
                    for k in range(degrees + 2):
                        coefficient[c, k] += d * basis[f, k]
            for c in range(3):
                middle[i, c] += coefficient[c, 0] * level[i]
                middle[i, 3 + c] += coefficient[c, 1] * slope[i]
        for c in range(3):
            for k in range(degrees):
                left[i, c, k] = coefficient[c, 2 + k] / noise[i, c]
    return middle, left
