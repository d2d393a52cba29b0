"""Independent jobs in several processes, which always end with this process."""

from __future__ import annotations

import gc
import os
import pickle
import signal
import sys
import threading
from collections.abc import Callable, Generator, Iterator, Sequence
from concurrent.futures import Future, ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from contextlib import ExitStack, contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

UNGUARDED = 'a script without `if __name__ == "__main__":`'
MOST_DEATHS = 3  # largest number of deaths of workers without a finished job between them
_KILL_AT_DEATH_OF_PARENT = 1  # PR_SET_PDEATHSIG of Linux


class Processes:
    """Worker processes for several rounds of jobs. They start with the first round that needs them, and end with the
    block.

    A single job runs in this process with all its threads, several in `workers` processes with one thread each;
    `shared` is sent to each of them once."""

    def __init__(self, workers: int, shared: tuple[Any, ...] = ()) -> None:
        if workers > 1:
            check_not_imported()
        self._workers, self._shared = workers, shared
        self._pool: ExitStack | None = None
        self._executor: ProcessPoolExecutor | None = None

    def __enter__(self) -> Processes:
        return self

    def __exit__(self, *error: Any) -> None:
        pool, self._pool, self._executor = self._pool, None, None
        if pool is not None:
            pool.__exit__(*error)

    def as_finished(self, work: Callable[..., Any], jobs: Sequence[tuple[Any, ...]]) -> Generator[tuple[int, Any]]:
        """Index of each job and the result of `work(*shared, *job)`, in the order in which they finish.

        Jobs of a worker that died are repeated. Raises the errors of `work`, and ChildProcessError if workers keep
        dying."""
        if min(self._workers, len(jobs)) <= 1:
            for k, job in enumerate(jobs):
                yield k, work(*self._shared, *job)
            return
        left, deaths = dict(enumerate(jobs)), 0
        while left:
            try:
                for k, result in self._finished(work, left):
                    deaths = 0
                    del left[k]
                    yield k, result
            except BrokenProcessPool:
                self.__exit__(None, None, None)
                deaths += 1
                if deaths > MOST_DEATHS:
                    raise ChildProcessError(
                        f"several worker processes died at the same job; is there too little memory, or {UNGUARDED}?"
                    ) from None

    def _finished(self, work: Callable[..., Any], jobs: dict[int, tuple[Any, ...]]) -> Iterator[tuple[int, Any]]:
        if self._executor is None:
            self._pool = ExitStack()
            shared = self._pool.enter_context(_in_file(self._shared))
            self._executor = self._pool.enter_context(_pool(self._workers, (shared,), _begin_worker))
        with _interrupts_held():
            waiting = {self._executor.submit(_work, work, job): k for k, job in jobs.items()}
        for done in as_completed(waiting):
            yield waiting[done], done.result()


def check_not_imported() -> None:
    """Raise ChildProcessError in a worker that imports the script that started it, and so runs its work again.

    `multiprocessing.spawn` uses the same attribute, but detects this only at the start of a process, after the work."""
    from multiprocessing import current_process

    if getattr(current_process(), "_inheriting", False):
        raise ChildProcessError(f"a worker process runs the work again: this is {UNGUARDED}")


def as_finished(
    work: Callable[..., Any], jobs: Sequence[tuple[Any, ...]], workers: int, shared: tuple[Any, ...] = ()
) -> Generator[tuple[int, Any]]:
    """One round of jobs of `Processes`.

    Close the iterator (`contextlib.closing`) to kill the workers at once; the caller removes temporary files of their
    jobs."""
    with Processes(min(workers, len(jobs)), shared) as processes:
        yield from processes.as_finished(work, jobs)


@contextmanager
def second_process() -> Iterator[Callable[..., Future[Any]]]:
    """Give a function that submits work(*given) to another process; it raises BrokenProcessPool if that has died. The
    process has all its threads, for work without compiled code."""
    with _pool(1, (), begin=_begin) as pool:

        def submit(work: Callable[..., Any], *given: Any) -> Future[Any]:
            with _interrupts_held():
                return pool.submit(work, *given)

        yield submit


@contextmanager
def _pool(workers: int, given: tuple[Any, ...], begin: Callable[..., None]) -> Iterator[ProcessPoolExecutor]:
    """A pool whose processes are killed if the block ends with an error."""
    import multiprocessing

    context = multiprocessing.get_context("spawn")
    pool = ProcessPoolExecutor(workers, mp_context=context, initializer=begin, initargs=given)
    try:
        yield pool
        pool.shutdown()
    except BaseException:
        with _interrupts_held():
            processes = list((pool._processes or {}).values())
            for process in processes:  # at once: jobs leave nothing half-written under a final name
                process.kill()
            pool.shutdown(cancel_futures=True)
        raise


@contextmanager
def _in_file(shared: tuple[Any, ...]) -> Iterator[str]:
    """Path of a file with this data for workers. The pipe to a new worker must carry little: if the worker ends before
    it has read everything, this process waits forever."""
    with TemporaryDirectory(prefix="rock2d_") as folder:
        path = Path(folder) / "shared"
        with path.open("wb") as file:
            pickle.dump(shared, file, pickle.HIGHEST_PROTOCOL)
        yield str(path)


@contextmanager
def _interrupts_held() -> Iterator[None]:
    """Delay Ctrl-C until the block ends, because a partly started pool cannot be stopped.

    The threads and processes that start in the block ignore Ctrl-C; this process answers it."""
    if not hasattr(signal, "pthread_sigmask") or threading.current_thread() is not threading.main_thread():
        yield
        return
    from multiprocessing import resource_tracker

    resource_tracker.ensure_running()  # otherwise the first worker starts it, which unblocks the signal
    pressed: list[int] = []
    before = signal.signal(signal.SIGINT, lambda number, frame: pressed.append(number))
    mask = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, mask)
        signal.signal(signal.SIGINT, before)
    if pressed:
        raise KeyboardInterrupt


_shared: tuple[Any, ...]


def _begin() -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    _follow_parent()


def _begin_worker(shared: str) -> None:
    global _shared
    _begin()
    with open(shared, "rb") as file:
        _shared = pickle.load(file)
    one_thread()
    gc.collect()
    gc.freeze()  # modules and shared data stay: the garbage collector need not walk over them


def _work(work: Callable[..., Any], job: tuple[Any, ...]) -> Any:
    return work(*_shared, *job)


def _follow_parent() -> None:
    """End this process when its parent ends or is killed."""
    import ctypes
    import multiprocessing

    if sys.platform == "linux":  # at once, also in compiled code
        ctypes.CDLL(None).prctl(_KILL_AT_DEATH_OF_PARENT, signal.SIGKILL)
    parent = multiprocessing.parent_process()
    assert parent is not None

    def follow() -> None:
        parent.join()
        os._exit(1)

    threading.Thread(target=follow, daemon=True).start()


def one_thread() -> None:
    """Limit this process to one thread, because the threads of several processes slow each other down."""
    import numba
    import scipy.linalg  # noqa: F401  loads its own BLAS, whose threads can only be limited once it is loaded
    from threadpoolctl import threadpool_limits

    numba.set_num_threads(1)
    threadpool_limits(1)


@contextmanager
def numba_threads(count: int | None) -> Iterator[int]:
    """Limit the threads to `count`; gives their number."""
    import numba

    before = numba.get_num_threads()
    numba.set_num_threads(min(count or before, before))
    try:
        yield numba.get_num_threads()
    finally:
        numba.set_num_threads(before)
