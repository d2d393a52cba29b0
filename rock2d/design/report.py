"""The report of a site, one page to hand in: assumptions, results, their uncertainty and their limits."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any

from rock2d.design.assessment import Assessment
from rock2d.design.headline import bound_text, first_sentence, headline, norm_sentence, worst_blocks
from rock2d.design.least_size import Answer
from rock2d.design.live_slope import ShownRun, live_slope
from rock2d.design.model_range import short_ranges
from rock2d.design.norms import demands
from rock2d.design.report_sections import ReportContent, numbered_embankments, report_sections
from rock2d.design.report_tables import quantity_text
from rock2d.files.csv_tables import write_tables
from rock2d.files.folders import write_whole
from rock2d.files.scenario_checks import doubts
from rock2d.files.scenario_variants import scenario_text
from rock2d.graphics.figure_files import Figures
from rock2d.graphics.live_data import live_assets
from rock2d.graphics.pages import PAGE, write_pdf
from rock2d.graphics.rendering import Made, rendered
from rock2d.runs.release_remarks import source_remarks
from rock2d.scene.cross_section import CrossSection, Embankment
from rock2d.scene.earthworks import ARRIVAL_LINE, numbered
from rock2d.wording import three_digits, with_interval

PDF = "report.pdf"
ZOOM_HEIGHTS = 3.0  # width of the enlarged view on each side of an embankment, in heights of the embankment


def write_report(
    content: ReportContent, folder: Path, command: str, pdf: bool = False, figures: Figures | None = None
) -> None:
    """Write the figures, the tables of envelopes, reach and design values, and report.html, with `pdf` also report.pdf,
    into an existing folder."""
    figures = figures or Figures()
    files = {name: figures.save(folder / f"{name}.png", *drawn) for name, drawn in _figures(content).items()}
    tables = {name: content.sample.to_pandas(name) for name in ("envelopes", "reach")}
    if "percentiles" in content.tables:
        tables["design_values"] = content.design_values
    write_tables(folder, tables)
    made = Made.now(command, f"{content.sample.seed} (of every random draw)")
    figures.finish()
    page = report_page(content, files if figures.wanted else {}, made)
    write_whole(folder / PAGE, page)
    if pdf:
        write_pdf(page, folder / PDF)


def report_page(content: ReportContent, figures: Mapping[str, Path], made: Made) -> str:
    """The HTML of the page; without figures it has no live view either."""
    scenario, answer, sample = content.scenario, content.answer, content.sample
    live = None
    if figures:
        views = content.views or [ShownRun("", sample)]
        shown = next(i for i, view in enumerate(views) if view.run is sample)
        live = live_slope(views, content.releases, shown, answer.place if answer else "")
    context = {
        "project": scenario.project, "name": scenario.name, "made": made, "headline": headline(content),
        "sentences": [text for text in (first_sentence(content), norm_sentence(content), scenario.about) if text],
        "key_figures": _tiles(content),
        "remarks": [
            *content.remarks, *(content.assessment.remarks() if content.assessment else ()),
            *source_remarks(content.tables),
            *(line for line in content.diagnosis if line.startswith("warning")),
            *(f"unusual: {doubt.text}" for doubt in doubts(scenario, sample.engine)),
        ],
        "verdict": "faults" if content.remarks else "unknown" if content.fails else "effect",
        "sections": report_sections(content, figures),
        "scenario_text": scenario_text(scenario),
        "live": live,
        **live_assets("live_slope"),
    }  # fmt: skip
    return rendered("rock2d.design", "report.html.j2", context)


def _figures(content: ReportContent) -> dict[str, tuple[Any, ...]]:
    """Name of each figure -> the function that draws it, and its arguments."""
    from rock2d.design.least_volume import volume_figure
    from rock2d.design.model_range import range_figure
    from rock2d.graphics.slope_figures import distributions_figure, envelopes_figure, stops_figure
    from rock2d.graphics.trajectories import trajectories_figure

    run = content.sample
    ground, lines = run.cross_section, list(run.cross_section.measure_lines)
    found: dict[str, tuple[Any, ...]] = {"trajectories": (trajectories_figure, *run.drawn_paths(run.title))}
    for name, words, bank in numbered_embankments(ground):
        found[name] = (trajectories_figure, *run.drawn_paths(f"At {words}", _window(ground, bank)))
    found["envelopes"] = (envelopes_figure, ground, run.to_pandas("envelopes"))
    found["stops"] = (stops_figure, ground, run.to_pandas("stops"))
    if lines:
        found["distributions"] = (distributions_figure, run.to_pandas("crossings"), lines, dict(run.blocks))
    if content.assessment is not None and len(content.assessment.told_apart):
        found["tornado"] = (Assessment.plot, content.assessment)
    if content.answer is not None:
        found["design"] = (Answer.plot, content.answer)
    if content.combinations:
        found["combinations"] = (volume_figure, content.combinations)
    if content.models is not None:
        found["models"] = (range_figure, content.models)
    return found


def _window(ground: CrossSection, bank: Embankment) -> tuple[float, float, float, float]:
    """The surroundings of an embankment: x_min, x_max, y_min, y_max in m."""
    points = ground.points_m[bank.left : bank.right + 1]
    reach = ZOOM_HEIGHTS * bank.height_m
    low, high = points.min(axis=0), points.max(axis=0)
    return (float(low[0] - reach), float(high[0] + 0.5 * reach), float(low[1] - 0.3 * reach), float(high[1] + reach))


def _tiles(content: ReportContent) -> list[tuple[str, str, str]]:
    """(label, value, note) of each tile. With an answer, a tile shows the judged bound."""
    run, answer, found = content.sample, content.answer, []
    ranges = short_ranges(content.models) if content.models is not None else {}
    over = "over sampling and what is not known" if content.assessment is not None else "sampling only"
    for worst in worst_blocks(content):
        what = f"Share of {worst.block} that pass {worst.line}"
        if answer is None:
            tile = what, f"{with_interval(*worst.frequency, 100.0)} %", over
            found.append(_with_range(tile, ranges.get((worst.line, "frequency"))))
            continue
        target, (value, _, high) = answer.target, worst.frequency
        found.append((
            what, f"≤ {bound_text(high, target.frequency)} %",
            f"judged bound at {100 * target.confidence:.3g} % confidence; median {three_digits(100 * value)} %",
        ))  # fmt: skip
        found.append(("Target", f"≤ {100 * target.frequency:.3g} %", target.text))
    return [
        *found,
        *demand_tiles(content, ranges),
        ("Releases", f"{content.releases}", f"engine {run.engine}, seed {run.seed}"),
    ]


def _with_range(tile: tuple[str, str, str], over_models: str | None) -> tuple[str, str, str]:
    """The tile with the range over the models added to its note."""
    what, value, note = tile
    return (what, value, f"{note}; {over_models}") if over_models else tile


def demand_tiles(
    content: ReportContent, ranges: Mapping[tuple[str, str], str] = MappingProxyType({})
) -> list[tuple[str, str, str]]:
    """Tiles of what each embankment must withstand: label, largest value of all blocks with its interval, and the block
    with the range over the models. `ranges`: (line, key of `model_range.SHOWN_VALUES`) -> words."""
    if "percentiles" not in content.tables:
        return []
    words = {
        "kinetic_J": ("Energy that arrives (95 %)", "kinetic"),
        "passing_height_m": ("Height at which it arrives (95 %)", "height"),
    }
    found = []
    required = demands(content.tables["percentiles"], content.uncertain)
    for (number, quantity), (block, estimate) in required.items():
        what, key = words[quantity]
        tile = (
            what + ("" if number is None else f", embankment {number}"), quantity_text(quantity, *estimate),
            block if math.isfinite(estimate.value) else "too few blocks arrive",
        )  # fmt: skip
        found.append(_with_range(tile, ranges.get((numbered(ARRIVAL_LINE, number), key))))
    return found
