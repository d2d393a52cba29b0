"""The chunks of a campaign on the workers of a running Dask scheduler.

Workers write the chunk files themselves, so they need access to the campaign's folder. Workers on other machines need
a shared file system. If a worker dies, only its current chunk is lost, and another worker repeats it. A worker should
have one thread, because the compiled code does not run in parallel threads of one process.
"""

from __future__ import annotations

import logging
import re
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from itertools import islice
from typing import TYPE_CHECKING, Any

from rock2d.errors import InputError
from rock2d.runs.campaigns.chunks import run_chunk
from rock2d.runs.campaigns.job import Chunk, Job, versions

if TYPE_CHECKING:
    from distributed import Client

IN_FLIGHT = 2  # tasks with the scheduler for each thread of the workers
CONNECT_S = 10


def run_on_cluster(
    job: Job,
    chunks: Sequence[Chunk],
    on_progress: Callable[[int], Any],
    scheduler: str,
) -> None:
    """Compute chunks on the workers of `scheduler`, in any order; `on_progress` gets the number of releases of each
    finished chunk.

    Raises InputError if the scheduler does not answer or is lost, if workers keep dying at the same chunk or
    have other versions than this process; OSError if they cannot write.
    """
    from distributed import CancelledError, KilledWorker, as_completed
    from distributed.comm import CommClosedError

    waiting = iter(chunks)
    with _client(scheduler) as client:

        def submitted(most: int) -> list[Any]:
            return [client.submit(_on_worker, job, c, pure=False) for c in islice(waiting, max(most, 0))]

        running = as_completed(submitted(_room(client)), loop=client.loop)
        try:
            for future in running:
                on_progress(future.result())
                running.update(submitted(_room(client) - running.count()))
        except KilledWorker:
            raise InputError(
                "several workers died at the same chunk; is there too little memory?", code="no_cluster"
            ) from None
        except (CancelledError, CommClosedError):
            raise InputError(
                "the scheduler is gone; the same command continues from there", code="no_cluster"
            ) from None


def _room(client: Client) -> int:
    """How many tasks may be with the scheduler: its workers may come and go."""
    return IN_FLIGHT * max(1, sum(client.nthreads().values()))


def _on_worker(job: Job, chunk: Chunk) -> int:
    import numba

    if job.versions != versions():
        raise InputError(f"a worker has {versions()}, this process {job.versions}", code="no_cluster")
    if not job.folder.is_dir():
        message = "not there for a worker: workers and this process must share a file system"
        raise InputError(message, job.folder, code="no_cluster")
    numba.set_num_threads(1)
    return run_chunk(job, chunk)


@contextmanager
def _client(scheduler: str) -> Iterator[Client]:
    from distributed import Client

    if not re.fullmatch(r"\w+://.+:\d+", scheduler):
        raise InputError(
            f"expected a scheduler's address like tcp://host:8786, found {scheduler!r}", code="no_cluster"
        )
    for name in [name for name in logging.root.manager.loggerDict if name.startswith("distributed")]:
        logging.getLogger(name).setLevel(logging.CRITICAL)
    try:
        client = Client(scheduler, timeout=CONNECT_S, set_as_default=False)
    except (OSError, ValueError) as error:
        raise InputError(f"no Dask scheduler answers at {scheduler}: {error}", code="no_cluster") from None
    with client:
        yield client
