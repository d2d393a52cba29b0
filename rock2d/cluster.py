"""Independent jobs on the workers of a running Dask scheduler.

Where workers write the files themselves, they need access to the folder of the results: on other machines a shared
file system. If a worker dies, only its current job is lost, and another worker repeats it. A worker should have one
thread, because the compiled code does not run in parallel threads of one process."""

from __future__ import annotations

import logging
import re
from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rock2d.errors import InputError, require
from rock2d.processes import Processes, numba_threads

if TYPE_CHECKING:
    from distributed import Client

SCALE_EXTRA = "pip install 'rock2d[scale]'"
IN_FLIGHT = 2  # tasks with the scheduler for each thread of the workers
CONNECT_S = 10


@dataclass(frozen=True)
class Workers:
    """Where jobs are computed; results do not depend on it.

    Attributes
    ----------
    processes : number of processes on this machine, with one thread each; None: default of the command
    scheduler : address of a Dask scheduler, instead of processes. Its workers need access to the folder of the results
        (a shared file system) and should have one thread each"""

    processes: int | None = None
    scheduler: str | None = None


THIS_PROCESS = Workers()  # with all its threads

# index of each job and the result of `work(*job)`, in the order in which they finish
JobRunner = Callable[[Callable[..., Any], Sequence[tuple[Any, ...]]], Generator[tuple[int, Any]]]


@contextmanager
def job_runner(workers: Workers) -> Iterator[JobRunner]:
    """Give a function that computes a round of jobs on the workers of a scheduler, in several processes or in this one;
    the jobs must not write files. Raises InputError if Dask is missing; a round raises the errors of
    `as_finished_on_cluster` or `Processes`."""
    if workers.scheduler is not None:
        require_dask()
        address = workers.scheduler
        yield lambda work, jobs: as_finished_on_cluster(work, jobs, address, (), None)
        return
    with numba_threads(workers.processes), Processes(workers.processes or 1) as processes:
        yield processes.as_finished


def as_finished_on_cluster(
    work: Callable[..., Any],
    jobs: Sequence[tuple[Any, ...]],
    scheduler: str,
    shared: tuple[Any, ...],
    folder: Path | None,
) -> Generator[tuple[int, Any]]:
    """Index of each job and the result of `work(*shared, *job)`, in the order in which they finish; see
    `processes.as_finished`.

    scheduler : address, tcp://host:port
    folder : absolute path of the folder into which the workers write; None if they write nothing

    Raises the errors of `work`, and InputError if the scheduler does not answer or is lost, if workers keep dying at
    the same job, or if they do not see the folder or have other versions than this process."""
    from distributed import CancelledError, KilledWorker, as_completed
    from distributed.comm import CommClosedError

    waiting, own = enumerate(jobs), versions()
    with _client(scheduler) as client:

        def submitted(most: int) -> list[Any]:
            return [
                client.submit(_on_worker, work, (*shared, *job), k, own, folder, pure=False)
                for k, job in islice(waiting, max(most, 0))
            ]

        running = as_completed(submitted(_room(client)), loop=client.loop)
        try:
            for future in running:
                yield future.result()
                running.update(submitted(_room(client) - running.count()))
        except KilledWorker:
            raise InputError(
                "several workers died at the same job; is there too little memory?", code="no_cluster"
            ) from None
        except (CancelledError, CommClosedError):
            raise InputError(
                "the scheduler is gone; the same command continues from there", code="no_cluster"
            ) from None


def require_dask() -> None:
    """Raise InputError if Dask is not installed."""
    require("distributed", f"--scheduler needs Dask, which is missing: {SCALE_EXTRA}")


def versions() -> dict[str, str]:
    """Versions of the packages on which the numbers depend."""
    import numba
    import numpy as np

    from rock2d.version import __version__

    return {"rock2d": __version__, "numpy": np.__version__, "numba": numba.__version__}


def _room(client: Client) -> int:
    """Number of tasks that the scheduler may have now, because workers may come and go."""
    return IN_FLIGHT * max(1, sum(client.nthreads().values()))


def _on_worker(
    work: Callable[..., Any], arguments: tuple[Any, ...], index: int, expected: dict[str, str], folder: Path | None
) -> tuple[int, Any]:
    from rock2d.processes import one_thread

    if expected != versions():
        raise InputError(f"a worker has {versions()}, this process {expected}", code="no_cluster")
    if folder is not None and not folder.is_dir():
        message = "a worker does not see this folder: workers and this process must share a file system"
        raise InputError(message, folder, code="no_cluster")
    one_thread()
    return index, work(*arguments)


@contextmanager
def _client(scheduler: str) -> Iterator[Client]:
    from distributed import Client

    if not re.fullmatch(r"\w+://.+:\d+", scheduler):
        raise InputError(f"expected a scheduler's address like tcp://host:8786, found {scheduler!r}", code="no_cluster")
    for name in [name for name in logging.root.manager.loggerDict if name.startswith("distributed")]:
        logging.getLogger(name).setLevel(logging.CRITICAL)
    try:
        client = Client(scheduler, timeout=CONNECT_S, set_as_default=False)
    except (OSError, ValueError) as error:
        raise InputError(f"no Dask scheduler answers at {scheduler}: {error}", code="no_cluster") from None
    with client:
        yield client
