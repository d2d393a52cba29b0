"""The report of a diagnosis: an HTML page that needs no network, and a video."""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from rock2d.diagnosis.checks import REPLICATES
from rock2d.diagnosis.data import FilmData
from rock2d.diagnosis.diagnose import Diagnosis
from rock2d.diagnosis.diagnosis_content import reported_effect
from rock2d.diagnosis.gap import SIGNIFICANT_CELL_Z
from rock2d.diagnosis.replay import measured_releases, simulated_releases
from rock2d.diagnosis.report import report_data, text
from rock2d.diagnosis.report.figures import (
    described,
    impact_alt,
    impact_figure,
    learnt_figure,
    section_alt,
    section_figure,
)
from rock2d.diagnosis.report.live_gap import live_gap
from rock2d.diagnosis.report.parameters import parameters_section
from rock2d.diagnosis.report.practical_indicators import (
    PASSING,
    Quantity,
    Row,
    film_quantities,
    measure_lines,
    quantity_data,
    table_quantities,
)
from rock2d.diagnosis.report.sections import budget_section, checks_section, limits_section
from rock2d.diagnosis.report.side_by_side import video_section
from rock2d.diagnosis.report.what_to_do import what_to_do
from rock2d.diagnosis.workload import REPORT
from rock2d.effects import catalogue
from rock2d.errors import counted
from rock2d.files.experiment import kind_and_table
from rock2d.files.folders import write_whole
from rock2d.graphics.bar_charts import SHAPES, Axis, Mark, axis_over, bar, chart, share_mark, tick_labels
from rock2d.graphics.live_data import live_assets
from rock2d.graphics.pages import download, embedded
from rock2d.graphics.rendering import Made, rendered
from rock2d.progress import Bars
from rock2d.wording import interval, length, listed, number, percent, plus_minus, spoken

Progress = Callable[[str], None]

PAGE = "report.html"
FOLDED_PROBABILITY = 0.005  # names with a smaller probability are folded away
SHOWN_CELLS = 8  # shown places; the others are folded away
MOST_REPORTED_FRAMES = 150_000  # frames of the film for the practical indicators
MOST_REPORTED_RELEASES = 4_000  # simulated releases for the practical indicators
PARTS = 5  # steps of the progress bar for the page of a film
LINEAR_GAIN = 10.0  # log likelihood up to which the scale of gains is linear


def write_report(
    result: Diagnosis, content: dict[str, Any], folder: Path, *, bars: Bars, command: str = "rock2d.diagnose in Python"
) -> None:
    """Write report.html and, where there is a film, the video into an existing `folder`.

    `content`: that of diagnosis.json; `command`: command line that the page shows."""
    made = Made.now(command, f"{result.seed} (of the bootstrap intervals)")
    context: dict[str, Any] = {"content": content, "sanity": content["sanity"], "made": made, "live": None}
    context |= live_assets("live_gap") | {"replicates": REPLICATES}
    with bars.stage(REPORT, PARTS, "parts") as bar:
        models = report_data.compared_models(result) if result.found is not None else {}
        effect = models.get("effect")
        chain = [e.name for e in effect.fit.model.effects] if effect is not None else []
        context |= _verdict_section(result, content, chain)
        context |= budget_section(content) | checks_section(result.checks)
        if models:
            context |= _sections(result, content, models, chain, folder, bar.step)
            context["key_figures"] += context["passing_tile"]
        write_whole(folder / PAGE, rendered("rock2d.diagnosis.report", "page.html.j2", context))
        bar.step("page")


def _verdict_section(result: Diagnosis, content: dict[str, Any], chain: list[str]) -> dict[str, Any]:
    name, sentence = text.verdict_sentence(content)
    diagnosed = result.found is not None
    kind = content["verdict"] if content["verdict"] in ("none", "unknown") else "effect"
    return {
        "verdict": name, "sentence": sentence, "kind": kind if diagnosed else "faults", "diagnosed": diagnosed,
        "key_figures": text.key_figures(content, chain) if diagnosed else [],
        "material": _counts_sentence(result), "advice": what_to_do(content, result.experiment),
    }  # fmt: skip


