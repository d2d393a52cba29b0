"""Sites for Python programs: thin functions over `rock2d.runs` and `rock2d.design`."""

from __future__ import annotations

from dataclasses import dataclass, fields
from pathlib import Path
from typing import TYPE_CHECKING

from rock2d.runs import results
from rock2d.runs.run import run as run_scenario

if TYPE_CHECKING:
    from rock2d.design.assessment import Assessment
    from rock2d.design.least_size import Answer, Target
    from rock2d.files.scenario import Scenario


@dataclass(kw_only=True, repr=False)
class RunResult(results.RunResult):
    """The simulated releases of a scenario; returned by `run`. See `Simulation` for tables and plots.

    Attributes
    ----------
    scenario, seed : the scenario and the seed of its random draws
    incident_states : the incident state of each release
    drawn : release -> values drawn for it in addition to its start: name -> value"""

    def view(self, *, assessment: Assessment | None = None) -> Path:
        """Open report.html in the browser, see `write_report`; returns its path, in a temporary folder."""
        from rock2d.graphics.pages import PAGE, view

        return view(lambda folder: write_report(self, folder, assessment=assessment), PAGE)


def run(
    scenario: Scenario,
    *,
    engine: str | None = None,
    seed: int | None = None,
    releases: int | None = None,
    workers: int | None = None,
    progress: bool = False,
) -> RunResult:
    """Run every release of a scenario.

    Parameters
    ----------
    scenario : Scenario
        From `load_scenario`.
    engine : {"pymunk", "batch", "point_mass"}, optional
        Replaces that of the scenario.
    seed : int, optional
        Seed of every random draw; replaces that of the scenario.
    releases : int, optional
        Releases of each block; replaces those of the scenario.
    workers : int, optional
        Processes; default: all cores. Results do not depend on it.
    progress : bool
        Show a progress bar.

    Returns
    -------
    RunResult
        Tracks, tables and plots; `RunResult.write` writes the results folder, `RunResult.view` opens the report.

    Raises
    ------
    InputError
        If the scenario has no parameters for the engine, or if there is no such engine.

    Examples
    --------
    >>> import rock2d
    >>> from rock2d.files.scenario import scenario_file
    >>> scenario = rock2d.load_scenario(scenario_file("flat_floor.yaml"))
    >>> result = rock2d.run(scenario, engine="point_mass", releases=2)
    >>> len(result.tracks), list(result.blocks)
    (10, ['circle', 'square', 'rectangle', 'ellipse', 'polygon'])"""
    found = run_scenario(scenario, engine=engine, seed=seed, releases=releases, workers=workers, progress=progress)
    return RunResult(**{field.name: getattr(found, field.name) for field in fields(found)})


def assess(
    scenario: Scenario, *, engine: str | None = None, seed: int | None = None, progress: bool = False
) -> Assessment:
    """Simulate the possible sites of a scenario, and separate the error of sampling from what is not known.

    Parameters
    ----------
    scenario : Scenario
        From `load_scenario`, with the key ``uncertainty`` and a measure line.
    engine : {"batch", "point_mass", "pymunk"}, optional
        Replaces that of the scenario; "batch", which has the same law, replaces "pymunk".
    seed : int, optional
        Seed of every random draw; replaces that of the scenario.
    progress : bool
        Show a progress bar.

    Returns
    -------
    Assessment
        Tables over the sites and a tornado figure; `Assessment.write` writes them.

    Raises
    ------
    InputError
        Code ``missing_key`` if the scenario has no ``uncertainty``. Also raised if a drawn value makes no sense.

    Examples
    --------
    >>> import rock2d
    >>> site = rock2d.load_scenario("site.yaml")  # doctest: +SKIP
    >>> found = rock2d.assess(site)  # doctest: +SKIP
    >>> found.uncertain[["block", "line", "quantity", "value", "low95", "high95"]]  # doctest: +SKIP"""
    from rock2d.design.assessment import assess as assess_sites

    return assess_sites(scenario, engine or scenario.engine, scenario.seed if seed is None else seed, progress)


def least_size(
    scenario: Scenario,
    place: str,
    bounds: tuple[float, float],
    target: Target,
    *,
    engine: str | None = None,
    seed: int | None = None,
    progress: bool = False,
) -> Answer:
    """Find the least size that stops enough blocks, over sampling and all that is not known.

    Parameters
    ----------
    scenario : Scenario
        From `load_scenario`.
    place : str
        Place of the number to minimize, for example ``"embankment.height_m"``.
    bounds : (float, float)
        Least and greatest value, in the unit of the number; the greatest must be the safest. The answer is exact to
        1/50 of their distance.
    target : Target
        Measure line, largest share of the releases of each block that may pass it, and confidence.
    engine, seed, progress : optional
        As in `assess`.

    Returns
    -------
    Answer
        `Answer.least` is None if no value of the range meets the target. `variant` returns the scenario with a size.

    Raises
    ------
    InputError
        If there is no number at the place, no such measure line, or the bounds or the target make no sense.

    Examples
    --------
    >>> import rock2d
    >>> site = rock2d.load_scenario("site.yaml")  # doctest: +SKIP
    >>> target = rock2d.Target("crest", frequency=0.01, confidence=0.95)
    >>> answer = rock2d.least_size(site, "embankment.height_m", (2.0, 8.0), target)  # doctest: +SKIP
    >>> least = rock2d.variant(site, {answer.place: answer.least}, uncertain=True)  # doctest: +SKIP
    >>> rock2d.write_report(rock2d.run(least), "out/least")  # doctest: +SKIP"""
    from rock2d.design.least_size import Judgement, Search, size_bars, work_of_sizes
    from rock2d.design.least_size import least_size as bisect
    from rock2d.progress import Bars

    own_seed = scenario.seed if seed is None else seed
    search = Search(scenario, place, bounds, target, engine or scenario.engine, own_seed)
    search.check()
    with size_bars(search, Bars(progress, work_of_sizes(search))) as bar_of:

        def judged(size: float) -> Judgement:
            return search.judge(size, bar_of(size).update)

        return bisect(search, judged)


def write_report(
    result: results.RunResult, folder: str | Path, *, assessment: Assessment | None = None, pdf: bool = False
) -> None:
    """Write report.html, a page to read, print and hand in, and its figures and tables.

    Parameters
    ----------
    result : RunResult
        From `run`.
    folder : path
        It is created if it does not exist.
    assessment : Assessment, optional
        From `assess`: the page then also shows the results over the possible sites.
    pdf : bool
        Also write report.pdf.

    Raises
    ------
    InputError
        Code ``wrong_kind`` if the releases restarted a film, ``not_writable`` if the folder cannot be written.

    Examples
    --------
    >>> import rock2d
    >>> site = rock2d.load_scenario("site.yaml")  # doctest: +SKIP
    >>> rock2d.write_report(rock2d.run(site), "out/site", assessment=rock2d.assess(site))  # doctest: +SKIP"""
    from rock2d.design.report import write_report as write_page
    from rock2d.design.report_sections import REPORTED_TABLES, ReportContent
    from rock2d.errors import InputError
    from rock2d.files.folders import make_folder

    folder = Path(folder)
    if result.scenario.experiment is not None:
        message = "a report is for sites; releases restarted from a film are compared with the film instead"
        raise InputError(message, code="wrong_kind")
    tables = {name: result.to_pandas(name) for name in REPORTED_TABLES}
    make_folder(folder)
    write_page(ReportContent(result, tables, assessment), folder, "rock2d.write_report in Python", pdf)
    if assessment is not None:
        assessment.write(folder)
