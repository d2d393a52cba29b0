"""Make the diagnoses of a trial: every case only from its films, in parallel; finished cases are kept.

A diagnosis is compared with films that it did not see: it predicts the held-out releases, and the share of the gap that
it truly closes is measured there."""

import json
import os
import tempfile
from collections.abc import Callable
from contextlib import closing
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np

from rock2d.arrays import Array
from rock2d.blind.case_files import CASES, FIT, HELDOUT, TWIN, TWIN_FIT
from rock2d.cluster import Workers, as_finished_on_cluster, require_dask
from rock2d.diagnosis.attribution import Attribution
from rock2d.diagnosis.base_law import fit_base
from rock2d.diagnosis.budget import ResidualSizes
from rock2d.diagnosis.data import Data, FilmData, Residuals
from rock2d.diagnosis.diagnose import check_and_segment, diagnose
from rock2d.diagnosis.diagnosis_content import diagnosis_json
from rock2d.diagnosis.learnt import Learnt, residuals_on
from rock2d.diagnosis.predict import predict
from rock2d.diagnosis.predicted_gap import TAIL_PERCENTILE, replicate_misses
from rock2d.diagnosis.replay import Segments
from rock2d.errors import InputError
from rock2d.files.experiment import Experiment, load_experiment
from rock2d.files.folders import make_folder, temporary_folder, write_whole
from rock2d.kinematics.sanity import Sanity
from rock2d.kinematics.setup_world import base_law_start, setup_world
from rock2d.processes import as_finished
from rock2d.scene.world import World

RESULTS = "results"
LEAST_NOISE = 1e-9  # m and rad, for a camera without stated noise
# smallest ratio of the gap of the base law to the floor for which the share that is closed is computed
LEAST_GAP_RATIO = 1.03


def run_cases(
    folder: Path,
    count: int,
    do: Callable[[Path, Path, Path], None],
    workers: Workers,
    on_progress: Callable[[int, int], None],
) -> Path:
    """Do the work for every case of a folder that has no result yet; returns the folder of the results,
    results/NNN.json each.

    `do`: function of a folder for temporary files, the case, and the file of its result"""
    if workers.scheduler is not None:
        require_dask()
    out = folder / RESULTS
    make_folder(out)
    names = [f"{i:03d}" for i in range(count)]
    waiting = [name for name in names if not (out / f"{name}.json").is_file()]
    on_progress(count - len(waiting), count)
    cases, absolute = (folder / CASES).absolute(), out.absolute()  # a worker may run in another folder
    jobs = [(cases / name, absolute / f"{name}.json") for name in waiting]
    with temporary_folder(out) as fits:
        if workers.scheduler is None:
            finished = as_finished(do, jobs, workers.processes or os.cpu_count() or 1, (fits,))
        else:
            finished = as_finished_on_cluster(do, jobs, workers.scheduler, (fits,), fits)
        with closing(finished) as diagnosed:
            for k, _ in enumerate(diagnosed):
                on_progress(count - len(waiting) + k + 1, count)
    return out


def diagnose_trial_case(every_fit: Path, case: Path, out: Path) -> None:
    """Diagnose case/fit, test the model on case/heldout, and write one JSON file. The labels stay closed, and a
    diagnosis sees no twin.

    `every_fit`: folder below which temporary files may be written."""
    experiment = load_experiment(case / FIT)
    begin = perf_counter()
    with tempfile.TemporaryDirectory(dir=every_fit) as fits:
        result = diagnose(experiment, folder=Path(fits))
        content = diagnosis_json(result)
        seconds = perf_counter() - begin
        kept: dict[str, Any] = {"diagnosis": content, "seconds": seconds}
        if result.found is not None:
            heldout = load_experiment(case / HELDOUT)
            *_, held = _segmented(heldout)
            kept["heldout"] = _heldout(heldout, held, content, result.found.learnt)
            kept["true_closure"] = true_closure(case, held, result.found)
    write_whole(out, json.dumps(kept, indent=1) + "\n")


