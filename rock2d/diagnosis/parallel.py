"""Fits of models in several processes. The result does not depend on their number."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Sequence
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path

from rock2d.diagnosis.checkpoint import load_fit, save_fit
from rock2d.diagnosis.cross_validation import HeldOut, cross_validate
from rock2d.diagnosis.data import Data
from rock2d.diagnosis.exploring import fit_effects
from rock2d.diagnosis.fitting import Fit
from rock2d.diagnosis.model import Model
from rock2d.effects import catalogue
from rock2d.processes import as_finished
from rock2d.scene.world import World

Result = tuple[Fit, HeldOut]


@dataclass
class Job:
    """Set-up, data and the fit to start from; every process needs them."""

    setup: World
    data: Data
    start: Fit
    folder: Path | None = None  # for finished fits, if they are kept


def try_effects(job: Job, names: tuple[str, ...]) -> Result:
    """Fit the model with these effects and cross-validate it, or read the result if it exists."""
    known = catalogue()
    model = Model(job.setup, job.start.model.base, [known[name] for name in names], job.start.p)
    start = hashlib.sha256(job.start.p.tobytes()).hexdigest()[:8]
    path = job.folder / f"{'+'.join(names)}_{start}.npz" if job.folder is not None else None
    if path is not None and (found := load_fit(path, model)) is not None:
        return found
    fitted = fit_effects(model, job.data, job.start)
    out = cross_validate(fitted, job.data)
    if path is not None:
        save_fit(path, fitted, out)
        # read back, so that a resumed diagnosis uses arrays with the same memory layout
        return load_fit(path, model) or (fitted, out)
    return fitted, out


def try_all(
    job: Job, models: Sequence[tuple[str, ...]], workers: int, on_progress: Callable[[str], None]
) -> dict[tuple[str, ...], Result]:
    """Every model (a tuple of effects' names) with its result; `on_progress` is called with each when it is done."""
    results: dict[tuple[str, ...], Result] = {}
    with closing(as_finished(try_effects, [(names,) for names in models], workers, (job,))) as tried:
        for k, result in tried:
            results[models[k]] = result
            on_progress(" + ".join(models[k]))
    return {names: results[names] for names in models}