def _counts_sentence(result: Diagnosis) -> str:
    """Numbers of releases, impacts and flights that were diagnosed."""
    experiment, (_, table) = result.experiment, kind_and_table(result.experiment)
    counts = table.groupby("block")["release"].nunique()
    blocks = ", ".join(f"{counts[name]} {spoken(name)}" for name in experiment.blocks if name in counts)
    material = f"{counted(table['release'].nunique(), 'release')} ({blocks})"
    if result.data is not None:
        material += f", {counted(len(result.data.impact_release), 'impact')}"
    if isinstance(result.data, FilmData):
        material += f", {counted(len(result.data.flights), 'flight')}"
    filmed = f", filmed at {experiment.fps:g} frames/s" if experiment.trajectories is not None else ""
    return material + filmed


def _sections(
    result: Diagnosis,
    content: dict[str, Any],
    models: report_data.Models,
    chain: list[str],
    folder: Path,
    on_progress: Progress,
) -> dict[str, Any]:
    """All sections below the verdict."""
    assert result.found is not None and result.data is not None
    labels = {"measured": "measured", "base": "base law", "effect": f"with {listed(chain)}"}
    context = {
        "labels": labels, "chain": chain, "models": list(models), "shapes": SHAPES,
        "marks": [(labels[model], model) for model in ("measured", *models)],
        "impacts": [], "video": "", "repetitions": 0, "line_note": "", "passing_tile": [], "practice": [],
        "assumptions": text.assumptions(result, content, chain), **_where_section(result, content, models),
    }  # fmt: skip
    context["learnt"] = [
        {"name": described(change), "image": embedded(learnt_figure(result, change), "svg"),
         "gain": plus_minus(change.total, change.error)}
        for change in result.found.learnt.changes
    ]  # fmt: skip
    on_progress("where")
    context |= _which_section(content) | _gap_section(content, chain or [reported_effect(result.found)])
    context |= parameters_section(result, content, models) | limits_section(content, result.setup)
    if not len(result.data.impact_release):
        return context
    if isinstance(result.data, FilmData):
        context |= _film_section(result, content, result.data, models, labels, folder, on_progress)
    else:
        residuals = {name: model.held_out.residuals.impacts for name, model in models.items()}
        quantities = table_quantities(result.experiment, result.data, residuals)
        context |= {"practice": [_practice_chart(q, labels) for q in quantities]}
    return context


# --- sections -----------------------------------------------------------------------------------------


def _where_section(result: Diagnosis, content: dict[str, Any], models: report_data.Models) -> dict[str, Any]:
    experiment = result.experiment
    shares: dict[str, float] = {}
    shown_cells = [cell for cell in content["where"] if cell["z"] >= SIGNIFICANT_CELL_Z]
    for cell in content["where"] if shown_cells and content["verdict"] != "none" else []:
        shares[cell["zone"]] = shares.get(cell["zone"], 0.0) + cell["share"]
    flights = []
    if isinstance(result.data, FilmData):
        flights = report_data.flight_lines(result.data, report_data.signs_of(result))
    misses = report_data.impact_misses(result, models["base"].held_out)
    parts = (experiment.cross_section, experiment.blocks, flights, misses, shares)
    blocks, keys = list(experiment.blocks), ("share", "z", "phase", "zone", "block", "channel")
    impacts = [
        (blocks[b], *place, sigma) for b, place, sigma in zip(misses.block, misses.place_m, misses.sigma, strict=True)
    ]
    points = [(i, *place) for i, path in enumerate(flights) for place in path]
    return {
        "section": embedded(section_figure(*parts), "svg"),
        "narrow_section": embedded(section_figure(*parts, narrow=True), "svg"),
        "section_alt": section_alt(misses, len(flights), shares),
        "section_data": download("impacts.csv", ("block", "x_m", "y_m", "residual_sigma"), impacts),
        "flights_data": download("flights.csv", ("flight", "x_m", "y_m"), points) if flights else None,
        "where_sentence": text.where_sentence(content),
        "cells": shown_cells if shares else [], "few_cells": SHOWN_CELLS,
        "where_data": download("where.csv", keys, [[cell[key] for key in keys] for cell in content["where"]]),
    }  # fmt: skip


