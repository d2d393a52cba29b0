"""The sections of the report of a site."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rock2d.design.assessment import Assessment, certainty_section, tornado_words
from rock2d.design.norms import design_table, norm_remarks
from rock2d.design.report_tables import (
    block_page_table,
    data_of,
    design_value_page_table,
    model_page_table,
    norm_page_table,
    parameter_tables,
    passing_page_table,
    percentile_page_table,
    reach_page_table,
    stop_page_table,
)
from rock2d.files.scenario_checks import rough_without_slope_reduction
from rock2d.graphics.pages import Picture, Section, Table, embedded_picture
from rock2d.runs.diagnosis_remarks import diagnosis_remarks
from rock2d.runs.engines import engine_named
from rock2d.runs.printed_tables import table_note
from rock2d.runs.release_remarks import unresolved_remarks
from rock2d.scene.cross_section import CrossSection, Embankment
from rock2d.scene.earthworks import ARRIVAL_LINE, is_line
from rock2d.wording import three_digits

if TYPE_CHECKING:
    import pandas as pd

    from rock2d.design.least_size import Answer
    from rock2d.design.least_volume import Combination
    from rock2d.design.live_slope import ShownRun
    from rock2d.files.scenario import Scenario
    from rock2d.runs.results import RunResult

LEAST_SHARE = 1e-6
REPORTED_TABLES = ("passing", "percentiles", "stops")  # tables over all releases
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
    assessment : results over the possible sites, if something is not known
    answer : answer of a search for the least size
    combinations : combinations of a search for the least volume, the best first
    before_after : table before and after the diagnosis of the scenario
    models : table with other models, see `design.model_range`
    views : `sample` and runs with other models; or, for a search, a run with each judged size, in ascending order"""

    sample: RunResult
    tables: Mapping[str, pd.DataFrame]
    assessment: Assessment | None = None
    answer: Answer | None = None
    combinations: Sequence[Combination] = ()
    before_after: pd.DataFrame | None = None
    models: pd.DataFrame | None = None
    views: Sequence[ShownRun] = ()

    @property
    def scenario(self) -> Scenario:
        """The scenario of the releases."""
        return self.sample.scenario

    @cached_property
    def remarks(self) -> list[str]:
        """Remarks on unresolved releases."""
        return unresolved_remarks(self.tables, self.scenario.longest_release_s())

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

    @property
    def uncertain(self) -> pd.DataFrame | None:
        """The table over the possible sites."""
        return self.assessment.uncertain if self.assessment is not None else None

    @cached_property
    def design_values(self) -> pd.DataFrame:
        """Table of design values at all lines. Needs the table percentiles."""
        return design_table(self.scenario, self.tables["percentiles"], self.uncertain)


def numbered_embankments(ground: CrossSection) -> list[tuple[str, str, Embankment]]:
    """(name of the figure, name in words, embankment) of each embankment."""
    banks = ground.embankments
    if len(banks) == 1:
        return [("embankment", "the embankment", banks[0])]
    return [(f"embankment_{i}", f"embankment {i}", bank) for i, bank in enumerate(banks, start=1)]


def report_sections(content: ReportContent, figures: Mapping[str, Path]) -> list[Section]:
    """The sections of the page. Those with results have a note in their tables on the changes that the run leaves
    out."""
    note = table_note(content.scenario)
    site = _site_section(content, figures)
    found = [
        _answer_section(content, figures), _volume_section(content, figures), _assumption_section(content), site,
        _passing_section(content, figures), _slope_section(content, figures), _line_section(content, figures),
        _design_section(content), _model_section(content, figures), _certainty_section(content, figures),
        _diagnosis_section(content), Section("Limits", items=LIMITS),
    ]  # fmt: skip

    def noted(section: Section) -> Section:
        tables = [replace(table, note=f"{table.note} Simulated {note}.".strip()) for table in section.tables]
        return replace(section, tables=tables)

    return [noted(each) if note and each is not site else each for each in found if each is not None]


