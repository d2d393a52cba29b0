"""Rest prediction: the end of every film predicted from the last measured flight.

Rests are not used in fits, because a long roll on the ground depends little on impacts and much on chance. So they are
always held out. They show where else the gap appears.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rock2d.diagnosis.data import FilmData
from rock2d.diagnosis.fitting import Fit
from rock2d.diagnosis.model import BASE_WIDTH
from rock2d.diagnosis.residual_regression import clipped
from rock2d.engines.batch import run_world
from rock2d.kinematics.film_findings import REST_FRAMES
from rock2d.kinematics.film_segments import STATE_SIZE
from rock2d.kinematics.states import centroid_poses
from rock2d.records.columns import THETA
from rock2d.scene.world import World

Array = np.ndarray

SCATTER_STEP = 0.02  # step of finite differences, as a share of a parameter's scale


@dataclass
class Rests:
    """Ends of the films: last flight of each, recorded time from its start to the end of the film in s, and final
    pose."""

    flight: Array
    wait_s: Array
    pose: Array


def find_rests(data: FilmData) -> Rests:
    """Ends of the releases that touch the ground after their last flight."""
    film, flights = data.film, data.flights
    last = np.array([f for f in range(len(flights)) if f not in set(flights.follows)], np.int64)
    ends = np.searchsorted(film.release, flights.release[last], side="right")
    use = (ends - flights.last[last] > 3 * REST_FRAMES) & np.isfinite(data.start_s[last])
    last, ends = last[use], ends[use]
    pose = np.array([film.pose[end - REST_FRAMES : end].mean(axis=0) for end in ends]).reshape(-1, 3)
    middle = np.array([film.t_s[end - REST_FRAMES : end].mean() for end in ends])
    return Rests(last, middle - data.basis.middle[last] - data.start_s[last], pose)


def rest_squares(data: FilmData, rests: Rests, fit: Fit, covariance: Array) -> Array:
    """(n, 3) squares of simulated - measured x, y, theta at the end, over their variance; clipped."""
    residuals = _residuals(data, rests, _world(data, rests, fit, fit.p))
    return clipped(residuals / np.sqrt(covariance)) ** 2


def rest_variance(data: FilmData, rests: Rests, fit: Fit) -> Array:
    """(n, 3) variances of the ends, from the noise of the last flights and the soil's scatter."""
    world = _world(data, rests, fit, fit.p)
    at = _residuals(data, rests, world)
    variance = np.repeat(data.film.long_noise[None] ** 2, len(rests.flight), axis=0)
    for k, sigma in enumerate(fit.scatter[: len(BASE_WIDTH)]):
        p = fit.p + SCATTER_STEP * (np.arange(len(fit.p)) == k)
        stepped = _residuals(data, rests, _world(data, rests, fit, p))
        variance += np.nan_to_num((stepped - at) * sigma / SCATTER_STEP) ** 2
    start = data.start_s[rests.flight]
    states = data.states_at(world, rests.flight, start)
    noise = data.true_covariance(world, rests.flight, start, states)
    for k in range(STATE_SIZE):
        sigma_state = np.sqrt(noise[:, k, k])
        stepped = _residuals(data, rests, world, sigma_state[:, None] * (np.arange(STATE_SIZE) == k))
        variance += np.nan_to_num(stepped - at) ** 2
    variance[data.unknown_spin[rests.flight] > 0.0, THETA] = np.inf
    return variance


def _world(data: FilmData, rests: Rests, fit: Fit, p: Array) -> World:
    return fit.model.world(p, data.order[data.flights.release[rests.flight]])


def _residuals(data: FilmData, rests: Rests, world: World, shift: Array | float = 0.0) -> Array:
    """(n, 3) simulated - recorded pose at the end of the film."""
    block, wait_s = data.flights.block[rests.flight], rests.wait_s * world.view.time_scale
    starts = data.states_at(world, rests.flight, data.start_s[rests.flight]) + shift
    samples = run_world(world, starts, block, time_limit_s=wait_s + 1e-9, times_s=wait_s[:, None]).samples
    return world.view.record(centroid_poses(world, block, samples))[:, 0] - rests.pose
