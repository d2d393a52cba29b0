"""The report of a site, one page to hand in: assumptions, results, their uncertainty and their limits."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

from rock2d.design.design_values import demands, design_table, norm_remarks
from rock2d.design.live_slope import LiveSlope, View, live_slope
from rock2d.design.model_range import short_ranges
from rock2d.design.report_tables import (
    block_rows,
    data_of,
    design_value_rows,
    model_rows,
    norm_rows,
    parameter_tables,
    passing_rows,
    percentile_rows,
    quantity_text,
    reach_rows,
    stop_rows,
    uncertain_rows,
)
from rock2d.design.verdict import bound_text, first_sentence, headline, norm_sentence, worst_blocks
from rock2d.files.folders import write_whole
from rock2d.files.scenario import Scenario
from rock2d.files.scenario_checks import doubts
from rock2d.files.scenario_variants import scenario_text
from rock2d.graphics.figure_files import Figures
from rock2d.graphics.live_data import live_assets
from rock2d.graphics.pages import Picture, Section, Table, embedded_picture
from rock2d.graphics.printing import write_pdf
from rock2d.graphics.rendering import Made, rendered
from rock2d.runs.diagnosis_remarks import diagnosis_remarks
from rock2d.runs.resolution import source_remarks
from rock2d.runs.results import RunResult
from rock2d.runs.tables import table_note
from rock2d.scene.cross_section import CrossSection, Embankment
from rock2d.scene.earthworks import ARRIVAL_LINE, is_line, numbered
from rock2d.wording import three_digits, with_interval

if TYPE_CHECKING:
    import pandas as pd

    from rock2d.design.assessment import Assessment
    from rock2d.design.least_size import Answer
    from rock2d.design.least_volume import Combination

PAGE, PRINTED = "report.html", "report.pdf"
REPORTED_TABLES = ("passing", "percentiles", "stops")  # tables over all releases
LEAST_SHARE = 1e-6
ZOOM_HEIGHTS = 3.0  # width of the enlarged view on each side of an embankment, in heights of the embankment
LIMITS = (
    "The section is plane: lateral spread is not modelled. Use a 3D trajectory code on a terrain model where blocks "
    "can leave the section.",
    "Trees absorb no energy. Use a 3D code with single trees.",
    "Blocks do not break. Use a code with a fragmentation model if that matters.",
    "The embankment is ground with a contact law: it does not slide, yield or fail. Check its stability with a model "
    "of the structure.",
    "Intervals cover only sampling and what is listed as not known.",
    "Few numbers of UNI 11211-4 and ONR 24810 are verified by two published sources: compare those that are marked "
    "with the text of the norm before use.",
)


@dataclass(frozen=True)
class ReportContent:
    """Content of a report.

    Attributes
    ----------
    sample : the releases in figures and envelopes: all of a run, the first ones of a campaign
    tables : passing, percentiles and stops of all releases
    remarks : remarks on unresolved releases
    assessment : results over the possible sites, if something is not known
    answer : answer of a search for the least size
    combinations : combinations of a search for the least volume, the best first
    compared : table before and after the diagnosis of the scenario
    models : table with other models, see `design.model_range`
    views : `sample` and runs with other models; or, for a search, a run with each judged size, in ascending order
    """

    scenario: Scenario
    sample: RunResult
    tables: Mapping[str, pd.DataFrame]
    remarks: Sequence[str] = ()
    assessment: Assessment | None = None
    answer: Answer | None = None
    combinations: Sequence[Combination] = ()
    compared: pd.DataFrame | None = None
    models: pd.DataFrame | None = None
    views: Sequence[View] = ()

    @property
    def fails(self) -> bool:
        """Whether no size of a search meets its target."""
        return self.answer is not None and self.answer.least is None

    @property
    def releases(self) -> int:
        """Number of releases in the tables."""
        stops = self.tables.get("stops", ())
        return int(self.tables["stops"]["releases"].sum()) if "releases" in stops else len(self.sample.tracks)

    @cached_property
    def diagnosis(self) -> list[str]:
        """Remarks on the diagnosis of the scenario."""
        return diagnosis_remarks(self.scenario)

    @cached_property
    def design_values(self) -> pd.DataFrame:
        """Table of design values at all lines. Needs the table percentiles."""
        uncertain = self.assessment.uncertain if self.assessment is not None else None
        return design_table(self.scenario, self.tables["percentiles"], uncertain)


def write_report(
    content: ReportContent, folder: Path, command: str, pdf: bool = False, figures: Figures | None = None
) -> None:
    """Write the figures, the tables of `_further_tables` and report.html, with `pdf` also report.pdf, into an existing
    folder."""
    figures = figures or Figures()
    files = {name: figures.save(folder / f"{name}.png", *drawn) for name, drawn in _figures(content).items()}
    for name, table in _further_tables(content).items():
        write_whole(folder / f"{name}.csv", table.to_csv(index=False, lineterminator="\n"))
    made = Made.now(command, f"{content.sample.seed} (of every random draw)")
    figures.finish()
    page = report_page(content, files if figures.wanted else {}, made)
    write_whole(folder / PAGE, page)
    if pdf:
        write_pdf(page, folder / PRINTED)


def report_page(content: ReportContent, figures: Mapping[str, Path], made: Made) -> str:
    """The HTML of the page; without figures it has no live view either."""
    scenario = content.scenario
    context = {
        "project": scenario.project, "name": scenario.name, "made": made, "headline": headline(content),
        "sentences": [text for text in (first_sentence(content), norm_sentence(content), scenario.about) if text],
        "tiles": _tiles(content),
        "remarks": [
            *content.remarks, *(content.assessment.remarks() if content.assessment else ()),
            *source_remarks(content.tables),
            *(line for line in content.diagnosis if line.startswith("warning")),
            *(f"unusual: {doubt.text}" for doubt in doubts(scenario, content.sample.engine)),
        ],
        "verdict": "faults" if content.remarks else "unknown" if content.fails else "effect",
        "sections": [section for section in _sections(content, figures) if section is not None],
        "scenario_text": scenario_text(scenario),
        "live": _live(content) if figures else None,
        **live_assets("live_slope"),
    }  # fmt: skip
    return rendered("rock2d.design", "report.html.j2", context, {})


def _live(content: ReportContent) -> LiveSlope | None:
    views = content.views or [View("", content.sample)]
    shown = next(i for i, view in enumerate(views) if view.run is content.sample)
    return live_slope(views, content.releases, shown, content.answer.place if content.answer else "")


def _figures(content: ReportContent) -> dict[str, tuple[Any, ...]]:
    """Name of each figure -> the function that draws it, and its arguments."""
    from rock2d.design.design_curve import design_figure
    from rock2d.design.least_volume import volume_figure
    from rock2d.design.model_range import range_figure
    from rock2d.graphics.slope_figures import distributions_figure, envelopes_figure, stops_figure
    from rock2d.graphics.tornado import tornado_figure
    from rock2d.graphics.trajectories import trajectories_figure

    run = content.sample
    ground, lines = run.cross_section, list(run.cross_section.measure_lines)
    found: dict[str, tuple[Any, ...]] = {"trajectories": (trajectories_figure, *run.drawn_paths(run.title))}
    for name, words, bank in _embankments(ground):
        found[name] = (trajectories_figure, *run.drawn_paths(f"At {words}", _window(ground, bank)))
    found["envelopes"] = (envelopes_figure, ground, run.to_pandas("envelopes"))
    found["stops"] = (stops_figure, ground, run.to_pandas("stops"))
    if lines:
        found["distributions"] = (distributions_figure, run.to_pandas("crossings"), lines, dict(run.blocks))
    if content.assessment is not None and len(content.assessment.told_apart):
        found["tornado"] = (tornado_figure, content.assessment.told_apart)
    if content.answer is not None:
        found["design"] = (design_figure, content.answer)
    if content.combinations:
        found["combinations"] = (volume_figure, content.combinations)
    if content.models is not None:
        found["models"] = (range_figure, content.models)
    return found


def _embankments(ground: CrossSection) -> list[tuple[str, str, Embankment]]:
    """(name of the figure, name in words, embankment) of each embankment."""
    banks = ground.embankments
    if len(banks) == 1:
        return [("embankment", "the embankment", banks[0])]
    return [(f"embankment_{i}", f"embankment {i}", bank) for i, bank in enumerate(banks, start=1)]


def _window(ground: CrossSection, bank: Embankment) -> tuple[float, float, float, float]:
    """The surroundings of an embankment: x_min, x_max, y_min, y_max in m."""
    points = ground.points_m[bank.left : bank.right + 1]
    reach = ZOOM_HEIGHTS * bank.height_m
    low, high = points.min(axis=0), points.max(axis=0)
    return (
        float(low[0] - reach), float(high[0] + 0.5 * reach), float(low[1] - 0.3 * reach), float(high[1] + reach)
    )  # fmt: skip


def _further_tables(content: ReportContent) -> dict[str, pd.DataFrame]:
    found = {name: content.sample.to_pandas(name) for name in ("envelopes", "reach")}
    if "percentiles" in content.tables:
        found["design_values"] = content.design_values
    return found


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
    with the range over the models. `ranges`: (line, key of `model_range.SHOWN`) -> words."""
    if "percentiles" not in content.tables:
        return []
    words = {
        "kinetic_J": ("Energy that arrives (95 %)", "kinetic"),
        "passing_height_m": ("Height at which it arrives (95 %)", "height"),
    }
    uncertain = content.assessment.uncertain if content.assessment is not None else None
    found = []
    for (number, quantity), (block, estimate) in demands(content.tables["percentiles"], uncertain).items():
        what, key = words[quantity]
        tile = (
            what + ("" if number is None else f", embankment {number}"), quantity_text(quantity, *estimate),
            block if math.isfinite(estimate.value) else "too few blocks arrive",
        )  # fmt: skip
        found.append(_with_range(tile, ranges.get((numbered(ARRIVAL_LINE, number), key))))
    return found