def _picture(figures: Mapping[str, Path], name: str, alt: str, caption: str = "") -> list[Picture]:
    return [Picture(embedded_picture(figures[name]), alt, caption)] if name in figures else []


def _answer_section(content: ReportContent, figures: Mapping[str, Path]) -> Section | None:
    if content.answer is None:
        return None
    answer = content.answer
    rows = [
        (f"{size:.4g}", block, _percent(median), _percent(high), "yes" if meets else "no")
        for size, block, median, _, high, meets in answer.to_pandas().itertuples(index=False, name=None)
    ]
    shown = Table((answer.place, "block", "median %", "bound %", "meets"), rows)
    alt = f"Passing frequency of every block against {answer.place}, with the target and the least size"
    return Section("Which size holds", pictures=_picture(figures, "design", alt), tables=[shown])


def _volume_section(content: ReportContent, figures: Mapping[str, Path]) -> Section | None:
    if not content.combinations:
        return None
    from rock2d.design.least_volume import COMBINATIONS, combination_table, volume_text

    table = combination_table(content.combinations)
    rows = [tuple(map(three_digits, row)) for row in table.itertuples(index=False, name=None)]
    shown = Table(
        list(table.columns), rows, note="m³ per metre of embankment. A dash: no size of the range holds.",
        data=data_of(COMBINATIONS, table),
    )  # fmt: skip
    alt = "Volume of earth against each number that was varied, and over each pair of them"
    least = volume_text(content.combinations)
    text = f"{least[0].upper()}{least[1:]}. Volume is not cost: a steep facing needs a wall."
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
        for name, words, _ in numbered_embankments(run.cross_section)
        for picture in _picture(figures, name, f"The paths of the blocks at {words}, enlarged")
    ]
    return Section(
        "Site and blocks",
        pictures=[*_picture(figures, "trajectories", alt), *near],
        tables=[block_page_table(content.scenario), *parameter_tables(content.scenario, run.engine)],
    )


def _assumption_section(content: ReportContent) -> Section:
    scenario = content.scenario
    law = engine_named(content.sample.engine).law
    rough_zones = rough_without_slope_reduction(scenario) if law == "probabilistic" else scenario.roughness
    points = list(scenario.assumed) or ["The scenario file lists no assumption."]
    points += [f"Varies from release to release: {place}, {_drawn(draw)}" for place, draw in scenario.scatter.items()]
    for zone in rough_zones:
        rough = scenario.roughness[zone]
        text = f"local slopes vary by {rough.sd_deg:g} degrees (1 sigma) over {rough.length_m:g} m"
        points.append(f"Rough ground in {zone}: {text}")
    points += [f"Not known: {place}, {how}" for place, how in _not_known(scenario).items()]
    return Section("What was assumed", items=points)


def _not_known(scenario: Scenario) -> dict[str, str]:
    """Place of each value that is not known about the site -> its distribution in words."""
    if scenario.uncertainty is None:
        return {}
    found = {place: _drawn(draw) for place, draw in scenario.uncertainty.site.items()}
    if (posterior := scenario.posterior) is not None:
        found |= dict.fromkeys(posterior.places, f"as in the {len(posterior.draws)} draws of {posterior.given}")
    if (diagnosed := scenario.diagnosed) is not None:
        found |= dict.fromkeys(diagnosed.unknown(), f"as {diagnosed.given} gives it")
    return found


def _drawn(draw: Any) -> str:
    """A distribution in words."""
    kind, numbers = next(iter(draw.model_dump().items()))
    if kind == "times":
        return "the value of the file times " + _drawn(draw.times)
    return f"{kind} ({', '.join(f'{key} {value:g}' for key, value in numbers.items())})"


def _passing_section(content: ReportContent, figures: Mapping[str, Path]) -> Section:
    tables = []
    if len(content.tables.get("passing", ())):
        tables.append(passing_page_table(content.tables["passing"]))
    if "stops" in content.tables:
        tables.append(stop_page_table(content.tables["stops"]))
    held = content.sample.cross_section.embankment is not None
    tables.append(reach_page_table(content.sample.to_pandas("reach"), held))
    alt = "Histogram of the places at which releases ended, below the cross-section"
    one = "One sample, on the site as in the file. The verdict holds over all possible sites: see above."
    texts = [] if content.answer is None else [one]
    pictures = _picture(figures, "stops", alt)
    return Section("Do blocks pass, and where do they end", texts, pictures=pictures, tables=tables)


