"""Films and experiments for Python programs: thin functions over `rock2d_tracking` and `rock2d.diagnosis`."""

from __future__ import annotations

import copy
import json
import math
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from rock2d.errors import InputError
from rock2d.files.experiment import load_experiment

if TYPE_CHECKING:
    import pandas as pd
    from rock2d_tracking.film_tracking import FilmTrack

    from rock2d.diagnosis.diagnose import Diagnosis
    from rock2d.files.experiment import Experiment

IMPACTS_SHOWN = 8  # impacts that a notebook shows
LIKELIEST_SHOWN = 5  # effects that a notebook shows


@dataclass(frozen=True, repr=False)
class TrackResult:
    """The tracked blocks of a film; returned by `track`.

    Attributes
    ----------
    found : all results of the tracker"""

    found: FilmTrack

    @property
    def experiment(self) -> Experiment:
        """The frames that can be trusted, which `diagnose` takes."""
        return self.found.film.experiment

    @property
    def flights(self) -> pd.DataFrame:
        """One row for each flight: release, block, begin_s, end_s, frames, state at t_s with standard errors, misfit
        (residual of the parabola fit over the noise), gravity_m_s2 and its error."""
        return self.found.film.flights.copy()

    @property
    def impacts(self) -> pd.DataFrame:
        """One row for each impact: release, block, t_s, zone, velocities before and after with standard errors, normal
        restitution, penetration_m, rebound_m, flag."""
        return self.found.film.impacts.copy()

    @property
    def remarks(self) -> list[str]:
        """Findings about the film itself and remarks on the track, in sentences."""
        return [*self.found.film.findings.sentences(), *self.found.film.remarks]

    def to_pandas(self) -> pd.DataFrame:
        """Every frame in which a release was followed.

        Returns
        -------
        pandas.DataFrame
            release, block, frame (of the film), t_s (of the release); u_px, v_px, angle_px_rad in the picture with
            standard errors; confidence; reason ("" if the frame is trusted); x_m, y_m, theta_rad. These three are NaN
            in frames that are not trusted; theta_rad is also NaN if no angle is visible."""
        return self.found.film.frames.copy()

    def write(self, folder: str | Path) -> None:
        """Write the folder of `rock2d track`: experiment, tables, set-up file, overlay video and tracking.html.

        Raises
        ------
        InputError
            Code ``not_a_result`` if the folder exists and is not a result of rock2d, ``not_writable`` if it cannot be
            written."""
        self.found.write(Path(folder))

    def view(self) -> Path:
        """Open tracking.html in the browser; returns its path, in a temporary folder."""
        from rock2d_tracking.film_tracking import PAGE

        from rock2d.graphics.pages import view

        return view(self.found.write_page, PAGE)

    def __repr__(self) -> str:
        return f"<TrackResult of {self.experiment.name}: {self.found.counts()}>"

    def _repr_html_(self) -> str:
        from rock2d.graphics.pages import notebook_table

        columns = ["release", "t_s", "zone", "restitution", "restitution_se", "flag"]
        said = (f"{self.experiment.name}: {self.found.counts()}", *self.remarks)
        impacts = self.found.film.impacts[columns].head(IMPACTS_SHOWN)
        return "".join(f"<p>{escape(text)}</p>" for text in said) + (notebook_table(impacts) if len(impacts) else "")


def track(
    film: str | Path,
    setup: Mapping[str, Any] | str | Path | None = None,
    *,
    metres_per_pixel: float | Literal["gravity"] | None = None,
    fps: float | Literal["gravity"] | None = None,
    frames: int | None = None,
    explained: str | Path | None = None,
    progress: bool = False,
) -> TrackResult:
    """Track the blocks in a film.

    Parameters
    ----------
    film : path
        Any format that FFmpeg reads.
    setup : dict or path, optional
        The keys of a set-up file, or the file.
    metres_per_pixel, fps : float or "gravity", optional
        Instead of `setup`: the scale, and the frames per second of the recording. They are enough for a first track.
        One of them may be "gravity": then it is computed from the fall of the blocks.
    frames : int, optional
        Number of frames to track; default: all.
    explained : path, optional
        Folder for an explanation if the film cannot be tracked.
    progress : bool
        Show a progress bar.

    Returns
    -------
    TrackResult
        Frames, flights and impacts; its `TrackResult.experiment` can be diagnosed.

    Raises
    ------
    InputError
        If the film cannot be read or tracked, or the set-up or a number makes no sense.

    Examples
    --------
    >>> import rock2d
    >>> found = rock2d.track("film.mp4", metres_per_pixel=0.0025, fps=30)  # doctest: +SKIP
    >>> found.to_pandas()[["release", "t_s", "x_m", "y_m", "reason"]]  # doctest: +SKIP
    >>> found.view()  # doctest: +SKIP
    >>> diagnosis = rock2d.diagnose(found.experiment)  # doctest: +SKIP"""
    from rock2d_tracking import FROM_GRAVITY
    from rock2d_tracking.film_tracking import NotTrackedError, track_film

    scale = [value for value in (metres_per_pixel, fps) if value is not None]
    if len(scale) != (2 if setup is None else 0):
        raise InputError("expected either setup, or metres_per_pixel and fps", code="wrong_kind")
    if scale == [FROM_GRAVITY, FROM_GRAVITY]:
        raise InputError("gravity gives metres_per_pixel or fps, not both", code="bad_parameter", key="fps")
    for name, value in {"metres_per_pixel": metres_per_pixel, "fps": fps, "frames": frames}.items():
        number = isinstance(value, (int, float)) and math.isfinite(value) and value > 0
        not_a_number = value is None or (value == FROM_GRAVITY and name != "frames")
        if not (not_a_number or number):
            raise InputError(f"expected {name} > 0, found {value!r}", code="bad_parameter", key=name)
    try:
        return TrackResult(track_film(Path(film), _setup_or_scale(setup, scale), frames, progress=progress)[0])
    except NotTrackedError as error:
        if explained is not None:
            error.write(Path(explained))
        raise


