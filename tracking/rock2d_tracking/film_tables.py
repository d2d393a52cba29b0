"""Tables of the flights and impacts of a film, from the equations of free flight fitted to the frames between impacts.

As in Lambert et al., impacts are the breaks between ballistic flights; the equations of a flight give its translational
and rotational velocity at any time. Deep penetration and low rebounds, which reduce the accuracy, are flagged."""

import numpy as np
import pandas as pd

from rock2d.arrays import Array
from rock2d.engines.geometry import block_arrays, ground_arrays
from rock2d.files.experiment import Experiment
from rock2d.kinematics.film_segments import FilmSegments
from rock2d.kinematics.flight_gravity import FlightGravity
from rock2d.kinematics.flights import clearances
from rock2d.kinematics.impacts import FlightPairs
from rock2d.kinematics.setup_world import setup_world
from rock2d.records.columns import LINEAR_VELOCITY, OMEGA, POSITION, STATE_NAMES, VX, VY, after

DEEP_PENETRATION_SIZES = 0.1  # in block sizes: penetration above which the ground hides part of the block
# in block sizes: rebound below which a flight is too short for precise velocities
LOW_REBOUND_SIZES = 0.25
# largest time between two flights, over the duration of the shorter one, without the flag "wide gap"
WIDEST_GAP = 0.6
FLAGS, MID_AIR = ["deep", "low", "wide gap"], "mid-air"


def flights_table(experiment: Experiment, data: FilmSegments, gravity: FlightGravity | None) -> pd.DataFrame:
    """Table of the flights of an experiment's film: release, block, begin_s, end_s, frames, the state at the middle
    instant `t_s` and its standard errors (`*_se`), `misfit` (root mean square of the residuals of the parabola, over
    the noise), `gravity_m_s2` (acceleration of a flight that clearly falls, otherwise NaN; also NaN if scale or frame
    rate was computed from it) and its standard error.

    gravity : that of the flights; None if no flight shows it"""
    middle, misfit = data.states(setup_world(experiment)).middle, _misfit(data, experiment)
    film, flights = data.film, data.flights
    error = _errors(data, np.arange(len(flights)), np.zeros(len(flights)), misfit)
    names = list(experiment.blocks)
    table = pd.DataFrame({
        "release": film.release_names[flights.release], "block": np.array(names)[flights.block],
        "begin_s": film.t_s[flights.first], "end_s": film.t_s[flights.last - 1],
        "frames": flights.last - flights.first, "t_s": data.flights.middle,
    })  # fmt: skip
    for k, name in enumerate(STATE_NAMES):
        table[name], table[f"{name}_se"] = middle[:, k], error[:, k]
    table["misfit"] = misfit.max(axis=1)
    found = gravity if experiment.from_gravity is None else None  # else it is no measurement
    for name, values in (("gravity_m_s2", "each"), ("gravity_m_s2_se", "each_error")):
        table[name] = np.where(found.used, getattr(found, values), np.nan) if found is not None else np.nan
    return table


def _errors(data: FilmSegments, which: Array, dt: Array, misfit: Array) -> Array:
    """(n, 6) standard errors of the states of flights `which`, dt after their middle: from the noise, or from the
    residuals if these are larger."""
    error = np.sqrt(np.diagonal(data.state_covariance(which, dt), axis1=1, axis2=2))
    return error * np.tile(np.maximum(misfit[which], 1.0), 2)


def _misfit(data: FilmSegments, experiment: Experiment) -> Array:
    """(flights, 3) root mean square residuals of x, y and theta, over the noise."""
    residuals = data.states(setup_world(experiment)).residuals
    known = np.minimum(residuals.shape[2], data.flights.degrees)
    return np.asarray(np.sqrt((residuals**2).sum(axis=2) / known[:, None]))


def measured_impacts_table(experiment: Experiment, data: FilmSegments) -> pd.DataFrame:
    """Table of the impacts of an experiment's film and of the changes of motion in mid-air, ordered by time: release,
    block, t_s and zone of the contact, velocities just before and after it with standard errors, `restitution` (speed
    across the ground after over before), `penetration_m`, `rebound_m`, `flag` (any of "deep", "low", "wide gap";
    "mid-air" if the ground is not near and the block does not bounce: this is not an impact)."""
    misfit = _misfit(data, experiment)
    tables = [_contacts(experiment, data, pairs, misfit) for pairs in (data.impacts, data.mid_air)]
    tables[1]["flag"] = MID_AIR
    tables[1][["restitution", "restitution_se"]] = np.nan
    own = [table for table in tables if len(table)] or tables[:1]
    return pd.concat(own, ignore_index=True).sort_values(["release", "t_s"], ignore_index=True)


