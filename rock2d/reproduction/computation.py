"""All calibrations of a reproduction and the predictions made from them."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from rock2d.arrays import Array
from rock2d.calibration.sequential_monte_carlo import Sample
from rock2d.files.folders import make_folder
from rock2d.files.saved_arrays import fingerprint, load_arrays, save_arrays
from rock2d.progress import Bars
from rock2d.reproduction import calibrations, published
from rock2d.reproduction.arrival_results import ArrivalStages
from rock2d.reproduction.calibrations import Effort
from rock2d.reproduction.missing_effects import deterministic_candidates, probabilistic_candidates
from rock2d.reproduction.results import Results, evaluate
from rock2d.reproduction.table_3_readings import compute_readings

OnProgress = Callable[[float], None]

PREDICTIONS, FIGURES = "predictions", "figures"  # stages after the calibrations

# calibration -> relative duration with this effort, for the progress bars
WORK_EFFORT = Effort(96, 16)
WORK = {
    "deterministic": 1.2, "probabilistic": 1.3, "slope_reduction": 0.5, "without_cube": 2.0,
    "without_parallelepiped": 2.0, "arrivals": 2.3, "missing_effects_deterministic": 4.2,
    "missing_effects_probabilistic": 0.5, "table_3_readings": 0.7,
}  # fmt: skip


def reproduction_bars(shown: bool, effort: Effort, candidates: bool) -> Bars:
    """The progress bars of a reproduction."""
    hypotheses, releases = effort.hypotheses / WORK_EFFORT.hypotheses, effort.releases / WORK_EFFORT.releases
    work = {
        stage_title(name): hypotheses * releases * own
        for name, own in WORK.items()
        if candidates or not name.startswith("without_")
    }
    return Bars(shown, {**work, PREDICTIONS: 3.0 * hypotheses, FIGURES: 1.0})


def stage_title(name: str) -> str:
    """The title of the progress bar of a calibration."""
    return name.replace("_", " ")


def compute_results(
    finished: FinishedStages, bars: Bars, *, seed: int, effort: Effort, candidates: bool = False
) -> Results:
    """Calibrate both models and predict the three blocks; stages in `finished` are not computed again.

    With `candidates`, the deterministic model with candidate effects is also calibrated, with held-out blocks."""
    seeds = np.random.SeedSequence(seed).spawn(10)
    samples = {
        "deterministic": finished.sample(
            "deterministic", partial(calibrations.calibrate_deterministic, effort, seeds[0])
        ),
        "probabilistic": finished.sample(
            "probabilistic", partial(calibrations.calibrate_probabilistic, effort, seeds[1])
        ),
    }
    rebound = samples["probabilistic"].u
    reduction = finished.arrays(
        "slope_reduction", partial(calibrations.calibrate_slope_reductions, rebound, effort, seeds[2])
    )
    held_out = {
        block: finished.sample(f"without_{block}", partial(calibrations.calibrate_candidates, block, effort, own))
        for block, own in zip(published.BLOCKS[1:], seeds[3:5], strict=True)
        if candidates
    }
    arrivals = finished.sample("arrivals", partial(calibrations.calibrate_with_arrivals, effort, seeds[6]))
    missing = {
        model: finished.arrays(f"missing_effects_{model}", partial(compute, arrivals.u, effort, own))
        for model, compute, own in (
            ("deterministic", deterministic_candidates, seeds[7]),
            ("probabilistic", probabilistic_candidates, seeds[8]),
        )
    }
    readings = finished.arrays("table_3_readings", partial(compute_readings, effort, seeds[9]))
    found = ArrivalStages(arrivals, missing, readings)
    with bars.stage(PREDICTIONS, 1, "step") as bar:
        results = evaluate(samples, reduction, held_out, found, seeds[5], seed)
        bar.update()
    return results


class FinishedStages:
    """Results of finished calibrations in a folder, each with its key: seed, effort and fingerprint of the code."""

    def __init__(self, folder: Path, key: dict[str, Any], bars: Bars) -> None:
        self._folder, self._bars = folder, bars
        self._key = json.dumps({**key, "code": fingerprint()}, sort_keys=True)
        make_folder(folder)

    def arrays(self, name: str, compute: Callable[[OnProgress], dict[str, Array]]) -> dict[str, Array]:
        """The result of `compute`, or its saved result from before an interruption."""
        path = self._folder / f"{name}.npz"
        kept = load_arrays(path)
        if kept is not None and str(kept.pop("key", "")) == self._key:
            return kept
        with self._bars.stage(stage_title(name), 100, "%") as bar:
            found = compute(lambda share: bar.reach(round(100 * share), 100))
        save_arrays(path, key=np.array(self._key), **found)
        return found

    def sample(self, name: str, compute: Callable[[OnProgress], Sample]) -> Sample:
        """As `arrays`, for a posterior."""
        found = self.arrays(name, lambda on_progress: vars(compute(on_progress)))
        return Sample(found["u"], found["log_likelihood"], float(found["log_evidence"]))

    def clear(self) -> None:
        """Delete the folder."""
        shutil.rmtree(self._folder, ignore_errors=True)
