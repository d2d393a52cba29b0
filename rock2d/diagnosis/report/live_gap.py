"""The live view of a diagnosis: a film compared with the model with chosen causes, as data for live_gap.js.

Each combination of causes is one of the fits of the budget: law and causes are fitted together, and each release is
predicted by the fit without it. Nothing is fitted here. The script only displays what is computed here."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from markupsafe import Markup

from rock2d.arrays import Array
from rock2d.diagnosis.budget import Share
from rock2d.diagnosis.checks import Check
from rock2d.diagnosis.cross_validation import Validated
from rock2d.diagnosis.data import FilmData
from rock2d.diagnosis.diagnose import Diagnosis
from rock2d.diagnosis.gap import CHANNELS, typical_size, zone_below
from rock2d.diagnosis.likelihood import standard_deviations
from rock2d.diagnosis.predicted_gap import end_misses, held_out_poses, measured, off
from rock2d.diagnosis.replay import Segments
from rock2d.diagnosis.report import report_data, text
from rock2d.diagnosis.report.figures import MISS_CLASSES
from rock2d.diagnosis.report.practical_indicators import Row
from rock2d.diagnosis.report.sections import LEARNT_ORIGIN, cause_name, learnt_name, p_text
from rock2d.diagnosis.residual_regression import FLIGHT_DEGREES, clipped
from rock2d.graphics.bar_charts import Axis, chart, share_mark
from rock2d.graphics.canvas import motion_limits
from rock2d.graphics.live_data import STEPS, compact, in_page, live_scene, packed, packed_columns
from rock2d.graphics.palette import block_colours
from rock2d.kinematics.impacts import ground_axes
from rock2d.records.columns import LINEAR_VELOCITY, OMEGA, POSITION, THETA, X
from rock2d.wording import listed, spoken

MOST_BYTES = 1_900_000  # size of the data in a page
MOST_NUMBERS = 2_000_000  # packed numbers of frames, of about two bytes each
OUTLINE_POINTS = 32
LEAST_SIZES = (0.0, *(least for least, _, _ in MISS_CLASSES[1:]), 4.0)  # residuals to choose from, in σ
LEARNT = "learnt"  # name of the learnt changes in the address
# the largest move of a block between shown frames, and the share of the frames in which it is kept
SHOWN_MOVE_RADII, FAST = 0.25, 0.9
WORST_SHARE = 0.25  # if not all releases are shown, share of those that the base law misses most
IMPACT, FLIGHT = range(2)
PHASES = ("impact", "flight")
IMPACT_UNITS = (("m/s", "mm"), ("m/s", "mm"), ("rad/s", "°"))
FLIGHT_UNITS = (("mm",), ("mm",), ("°",))
IN_UNIT = {"m/s": 1.0, "rad/s": 1.0, "mm": 1e3, "°": 180.0 / np.pi}


@dataclass(frozen=True)
class _Model:
    """A fit that the view can show.

    Attributes
    ----------
    causes : positions of its causes among the check boxes; the last box is for the learnt changes
    label, gap, share : name, gap, and share of the gap that it closes
    own : the fit with its residuals on held-out releases
    poses : (n, k, 3) of the segments of the film, each predicted by the fit without its release"""

    causes: Sequence[int]
    label: str
    gap: float
    share: Share | None
    own: Validated
    poses: Array


def live_gap(
    result: Diagnosis, content: Mapping[str, Any], passing: Sequence[Row], named: report_data.Models
) -> dict[str, Any] | None:
    """What live_gap.html.j2 shows of a diagnosed film; None if it has no impacts.

    `passing`: passing frequencies of the film and of the models in `named` (name -> model)"""
    data = result.data
    assert isinstance(data, FilmData)
    segments = Segments.of(data)
    if not len(segments):
        return None
    causes = sorted(text.model_causes(content), key=lambda cause: -cause["closes"])
    models = _models(result, data, segments, [cause["effect"] for cause in causes])
    items = Items.of(result, data, [model.own for model in models])
    blocks, zones = list(result.experiment.blocks), result.experiment.cross_section.zone_names
    checks = result.checks.all if result.checks is not None else []
    names = [cause["effect"] for cause in causes] + [LEARNT] * any(len(causes) in m.causes for m in models)
    known = {
        **_static_data(result, data), "causes": names, "models": [m.causes for m in models],
        "labels": [m.label for m in models], "channels": channel_words(items, len(blocks), len(zones)),
        "channel_names": [["all channels", *CHANNELS[phase]] for phase in PHASES],
        "phases": PHASES, "zones": list(map(spoken, zones)), "sizes": LEAST_SIZES, "classes": MISS_CLASSES,
        "checks": list(map(_check_data, checks)),
    }  # fmt: skip
    moving, notes = _moving_data(result, data, segments, models, items, MOST_BYTES - len(compact(known)))
    simulated = {k: name for k, m in enumerate(models) for name, model in named.items() if m.own.fit is model.fit}
    return {
        "data": in_page(known | moving), "causes": _cause_boxes(result, content, causes, names),
        "models": _model_words(models, data, segments, simulated, passing), "blocks": list(map(spoken, blocks)),
        "zones": list(map(spoken, zones)), "phases": [f"{phase}s" for phase in PHASES],
        "sizes": ["any size", *(f"{least:g} σ and more" for least in LEAST_SIZES[1:])],
        "checks": bool(checks), "notes": notes,
    }  # fmt: skip


# --- models -------------------------------------------------------------------------------------------


def _models(result: Diagnosis, data: FilmData, segments: Segments, causes: Sequence[str]) -> list[_Model]:
    """The base law, the known sets of causes, and the model with learnt changes."""
    found, budget = result.found, result.budget
    assert found is not None and budget is not None
    models = []
    for names in sorted(found.sets, key=lambda names: (len(names), *sorted(map(causes.index, names)))):
        own, (gap, share) = found.sets[names], budget.sets[names]
        at = sorted(map(causes.index, names))
        label = f"with {listed([causes[i] for i in at])}" if at else "base law"
        poses = held_out_poses(data, segments, own)
        models.append(_Model(at, label, gap, share if at else None, own, poses))
    if found.learnt.changes:
        label = "with all causes and what was learnt" if causes else "with what was learnt"
        poses = held_out_poses(data, segments, found.learnt)
        every = list(range(len(causes) + 1))
        models.append(_Model(every, label, budget.learnt, budget.closed, found.learnt, poses))
    return models


def _cause_boxes(
    result: Diagnosis, content: Mapping[str, Any], causes: Sequence[Mapping[str, Any]], names: Sequence[str]
) -> list[tuple[str, str, Markup, str]]:
    """(name, origin, bar, words) of each cause with the share that it closes: mean over all orders, as in the budget;
    alone; and after all others."""
    assert result.budget is not None
    sets, axis, found = result.budget.sets, Axis(0.0, 100.0), list[tuple[str, str, Markup, str]]()
    every = frozenset(cause["effect"] for cause in causes)

    def boxed(name: str, origin: str, part: Mapping[str, Any], said: str) -> None:
        own = text.share_closed(part["closes"], part["closes_ci95"])
        mark = share_mark("effect", part["closes"], part["closes_ci95"], f"{name}: {own}", "bar")
        found.append((name, origin, chart(axis, [mark]), own + said))

    for cause in causes:
        name, said = cause["effect"], ""
        if len(every) > 1:
            alone = sets[frozenset({name})][1].closes
            last = sets[every][1].closes - sets[every - {name}][1].closes
            said = f"; alone {round(100 * alone)} %, after all others {round(100 * last)} %".replace("-", "−")
        boxed(cause_name(cause), cause["origin"], cause, said)
    if LEARNT in names and (learnt := content["outside"]["learnt"]):
        said = "; fitted together with all causes" if causes else ""
        boxed(learnt_name(learnt), LEARNT_ORIGIN, learnt, said)
    return found


def _model_words(
    models: Sequence[_Model], data: FilmData, segments: Segments, passing: Mapping[int, str], rows: Sequence[Row]
) -> list[dict[str, Any]]:
    """For each model a sentence on its gap, the gap as a bar, misses (what, base law, this model) and passing
    frequencies (what, film, base law, this model). `passing`: position of a model -> its name in the `rows`."""
    film = measured(data, segments)
    places = ("place at the end of a segment", "angle at the end of a segment", "velocity after an impact")
    misses, words = [], []
    for model in models:
        speed = np.hypot(*model.own.held_out.residuals.impacts[:, -3:-1].T)
        mm, degrees = end_misses(segments, off(model.poses, film))
        velocity = float(np.median(speed[np.isfinite(speed)])) if np.isfinite(speed).any() else np.nan
        misses.append((f"{mm:.2g} mm", f"{degrees:.2g}°", f"{velocity:.2g} m/s"))
    axis = Axis(0.0, 100.0)
    for k, model in enumerate(models):
        passes = []
        for row in rows:
            shares = {name: f"{estimates[0].value:.0f} %" for name, estimates in row.models.items()}
            what, here = f"{spoken(row.place)}: {spoken(row.block)}", passing.get(k, "")
            passes.append((what, shares["measured"], shares["base"], shares.get(here, "not simulated")))
        said, bar = f"The typical residual is {model.gap:.2f} σ.", Markup("")
        if model.share is not None:
            closed = text.share_closed(model.share.closes, model.share.ci95)
            said = f"The typical residual falls from {models[0].gap:.2f} σ to {model.gap:.2f} σ: closed {closed}."
            label = f"{model.label} closes {closed}"
            bar = chart(axis, [share_mark("effect", model.share.closes, model.share.ci95, label, "bar")])
        own = list(zip(places, misses[0], misses[k], strict=True))
        words.append({"said": said, "bar": bar, "misses": own, "passing": passes})
    return words


# --- what is shown ------------------------------------------------------------------------------------


def _static_data(result: Diagnosis, data: FilmData) -> dict[str, Any]:
    """Data that do not change: ground, blocks, and flights as lines."""
    ground, blocks = result.experiment.cross_section, result.experiment.blocks
    colours = block_colours(blocks)
    flights = report_data.flight_lines(data, report_data.signs_of(result))
    ways = np.vstack([*flights, report_data.touch_places(result, data)])
    radius = max(block.radius_m for block in blocks.values())
    return {
        "limits": motion_limits(ground, ways[:, 0], ways[:, 1], radius),
        "blocks": [
            {"name": spoken(name), "colour": colours[name], "radius": block.radius_m, "inner": block.inradius_m,
             "outline": block.outline(OUTLINE_POINTS).round(6).tolist()}
            for name, block in blocks.items()
        ],
        "flights": [path.round(5).tolist() for path in flights], **live_scene(ground),
    }  # fmt: skip


def _moving_data(
    result: Diagnosis, data: FilmData, segments: Segments, models: Sequence[_Model], items: Items, room: int
) -> tuple[dict[str, Any], list[str]]:
    """Frames, impacts and flights of the releases that fit into `room` bytes, and notes on what was left out."""
    count, step = len(data.order), frame_step(result, data)
    share = min(MOST_NUMBERS * step / (len(data.film.t_s) * (4 + 3 * len(models))), 1.0)
    while True:
        shown = shown_releases(items, count, share)
        frames = frames_table(result, data, segments, [model.poses for model in models], shown)
        found = {"frames": frames, "items": items.table(shown[items.release]), "steps": STEPS}
        size = len(compact(found))
        if size <= room or shown.sum() == 1:
            break
        share = min(0.95 * room / size, 0.95) * share
    found["released"] = data.film.release_names.tolist()
    found["release_block"] = data.film.release_block.tolist()
    found["angles"] = data.film.angle_known.astype(int).tolist()
    notes = []
    if not shown.all():
        notes.append(
            f"The page holds {shown.sum()} of {count} releases: the first ones, and those that the base law misses "
            "most. The tables count all."
        )
    every = "every frame" if step == 1 else f"one frame of {step}, and the first and last of each segment"
    notes.append(f"Of each release {every} is shown.")
    return found, notes


def _check_data(check: Check) -> dict[str, Any]:
    """Data of a check."""
    low, _, high = check.replicates
    said = (
        f"{check.name} ({spoken(check.largest)}): this film {check.value:.2f}; 90 % of the replicates are from "
        f"{low:.2f} to {high:.2f} (p {p_text(check.p)})."
    )
    verdict = "The model would hardly produce this." if check.fails else "The model would produce this."
    return {
        "name": check.name, "value": check.value, "fails": check.fails, "said": f"{said} {verdict}",
        "percentiles": [float(f"{v:.4g}") for v in check.percentiles],
    }  # fmt: skip


# --- impacts, flights and frames ------------------------------------------------------------------------


@dataclass
class Items:
    """The n impacts and flights of a film, impacts first, and their residuals in each of k models.

    Attributes
    ----------
    phase, release, block, zone : (n,) indices
    t_s, until_s : (n,) time since the beginning of the release: for an impact the end of the previous and the beginning
        of the next flight; for a flight its middle
    place_m : (n, 2) position of the centroid
    incident, outgoing : (n, 3) measured velocities of impacts along and across the ground, and spin; else NaN
    squares : (k, n, 3, c) squares of the residuals of the three channels, in standard deviations, clipped
    misses : (k, n, 3, 2) residuals of the channels in SI: of impacts rates and poses; of flights their bend, root mean
        square over frames, and NaN"""

    phase: Array
    release: Array
    block: Array
    zone: Array
    t_s: Array
    until_s: Array
    place_m: Array
    incident: Array
    outgoing: Array
    squares: Array
    misses: Array

    def __len__(self) -> int:
        return len(self.phase)

    @property
    def sigma(self) -> Array:
        """(k, n) root mean square of the residuals over the channels, in standard deviations."""
        return np.asarray(np.sqrt(self.squares.mean(axis=(2, 3))))

    @classmethod
    def of(cls, result: Diagnosis, data: FilmData, models: Sequence[Validated]) -> Items:
        """All impacts and flights, with residuals on held-out releases."""
        found, impacts, flights = result.found, data.impacts, data.flights
        assert found is not None
        setup, film, middle = report_data.corrected_setup(result), data.film, flights.middle
        began = film.t_s[np.searchsorted(film.release, np.arange(len(data.order)))]
        ends = film.t_s[flights.last[impacts.before] - 1]
        velocities = [
            np.column_stack([*ground_axes(impacts.tangent, own[:, LINEAR_VELOCITY]), own[:, OMEGA]])
            for own in report_data.states_around(result, data)
        ]
        aloft = data.states(setup).middle
        fitted = found.final.fit.model.world(found.final.fit.p, data.impact_order)
        below = zone_below(result.experiment.cross_section, data.states(fitted).middle[:, X])
        middles = middle - began[flights.release]
        after_s = middle[impacts.after] + impacts.begin_s - began[impacts.release]
        none = np.full((len(flights), 3), np.nan)
        squares, misses = zip(*(_squares_and_misses(result, data, own) for own in models), strict=True)
        return cls(
            np.repeat([IMPACT, FLIGHT], [len(impacts), len(flights)]),
            np.concatenate([impacts.release, flights.release]), np.concatenate([impacts.block, flights.block]),
            np.concatenate([impacts.zone, below]),
            np.concatenate([ends - began[impacts.release], middles]), np.concatenate([after_s, middles]),
            np.concatenate([report_data.touch_places(result, data), aloft[:, POSITION]]),
            np.concatenate([velocities[0], none]), np.concatenate([velocities[1], none]),
            np.array(squares), np.array(misses),
        )  # fmt: skip

    def channels(self, phase: int, block: int | None, zone: int | None) -> tuple[int, list[list[str]]]:
        """Number of the impacts or flights of a block in a zone (None: all); and in words for each model, for all
        channels together and then each channel: typical residual, with the median misses of the channel."""
        own = self.phase == phase
        own &= (block is None or self.block == block) & (zone is None or self.zone == zone)
        units = (IMPACT_UNITS, FLIGHT_UNITS)[phase]
        if not own.any():
            return 0, [["-"] * len(self.squares)] * (1 + len(units))
        together = [f"{typical_size(squares[own].reshape(own.sum(), -1)):.1f} σ" for squares in self.squares]
        each = [
            [
                f"{typical_size(squares[own, c]):.1f} σ ({_median_words(misses[own, c], of)})"
                for squares, misses in zip(self.squares, self.misses, strict=True)
            ]
            for c, of in enumerate(units)
        ]
        return int(own.sum()), [together, *each]

    def table(self, keep: Array) -> dict[str, Any]:
        """Rows of the items in the mask `keep` (n,), as 32-bit numbers column by column: measured values; then for each
        model the size of the residual in σ, the misses in mm and degrees, and the predicted velocities."""
        measured = [self.release, self.block, self.zone, self.phase, self.t_s, self.until_s, *self.place_m.T]
        columns = [*measured, *self.incident.T, *self.outgoing.T]
        shown = [IN_UNIT["mm"], IN_UNIT["mm"], IN_UNIT["°"]]
        for sigma, misses in zip(self.sigma, self.misses, strict=True):
            poses = np.where((self.phase == IMPACT)[:, None], misses[..., 1], misses[..., 0]) * shown
            columns += [sigma, *poses.T, *(self.outgoing + misses[..., 0]).T]
        raw = np.array(columns)[:, keep].astype("<f4").tobytes()
        return {"rows": packed(raw), "count": int(keep.sum()), "measured": len(measured)}


def _median_words(misses: Array, units: Sequence[str]) -> str:
    """Medians of misses (n, 2) in their units."""
    sizes = [np.abs(own[np.isfinite(own)]) * IN_UNIT[unit] for own, unit in zip(misses.T, units, strict=False)]
    said = [f"{np.median(own):.2g}" if len(own) else "-" for own in sizes]
    return ", ".join(f"{value} {unit}".replace(" °", "°") for value, unit in zip(said, units, strict=True))


def _squares_and_misses(result: Diagnosis, data: FilmData, own: Validated) -> tuple[Array, Array]:
    """`squares` and `misses` of a model."""
    assert result.found is not None
    residuals = own.held_out.residuals
    z = clipped(residuals.impacts / standard_deviations(result.found.final.fit.covariance()))
    flights = residuals.flights[: data.flown, :, :FLIGHT_DEGREES]
    poses, rates = residuals.impacts.reshape(-1, 2, 3).swapaxes(0, 1)
    bend = np.sqrt((flights**2).sum(axis=2))
    bend *= data.film.long_noise * data.flights.level[:, None]
    squares = np.concatenate([z.reshape(-1, 2, 3).swapaxes(1, 2) ** 2, clipped(flights) ** 2])
    misses = np.stack([rates, poses], axis=2), np.stack([bend, np.full_like(bend, np.nan)], axis=2)
    return squares, np.concatenate(misses)


def channel_words(items: Items, blocks: int, zones: int) -> list[list[list[Any]]]:
    """`Items.channels` of both phases for all blocks, then each block; for all zones, then each zone."""
    return [
        [[items.channels(phase, b, z) for phase in (IMPACT, FLIGHT)] for z in (None, *range(zones))]
        for b in (None, *range(blocks))
    ]


def shown_releases(items: Items, count: int, share: float) -> Array:
    """(count,) mask of a share of the releases: those that the base law misses most, and the first ones."""
    if share >= 1.0:
        return np.ones(count, bool)
    most = max(int(share * count), 1)
    size = np.zeros(count)
    np.maximum.at(size, items.release, items.sigma[0])
    worst = np.argsort(-size, kind="stable")[: math.ceil(WORST_SHARE * most)]
    others = np.setdiff1d(np.arange(count), worst)[: most - len(worst)]
    shown = np.zeros(count, bool)
    shown[worst] = shown[others] = True
    return shown


def frames_table(
    result: Diagnosis, data: FilmData, segments: Segments, poses: Sequence[Array], shown: Array
) -> dict[str, Any]:
    """Frames of the `shown` releases (releases,): instant and measured pose, and for each model how far the predicted
    pose is off; 0 outside the segments. The first and the last frame of each segment are always included."""
    film, signs, models = data.film, np.array(report_data.signs_of(result)), len(poses)
    misses, segment = np.zeros((len(film.t_s), models, 3)), np.full(len(film.t_s), -1)
    kept = np.zeros(len(film.t_s), bool)
    first = np.searchsorted(film.release, np.arange(len(data.order)))
    step = frame_step(result, data)
    kept[(np.arange(len(kept)) - first[film.release]) % step == 0] = True
    for i, rows in enumerate(segments.frames):
        segment[rows] = i
        kept[rows[[0, -1]]] = True
        for m, own in enumerate(poses):
            misses[rows, m] = np.nan_to_num(off(own[i, : len(rows)], film.pose[rows]))
    misses *= signs
    misses[~film.angle_known[film.release], :, THETA] = 0.0
    kept &= shown[film.release]
    own = np.flatnonzero(kept)
    values = np.column_stack(
        [film.t_s[own] - film.t_s[first[film.release[own]]], film.pose[own] * signs, misses[own].reshape(len(own), -1)]
    )
    raw, scales = packed_columns(values)
    releases, counts = np.unique(film.release[own], return_counts=True)
    runs = np.flatnonzero(np.diff(segment[own], prepend=-2, append=-2) != 0)
    return {
        "rows": packed(raw), "scales": scales, "counts": counts.tolist(), "release": releases.tolist(),
        "segments": [[int(a), int(b)] for a, b in pairwise(runs) if segment[own[a]] >= 0],
    }  # fmt: skip


def frame_step(result: Diagnosis, data: FilmData) -> int:
    """Number k if every k-th frame is shown."""
    film = data.film
    same = np.diff(film.release) == 0
    moved = np.hypot(*np.diff(film.pose[:, :2], axis=0)[same].T)
    radii = np.array([block.radius_m for block in result.experiment.blocks.values()])
    moved /= radii[film.release_block[film.release[1:][same]]]
    return max(int(SHOWN_MOVE_RADII / max(float(np.quantile(moved, FAST)), 1e-6)), 1)