def _contacts(experiment: Experiment, data: FilmSegments, pairs: FlightPairs, misfit: Array) -> pd.DataFrame:
    film = data.film
    names, zones = list(experiment.blocks), experiment.cross_section.zone_names
    table = pd.DataFrame({
        "release": film.release_names[pairs.release], "block": np.array(names)[pairs.block],
        "t_s": data.flights.middle[pairs.before] + pairs.touch_s, "zone": np.array(zones)[pairs.zone],
    })  # fmt: skip
    sides = ((str, pairs.arriving, pairs.before, pairs.touch_s), (after, pairs.leaving, pairs.after, pairs.leave_s))
    instant = _instant_errors(data, pairs, misfit)
    across = np.column_stack([-pairs.tangent[:, 1], pairs.tangent[:, 0]])
    normal = []
    for named, state, which, dt in sides:
        error = _errors(data, which, dt, misfit)
        error[:, VY] = np.hypot(error[:, VY], experiment.gravity_m_s2 * instant)
        for k in (VX, VY, OMEGA):
            name = named(STATE_NAMES[k])
            table[name], table[f"{name}_se"] = state[:, k], error[:, k]
        speed, speed_se = state[:, LINEAR_VELOCITY] * across, error[:, LINEAR_VELOCITY] * across
        normal.append((speed.sum(axis=1), np.hypot(*speed_se.T)))
    (coming, coming_se), (going, going_se) = normal
    turned = (coming < 0.0) & (going > 0.0)
    ratio = np.where(turned, -going / np.where(turned, coming, 1.0), np.nan)
    table["restitution"] = ratio
    table["restitution_se"] = np.hypot(going_se, ratio * coming_se) / np.where(turned, -coming, np.nan)
    deep, high = _depths(experiment, data, pairs)
    size = np.array([b.size_m for b in experiment.blocks.values()])[pairs.block]
    table["penetration_m"], table["rebound_m"] = deep, high
    table["flag"] = _flags(data, pairs, deep > DEEP_PENETRATION_SIZES * size, high < LOW_REBOUND_SIZES * size)
    return table


def _instant_errors(data: FilmSegments, pairs: FlightPairs, misfit: Array) -> Array:
    """(n,) standard errors in s of the instants at which two flights meet."""
    errors = [
        _errors(data, which, dt, misfit)[:, POSITION].max(axis=1)
        for which, dt in ((pairs.before, pairs.touch_s), (pairs.after, pairs.leave_s))
    ]
    change = np.hypot(*(pairs.leaving - pairs.arriving)[:, LINEAR_VELOCITY].T)
    return np.hypot(*errors) / np.maximum(change, 1e-9)


def _flags(data: FilmSegments, pairs: FlightPairs, deep: Array, low: Array) -> list[str]:
    flights, t = data.flights, data.film.t_s
    gap = t[flights.first[pairs.after]] - t[flights.last[pairs.before] - 1]
    lasts = t[flights.last - 1] - t[flights.first]
    wide = gap > WIDEST_GAP * np.minimum(lasts[pairs.before], lasts[pairs.after])
    words = np.where(np.column_stack([deep, low, wide]), FLAGS, "")
    return [" ".join(word for word in own if word) for own in words.tolist()]


def _depths(experiment: Experiment, data: FilmSegments, pairs: FlightPairs) -> tuple[Array, Array]:
    """(n,) deepest visible penetration between the two flights of an impact, and height of the flight after it."""
    film, flights = data.film, data.flights
    blocks = list(experiment.blocks.values())
    ground = ground_arrays(experiment.cross_section)
    arrays = [block_arrays(b) for b in blocks]
    deep, high = np.zeros(len(pairs)), np.zeros(len(pairs))
    for i in range(len(pairs)):
        shape = arrays[pairs.block[i]]
        contact = slice(flights.last[pairs.before[i]] - 1, flights.first[pairs.after[i]] + 1)
        flight = slice(flights.first[pairs.after[i]], flights.last[pairs.after[i]])
        deep[i] = max(0.0, -float(clearances(shape, ground, film.pose[contact]).min()))
        high[i] = float(clearances(shape, ground, film.pose[flight]).max())
    return deep, high
