"""Fits of models in several processes, each with one thread. The result does not depend on their number."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import dataclass
from pathlib import Path

from rock2d.diagnosis.checkpoint import load_fit, save_fit
from rock2d.diagnosis.cross_validation import HeldOut, cross_validate
from rock2d.diagnosis.data import Data
from rock2d.diagnosis.fitting import Fit, fit_effects
from rock2d.diagnosis.model import Model
from rock2d.effects import catalogue
from rock2d.scene.world import World

Result = tuple[Fit, HeldOut]


@dataclass
class Job:
    """Set-up, data and the fit to start from; every process needs them."""

    setup: World
    data: Data
    start: Fit
    folder: Path | None = None  # for finished fits, if they are kept


_job: Job | None = None


def one_thread() -> None:
    """Limit this process to one thread, because the threads of several processes slow each other down.

    The process ends with the one that started it, in whatever way that ends.
    """
    import multiprocessing
    import os
    import threading

    import numba
    import scipy.linalg  # noqa: F401  loads its own BLAS, whose threads can only be limited once it is loaded
    from threadpoolctl import threadpool_limits

    numba.set_num_threads(1)
    threadpool_limits(1)
    if (parent := multiprocessing.parent_process()) is not None:

        def follow() -> None:
            parent.join()
            os._exit(1)

        threading.Thread(target=follow, daemon=True).start()


def _set_job(job: Job) -> None:
    global _job
    _job = job
    one_thread()


def _try_own(names: tuple[str, ...]) -> Result:
    assert _job is not None
    return try_effects(_job, names)


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
    for names, result in _run(job, models, workers):
        results[names] = result
        on_progress(" + ".join(names))
    return {names: results[names] for names in models}


def _run(
    job: Job, models: Sequence[tuple[str, ...]], workers: int
) -> Iterator[tuple[tuple[str, ...], Result]]:
    if workers <= 1 or len(models) <= 1:
        for names in models:
            yield names, try_effects(job, names)
        return
    import multiprocessing

    pool = ProcessPoolExecutor(
        workers, mp_context=multiprocessing.get_context("spawn"), initializer=_set_job, initargs=(job,)
    )
    try:
        waiting = {pool.submit(_try_own, names): names for names in models}
        for done in as_completed(waiting):
            yield waiting[done], done.result()
    finally:
        pool.shutdown(wait=True, cancel_futures=True)