def _setup_or_scale(setup: Mapping[str, Any] | str | Path | None, scale: Sequence[float | str]) -> Any:
    """Input of the tracker: a `Setup`, or a `FilmScale` of scale and frame rate."""
    from rock2d_tracking import FROM_GRAVITY
    from rock2d_tracking.film_scale import FilmScale
    from rock2d_tracking.setup_file import Setup

    from rock2d.files.checked_yaml import yaml_text

    if setup is None:
        metres_per_pixel, fps = (None if value == FROM_GRAVITY else float(value) for value in scale)
        return FilmScale(metres_per_pixel, fps)
    if not isinstance(setup, Mapping):
        return Setup(setup)
    try:
        # convert numpy arrays and scalars to lists and numbers
        plain = json.loads(json.dumps(dict(setup), default=lambda value: value.tolist()))
    except (TypeError, ValueError, AttributeError) as error:
        raise InputError(
            f"the set-up contains a value that a set-up file cannot contain: {error}", code="wrong_kind"
        ) from None
    try:
        return Setup("setup", yaml_text(plain))
    except InputError as error:  # without line and column, because there is no file
        raise InputError(error.message, "setup", code=error.code, **error.fields) from None


@dataclass(frozen=True, repr=False)
class DiagnosisResult:
    """The result of a diagnosis; returned by `diagnose`.

    Attributes
    ----------
    diagnosis : all results of the diagnosis
    content : content of diagnosis.json; `to_dict` returns a copy"""

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
        """One row for each answer, most probable first.

        Returns
        -------
        pandas.DataFrame
            effect, probability, heldout_score_gain and heldout_score_gain_se (log likelihood on held-out releases,
            against the base law), closure, closure_low95 and closure_high95 (share of the gap closed). Answers that
            were not fitted have no gain and no closure."""
        import pandas as pd

        fitted = ("heldout_score_gain", "heldout_score_gain_se", "closure")
        columns = ["effect", "probability", *fitted, "closure_low95", "closure_high95"]
        rows = []
        for name, probability in self.probabilities.items():
            found = self.content["effects"].get(name, {})
            interval = found.get("closure_ci95", (None, None))
            rows.append((name, probability, *map(found.get, fitted), *interval))
        table = pd.DataFrame(rows, columns=columns).astype(dict.fromkeys(columns[1:], float))
        return table.sort_values("probability", ascending=False, kind="stable", ignore_index=True)

    def write(self, folder: str | Path, *, progress: bool = False) -> None:
        """Write diagnosis.json and report.html into `folder`, which is created if it does not exist.

        Raises
        ------
        InputError
            Code ``not_writable`` if the folder cannot be written."""
        from rock2d.diagnosis.report.page import write_report
        from rock2d.files.diagnosis import DIAGNOSIS, diagnosis_text
        from rock2d.files.folders import make_folder, write_whole
        from rock2d.progress import Bars

        folder, content = Path(folder), self.to_dict()
        text = diagnosis_text(content)
        make_folder(folder)
        write_report(self.diagnosis, content, folder, bars=Bars(progress))
        write_whole(folder / DIAGNOSIS, text)

    def view(self) -> Path:
        """Open report.html in the browser; returns its path, in a temporary folder."""
        from rock2d.diagnosis.report.page import PAGE
        from rock2d.graphics.pages import view

        return view(self.write, PAGE)

    def __repr__(self) -> str:
        likeliest = sorted(self.probabilities.items(), key=lambda item: -item[1])[:LIKELIEST_SHOWN]
        answers = ", ".join(f"{name} {p:.2f}" for name, p in likeliest)
        return f"<DiagnosisResult of {self.content['experiment']}: {self.verdict}\n probabilities: {answers}>"

    def _repr_html_(self) -> str:
        from rock2d.graphics.pages import notebook_table

        shown = notebook_table(self.to_pandas().head(LIKELIEST_SHOWN))
        return f"<p>{escape(str(self.content['experiment']))}: <b>{escape(self.verdict)}</b></p>{shown}"


def diagnose(
    experiment: Experiment | str | Path, *, seed: int = 0, workers: int | None = None, progress: bool = False
) -> DiagnosisResult:
    """Find where the simulation of an experiment is wrong and which effect it lacks.

    Every effect of the `catalogue` is fitted together with the base law and tested on releases that the fit did not
    use. This takes minutes.

    Parameters
    ----------
    experiment : Experiment or path
        An experiment, or its folder.
    seed : int
        Seed of the bootstrap intervals.
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
        If the folder is not a valid experiment.

    Examples
    --------
    >>> import rock2d
    >>> found = rock2d.diagnose("experiments/drops")  # doctest: +SKIP
    >>> found.verdict  # doctest: +SKIP
    'air_drag'
    >>> found.write("out/drops")  # doctest: +SKIP"""
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
        If the experiment has no trajectories or fails its sanity checks, or if the file is not a diagnosis."""
    from rock2d.diagnosis.predict import predict as predict_segments
    from rock2d.diagnosis.predict import read_for_prediction

    if isinstance(diagnosis, DiagnosisResult):
        content = diagnosis.to_dict()
    else:
        content = dict(diagnosis) if isinstance(diagnosis, Mapping) else read_for_prediction(diagnosis)
    return predict_segments(_loaded(experiment), content, base_only=base_only)


def _loaded(experiment: Experiment | str | Path) -> Experiment:
    return load_experiment(experiment) if isinstance(experiment, (str, Path)) else experiment
