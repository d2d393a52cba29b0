"""All calibrations of a reproduction and the predictions made from them."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from rock2d.calibration.sequential_monte_carlo import Sample
from rock2d.files.folders import make_folder
from rock2d.files.saved_arrays import fingerprint, load_arrays, save_arrays
from rock2d.files.scenario import load_scenario
from rock2d.files.shipped_scenarios import scenario_file
from rock2d.reproduction import published, stages
from rock2d.reproduction.arrival_results import ArrivalStages
from rock2d.reproduction.arrivals import calibrate_with_arrivals
from rock2d.reproduction.hypotheses import known_setup
from rock2d.reproduction.missing_effects import deterministic_candidates, point_mass_candidates
from rock2d.reproduction.results import Results, evaluate
from rock2d.reproduction.stages import Effort
from rock2d.reproduction.table_3_readings import readings_computed

Array = np.ndarray
OnProgress = Callable[[float], None]

SCENARIO = "paper_setup.yaml"


def compute_results(
    finished: FinishedStages, *, seed: int, effort: Effort, candidates: bool = False
) -> Results:
    """Calibrate both models and predict the three blocks; stages that `finished` holds are not computed again.

    With `candidates` also the deterministic model with candidate effects, on held-out blocks.
    """
    known = known_setup(load_scenario(scenario_file(SCENARIO)))
    seeds = np.random.SeedSequence(seed).spawn(10)
    samples = {
        "deterministic": finished.sample(
            "deterministic", partial(stages.calibrate_deterministic, known, effort, seeds[0])
        ),
        "probabilistic": finished.sample(
            "probabilistic", partial(stages.calibrate_probabilistic, known, effort, seeds[1])
        ),
    }
    rebound = samples["probabilistic"].u
    reduction = finished.arrays(
        "slope_reduction", partial(stages.calibrate_slope_reductions, known, rebound, effort, seeds[2])
    )
    held_out = {
        block: finished.sample(
            f"without_{block}", partial(stages.calibrate_candidates, known, block, effort, own)
        )
        for block, own in zip(published.BLOCKS[1:], seeds[3:5], strict=True)
        if candidates
    }
    arrivals = finished.sample("arrivals", partial(calibrate_with_arrivals, known, effort, seeds[6]))
    missing = {
        model: finished.arrays(f"missing_effects_{model}", partial(compute, known, arrivals.u, effort, own))
        for model, compute, own in (
            ("deterministic", deterministic_candidates, seeds[7]),
            ("probabilistic", point_mass_candidates, seeds[8]),
        )
    }
    readings = finished.arrays("table_3_readings", partial(readings_computed, known, effort, seeds[9]))
    found = ArrivalStages(arrivals, missing, readings)
    return evaluate(known, samples, reduction, held_out, found, seeds[5], seed)


class FinishedStages:
    """Results of finished calibrations in a folder, each with the key (seed, effort, code) that it belongs to."""

    def __init__(self, folder: Path, key: dict[str, Any], progress: bool) -> None:
        self._folder, self._progress = folder, progress
        self._key = json.dumps({**key, "code": fingerprint()}, sort_keys=True)
        make_folder(folder)

    def arrays(self, name: str, compute: Callable[[OnProgress], dict[str, Array]]) -> dict[str, Array]:
        """What `compute` returns, or what it returned before an interruption."""
        path = self._folder / f"{name}.npz"
        kept = load_arrays(path)
        if kept is not None and str(kept.pop("key", "")) == self._key:
            return kept
        with _percent_bar(name.replace("_", " "), self._progress) as on_progress:
            found = compute(on_progress)
        save_arrays(path, key=np.array(self._key), **found)
        return found

    def sample(self, name: str, compute: Callable[[OnProgress], Sample]) -> Sample:
        """As `arrays`, of a posterior."""
        found = self.arrays(name, lambda on_progress: vars(compute(on_progress)))
        return Sample(found["u"], found["log_likelihood"], float(found["log_evidence"]))

    def clear(self) -> None:
        """Remove the folder, once the results are written."""
        shutil.rmtree(self._folder, ignore_errors=True)


@contextmanager
def _percent_bar(title: str, shown: bool) -> Iterator[OnProgress]:
    """Give a callback (share done, 0 to 1) that drives a progress bar."""
    from tqdm import tqdm

    form = "{desc}: {percentage:3.0f}%|{bar}| {elapsed}"
    with tqdm(desc=title, total=100, disable=not shown, bar_format=form) as bar:

        def on_progress(share: float) -> None:
            bar.update(100 * share - bar.n)

        yield on_progress
