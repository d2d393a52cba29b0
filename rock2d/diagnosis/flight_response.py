"""Response of flights to a small acceleration that depends on the position and motion of the block.

An acceleration a(t) along the measured path displaces the block by its double integral. The polynomials of degree 0 and
1 of a flight absorb a part of that as another state; the rest remains in the residuals. Both are linear in the
acceleration, so no simulation is needed."""

import itertools
from dataclasses import dataclass

import numpy as np

from rock2d.arrays import Array
from rock2d.diagnosis import quantities as q
from rock2d.kinematics.film_segments import FilmSegments
from rock2d.kinematics.states import move_freely
from rock2d.records.columns import OMEGA, THETA, VX, VY, X, Y
from rock2d.scene.world import World


@dataclass
class FlightPaths:
    """The measured paths of all flights, frame by frame, one flight after the other.

    Attributes
    ----------
    start : (m + 1,) index of the first frame of each flight
    t_s : (frames,) true time from the middle of the flight
    quantities : name -> (frames,) values of what an acceleration may depend on"""

    start: Array
    t_s: Array
    quantities: dict[str, Array]


def flight_paths(data: FilmSegments, world: World) -> FlightPaths:
    """The paths of a film's flights in a world."""
    flights = data.flights
    flight = np.repeat(np.arange(len(flights)), np.diff(flights.start))
    t_s = (data.film.t_s[flights.frames] - flights.middle[flight]) * world.view.time_scale
    path = move_freely(world, flights.block[flight], data.states(world).middle[flight], t_s)
    release = flights.release[flight]
    began = data.film.t_s[np.searchsorted(data.film.release, release)]
    number = np.zeros(len(flights))
    for i in np.flatnonzero(flights.follows >= 0):
        number[i] = number[flights.follows[i]] + 1
    quantities = path_quantities(world, path)
    quantities |= {
        q.BLOCK: flights.block[flight].astype(float),
        q.SERIES: data.order[release].astype(float),
        q.TIME_S: (data.film.t_s[flights.frames] - began) * world.view.time_scale,
        q.HISTORY: np.minimum(number, q.MOST_COUNTED_IMPACTS)[flight],
    }
    return FlightPaths(flights.start, t_s, quantities)


def path_quantities(world: World, states: Array) -> dict[str, Array]:
    """Name -> (n,): what an acceleration may depend on, from states (n, 6)."""
    points = world.cross_section.points_m
    vx, vy, omega = states[:, VX], states[:, VY], states[:, OMEGA]
    speed = np.hypot(vx, vy)
    return {
        q.PLACE_M: states[:, X],
        q.HEIGHT_M: states[:, Y],
        q.CLEARANCE_M: states[:, Y] - np.interp(states[:, X], points[:, X], points[:, Y]),
        q.THETA_RAD: states[:, THETA],
        q.VX_M_S: vx,
        q.VY_M_S: vy,
        q.DRAG_X_M2_S2: speed * vx,
        q.DRAG_Y_M2_S2: speed * vy,
        q.OMEGA_RAD_S: omega,
        q.SPIN_VX_M_S2: omega * vx,
        q.SPIN_VY_M_S2: omega * vy,
    }


@dataclass
class FlightResponse:
    """Response of each flight to unit accelerations with the k functions of a basis.

    Attributes
    ----------
    residuals : (m, degrees, k) change of the coefficients of degree 2 and higher, in m for 1 m/s² (or rad for 1 rad/s²)
    place, rate : (m, k) change of the fitted position and velocity at the middle
    paths : the measured paths
    moved, moving : (frames, k) displacement and its rate along the paths"""

    residuals: Array
    place: Array
    rate: Array
    paths: FlightPaths
    moved: Array
    moving: Array

    def state_change(self, flight: Array, dt: Array) -> tuple[Array, Array]:
        """(n, k) changes of position and velocity of a `flight` (n,) at the time `dt` (n,) in s from its middle."""
        start, t = self.paths.start, self.paths.t_s
        ends = zip(start[flight], start[flight + 1], dt, strict=True)
        row = np.array([min(a + np.searchsorted(t[a:b], at), b - 1) for a, b, at in ends], np.int64)
        beyond = (dt - t[row])[:, None]
        place = self.moved[row] + beyond * self.moving[row]
        return place - self.place[flight] - self.rate[flight] * dt[:, None], self.moving[row] - self.rate[flight]


def flight_response(data: FilmSegments, world: World, paths: FlightPaths, basis: q.Basis) -> FlightResponse:
    """The responses of a film's flights to accelerations that follow a basis."""
    begin = paths.start[:-1]
    moving = integral(paths.t_s, basis.features(paths.quantities), begin)
    moved = integral(paths.t_s, moving, begin)
    values = data.flights.values
    coefficient = np.stack([values[a:b].T @ moved[a:b] for a, b in itertools.pairwise(paths.start)])
    slope = data.flights.slope / world.view.time_scale
    return FlightResponse(
        coefficient[:, 2:],
        coefficient[:, 0] * data.flights.level[:, None],
        coefficient[:, 1] * slope[:, None],
        paths,
        moved,
        moving,
    )


def integral(t: Array, values: Array, begin: Array) -> Array:
    """(n, k) cumulative integral of values (n, k) over t (n,) by the trapezoidal rule. Several paths follow each other;
    the integral starts anew at the rows `begin`."""
    steps = np.zeros_like(values)
    steps[1:] = 0.5 * (values[1:] + values[:-1]) * np.diff(t)[:, None]
    steps[begin] = 0.0
    for a, b in itertools.pairwise([*begin, len(t)]):
        np.cumsum(steps[a:b], axis=0, out=steps[a:b])
    return steps
