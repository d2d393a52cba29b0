"""Design, diagnosis and prediction for Python programs: thin functions over `rock2d.design` and `rock2d.diagnosis`."""

from __future__ import annotations

import copy
import os
from collections.abc import Mapping
from dataclasses import dataclass
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rock2d.files.experiment import load_experiment

if TYPE_CHECKING:
    import pandas as pd

    from rock2d.design.assessment import Assessment
    from rock2d.design.least_size import Answer, Target
    from rock2d.diagnosis.diagnose import Diagnosis
    from rock2d.files.experiment import Experiment
    from rock2d.files.scenario import Scenario
    from rock2d.runs.results import RunResult

LIKELIEST_SHOWN = 5  # effects that a notebook shows


@dataclass(frozen=True, repr=False)
class DiagnosisResult:
    """What a diagnosis found; made by `diagnose`.

    Attributes
    ----------
    diagnosis : everything that the diagnosis computed
    content : what diagnosis.json holds; `to_dict` gives a copy
    """

    diagnosis: Diagnosis
    content: Mapping[str, Any]

    @property
    def verdict(self) -> str:
        """The likeliest single answer: an effect of the catalogue, "none" or "unknown"."""
        return str(self.content["verdict"])

    @property
    def probabilities(self) -> dict[str, float]:
        """Probability of "none", of "unknown" and of each effect; their sum is 1."""
        return dict(self.content["probabilities"])

    def to_dict(self) -> dict[str, Any]:
        """The content of diagnosis.json."""
        return copy.deepcopy(dict(self.content))

    def to_pandas(self) -> pd.DataFrame:
        """One row for each answer, likeliest first.

        Returns
        -------
        pandas.DataFrame
            effect, probability, heldout_score_gain and heldout_score_gain_se (log likelihood on held-out releases,
            against the base law), closure, closure_low95 and closure_high95 (share of the gap closed). Answers that
            were not fitted have no gain and no closure.
        """
        import pandas as pd

        rows = []
        for name, probability in self.probabilities.items():
            found = self.content["effects"].get(name, {})
            low, high = found.get("closure_ci95", (None, None))
            rows.append(
                {
                    "effect": name,
                    "probability": probability,
                    "heldout_score_gain": found.get("heldout_score_gain"),
                    "heldout_score_gain_se": found.get("heldout_score_gain_se"),
                    "closure": found.get("closure"),
                    "closure_low95": low,
                    "closure_high95": high,
                }
            )
        table = pd.DataFrame(rows)
        table = table.astype({column: float for column in table.columns if column != "effect"})
        return table.sort_values("probability", ascending=False, kind="stable", ignore_index=True)

    def write(self, folder: str | Path, *, progress: bool = False) -> None:
        """Write diagnosis.json and report.html into `folder`, which is made if it is not there.

        Raises
        ------
        InputError
            Code ``not_writable`` if the folder cannot be written.
        """
        from rock2d.diagnosis.report.page import write_report
        from rock2d.files.diagnosis import DIAGNOSIS, diagnosis_text
        from rock2d.files.folders import make_folder, write_whole
        from rock2d.progress import Bars

        folder, content = Path(folder), self.to_dict()
        text = diagnosis_text(content)
        make_folder(folder)
        write_report(self.diagnosis, content, folder, bars=Bars(progress))
        write_whole(folder / DIAGNOSIS, text)

    def __repr__(self) -> str:
        likeliest = sorted(self.probabilities.items(), key=lambda item: -item[1])[:LIKELIEST_SHOWN]
        answers = ", ".join(f"{name} {p:.2f}" for name, p in likeliest)
        return f"<DiagnosisResult of {self.content['experiment']}: {self.verdict}\n probabilities: {answers}>"

    def _repr_html_(self) -> str:
        from rock2d.graphics.notebook import table_html

        shown = table_html(self.to_pandas().head(LIKELIEST_SHOWN))
        return f"<p>{escape(str(self.content['experiment']))}: <b>{escape(self.verdict)}</b></p>{shown}"


def diagnose(
    experiment: Experiment | str | Path,
    *,
    seed: int = 0,
    workers: int | None = None,
    progress: bool = False,
) -> DiagnosisResult:
    """Say where the simulation of an experiment is wrong and which effect it misses.

    Every effect of the `catalogue` is fitted together with the base law and tested on releases that the fit did not
    use. This takes minutes.

    Parameters
    ----------
    experiment : Experiment or path
        An experiment, or its folder.
    seed : int
        Of the bootstrap intervals.
    workers : int, optional
        Processes; default: all cores. Results do not depend on it.
    progress : bool
        Show a progress bar.

    Returns
    -------
    DiagnosisResult
        The verdict, the probabilities and a table of the effects; `DiagnosisResult.write` writes the report.

    Raises
    ------
    InputError
        If the folder holds no valid experiment.

    Examples
    --------
    >>> import rock2d
    >>> found = rock2d.diagnose("experiments/drops")  # doctest: +SKIP
    >>> found.verdict  # doctest: +SKIP
    'air_drag'
    >>> found.write("out/drops")  # doctest: +SKIP
    """
    from rock2d.diagnosis.diagnose import diagnose as run_diagnosis
    from rock2d.diagnosis.diagnosis_content import diagnosis_json
    from rock2d.diagnosis.workload import DiagnosisBars
    from rock2d.effects import catalogue
    from rock2d.processes import check_not_imported

    processes = workers or os.cpu_count() or 1
    if processes > 1:
        check_not_imported()
    read = _loaded(experiment)
    bars = DiagnosisBars(progress, len(catalogue()), processes)
    found = run_diagnosis(read, seed=seed, workers=processes, bars=bars)
    return DiagnosisResult(found, diagnosis_json(found))