def _sections(content: ReportContent, figures: Mapping[str, Path]) -> list[Section | None]:
    def noted(section: Section | None) -> Section | None:
        """The section with a note in its tables on the changes that the run leaves out."""
        note = table_note(content.scenario)
        if section is None or not note:
            return section
        tables = [replace(table, note=f"{table.note} Simulated {note}.".strip()) for table in section.tables]
        return replace(section, tables=tables)

    return [
        noted(_answer_section(content, figures)), noted(_volume_section(content, figures)),
        _assumption_section(content), _site_section(content, figures),
        noted(_passing_section(content, figures)), noted(_slope_section(content, figures)),
        noted(_line_section(content, figures)), noted(_design_section(content)),
        noted(_model_section(content, figures)), noted(_certainty_section(content, figures)),
        noted(_diagnosis_section(content)),
        Section("Limits", items=LIMITS),
    ]  # fmt: skip


def _picture(figures: Mapping[str, Path], name: str, alt: str, caption: str = "") -> list[Picture]:
    return [Picture(embedded_picture(figures[name]), alt, caption)] if name in figures else []


def _answer_section(content: ReportContent, figures: Mapping[str, Path]) -> Section | None:
    if content.answer is None:
        return None
    answer = content.answer
    shown = Table(
        (answer.place, "block", "median %", "bound %", "meets"),
        [
            (f"{size:.4g}", block, _percent(median), _percent(high), "yes" if meets else "no")
            for size, block, median, _, high, meets in answer.to_pandas().itertuples(index=False, name=None)
        ],
    )  # fmt: skip
    alt = f"Passing frequency of every block against {answer.place}, with the target and the least size"
    return Section("Which size holds", pictures=_picture(figures, "design", alt), tables=[shown])


