"""Velocities between impacts, from the equations of free flight fitted to the frames between them.

After Lambert et al.: impacts are the breaks between ballistic flights; translational and rotational velocity at any
point of a flight follow from its equations. What the paper warns of is flagged: deep penetration and low rebounds.
"""

from __future__ import annotations

import numpy as np
import pandas as pd

from rock2d.engines.geometry import block_arrays, ground_arrays
from rock2d.files.experiment import Experiment
from rock2d.kinematics.film_segments import FilmSegments
from rock2d.kinematics.flight_gravity import flight_gravity
from rock2d.kinematics.flights import Film, clearances
from rock2d.kinematics.setup_world import setup_world
from rock2d.kinematics.states import move_freely
from rock2d.records.columns import OMEGA, STATE_NAMES, VX, VY
from rock2d.scene.world import World

Array = np.ndarray

DEEP_PENETRATION_SIZES = 0.1  # in block sizes: penetration from which on the ground hides part of the block
# in block sizes: rebound below which a flight is too short for precise velocities
LOW_REBOUND_SIZES = 0.25


def flights_and_impacts(
    film: Film, experiment: Experiment
) -> tuple[pd.DataFrame, pd.DataFrame, FilmSegments]:
    """Tables of flights and impacts of a `film` (see `tracked_film.film_of`).

    Flights: release, block, begin_s, end_s, frames, the state at the middle instant `t_s` and its standard errors
    (`*_se`), `misfit` (root mean square of what the parabola leaves, over the noise), `gravity_m_s2` (size of the
    acceleration of a flight that clearly falls, else NaN) and its standard error. Impacts: release, block, t_s,
    zone, velocities before and after with standard errors, `penetration_m`, `rebound_m`, `flag` ("", "deep", "low",
    "deep low").
    """
    setup = setup_world(experiment)
    data = FilmSegments.of(film, setup)
    states = data.states(setup)
    known = np.minimum(states.residuals.shape[2], data.basis.degrees)
    # (flights, 3) root mean square of what parabolas leave of x, y and theta, over the noise
    misfit = np.sqrt((states.residuals**2).sum(axis=2) / known[:, None])
    flights = _flights(experiment, data, states.middle, misfit)
    return flights, _impacts(experiment, data, setup, states.middle, misfit), data


def _flights(experiment: Experiment, data: FilmSegments, middle: Array, misfit: Array) -> pd.DataFrame:
    film, flights = data.film, data.segmentation.flights
    error = _errors(data, np.arange(len(flights)), np.zeros(len(flights)), misfit)
    names = list(experiment.blocks)
    table = pd.DataFrame({
        "release": film.release_names[flights.release], "block": np.array(names)[flights.block],
        "begin_s": film.t_s[flights.first], "end_s": film.t_s[flights.last - 1],
        "frames": flights.last - flights.first, "t_s": data.basis.middle,
    })  # fmt: skip
    for k, name in enumerate(STATE_NAMES):
        table[name], table[f"{name}_se"] = middle[:, k], error[:, k]
    table["misfit"] = misfit.max(axis=1)
    found = flight_gravity(film, flights, experiment.gravity_m_s2)
    for name, values in (("gravity_m_s2", "each"), ("gravity_m_s2_se", "each_error")):
        table[name] = np.where(found.used, getattr(found, values), np.nan) if found is not None else np.nan
    return table


def _errors(data: FilmSegments, which: Array, dt: Array, misfit: Array) -> Array:
    """(n, 6) standard errors of the states of flights `which`, dt after their middle: from the noise, or from what
    the parabola leaves where that is more."""
    error = np.sqrt(np.diagonal(data.state_covariance(which, dt), axis1=1, axis2=2))
    return error * np.tile(np.maximum(misfit[which], 1.0), 2)


def _impacts(
    experiment: Experiment, data: FilmSegments, world: World, middle: Array, misfit: Array
) -> pd.DataFrame:
    film, flights, impacts = data.film, data.segmentation.flights, data.impacts
    ends = film.t_s[flights.last[impacts.before] - 1] - data.basis.middle[impacts.before]
    begins = film.t_s[flights.first[impacts.after]] - data.basis.middle[impacts.after]
    before = move_freely(world, impacts.block, middle[impacts.before], ends)
    after = move_freely(world, impacts.block, middle[impacts.after], begins)
    names, zones = list(experiment.blocks), experiment.cross_section.zone_names
    t = 0.5 * (film.t_s[flights.last[impacts.before] - 1] + film.t_s[flights.first[impacts.after]])
    table = pd.DataFrame({
        "release": film.release_names[impacts.release], "block": np.array(names)[impacts.block], "t_s": t,
        "zone": np.array(zones)[impacts.zone],
    })  # fmt: skip
    for label, state, which, dt in (
        ("", before, impacts.before, ends),
        ("_after", after, impacts.after, begins),
    ):
        error = _errors(data, which, dt, misfit)
        for k in (VX, VY, OMEGA):
            name = STATE_NAMES[k].replace("_m_s", f"{label}_m_s").replace("_rad_s", f"{label}_rad_s")
            table[name], table[f"{name}_se"] = state[:, k], error[:, k]
    deep, high = _depths(experiment, data)
    size = np.array([b.size_m for b in experiment.blocks.values()])[impacts.block]
    table["penetration_m"], table["rebound_m"] = deep, high
    flags = np.where(deep > DEEP_PENETRATION_SIZES * size, "deep", "")
    table["flag"] = [
        f"{a} low".strip() if low else str(a)
        for a, low in zip(flags, high < LOW_REBOUND_SIZES * size, strict=True)
    ]
    return table


def _depths(experiment: Experiment, data: FilmSegments) -> tuple[Array, Array]:
    """(n,) deepest seen penetration between the two flights of an impact, and height that the flight after reaches."""
    film, flights, impacts = data.film, data.segmentation.flights, data.impacts
    blocks = list(experiment.blocks.values())
    ground = ground_arrays(experiment.cross_section)
    arrays = [block_arrays(b) for b in blocks]
    deep, high = np.zeros(len(impacts)), np.zeros(len(impacts))
    for i in range(len(impacts)):
        shape = arrays[impacts.block[i]]
        contact = slice(flights.last[impacts.before[i]] - 1, flights.first[impacts.after[i]] + 1)
        flight = slice(flights.first[impacts.after[i]], flights.last[impacts.after[i]])
        deep[i] = max(0.0, -float(clearances(shape, ground, film.pose[contact]).min()))
        high[i] = float(clearances(shape, ground, film.pose[flight]).max())
    return deep, high