def _which_section(content: dict[str, Any]) -> dict[str, Any]:
    chances = sorted(content["probabilities"].items(), key=lambda item: -item[1])
    axis = Axis(0.0, 1.0)
    bars = [(spoken(name), chart(axis, [bar("plain", p, f"{spoken(name)}: {percent(p)}")]), p) for name, p in chances]
    effects = catalogue()
    gains = [(name, e["heldout_score_gain"], e["heldout_score_gain_se"]) for name, e in content["effects"].items()]
    columns = ("effect", "heldout_score_gain", "heldout_score_gain_se")
    ends = [gain + s * 1.96 * error for _, gain, error in gains for s in (-1, 1)]
    low, high = min([*ends, 0.0]), max([*ends, LINEAR_GAIN])
    gain_axis = Axis(low - 0.1 * abs(low) - 1.0, 1.1 * high, LINEAR_GAIN)
    forest = []
    for name, gain, error in sorted(gains, key=lambda own: -own[1]):
        half, shown = 1.96 * error, plus_minus(gain, error)
        mark = Mark("plain", gain, gain - half, gain + half, f"{spoken(name)}: {shown}")
        forest.append({
            "name": name, "strip": chart(gain_axis, [mark]), "gain": shown,
            "summary": effects[name].summary if name in effects else "",
        })  # fmt: skip
    return {
        "bars": [(name, strip, percent(p)) for name, strip, p in bars if p >= FOLDED_PROBABILITY],
        "folded": [(name, strip, f"{100 * p:.2g} %") for name, strip, p in bars if p < FOLDED_PROBABILITY],
        "chances_data": download("probabilities.csv", ("answer", "probability"), chances),
        "forest": forest, "gain_scale": tick_labels(gain_axis), "gains_data": download("gains.csv", columns, gains),
        "group": content["group"], "unseen": text.unseen_words(content), "next_release": content["next_release"],
    }  # fmt: skip


def _gap_section(content: dict[str, Any], chain: list[str]) -> dict[str, Any]:
    gap, effects = content["gap"], catalogue()
    base, augmented, floor = gap["base"], gap["augmented"], gap["noise_floor"]
    low, high = (base - share * (base - floor) for share in reversed(gap["closure_ci95"]))
    axis = axis_over([base, augmented, floor, low, high])
    bars = (
        ("base law", bar("base", base, f"base law: {base:.2f}")),
        (f"with {text.best_model(content, chain)}",
         Mark("effect", augmented, low, high, f"with it: {augmented:.2f}", "bar")),
        ("noise floor", bar("measured", floor, f"noise floor: {floor:.2f}")),
    )  # fmt: skip
    open_gap = any(gap["closure_ci95"])
    closures = [(name, e["closure"], e["closure_ci95"]) for name, e in content["effects"].items()]
    ranked = [name for name in text.ranking(content) if not effects[name].scatter][:5] if open_gap else []
    marks = {name: share_mark("plain", share, ci95, text.share_closed(share, ci95)) for name, share, ci95 in closures}
    closure_axis = axis_over([v for n in ranked for v in (marks[n].value, marks[n].low, marks[n].high)] + [100.0])
    bounds, keys = ("closure_low95", "closure_high95"), ("base", "augmented", "noise_floor", "closure")
    numbers = [*(gap[key] for key in keys), *gap["closure_ci95"]]
    return {
        "gap_data": download("gap.csv", (*keys, *bounds), [numbers]),
        "closures_data": download(
            "closures.csv", ("effect", "closure", *bounds), [(name, own, *ci95) for name, own, ci95 in closures]
        ),
        "gap_rows": [(label, chart(axis, [mark]), f"{mark.value:.2f}") for label, mark in bars],
        "gap_scale": tick_labels(axis),
        "gap_unit": gap["unit"],
        "nothing_left": open_gap and abs(augmented - floor) < 1e-9 * abs(base),
        "whisker": low < high,
        "spreads": content["verdict"] in effects and effects[content["verdict"]].scatter,
        "closure_text": text.share_closed(gap["closure"], gap["closure_ci95"]),
        "closures": [(spoken(name), chart(closure_axis, [marks[name]]), marks[name].label) for name in ranked],
        "closure_scale": tick_labels(closure_axis),
    }