def _volume_section(content: ReportContent, figures: Mapping[str, Path]) -> Section | None:
    if not content.combinations:
        return None
    from rock2d.design.least_volume import TABLE, combination_table, volume_text

    table = combination_table(content.combinations)
    rows = [tuple(map(three_digits, row)) for row in table.itertuples(index=False, name=None)]
    shown = Table(
        list(table.columns), rows, note="m³ per metre of embankment. A dash: no size of the range holds.",
        data=data_of(TABLE, table),
    )  # fmt: skip
    alt = "Volume of earth against each number that was varied, and over each pair of them"
    text = (
        f"{volume_text(content.combinations).capitalize()}. Volume is not cost: a steep facing needs a wall."
    )
    return Section("Least volume", [text], pictures=_picture(figures, "combinations", alt), tables=[shown])


def _percent(share: float) -> str:
    """In %; shares below LEAST_SHARE are 0."""
    return three_digits(100.0 * share) if share >= LEAST_SHARE else "0"


def _site_section(content: ReportContent, figures: Mapping[str, Path]) -> Section:
    run = content.sample
    points = run.cross_section.points_m
    alt = (
        f"Cross-section from x = {points[0, 0]:.3g} to {points[-1, 0]:.3g} m with the paths of the blocks; "
        f"height from {points[:, 1].min():.3g} to {points[:, 1].max():.3g} m"
    )
    near = [
        picture
        for name, words, _ in _embankments(run.cross_section)
        for picture in _picture(figures, name, f"The paths of the blocks at {words}, enlarged")
    ]
    return Section(
        "Site and blocks",
        pictures=[*_picture(figures, "trajectories", alt), *near],
        tables=[block_rows(content.scenario), *parameter_tables(content.scenario, run.engine)],
    )


