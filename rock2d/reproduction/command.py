"""`rock2d reproduce`: the paper's tables and figures from the scenario of its set-up, in one command."""

from __future__ import annotations

import json
import time
import zipfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from rock2d.calibration.sequential_monte_carlo import Sample
from rock2d.files.folders import atomic_folder, make_folder
from rock2d.reproduction import published, stages
from rock2d.reproduction.passing import Known
from rock2d.reproduction.results import Results, judge
from rock2d.reproduction.stages import Effort

Array = np.ndarray
Report = Callable[[str], None]

SCENARIO = "paper_setup.yaml"


def reproduce(
    out: Path, *, seed: int, effort: Effort, candidates: bool = False, progress: bool, report: Report
) -> Results:
    """Calibrate both models, write every table and figure into the folder `out`, and say how well they agree.

    With `candidates` also try what physics the deterministic model may lack, on blocks that are left out.

    Calibrations that an interrupted call with the same seed and effort had finished are taken from a hidden folder
    beside `out`.
    """
    from rock2d_figures.all_figures import write_all

    from rock2d.files.scenario import load_scenario
    from rock2d.runs.demo import scenario_file

    begin = time.perf_counter()
    known = known_setup(load_scenario(scenario_file(SCENARIO)))
    with atomic_folder(out) as folder:
        whole = out.absolute()
        work = Work(whole.with_name(f".{whole.name}.stages"), {"seed": seed, **vars(effort)}, progress)
        results = _calibrate(known, work, effort, seed, candidates)
        write_all(results, folder, progress=progress)
    work.clear()
    for line in results.said:
        report(line)
    report(f"written: {out} in {time.perf_counter() - begin:.0f} s; open {out / 'report.md'}")
    return results


def _calibrate(known: Known, work: Work, effort: Effort, seed: int, candidates: bool) -> Results:
    seeds = np.random.SeedSequence(seed).spawn(6)
    samples = {
        "deterministic": work.sample(
            "deterministic", partial(stages.calibrate_deterministic, known, effort, seeds[0])
        ),
        "probabilistic": work.sample(
            "probabilistic", partial(stages.calibrate_probabilistic, known, effort, seeds[1])
        ),
    }
    rebound = samples["probabilistic"].u
    reduction = work.arrays(
        "slope_reduction", partial(stages.reduce_slopes, known, rebound, effort, seeds[2])
    )
    tried = {
        block: work.sample(f"without_{block}", partial(stages.try_candidates, known, block, effort, own))
        for block, own in zip(published.BLOCKS[1:], seeds[3:5], strict=True)
        if candidates
    }
    return judge(known, samples, reduction, tried, seeds[5], seed)


def known_setup(scenario: Any) -> Known:
    """Blocks, embankment and gravity of the scenario. Raises KeyError if a block of the paper is missing."""
    ground = scenario.make_cross_section()
    rise = ground.embankment
    blocks = scenario.make_blocks()
    crest = ground.points_m[rise.crest : rise.crest_end + 1, 0]
    return Known(
        {name: blocks[name] for name in published.BLOCKS}, float(rise.height_m), float(np.ptp(crest)),
        scenario.gravity_m_s2,
    )  # fmt: skip


class Work:
    """Finished calibrations, kept until all is written, each with the key it was made for."""

    def __init__(self, folder: Path, key: dict[str, Any], progress: bool) -> None:
        from rock2d.diagnosis.checkpoint import fingerprint

        self._folder, self._progress = folder, progress
        self._key = json.dumps({**key, "code": fingerprint()}, sort_keys=True)
        make_folder(folder)

    def arrays(
        self, name: str, make: Callable[[Callable[[float], None]], dict[str, Array]]
    ) -> dict[str, Array]:
        """What `make` returns, or what it returned before an interruption."""
        path = self._folder / f"{name}.npz"
        try:
            with np.load(path, allow_pickle=False) as kept:
                if str(kept["key"]) == self._key:
                    return {k: kept[k] for k in kept.files if k != "key"}
        except (OSError, ValueError, KeyError, zipfile.BadZipFile):
            pass  # nothing there that can be read
        with _percent_bar(name.replace("_", " "), self._progress) as on_progress:
            found = make(on_progress)
        unfinished = path.with_suffix(".part.npz")
        np.savez(unfinished, key=np.array(self._key), **found)  # type: ignore[arg-type]
        unfinished.replace(path)
        return found

    def sample(self, name: str, make: Callable[[Callable[[float], None]], Sample]) -> Sample:
        """As `arrays`, of a posterior."""
        found = self.arrays(name, lambda on_progress: vars(make(on_progress)))
        return Sample(found["u"], found["log_likelihood"], float(found["log_evidence"]))

    def clear(self) -> None:
        """Forget all: the results are written."""
        import shutil

        shutil.rmtree(self._folder, ignore_errors=True)


@contextmanager
def _percent_bar(what: str, shown: bool) -> Iterator[Callable[[float], None]]:
    """Give a callback (share done, 0 to 1) that drives a bar named `what`."""
    from tqdm import tqdm

    form = "{desc}: {percentage:3.0f}%|{bar}| {elapsed}"
    with tqdm(desc=what, total=100, disable=not shown, bar_format=form) as bar:

        def on_progress(share: float) -> None:
            bar.update(100 * share - bar.n)

        yield on_progress
