"""The live view of a diagnosis: a film compared with the model with chosen causes, as data for live_gap.js.

Each combination of causes is one of the fits of the budget: law and causes are fitted together, and each release is
predicted by the fit without it. Nothing is fitted here. The script only displays what is computed here.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from markupsafe import Markup

from rock2d.diagnosis.budget import Share
from rock2d.diagnosis.checks import REPLICATES, Check
from rock2d.diagnosis.cross_validation import Validated
from rock2d.diagnosis.data import FilmData
from rock2d.diagnosis.diagnose import Diagnosis
from rock2d.diagnosis.fitting import Fit
from rock2d.diagnosis.gap import CHANNELS
from rock2d.diagnosis.predicted_gap import end_misses, held_out_poses, measured
from rock2d.diagnosis.replay import Segments
from rock2d.diagnosis.report import tables, text
from rock2d.diagnosis.report.figures import MISS_CLASSES
from rock2d.diagnosis.report.live_items import (
    PHASES,
    Items,
    channel_words,
    frame_step,
    frames_table,
    shown_releases,
)
from rock2d.diagnosis.report.practical_indicators import Row
from rock2d.diagnosis.report.sections import cause_name, p_text
from rock2d.graphics.bar_charts import Axis, Mark, chart
from rock2d.graphics.canvas import motion_limits
from rock2d.graphics.live_data import STEPS, compact, in_page, live_scene
from rock2d.graphics.palette import block_colours
from rock2d.wording import listed, spoken

Array = np.ndarray

MOST_BYTES = 1_900_000  # size of the data in a page
MOST_NUMBERS = 2_000_000  # packed numbers of frames, of about two bytes each
OUTLINE_POINTS = 32
LEAST_SIZES = (0.0, *(least for least, _, _ in MISS_CLASSES[1:]), 4.0)  # residuals to choose from, in σ
LEARNT = "learnt"  # name of the learnt changes in the address


@dataclass(frozen=True)
class ModelWords:
    """A model in words: its name, a sentence on its gap, the gap as a bar, misses (what, base law, this model) and
    passing frequencies (what, film, base law, this model)."""

    label: str
    said: str
    bar: Markup
    misses: Sequence[tuple[str, str, str]]
    passing: Sequence[tuple[str, str, str, str]]


@dataclass(frozen=True)
class LiveGap:
    """What the template live_gap.html.j2 shows.

    Attributes
    ----------
    data : JSON that holds no "<"
    causes : for each check box: name, origin, share that it closes as a bar and in words
    models : every computed combination, the base law first
    blocks, zones, phases, sizes : options to choose from
    checks : whether there are checks
    notes : sentences on what was left out
    """

    data: str
    causes: Sequence[tuple[str, str, Markup, str]]
    models: Sequence[ModelWords]
    blocks: Sequence[str]
    zones: Sequence[str]
    phases: Sequence[str]
    sizes: Sequence[str]
    checks: bool
    notes: Sequence[str]


@dataclass(frozen=True)
class _Model:
    """A fit that the view can show.

    Attributes
    ----------
    causes : positions of its causes among the check boxes; the last box is for the learnt changes
    label, gap, share : name, gap, and share of the gap that it closes
    own : the fit with its residuals on held-out releases
    poses : (n, k, 3) of the segments of the film, each predicted by the fit without its release
    """

    causes: Sequence[int]
    label: str
    gap: float
    share: Share | None
    own: Validated
    poses: Array


def live_gap(
    result: Diagnosis, content: Mapping[str, Any], passing: Sequence[Row], named: Mapping[str, Fit]
) -> LiveGap | None:
    """The live view of a diagnosed film; None if it has no impacts.

    `passing`: passing frequencies of the film and of the models in `named` (name -> fit)
    """
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
    simulated = {k: name for k, m in enumerate(models) for name, fit in named.items() if m.own.fit is fit}
    return LiveGap(
        in_page(known | moving), _cause_boxes(result, content, causes, names),
        _model_words(models, data, segments, simulated, passing), list(map(spoken, blocks)),
        list(map(spoken, zones)), [f"{phase}s" for phase in PHASES],
        ["any size", *(f"{least:g} σ and more" for least in LEAST_SIZES[1:])], bool(checks), notes,
    )  # fmt: skip


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
    """Each cause with the share that it closes: mean over all orders, as in the budget; alone; and after all others."""
    assert result.budget is not None
    sets, axis, found = result.budget.sets, Axis(0.0, 100.0), list[tuple[str, str, Markup, str]]()
    every = frozenset(cause["effect"] for cause in causes)

    def boxed(name: str, origin: str, share: float, ci95: Sequence[float], said: str) -> None:
        low, high = (100.0 * float(v) for v in ci95)
        own = text.share_closed(share, ci95)
        mark = Mark("effect", 100.0 * share, low, high, f"{name}: {own}", "bar")
        found.append((name, origin, chart(axis, [mark]), own + said))

    for cause in causes:
        name, said = cause["effect"], ""
        if len(every) > 1:
            alone, last = (
                sets[frozenset({name})][1].closes,
                sets[every][1].closes - sets[every - {name}][1].closes,
            )
            said = f"; alone {round(100 * alone)} %, after all others {round(100 * last)} %".replace("-", "−")
        boxed(cause_name(cause), cause["origin"], cause["closes"], cause["closes_ci95"], said)
    if LEARNT in names and (learnt := content["outside"]["learnt"]):
        beside = f", with {listed(learnt['effects'])} (not certain)" if learnt["effects"] else ""
        said = "; fitted together with all causes" if causes else ""
        boxed(
            f"learnt: {listed(learnt['changes'])}{beside}",
            "learnt from the film",
            learnt["closes"],
            learnt["closes_ci95"],
            said,
        )
    return found


def _model_words(
    models: Sequence[_Model],
    data: FilmData,
    segments: Segments,
    passing: Mapping[int, str],
    rows: Sequence[Row],
) -> list[ModelWords]:
    """Gap and misses of every model; `passing`: position of a model -> its name in the `rows`."""
    film = measured(data, segments)
    places = ("place at the end of a segment", "angle at the end of a segment", "velocity after an impact")
    misses, words = [], []
    for model in models:
        speed = np.hypot(*model.own.held_out.residuals.impacts[:, -3:-1].T)
        mm, degrees = end_misses(segments, model.poses - film)
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
            value, low, high = (100.0 * v for v in (model.share.closes, *model.share.ci95))
            said = f"The typical residual falls from {models[0].gap:.2f} σ to {model.gap:.2f} σ: closed {closed}."
            bar = chart(axis, [Mark("effect", value, low, high, f"{model.label} closes {closed}", "bar")])
        own = list(zip(places, misses[0], misses[k], strict=True))
        words.append(ModelWords(model.label, said, bar, own, passes))
    return words


# --- what is shown ------------------------------------------------------------------------------------


def _static_data(result: Diagnosis, data: FilmData) -> dict[str, Any]:
    """Data that do not change: ground, blocks, and flights as lines."""
    ground, blocks = result.experiment.cross_section, result.experiment.blocks
    colours = block_colours(blocks)
    flights = tables.flight_paths(data, tables.signs_of(result))
    ways = np.vstack([*flights, tables.touch_places(result, data)])
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
    """Data of a check, with its rank among the replicates."""
    low, _, high = check.replicates
    far = round(check.p * (1 + REPLICATES)) - 1  # p counts the film itself
    said = (
        f"{check.name} ({spoken(check.largest)}): this film {check.value:.2f}; 90 % of the replicates are from "
        f"{low:.2f} to {high:.2f}, {far} of {REPLICATES} are as far out (p {p_text(check.p)})."
    )
    verdict = "The model would hardly produce this." if check.fails else "The model would produce this."
    return {
        "name": check.name, "value": check.value, "fails": check.fails, "said": f"{said} {verdict}",
        "percentiles": [float(f"{v:.4g}") for v in check.percentiles],
    }  # fmt: skip