def _film_section(
    result: Diagnosis, content: dict[str, Any], data: FilmData, models: report_data.Models, labels: Mapping[str, str],
    folder: Path, on_progress: Progress,
) -> dict[str, Any]:  # fmt: skip
    """Sections of a film: whole releases simulated again, single impacts, the video."""
    signs, experiment = report_data.signs_of(result), result.experiment
    film = measured_releases(data, signs, MOST_REPORTED_FRAMES)
    repetitions = int(np.clip(MOST_REPORTED_RELEASES // len(film), 1, 8))
    drawn = {"measured": film.pose[None]}
    plain = {}
    for name, model in models.items():
        plain[name] = simulated_releases(data, model.fit, film, signs)
        drawn[name] = simulated_releases(data, model.fit, film, signs, repetitions=repetitions)
    top = float(np.nanmax(film.pose[..., 1]))
    lines, line_note = measure_lines(experiment, top)
    on_progress("which")
    quantities = film_quantities(experiment, film, drawn, lines)
    improves = content["verdict"] not in ("none", "unknown")
    impacts = report_data.shown_impacts(result, models, improves)
    on_progress("practice")
    apart = {name: float(np.median(report_data.distances(film, poses))) for name, poses in plain.items()}
    passing = [row for q in quantities if q.title == PASSING for row in q.rows]
    context = {
        "practice": [_practice_chart(q, labels) for q in quantities],
        "passing_tile": _passing_tile(passing, labels) if improves else [],
        "live": live_gap(result, content, passing, models),
        "line_note": line_note, "repetitions": repetitions, "improves": improves, "releases": len(film),
        "impacts": [
            {"image": embedded(impact_figure(experiment.cross_section, own), "svg"), "alt": impact_alt(own, labels),
             "data": download(f"impact_{i}.csv", ("series", "t_s", "x_m", "y_m", "theta_rad"), own.rows(labels))}
            for i, own in enumerate(impacts, 1)
        ],
        "apart": {name: length(v) for name, v in apart.items()},
    }  # fmt: skip
    on_progress("impacts")
    return context | video_section(result, film, plain, labels, improves, folder)


def _passing_tile(rows: Sequence[Row], labels: Mapping[str, str]) -> list[text.Tile]:
    """The passing frequency with the largest error of the base law, in the film and of the models, in %."""
    if not rows:
        return []
    row = max(rows, key=lambda r: abs(r.models["base"][0].value - r.models["measured"][0].value))
    words = [f"{own[0].value:.0f} % {labels[model]}" for model, own in row.models.items()]
    return [(PASSING, ", ".join(words), f"{spoken(row.block)} at {spoken(row.place)}")]


def _practice_chart(quantity: Quantity, labels: Mapping[str, str]) -> dict[str, Any]:
    """A quantity as bar charts, one row for each block and place, and as a table of numbers."""
    estimates = [e for row in quantity.rows for own in row.models.values() for e in own]
    axis = axis_over([e.value for e in estimates]) if quantity.percentiles else Axis(0.0, 100.0)
    rows, table, named_blocks = [], [], set()
    for row in quantity.rows:
        label = " · ".join(spoken(part) for part in (row.block, row.place) if part)
        short = spoken(row.place or row.block)
        marks = []
        for model, own in row.models.items():
            if not own:
                continue
            words = ", ".join(f"{number(e.value)} ({interval(e.low, e.high)})" for e in own)
            tip = f"{label}, {labels[model]}: {words} {quantity.unit}"
            if quantity.percentiles:
                marks.append(Mark(model, own[1].value, own[0].value, own[2].value, tip, "span"))
            else:
                marks.append(Mark(model, own[0].value, own[0].low, own[0].high, tip))
            numbers = [(number(e.value), interval(e.low, e.high)) for e in own]
            table.append((label, labels[model], numbers, own[0].count))
        if marks:
            head = spoken(row.block) if row.place and row.block not in named_blocks else ""
            named_blocks.add(row.block)
            rows.append((head, short, chart(axis, marks)))
    return {
        "title": quantity.title, "unit": quantity.unit, "rows": rows, "scale": tick_labels(axis), "table": table,
        "percentiles": [f"{p:g} %" for p in quantity.percentiles],
        "data": quantity_data(quantity, labels),
    }  # fmt: skip