def _heldout(experiment: Experiment, data: Data | None, content: dict[str, Any], learnt: Learnt) -> dict[str, float]:
    """Misses of the predicted film for the base law and the diagnosed model: median and 95th percentile (`*_tail`) over
    segments of the root mean square of place and angle, in standard deviations of the camera's noise; and the `floor`,
    the median miss of replicates of these segments by the diagnosed model `learnt`."""
    assert experiment.trajectories is not None
    stated = [experiment.position_noise_m, experiment.position_noise_m, experiment.angle_noise_rad]
    noise = np.maximum(data.film.noise if isinstance(data, FilmData) else stated, LEAST_NOISE)  # as the claims
    out = dict[str, float]()
    for name, base_only in (("base", True), ("diagnosed", False)):
        try:
            predicted = predict(experiment, content, base_only=base_only)
        except InputError:
            return {}
        both = predicted.merge(experiment.trajectories, on=["release", "t_s"], suffixes=("", "_seen")).dropna()
        turn = np.angle(np.exp(1j * (both["theta_rad"] - both["theta_rad_seen"])))
        apart = (both["x_m"] - both["x_m_seen"], both["y_m"] - both["y_m_seen"], turn)
        square = sum((miss / own) ** 2 for miss, own in zip(apart, noise, strict=True))
        segments = np.sqrt((square / 3.0).groupby([both["release"], both["segment"]]).mean())
        if segments.empty:
            return {}
        out |= {name: float(segments.median()), f"{name}_tail": float(segments.quantile(TAIL_PERCENTILE / 100.0))}
    if isinstance(data, FilmData) and len(segments := Segments.of(data)):
        out["floor"] = float(np.median(replicate_misses(data, segments, learnt, seed=0)))
    return out


def true_closure(case: Path, held: Data | None, found: Attribution) -> float | None:
    """The share of the gap that is truly closed; None if there is no gap, the case has no twin, or one of its films
    cannot be segmented.

    The base law and the model with all causes and learnt changes, `found`, predict the held-out releases of a case. The
    gap of a perfect model is known from the null twin, the same releases without the hidden causes: the base law,
    fitted to the other twin, has there only the errors of noise, soil and form of the law. The gap is measured as in
    the diagnosis.
    """
    if not (case / TWIN).is_dir():
        return None
    (setup, start, sanity, data), (*_, twin) = (_segmented(load_experiment(case / name)) for name in (TWIN_FIT, TWIN))
    if data is None or held is None or twin is None:
        return None
    null = fit_base(setup, start, data, sanity.registered)
    variance = _typical_variance(found.final.fit.covariance())
    base = _gap(held, found.base.fit.model.residuals(found.base.fit.p, held), variance)
    closed = _gap(held, residuals_on(held, found.learnt), variance)
    floor = _gap(twin, null.model.residuals(null.p, twin), variance)
    return (base - closed) / (base - floor) if base > LEAST_GAP_RATIO * floor else None


def _typical_variance(covariance: Array) -> Array:
    """(d,) medians of the variances of n impacts, from their covariances (n, d, d); NaN without impacts: then all
    residuals of impacts count as equally large."""
    variance = np.diagonal(covariance, axis1=1, axis2=2)
    return np.asarray(np.median(variance, axis=0) if len(variance) else np.full(variance.shape[1], np.nan))


def _gap(data: Data, residuals: Residuals, variance: Array) -> float:
    """Gap of residuals; `variance` (d,) of the channels of impacts."""
    sizes = ResidualSizes(data, np.diag(variance) * np.ones((len(data.impact_release), 1, 1)))
    return float(np.exp(sizes.of(residuals).sum() / sizes.count.sum()))


def _segmented(experiment: Experiment) -> tuple[World, Array, Sanity, Data | None]:
    """The stated world of a film, its base law, and the result of `check_and_segment`."""
    setup = setup_world(experiment)
    return setup, base_law_start(experiment), *check_and_segment(experiment, setup)