def _assumption_section(content: ReportContent) -> Section:
    scenario = content.scenario
    points = list(scenario.assumed) or ["The scenario file lists no assumption."]
    points += [
        f"Varies from release to release: {place}, {_drawn(draw)}" for place, draw in scenario.scatter.items()
    ]
    points += [
        f"Rough ground in {zone}: local slopes vary by {rough.sd_deg:g} degrees (1 sigma) over {rough.length_m:g} m"
        for zone, rough in scenario.roughness.items()
    ]
    if scenario.uncertainty is not None:
        points += [f"Not known: {place}, {_drawn(draw)}" for place, draw in scenario.uncertainty.site.items()]
    return Section("What was assumed", items=points)


def _drawn(draw: Any) -> str:
    """A distribution in words."""
    kind, numbers = next(iter(draw.model_dump().items()))
    if kind == "times":
        return "the value of the file times " + _drawn(draw.times)
    return f"{kind} ({', '.join(f'{key} {value:g}' for key, value in numbers.items())})"


def _passing_section(content: ReportContent, figures: Mapping[str, Path]) -> Section:
    tables = []
    if len(content.tables.get("passing", ())):
        tables.append(passing_rows(content.tables["passing"]))
    if "stops" in content.tables:
        tables.append(stop_rows(content.tables["stops"]))
    tables.append(
        reach_rows(content.sample.to_pandas("reach"), content.sample.cross_section.embankment is not None)
    )
    alt = "Histogram of the places at which releases ended, below the cross-section"
    texts = [] if content.answer is None else [
        "One sample, on the site as in the file. The verdict holds over all possible sites: see above."
    ]  # fmt: skip
    return Section(
        "Do blocks pass, and where do they end",
        texts,
        pictures=_picture(figures, "stops", alt),
        tables=tables,
    )


def _slope_section(content: ReportContent, figures: Mapping[str, Path]) -> Section:
    table: Any = content.sample.to_pandas("envelopes")
    top = table[(table["quantity"] == "kinetic_J") & (table["percentile"] == 95.0)]["value"]
    alt = "Height above the ground, speed and energy along the slope, exceeded by 50, 5 and 1 % of the blocks"
    alt += (
        f"; the 95th percentile of the energy reaches {three_digits(1e-3 * top.max())} kJ" if len(top) else ""
    )
    caption = "Band: 95 % interval of the 95th percentile. Heights are those of the centroid, vertically."
    data = Table((), (), data=data_of("envelopes.csv", table))
    return Section("Along the slope", pictures=_picture(figures, "envelopes", alt, caption), tables=[data])