def _slope_section(content: ReportContent, figures: Mapping[str, Path]) -> Section:
    table: Any = content.sample.to_pandas("envelopes")
    top = table[(table["quantity"] == "kinetic_J") & (table["percentile"] == 95.0)]["value"]
    alt = "Height above the ground, speed and energy along the slope, exceeded by 50, 5 and 1 % of the blocks"
    if len(top):
        alt += f"; the 95th percentile of the energy reaches {three_digits(1e-3 * top.max())} kJ"
    caption = "Band: 95 % interval of the 95th percentile. Heights are those of the centroid, vertically."
    data = Table((), (), data=data_of("envelopes.csv", table))
    return Section("Along the slope", pictures=_picture(figures, "envelopes", alt, caption), tables=[data])


def _line_section(content: ReportContent, figures: Mapping[str, Path]) -> Section | None:
    if "percentiles" not in content.tables:
        return None
    alt = "Histograms of energy, passing height and speed of the blocks that pass each measure line"
    tables = [percentile_page_table(content.tables["percentiles"])]
    return Section("How high and how hard", pictures=_picture(figures, "distributions", alt), tables=tables)


def _design_section(content: ReportContent) -> Section | None:
    if "percentiles" not in content.tables:
        return None
    values = content.design_values
    arriving = [is_line(line, ARRIVAL_LINE) for line in values["line"]]
    values = values[arriving] if any(arriving) else values
    if not len(values):
        return None
    text = (
        "An embankment must withstand what arrives at it. Characteristic values are 95th percentiles of the blocks "
        "that pass the line. Each block of the scenario is a design block, with its mass (of a population, the 95th "
        "percentile of size)."
    )
    tables = [design_value_page_table(values), norm_page_table(content.scenario)]
    texts = [text, *(f"{line[0].upper()}{line[1:]}." for line in norm_remarks(content.scenario))]
    return Section("Design values", texts=texts, tables=tables)


def _model_section(content: ReportContent, figures: Mapping[str, Path]) -> Section:
    from rock2d.design.model_range import AS_IN_FILE, range_remarks

    title = "How much depends on the model"
    if content.models is None:
        text = (
            "Not computed: `rock2d run SCENARIO --compare --report` also runs the other law, rough or smooth ground, "
            "softer and harder soil, and blocks of other shapes."
        )
        return Section(title, texts=[text])
    text = "One change at a time, the same releases. None of these models is known to be the right one."
    alt = f"Shares, energies and heights with each model; the first is the model {AS_IN_FILE}"
    return Section(
        title, [text], range_remarks(content.models), pictures=_picture(figures, "models", alt),
        tables=[model_page_table(content.models, "models.csv")],
    )  # fmt: skip


def _diagnosis_section(content: ReportContent) -> Section | None:
    if not content.diagnosis:
        return None
    if content.before_after is None:  # of a search
        return Section("What the diagnosis gives", texts=content.diagnosis)
    shown = model_page_table(content.before_after, "before_after.csv")
    return Section("Before and after the diagnosis", texts=content.diagnosis, tables=[shown])


def _certainty_section(content: ReportContent, figures: Mapping[str, Path]) -> Section | None:
    if content.assessment is not None:
        drawn = _picture(figures, "tornado", tornado_words(content.assessment))
        return certainty_section(content.assessment, drawn)
    text = "The scenario has no key uncertainty. All intervals cover only sampling."
    if content.scenario.uncertainty is not None:
        text = (
            "The size holds over all that is listed as not known. The other intervals on this page cover only "
            "sampling: `rock2d run least.yaml --report` gives them over the possible sites, and how much each value "
            "matters."
        )
    return Section("How sure is that", texts=[text])
