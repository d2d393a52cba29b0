"""Independent jobs in several processes, each on one thread."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from typing import Any


def as_finished(work: Callable[..., Any], jobs: Sequence[tuple[Any, ...]], workers: int) -> Iterator[Any]:
    """Results of `work(*job)` in the order in which they finish; in this process if `workers` is 1."""
    if workers <= 1:
        for job in jobs:
            yield work(*job)
        return
    import multiprocessing

    from rock2d.diagnosis.parallel import one_thread

    context = multiprocessing.get_context("spawn")
    pool = ProcessPoolExecutor(workers, mp_context=context, initializer=one_thread)
    try:
        for done in as_completed([pool.submit(work, *job) for job in jobs]):
            yield done.result()
    finally:
        pool.shutdown(wait=True, cancel_futures=True)