def predict(
    experiment: Experiment | str | Path,
    diagnosis: DiagnosisResult | Mapping[str, Any] | str | Path,
    *,
    base_only: bool = False,
) -> pd.DataFrame:
    """Predict every segment of an experiment from the flight before it, with a diagnosed model.

    Parameters
    ----------
    experiment : Experiment or path
        An experiment with trajectories of the same set-up, or its folder.
    diagnosis : DiagnosisResult, dict or path
        From `diagnose`, its `to_dict`, or a diagnosis.json.
    base_only : bool
        Use the refitted base law without the diagnosed effect.

    Returns
    -------
    pandas.DataFrame
        release, block, segment, t_s, x_m, y_m, theta_rad at the recorded frames.

    Raises
    ------
    InputError
        If the experiment has no trajectories or fails its sanity checks, or the file is no diagnosis.
    """
    from rock2d.diagnosis.predict import predict as predict_segments
    from rock2d.diagnosis.predict import read_for_prediction

    if isinstance(diagnosis, DiagnosisResult):
        content = diagnosis.to_dict()
    else:
        content = dict(diagnosis) if isinstance(diagnosis, Mapping) else read_for_prediction(diagnosis)
    return predict_segments(_loaded(experiment), content, base_only=base_only)


def _loaded(experiment: Experiment | str | Path) -> Experiment:
    return load_experiment(experiment) if isinstance(experiment, (str, Path)) else experiment


def assess(
    scenario: Scenario, *, engine: str | None = None, seed: int | None = None, progress: bool = False
) -> Assessment:
    """Simulate the possible sites of a scenario: tell sampling and what is not known apart.

    Parameters
    ----------
    scenario : Scenario
        From `load_scenario`, with the key ``uncertainty`` and a measure line.
    engine : {"batch", "point_mass", "pymunk"}, optional
        Instead of the scenario's; "pymunk" is computed with "batch", which has the same law.
    seed : int, optional
        Seed of every random draw, instead of the scenario's.
    progress : bool
        Show a progress bar.

    Returns
    -------
    Assessment
        Tables over the sites and a tornado figure; `Assessment.write` writes them.

    Raises
    ------
    InputError
        Code ``missing_key`` if the scenario has no ``uncertainty``; also if a drawn value makes no sense.

    Examples
    --------
    >>> import rock2d
    >>> site = rock2d.load_scenario("site.yaml")  # doctest: +SKIP
    >>> found = rock2d.assess(site)  # doctest: +SKIP
    >>> found.uncertain[["block", "line", "quantity", "value", "low95", "high95"]]  # doctest: +SKIP
    """
    from rock2d.design.assessment import assess as assess_sites

    return assess_sites(
        scenario, engine or scenario.engine, scenario.seed if seed is None else seed, progress
    )


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
    """Find the least size that keeps blocks back, over sampling and all that is not known.

    Parameters
    ----------
    scenario : Scenario
        From `load_scenario`.
    place : str
        Of the number whose least value is sought, for example ``"embankment.height_m"``.
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
        `Answer.least` is None if no value of the range meets the target. `variant` makes the scenario of a size.

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
    >>> rock2d.write_report(rock2d.run(least), "out/least")  # doctest: +SKIP
    """
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
    result: RunResult, folder: str | Path, *, assessment: Assessment | None = None, pdf: bool = False
) -> None:
    """Write report.html, a page to read, print and hand in, with its figures and tables.

    Parameters
    ----------
    result : RunResult
        From `run`.
    folder : path
        It is made if it is not there.
    assessment : Assessment, optional
        From `assess`: the page then also says what the possible sites do.
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
    >>> rock2d.write_report(rock2d.run(site), "out/site", assessment=rock2d.assess(site))  # doctest: +SKIP
    """
    from rock2d.design.report import REPORTED_TABLES, ReportContent
    from rock2d.design.report import write_report as write_page
    from rock2d.errors import InputError
    from rock2d.files.folders import make_folder
    from rock2d.runs.resolution import unresolved_remarks

    scenario, folder = result.scenario, Path(folder)
    if scenario.experiment is not None:
        message = "a report is for sites; releases that restart a film are compared with it instead"
        raise InputError(message, code="wrong_kind")
    tables = {name: result.to_pandas(name) for name in REPORTED_TABLES}
    remarks = unresolved_remarks(tables, scenario.longest_release_s())
    make_folder(folder)
    found = ReportContent(scenario, result, tables, remarks, assessment)
    write_page(found, folder, "rock2d.write_report in Python", pdf)
    if assessment is not None:
        assessment.write(folder)
