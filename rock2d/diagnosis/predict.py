"""Prediction with a diagnosed model of another experiment with the same set-up: every segment of its film."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from rock2d.diagnosis.impact_table_data import TableData
from rock2d.diagnosis.learnt_prediction import (
    END_MARGIN_S,
    KnownChange,
    LearntMotion,
    Segments,
    read_changes,
)
from rock2d.diagnosis.table_prediction import predicted_velocities
from rock2d.effects import catalogue
from rock2d.engines.batch import run_batch, world_ensemble
from rock2d.errors import InputError
from rock2d.files.experiment import Experiment
from rock2d.kinematics import sanity
from rock2d.kinematics.film_segments import FilmSegments
from rock2d.kinematics.flights import FEWEST_FLIGHT_FRAMES, Film, load_film
from rock2d.kinematics.impact_table import AFTER_COLUMNS, BEFORE_COLUMNS
from rock2d.kinematics.setup_world import setup_world
from rock2d.kinematics.states import centroid_poses, drift
from rock2d.laws.contact import INDENTATION, K_L, K_R, K_T, K_UL, MU, ContactParameters
from rock2d.records.columns import POSE, THETA, X, Y
from rock2d.scene.world import View, World

if TYPE_CHECKING:
    import pandas as pd

Array = np.ndarray
# of films that cannot be read; any other film is predicted
UNREADABLE = {
    sanity.NO_FRAMES, sanity.NO_MOTION, sanity.FRAME_RATE, sanity.LENGTH_UNIT, sanity.ANGLE_UNIT,
    sanity.WRONG_GRAVITY, sanity.UPWARD_GRAVITY,
}  # fmt: skip
TABLE_COLUMNS = ("release", "block", "segment", *AFTER_COLUMNS)
COLUMNS = ("release", "block", "segment", "t_s", "x_m", "y_m", "theta_rad")


def diagnosed_world(content: dict[str, Any], setup: World, order: Array, base_only: bool) -> World:
    """The world of a diagnosis: the base law, or the law with all effects that were found."""
    known = catalogue()
    law, effects = (content["base"], {}) if base_only else _found(content)
    rows = setup.contact.copy()
    columns = [K_L, K_UL, K_T, MU, K_R, INDENTATION]
    reading = content.get("law", {}).get("rolling_in_indentation", False)
    rows[..., columns] = ContactParameters(**law, rolling_in_indentation=reading).row()[columns]
    world = replace(setup, contact=rows, order=order)
    for name, own in effects.items():
        if not known[name].scatter:  # a scatter shifts no mean
            values = [
                q.neutral if q.implied and q.name not in own else own[q.name]["value"]
                for q in known[name].parameters
            ]
            world = known[name].apply(world, values)
    return world


def _found(content: dict[str, Any]) -> tuple[dict[str, Any], dict[str, Any]]:
    """Base law and effects of a diagnosis: of its joint model, unless that lacks the verdict; then of the verdict."""
    verdict, model = content["verdict"], _joint(content)
    if model:
        return model["base"], model["parameters"]
    if verdict in ("none", "unknown"):
        return content["base"], {}
    if content.get("beside"):  # of a diagnosis without the key model
        return content["beside"][-1]["base"], content["beside"][-1]["parameters"]
    return content["effects"][verdict]["base"], {verdict: content["effects"][verdict]["parameters"]}


def _joint(content: dict[str, Any]) -> dict[str, Any] | None:
    """The joint model with its learnt changes; None if there is none, or if it lacks the effect of the verdict."""
    model = content.get("model")
    if not model or content["verdict"] not in (*model["parameters"], "none", "unknown"):
        return None
    return model.get("learnt") or dict(model)


def learnt_changes(content: dict[str, Any]) -> list[KnownChange]:
    """The learnt changes of a diagnosis, if its joint model is used."""
    return read_changes((_joint(content) or {}).get("changes", []))


def predict(experiment: Experiment, content: dict[str, Any], *, base_only: bool = False) -> pd.DataFrame:
    """Motion predicted from each measured flight, at the camera's instants in its frame: `COLUMNS`.

    A segment runs from the end of one flight to the end of the next, or of the film; its rows are the frames that were
    recorded. Where the angle was not measured, no spin is assumed, and theta_rad is NaN. The film is judged and divided
    with the camera and on the ground that the diagnosis found.
    Of an impact table the velocities after each impact are predicted: `TABLE_COLUMNS`.
    Raises InputError for a film that cannot be read or shows no flight with a frame after it, and for a diagnosis
    without a fitted law.
    """
    import pandas as pd

    if not content["base"]:
        raise InputError("this diagnosis has no fitted law: its experiment failed the sanity checks")
    if experiment.trajectories is None:
        return _impacts(experiment, content, base_only)
    setup, film = setup_world(experiment), load_film(experiment)
    diagnosed = diagnosed_world(content, setup, setup.order, base_only=False)
    as_recorded = replace(setup, view=diagnosed.view, cross_section=diagnosed.cross_section)
    data = FilmSegments.of(film, _readable(experiment, film, as_recorded))
    order = _places(content, film.block_names, film.release_block, data.order)
    flights = np.flatnonzero(np.isfinite(data.start_s))
    if not len(flights):
        raise InputError("no block flies in this film: there is nothing to predict from", experiment.folder)
    last, release = data.segmentation.flights.last, data.segmentation.flights.release
    flights = flights[last[flights] < np.searchsorted(film.release, release[flights], side="right")]
    if not len(flights):
        message = "no block touches the ground after a flight in this film: there is nothing to predict"
        raise InputError(message, experiment.folder)
    world = diagnosed_world(content, setup, order[data.segmentation.flights.release[flights]], base_only)
    changes = [] if base_only else learnt_changes(content)
    return pd.DataFrame(_segments(film, data, world, flights, changes), columns=list(COLUMNS))


def _places(content: dict[str, Any], names: Sequence[str], block: Array, order: Array) -> Array:
    """(releases,) places in the diagnosed series of releases with this `block` and `order` in their own: both are
    assumed to cover the same series."""
    series = content.get("series", {})
    lengths = np.bincount(block, minlength=len(names))
    known = np.array([series.get(name, n) for name, n in zip(names, lengths, strict=True)])
    return np.asarray((order + 0.5) / lengths[block] * known[block] - 0.5)


def _impacts(experiment: Experiment, content: dict[str, Any], base_only: bool) -> pd.DataFrame:
    """Predicted velocities after the impacts of a table; rows without a state before are left out."""

    assert experiment.impacts is not None
    given = experiment.impacts.dropna(subset=list(BEFORE_COLUMNS)).fillna(dict.fromkeys(AFTER_COLUMNS, 0.0))
    given = given.sort_values("release", kind="stable")
    data = TableData.of(replace(experiment, impacts=given))
    names = list(experiment.blocks)
    block = data.impact_block[np.unique(data.impact_release, return_index=True)[1]]
    data.impact_order = _places(content, names, block, data.order)[data.impact_release]
    world = diagnosed_world(content, setup_world(experiment), data.impact_order, base_only)
    velocities = predicted_velocities(data, world, [] if base_only else learnt_changes(content))
    found = given[["release", "block"]].reset_index(drop=True)
    found["segment"] = found.groupby("release").cumcount()
    return found.assign(**dict(zip(AFTER_COLUMNS, velocities.T, strict=True)))[list(TABLE_COLUMNS)]


def _readable(experiment: Experiment, film: Film, world: World) -> World:
    """The world in which a film is divided: that of the diagnosis, or if its camera is perfect, the one that the sanity
    checks find. Raises InputError for a film that cannot be read; warns of other faults."""
    view = world.view
    true = replace(film, t_s=film.t_s * view.time_scale, pose=view.true(film.pose))
    true.noise = film.noise / [view.scale, view.scale, 1.0]
    stated = replace(experiment, fps=experiment.fps / view.time_scale, cross_section=world.cross_section)
    found = sanity.check_film(stated, true)
    for fault in found.faults:
        if fault.code in UNREADABLE:
            raise InputError(fault.message, experiment.folder)
        if fault.code != sanity.FEW_RELEASES:
            warnings.warn(fault.message, stacklevel=3)
    return found.registered if found.registered is not None and view == View() else world


def _segments(
    film: Film, data: FilmSegments, world: World, flights: Array, changes: Sequence[KnownChange]
) -> dict[str, Array]:
    """Rows of all segments that begin with one of `flights`."""
    own, scale = data.segmentation.flights, world.view.time_scale
    ends = np.searchsorted(film.release, own.release[flights], side="right")
    following = {int(before): i for i, before in enumerate(own.follows) if before >= 0}
    for i, flight in enumerate(flights):
        if int(flight) in following:
            ends[i] = own.last[following[int(flight)]]
    frames = [np.arange(own.last[f], end) for f, end in zip(flights, ends, strict=True)]
    room = max(map(len, frames))
    states = data.states(world).middle[flights]
    starts = drift(world, own.block[flights], states, data.start_s[flights] * scale)
    instants = np.full((len(flights), room), np.inf)
    for i, (flight, rows) in enumerate(zip(flights, frames, strict=True)):
        instants[i, : len(rows)] = film.t_s[rows] - data.basis.middle[flight] - data.start_s[flight]
    limits = np.where(np.isfinite(instants), instants, 0.0).max(axis=1)
    segment = _numbers(own.release[flights])
    times, limits = instants * scale, limits * scale + END_MARGIN_S
    if changes:
        release = own.release[flights]
        start_s = data.start_s[flights]
        began = data.basis.middle[flights] + start_s - film.t_s[np.searchsorted(film.release, release)]
        frame_s = np.median(np.diff(film.t_s)[np.diff(film.release) == 0])
        known = Segments(
            flights, own.block[flights], world.order, segment, starts, start_s, began * scale, limits,
            FEWEST_FLIGHT_FRAMES * float(frame_s) * scale,
        )  # fmt: skip
        samples = LearntMotion(changes, world, data, known).samples(times)
    else:
        ensemble, tables = world_ensemble(world)
        samples = run_batch(
            ensemble, starts, block_ids=own.block[flights], table_ids=tables, gravity_m_s2=world.gravity_m_s2,
            time_limit_s=limits, times_s=times,
        ).samples  # fmt: skip
    last = starts[:, POSE]
    for k in range(room):  # a block that has left the cross-section, or that starts deep in the ground, stays
        gone = ~np.isfinite(samples[:, k, X])
        samples[gone, k] = last[gone]
        last = samples[:, k]
    poses = world.view.record(centroid_poses(world, own.block[flights], samples))
    counts = [len(rows) for rows in frames]
    index = np.concatenate(frames)
    pose = np.concatenate([poses[i, :count] for i, count in enumerate(counts)])
    names = np.array(film.block_names)
    pose[~film.angle_known[film.release[index]], THETA] = np.nan
    return {
        "release": film.release_names[film.release[index]],
        "block": names[film.release_block[film.release[index]]],
        "segment": np.repeat(segment, counts),
        "t_s": film.t_s[index],
        "x_m": pose[:, X],
        "y_m": pose[:, Y],
        "theta_rad": pose[:, THETA],
    }


def _numbers(release: Array) -> Array:
    """(n,) number of each segment within its release, from 0; segments follow each other."""
    number = np.zeros(len(release), np.int64)
    for i in range(1, len(release)):
        if release[i] == release[i - 1]:
            number[i] = number[i - 1] + 1
    return number