def _line_section(content: ReportContent, figures: Mapping[str, Path]) -> Section | None:
    if "percentiles" not in content.tables:
        return None
    alt = "Histograms of energy, passing height and speed of the blocks that pass each measure line"
    return Section(
        "How high and how hard",
        pictures=_picture(figures, "distributions", alt),
        tables=[percentile_rows(content.tables["percentiles"])],
    )


def _design_section(content: ReportContent) -> Section | None:
    if "percentiles" not in content.tables:
        return None
    values = content.design_values
    arriving = [is_line(line, ARRIVAL_LINE) for line in values["line"]]
    if any(arriving):
        values = values[arriving]
    if not len(values):
        return None
    text = (
        "An embankment must withstand what arrives at it. Characteristic values are 95th percentiles of the blocks "
        "that pass the line. Each block of the scenario is a design block, with its mass (of a population, the 95th "
        "percentile of size)."
    )
    tables = [design_value_rows(values), norm_rows(content.scenario)]
    texts = [text, *(f"{line[0].upper()}{line[1:]}." for line in norm_remarks(content.scenario))]
    return Section("Design values", texts=texts, tables=tables)


def _without_assessment(content: ReportContent) -> str:
    if content.scenario.uncertainty is None:
        return "The scenario has no key uncertainty. All intervals cover only sampling."
    return (
        "The size holds over all that is listed as not known. The other intervals on this page cover only sampling: "
        "`rock2d run least.yaml --report` gives them over the possible sites, and how much each value matters."
    )


def _model_section(content: ReportContent, figures: Mapping[str, Path]) -> Section:
    from rock2d.design.model_range import BASE, range_remarks

    title = "How much depends on the model"
    if content.models is None:
        text = (
            "Not computed: `rock2d run SCENARIO --compare --report` also runs the other law, rough or smooth ground, "
            "softer and harder soil, and blocks of other shapes."
        )
        return Section(title, texts=[text])
    text = "One change at a time, the same releases. None of these models is known to be the right one."
    alt = f"Shares, energies and heights with each model; the first is the model {BASE}"
    return Section(
        title, [text], range_remarks(content.models), pictures=_picture(figures, "models", alt),
        tables=[model_rows(content.models, "models.csv")],
    )  # fmt: skip


def _diagnosis_section(content: ReportContent) -> Section | None:
    if content.compared is None:
        return None
    shown = model_rows(content.compared, "before_after.csv")
    return Section("Before and after the diagnosis", texts=content.diagnosis, tables=[shown])


def _certainty_section(content: ReportContent, figures: Mapping[str, Path]) -> Section | None:
    if content.assessment is None:
        return Section("How sure is that", texts=[_without_assessment(content)])
    drawn = _picture(figures, "tornado", tornado_words(content.assessment))
    return certainty_section(content.assessment, drawn)


def tornado_words(assessment: Assessment) -> str:
    """Alternative text of the tornado figure of an assessment."""
    table: Any = assessment.told_apart
    alt = "Tornado figure: share of each unknown value in the variance of the passing frequency"
    if len(table):
        first = table.loc[table["total"].idxmax()]
        alt += f"; the largest is {first['parameter']} with a total index of {first['total']:.2f}"
    return alt


def certainty_section(assessment: Assessment, pictures: Sequence[Picture]) -> Section:
    """The section of an assessment; `pictures`: its tornado figure, if it has one."""
    remark = assessment.sampling_remark()
    return Section(
        "How sure is that",
        [remark] if remark else [],
        pictures=pictures,
        tables=[uncertain_rows(assessment.uncertain)],
    )
