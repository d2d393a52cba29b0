"""Prediction of another experiment with the same set-up by a diagnosed model: every segment of its film."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from rock2d.arrays import Array
from rock2d.diagnosis.data import TableData
from rock2d.diagnosis.learnt_prediction import KnownChange, predicted_poses, read_changes
from rock2d.diagnosis.levers import FRAME, FRAME_COLUMNS, LAW, LEVER_QUANTITIES, LEVER_SIZES, OUTCOME, PROFILE, STATE
from rock2d.diagnosis.model import with_changed_law
from rock2d.diagnosis.quantities import BLOCK, SPLINE, ZONE
from rock2d.diagnosis.replay import Segments, as_rows
from rock2d.effects import catalogue
from rock2d.errors import InputError, UnusualWarning
from rock2d.files.checked_yaml import Document, key_shown
from rock2d.files.diagnosis import no_fitted_law, read_fitted_diagnosis
from rock2d.files.diagnosis_keys import BlockScale, fitted_scale
from rock2d.files.experiment import Experiment
from rock2d.files.fitted_keys import ChangeKeys
from rock2d.kinematics import sanity
from rock2d.kinematics.film_segments import FilmSegments
from rock2d.kinematics.flights import Film, load_film
from rock2d.kinematics.impacts import AFTER_COLUMNS
from rock2d.kinematics.setup_world import setup_world
from rock2d.laws.contact import K_L, K_R, K_T, K_UL, MU, ROLLING_IN_INDENTATION, ContactParameters
from rock2d.records.columns import N_STATE, STATE_NAMES, X, Y
from rock2d.scene.world import View, World
from rock2d.wording import length

if TYPE_CHECKING:
    import pandas as pd

# faults with which a film cannot be predicted
UNREADABLE_FAULTS = {
    sanity.NO_FRAMES, sanity.NO_MOTION, sanity.FRAME_RATE, sanity.LENGTH_UNIT, sanity.ANGLE_UNIT,
    sanity.WRONG_GRAVITY, sanity.UPWARD_GRAVITY,
}  # fmt: skip
SAME = 1e-3  # largest relative difference of numbers of the same set-up
TABLE_COLUMNS = ("release", "block", "segment", *AFTER_COLUMNS)
COLUMNS = ("release", "block", "segment", "t_s", "x_m", "y_m", "theta_rad")


def diagnosed_world(content: dict[str, Any], setup: World, order: Array, base_only: bool) -> World:
    """The world of a diagnosis: with all effects that were found, or `base_only` with the base law.

    `order`: positions of the releases in their series, counted from 0."""
    known = catalogue()
    law, effects = (content["base"], {}) if base_only else _law_and_effects(content)
    rows = setup.contact.copy()
    columns = [K_L, K_UL, K_T, MU, K_R, ROLLING_IN_INDENTATION]
    reading = content.get("law", {}).get("rolling_in_indentation", False)
    rows[..., columns] = ContactParameters(**law, rolling_in_indentation=reading).row()[columns]
    filmed = {name: BlockScale.model_validate(scale) for name, scale in content.get("blocks", {}).items()}
    world = replace(setup, contact=rows, order=order, fitted_scale=fitted_scale(filmed))
    for name, parameters in effects.items():
        if not known[name].scatter:  # a scatter does not shift means
            values = [
                q.neutral if q.may_be_missing and q.name not in parameters else parameters[q.name]["value"]
                for q in known[name].parameters
            ]
            world = known[name].apply(world, values)
            by_block = [q.get("by_block") or {} for q in parameters.values()]
            blocks = [block for block in world.blocks if all(block in q for q in by_block)]
            world = known[name].on_blocks(world, {b: [q[b]["value"] for q in by_block] for b in blocks})
    return world


def _law_and_effects(content: dict[str, Any]) -> tuple[dict[str, Any], dict[str, Any]]:
    """Base law and effects of a diagnosis: of its joint model, or in a file without one, of the verdict alone."""
    verdict, model = content["verdict"], _joint_model(content)
    if model:
        return model["base"], model["parameters"]
    if verdict in ("none", "unknown"):
        return content["base"], {}
    if content.get("beside"):  # a diagnosis without the key `model`
        return content["beside"][-1]["base"], content["beside"][-1]["parameters"]
    return content["effects"][verdict]["base"], {verdict: content["effects"][verdict]["parameters"]}


def _joint_model(content: dict[str, Any]) -> dict[str, Any] | None:
    """The joint model with its learnt changes; None if there is none. Its effects are the named ones: the verdict can
    be a rival of two of them."""
    model = content.get("model")
    return (model.get("learnt") or dict(model)) if model else None


def learnt_changes(content: dict[str, Any], world: World | None = None) -> list[KnownChange]:
    """The learnt changes of a diagnosis, for blocks and zones of a `world`, if its joint model is used."""
    return read_changes((_joint_model(content) or {}).get("changes", []), world)


def read_for_prediction(path: str | Path) -> dict[str, Any]:
    """Content of diagnosis.json, checked for what a prediction needs.

    Raises InputError if it cannot be used; warns if it has keys with old names."""
    document, read = read_fitted_diagnosis(path)
    if read.model is not None and read.model.learnt is not None:
        for i, change in enumerate(read.model.learnt.changes):
            _check_change(document, i, change)
    return read.content()


def setup_remarks(experiment: Experiment, content: dict[str, Any]) -> list[str]:
    """Warnings on how the set-up of an experiment differs from that of a diagnosis, as far as its file says, and what
    this means for a prediction."""
    ground, stated = experiment.cross_section, content.get("cross_section")
    differs = []
    if stated is not None:
        points, zones = np.array(stated["points_m"]), tuple(stated["zones"])
        if len(points) != len(ground.points_m):
            differs.append(f"its cross-section has {len(ground.points_m)} points, that of the diagnosis {len(points)}")
        elif (far := np.hypot(*(points - ground.points_m).T).max()) > SAME * np.ptp(points, axis=0).max():
            differs.append(f"a point of its cross-section lies {length(far)} elsewhere")
        if zones != ground.zones:
            differs.append(f"its zones are {', '.join(ground.zones)}, those of the diagnosis {', '.join(zones)}")
    known = content.get("blocks") or {}
    for name, block in experiment.blocks.items() if known else ():
        if name not in known:
            differs.append(f"the diagnosis has no block {name}")
            continue
        for key, unit in (("mass_kg", " kg"), ("size_m", " m"), ("shape", "")):
            old, new = known[name].get(key), getattr(block, key)
            if old is not None and (old != new if key == "shape" else abs(new - old) > SAME * old):
                new, old = (value if key == "shape" else f"{value:.4g}{unit}" for value in (new, old))
                differs.append(f"{key.partition('_')[0]} of block {name}: {new}, in the diagnosis {old}")
    gravity = content.get("gravity_m_s2")
    if gravity is not None and abs(experiment.gravity_m_s2 - gravity) > SAME * gravity:
        differs.append(f"gravity is {experiment.gravity_m_s2:g} m/s², in the diagnosis {gravity:g} m/s²")
    if not differs:
        return []
    learnt = "; the learnt changes hold for the set-up of the diagnosis only" if learnt_changes(content) else ""
    return [
        f"warning: not the set-up of the diagnosis: {'; '.join(differs)}",
        "warning: this set-up is simulated with the law and the effects of the diagnosis, which no film tested on it: "
        f"expect larger misses than the report states{learnt}",
    ]


def _check_change(document: Document, i: int, change: ChangeKeys) -> None:
    """Raise InputError for a learnt change whose coefficients do not fit its curves, or whose lever lacks its
    quantities."""

    def wrong(message: str, *place: str | int, **fields: Any) -> InputError:
        return document.error(message, "model", "learnt", "changes", i, *place, **fields)

    for k, curve in enumerate(change.curves):
        if curve.quantity not in LEVER_QUANTITIES[change.lever]:
            message = f"no quantity {key_shown(curve.quantity)}"
            raise wrong(message, "curves", k, "quantity", code="unknown_name", name=curve.quantity)
    if change.lever == PROFILE and [curve.kind for curve in change.curves] != [SPLINE]:
        raise wrong("a profile is a spline of the place", "curves")
    for k, curve in enumerate(change.curves):
        if curve.names is not None and (curve.quantity not in (BLOCK, ZONE) or len(curve.names) != len(curve.numbers)):
            raise wrong("names of blocks or zones, one for each number", "curves", k, "names")
        if curve.kind == SPLINE and (len(curve.numbers) < 2 or (np.diff(curve.numbers) <= 0.0).any()):
            raise wrong("breakpoints of a spline must rise", "curves")
    given = read_changes([change.model_dump()])[0]
    functions = given.basis.features({c.quantity: np.zeros(1) for c in change.curves} or {"": np.zeros(1)})
    widths = {len(row) for row in change.coefficients}
    if widths != {functions.shape[1]} or len(change.coefficients) not in LEVER_SIZES[change.lever]:
        raise wrong("coefficients do not fit the curves", "coefficients")


def predict(experiment: Experiment, content: dict[str, Any], *, base_only: bool = False) -> pd.DataFrame:
    """Motion predicted from each measured flight, at the camera's instants in its frame: `COLUMNS`.

    A segment runs from the end of one flight to the end of the next, or of the film; its rows are the recorded frames.
    Where the angle was not measured, zero spin is assumed, and theta_rad is NaN. The film is checked and segmented with
    the camera and the ground of the diagnosis. For an impact table, the velocities after each impact are predicted:
    `TABLE_COLUMNS`.

    Raises InputError for a film that cannot be read or shows no flight with a frame after it, and for a diagnosis
    without a fitted law."""
    import pandas as pd

    if not content["base"]:
        raise InputError(no_fitted_law(content.get("sanity", {}).get("faults", [])))
    if experiment.trajectories is None:
        return _predict_impacts(experiment, content, base_only)
    setup, film = setup_world(experiment), load_film(experiment)
    diagnosed = diagnosed_world(content, setup, setup.order, base_only=False)
    as_recorded = replace(setup, view=diagnosed.view, cross_section=diagnosed.cross_section)
    data = FilmSegments.of(film, _world_for_segmentation(experiment, film, as_recorded))
    order = _series_positions(content, film.block_names, film.release_block, data.order)
    if not np.isfinite(data.start_s).any():
        raise InputError("no block flies in this film: there is nothing to predict from", experiment.folder)
    data.order = order  # learnt changes depend on it, too
    segments = Segments.of(data)
    if not len(segments):
        message = "no block touches the ground after a flight in this film: there is nothing to predict"
        raise InputError(message, experiment.folder)
    world = diagnosed_world(content, setup, order[segments.release], base_only)
    poses = predicted_poses(data, segments, world, [] if base_only else learnt_changes(content, world))
    segment, frame, pose = as_rows(data, segments, poses)
    release = segments.release[segment]
    columns = (
        film.release_names[release], np.array(film.block_names)[segments.block[segment]], segments.number[segment],
        film.t_s[frame], *pose.T,
    )  # fmt: skip
    return pd.DataFrame(dict(zip(COLUMNS, columns, strict=True)))


def _series_positions(content: dict[str, Any], names: Sequence[str], block: Array, order: Array) -> Array:
    """(releases,) positions in the diagnosed series, for releases with this `block` and position `order` in their own
    series; both series are assumed to cover the same range."""
    series = content.get("series", {})
    lengths = np.bincount(block, minlength=len(names))
    known = np.array([series.get(name, n) for name, n in zip(names, lengths, strict=True)])
    return np.asarray((order + 0.5) / lengths[block] * known[block] - 0.5)


def _predict_impacts(experiment: Experiment, content: dict[str, Any], base_only: bool) -> pd.DataFrame:
    """Predicted velocities after the impacts of a table; rows without a state before the impact are left out."""
    assert experiment.impacts is not None
    given = experiment.impacts.dropna(subset=list(STATE_NAMES)).fillna(dict.fromkeys(AFTER_COLUMNS, 0.0))
    given = given.sort_values("release", kind="stable")
    data = TableData.of(replace(experiment, impacts=given))
    positions = _series_positions(content, list(experiment.blocks), data.release_block, data.order)
    data.impact_order = positions[data.impact_release]
    world = diagnosed_world(content, setup_world(experiment), data.impact_order, base_only)
    changes = [] if base_only else learnt_changes(content, world)
    known = data.impact_quantities(world).keys() | data.outcome_quantities(world).keys()
    for change in changes:
        rates = change.lever == OUTCOME and len(change.coefficients) == len(AFTER_COLUMNS)
        acts = rates or change.lever in (LAW, STATE, FRAME)
        if not acts or not {curve.quantity for curve in change.basis.curves} <= known:
            message = (
                f"the diagnosis learnt a change of a film ({change.name}), which a table of "
                "impacts does not show; predict with --base-only, or diagnose a table"
            )
            raise InputError(message, experiment.folder, code="wrong_kind")
    velocities = _velocities(data, world, changes)
    found = given[["release", "block"]].reset_index(drop=True)
    found["segment"] = found.groupby("release").cumcount()
    return found.assign(**dict(zip(AFTER_COLUMNS, velocities.T, strict=True)))[list(TABLE_COLUMNS)]


def _velocities(data: TableData, world: World, changes: Sequence[KnownChange]) -> Array:
    """(n, 3) velocities after the impacts in the image: vx, vy in m/s, omega in rad/s."""
    quantities = data.impact_quantities(world)
    shift = np.zeros((len(data.before), N_STATE))
    added = np.zeros_like(data.after)
    for change in changes:
        amount = change.of(quantities)
        if change.lever == LAW:
            world = with_changed_law(world, amount)
        elif change.lever == STATE:
            shift += amount
        elif change.lever == OUTCOME:
            added += amount
        elif change.lever == FRAME:
            shift[:, FRAME_COLUMNS] += amount
    along, across, spin = (data.residuals(world, shift).impacts + added).T
    tx, ty = data.tangent[:, X], data.tangent[:, Y]
    after = data.after + np.column_stack([tx * along - ty * across, ty * along + tx * across, spin])
    outcome = replace(data, after=after).outcome_quantities(world)  # of the prediction, not of the measurement
    return after - sum((change.of(outcome)[:, :-1] for change in changes if change.lever == FRAME), 0.0)


def _world_for_segmentation(experiment: Experiment, film: Film, world: World) -> World:
    """The world in which a film is segmented: that of the diagnosis, or if its camera is perfect, the one that the
    sanity checks find. Raises InputError for a film that cannot be read; warns of other faults."""
    view = world.view
    true = replace(film, t_s=film.t_s * view.time_scale, pose=view.true(film.pose))
    true.noise = film.noise / [*view.scales, 1.0]
    stated = replace(experiment, fps=experiment.fps / view.time_scale, cross_section=world.cross_section)
    checked = sanity.check_film(stated, true)
    for fault in checked.faults:
        if fault.code in UNREADABLE_FAULTS:
            raise InputError(fault.message, experiment.folder)
        if fault.code != sanity.FEW_RELEASES:
            warnings.warn(UnusualWarning(fault.message), stacklevel=3)
    return checked.registered if checked.registered is not None and view == View() else world
