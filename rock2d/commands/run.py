"""The command `rock2d run`: run scenario files and write result folders."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import KW_ONLY, dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rock2d.cluster import THIS_PROCESS, Workers
from rock2d.design.report_tables import model_text
from rock2d.errors import InputError
from rock2d.files.csv_tables import write_tables
from rock2d.files.folders import check_output_folder
from rock2d.files.scenario import Scenario
from rock2d.files.scenario_checks import check_engine, engine_remarks
from rock2d.files.scenario_reading import load_scenario
from rock2d.graphics.figure_files import Figures, NoFigures, figures_in_second_process
from rock2d.graphics.pages import check_printer
from rock2d.runs.campaigns.campaign import MANIFEST, CampaignOptions, is_campaign, run_campaign
from rock2d.runs.diagnosis_remarks import diagnosis_remarks
from rock2d.runs.engines import ENGINES, compiled_engine
from rock2d.runs.model_comparison import Model, diagnosed_models, model_table
from rock2d.runs.printed_tables import PRINTED_TABLES, print_tables, residual_text, table_note
from rock2d.runs.release_remarks import precision_remarks, source_remarks, unresolved_remarks
from rock2d.runs.results import KIND
from rock2d.runs.run import run, run_bars
from rock2d.scene.plausibility import line_remarks

if TYPE_CHECKING:
    import pandas as pd

    from rock2d.design.assessment import Assessment
    from rock2d.design.live_slope import ShownRun
    from rock2d.runs.results import RunResult

FEWEST_FOR_PROCESS = 100  # fewest releases for which a separate process draws the figures
SHOWN_OF_A_CAMPAIGN = 1000  # releases of each block in the figures of the report of a campaign
# files that depend on keys without which a campaign can be continued, `uncertainty` and `design_values`
BESIDE_THE_RELEASES = (
    "uncertainty.csv", "sensitivity.csv", "sites.csv", "tornado.png", "design_values.csv", "report.html", "report.pdf",
)  # fmt: skip


@dataclass(frozen=True)
class RunRequest:
    """Options of `run_scenarios`.

    Attributes
    ----------
    out : folder in which each run has its own folder
    options : seed and releases of every run; keep, for a campaign only
    engines : engines that run each scenario; default: that of the scenario
    page_command : command line that the page report.html shows; None for no page
    pdf : also write the page as report.pdf
    compare : also run the other models of `design.model_range`
    precision : half-width of intervals that determines the number of releases, see `runs.needed_releases`
    draw : False for tables without figures
    overwrite : replace an earlier run; without it, a campaign continues an earlier one with the same manifest"""

    out: Path
    options: CampaignOptions = field(default_factory=CampaignOptions)
    workers: Workers = THIS_PROCESS
    _: KW_ONLY
    engines: Sequence[str] = ()
    video: bool = False
    page_command: str | None = None
    pdf: bool = False
    compare: bool = False
    precision: float | None = None
    draw: bool = True
    overwrite: bool = False
    progress: bool = True
    report: Callable[[str], Any] = print

    def is_campaign(self, scenario: Scenario) -> bool:
        """Whether the run is a campaign."""
        return self.workers.scheduler is not None or is_campaign(scenario, self.options.releases)

    def engines_of(self, scenario: Scenario) -> Sequence[str]:
        """The engines that run a scenario."""
        return list(dict.fromkeys(self.engines)) or [scenario.engine]

    def is_study(self, scenario: Scenario) -> bool:
        """Whether a scenario is a study of its field test."""
        return scenario.field_test is not None and self.options.releases is None and not self.engines

    def folder(self, scenario: Scenario, engine: str) -> Path:
        """Folder of the results."""
        return self.out / f"{scenario.name}_{engine}"

    def check(self, scenario: Scenario) -> None:
        """Raise InputError for options that do not fit the scenario, or a folder that cannot be used."""
        campaign = self.is_campaign(scenario)
        if self.options.keep and not campaign:
            message = "--keep is for campaigns: more than 10,000 releases, or --scheduler"
            raise InputError(message, code="wrong_kind", option="keep")
        if self.video and campaign:
            message = "--video is not for campaigns: they keep no full tracks"
            raise InputError(message, code="wrong_kind", option="video")
        if not self.draw and self.is_study(scenario):
            message = "--no-figures is for runs: the study of a field test always draws its figures"
            raise InputError(message, code="wrong_kind", option="no-figures")
        asks = {
            "report": self.page_command is not None,
            "compare": self.compare,
            "precision": self.precision is not None,
        }
        for option, asked in asks.items():
            if asked and scenario.experiment is not None:
                message = f"--{option} is for sites; releases restarted from a film are compared with the film instead"
                raise InputError(message, code="wrong_kind", option=option)
        for engine in () if campaign else self.engines_of(scenario):
            folder = self.folder(scenario, engine)
            if self.precision is None or not (folder / MANIFEST).is_file():  # it may continue the campaign there
                check_output_folder(folder, self.overwrite, KIND)
        for engine in self.engines_of(scenario):
            check_engine(scenario, engine)
        if scenario.uncertainty is not None:
            from rock2d.design.possible_sites import check_extremes

            check_extremes(scenario)


def run_scenarios(
    scenarios: Sequence[Path], request: RunRequest, *, data_root: Path | None = None, predict: Path | None = None
) -> bool:
    """Run scenario files with every engine of the request, each in its own folder. Returns False if more than 1 % of
    the releases of a block are unresolved (see `runs.release_remarks`).

    A scenario with a field test is a study of the test, unless engines or a number of releases are given; then its
    blocks run on the mean section. `predict` is a table of releases to forecast instead, into the file `request.out`.

    A run of more than 10,000 releases, or with a scheduler, is a campaign.

    Raises InputError for a mistake in a file, for options that do not fit such a run, or for a folder that cannot be
    used."""
    loaded = [load_scenario(path, data_root) for path in scenarios]
    if predict is not None:
        if len(loaded) != 1:
            raise InputError("--predict is for one scenario", code="wrong_kind", option="predict")
        from rock2d.field_tests.command import predict_releases

        seed, overwrite, progress = request.options.seed, request.overwrite, request.progress
        text = predict_releases(loaded[0], predict, request.out, seed=seed, overwrite=overwrite, progress=progress)
        request.report(text)
        return True
    if request.pdf:
        check_printer()
    for i, scenario in enumerate(loaded):  # before any work
        if any(scenario.name == other.name for other in loaded[:i]):
            message = "another scenario of this command has this name, which is that of the folder of its results"
            raise scenario.error(message, "name", code="duplicate")
        request.check(scenario)
    resolved = [_run_scenario(scenario, request) for scenario in loaded]
    return all(resolved)


def _run_scenario(scenario: Scenario, request: RunRequest) -> bool:
    """Run a scenario with every engine, or study its field test. Returns whether the releases are resolved."""
    if request.is_study(scenario):
        from rock2d.field_tests.command import run_field_test

        run_field_test(
            scenario, request.out / scenario.name, seed=request.options.seed, overwrite=request.overwrite,
            progress=request.progress, report=request.report,
        )  # fmt: skip
        return True
    for remark in line_remarks(scenario.make_cross_section(), scenario.make_blocks().values()):
        request.report(f"warning: {remark}")
    for remark in diagnosis_remarks(scenario):
        request.report(remark)
    for engine in dict.fromkeys([*request.engines_of(scenario), *(ENGINES if request.compare else ())]):
        for remark in engine_remarks(scenario, engine):
            request.report(remark)
    resolved = True
    for engine in request.engines_of(scenario):
        if request.precision is not None:
            request = _with_releases_for_precision(scenario, engine, request)
            request.check(scenario)  # it may be a campaign now
        run_one = _run_campaign if request.is_campaign(scenario) else _run_in_memory
        tables = run_one(scenario, engine, request)
        if scenario.experiment is None:  # a restarted release ends with its film
            remarks = unresolved_remarks(tables, scenario.longest_release_s())
            resolved = resolved and not remarks
            for remark in (
                *remarks,
                *(f"warning: {text}" for text in (*source_remarks(tables), *precision_remarks(tables))),
            ):
                request.report(remark)
        if request.page_command is not None and len(tables.get("percentiles", ())):
            from rock2d.design.norms import norm_remarks

            for remark in norm_remarks(scenario):
                request.report(remark)
        request.report(f"written: {request.folder(scenario, engine)}")
    return resolved


def _with_releases_for_precision(scenario: Scenario, engine: str, request: RunRequest) -> RunRequest:
    """The request with the number of releases that its precision needs."""
    from rock2d.runs.needed_releases import releases_for_precision

    assert request.precision is not None
    options = request.options
    seed = scenario.seed if options.seed is None else options.seed
    first = options.releases or scenario.releases
    releases = releases_for_precision(scenario, engine, seed, request.precision, first, request.progress)
    request.report(
        f"{releases} releases of each block: the half-width of every interval is at most {100 * request.precision:g} %"
    )
    return replace(request, options=replace(options, releases=releases))


def _run_in_memory(scenario: Scenario, engine: str, request: RunRequest) -> dict[str, pd.DataFrame]:
    """Run, print the tables and write the folder. Returns the tables in the folder."""
    options, processes = request.options, request.workers.processes
    bars = run_bars(scenario, engine, request.progress, processes)
    with _figures(scenario, request) as figures:
        result = run(
            scenario, engine=engine, seed=options.seed, releases=options.releases, workers=processes, progress=bars
        )
        shown = {name: result.to_pandas(name) for name in PRINTED_TABLES if name in result.table_names()}
        print_tables(scenario, f"{engine}, seed {result.seed}", shown)
        found = _findings(scenario, engine, result.seed, len(result.tracks) // len(result.blocks), request)
        found.show()

        def also(partial: Path) -> None:
            found.write(partial, figures)
            if request.page_command is not None:
                from rock2d.design.report_sections import REPORTED_TABLES

                of_run = {name: result.to_pandas(name) for name in REPORTED_TABLES}
                _write_page(result, of_run, found, partial, request, figures)

        folder = request.folder(scenario, engine)
        tables = result.write(folder, request.video, progress=bars, also=also, figures=figures)
    if "residual_summary" in tables:
        print(residual_text(tables["residual_summary"]))
    return tables


def _figures(scenario: Scenario, request: RunRequest) -> AbstractContextManager[Figures]:
    """How the figures of a run in memory are drawn: not at all, in this process, or in a second one."""
    if not request.draw:
        return nullcontext(NoFigures())
    releases = (request.options.releases or scenario.releases) * len(scenario.make_blocks())
    if request.workers.processes == 1 or releases < FEWEST_FOR_PROCESS:
        return nullcontext(Figures())
    return figures_in_second_process()


def _run_campaign(scenario: Scenario, engine: str, request: RunRequest) -> dict[str, pd.DataFrame]:
    """Run a campaign, print its tables, and write findings and page. The figures of the page show the first
    releases."""
    folder, progress = request.folder(scenario, engine), request.progress
    options = replace(request.options, engine=engine)
    tables = run_campaign(
        scenario,
        folder,
        options,
        request.workers,
        overwrite=request.overwrite,
        progress=progress,
        report=request.report,
    )
    for name in BESIDE_THE_RELEASES:
        (folder / name).unlink(missing_ok=True)  # of an earlier command
    print_tables(scenario, engine, tables)
    releases = options.releases or scenario.releases
    seed = scenario.seed if options.seed is None else options.seed
    found = _findings(scenario, engine, seed, releases, request)
    found.show()
    figures = Figures() if request.draw else NoFigures()
    found.write(folder, figures)
    if request.page_command is not None:
        first = min(releases, SHOWN_OF_A_CAMPAIGN)
        sample = run(scenario, engine=engine, seed=options.seed, releases=first, progress=progress)
        _write_page(sample, tables, found, folder, request, figures)
    return tables


@dataclass(frozen=True)
class Findings:
    """Results in addition to the run: design values before and after a diagnosis, over the possible sites, and with
    other models."""

    before_after: pd.DataFrame | None
    assessment: Assessment | None
    models: pd.DataFrame | None
    note: str

    def show(self) -> None:
        """Print the tables."""
        from rock2d.design.model_range import at_shown_lines, range_remarks

        if self.before_after is not None:
            print(model_text(self.before_after, "before and after the diagnosis", self.note))
        if self.assessment is not None:
            print(self.assessment.text())
        if self.models is not None:
            print(model_text(at_shown_lines(self.models), "with other models", self.note))
            print("\n".join(["range over the models", *(f"  {line}" for line in range_remarks(self.models))]))

    def write(self, folder: Path, figures: Figures) -> None:
        """Write the tables and figures into a folder."""
        tables = {"before_after": self.before_after, "models": self.models}
        write_tables(folder, {name: table for name, table in tables.items() if table is not None})
        if self.models is not None:
            from rock2d.design.model_range import range_figure

            figures.save(folder / "models.png", range_figure, self.models)
        if self.assessment is not None:
            self.assessment.write(folder, figures)


def _findings(scenario: Scenario, engine: str, seed: int, releases: int, request: RunRequest) -> Findings:
    """Compute the findings that the scenario and the request ask for."""
    before_after = models = None
    if scenario.diagnosed is not None:
        before_after = model_table(diagnosed_models(scenario, engine), seed, releases)
    if request.compare:
        from rock2d.design.model_range import range_table

        models = range_table(scenario, engine, seed, releases)
    assessment = None
    if scenario.uncertainty is not None:
        from rock2d.design.assessment import assess

        assessment = assess(scenario, engine, seed, request.progress)
    return Findings(before_after, assessment, models, table_note(scenario))


def _write_page(
    sample: RunResult,
    tables: dict[str, pd.DataFrame],
    found: Findings,
    folder: Path,
    request: RunRequest,
    figures: Figures,
) -> None:
    from rock2d.design.report import write_report
    from rock2d.design.report_sections import ReportContent

    results = ReportContent(
        sample, tables, found.assessment, before_after=found.before_after, models=found.models,
        views=_views(sample, request),
    )  # fmt: skip
    write_report(results, folder, request.page_command or "", request.pdf, figures)


def _views(sample: RunResult, request: RunRequest) -> list[ShownRun]:
    """The run, and some releases of each model with which it is compared."""
    from rock2d.design.live_slope import SHOWN_OF_OTHERS, ShownRun
    from rock2d.design.model_range import AS_IN_FILE, other_models

    scenario, engine, models = sample.scenario, sample.engine, list[Model]()
    if scenario.diagnosed is not None:
        of_diagnosis = diagnosed_models(scenario, engine)
        # if the verdict is a single model, the last one is the run itself
        models += of_diagnosis if scenario.diagnosed.undecided else of_diagnosis[:-1]
    if request.compare:
        models += other_models(scenario, engine)
    first = min(SHOWN_OF_OTHERS, len(sample.tracks) // len(sample.blocks))
    others = (
        run(model.scenario, engine=compiled_engine(model.engine).name, seed=sample.seed, releases=first)
        for model in models
    )
    names = [AS_IN_FILE, *(model.name for model in models)]
    return [ShownRun(name, shown) for name, shown in zip(names, [sample, *others], strict=True)]
