"""A process that answers questions one after the other; it is started anew after a hang or a crash."""

import multiprocessing
from collections.abc import Callable
from multiprocessing.connection import Connection
from time import monotonic
from typing import Any

import psutil

LONGEST_WAIT_S = 1800.0  # for one answer on a busy machine


class Answering:
    """Ask by calling. `prepare` runs once in the process and returns the function that answers there; an answer may
    take `limit_s` of processor time."""

    def __init__(self, prepare: Callable[[], Callable[[Any], Any]], limit_s: float) -> None:
        self._prepare, self._limit_s = prepare, limit_s
        self._start()

    def _start(self) -> None:
        context = multiprocessing.get_context("spawn")
        self._ours, theirs = context.Pipe()
        self._process = context.Process(target=_answer_all, args=(self._prepare, theirs), daemon=True)
        self._process.start()
        theirs.close()
        self._ours.recv()  # it is ready

    def __call__(self, question: Any) -> Any:
        """The answer. Raises TimeoutError if it takes too long, EOFError or OSError if the process ends."""
        try:
            self._ours.send(question)
            used_s, begin_s = self._used_s(), monotonic()
            while not self._ours.poll(1.0):
                if self._used_s() - used_s > self._limit_s or monotonic() - begin_s > LONGEST_WAIT_S:
                    raise TimeoutError(f"more than {self._limit_s:g} s of processor time")
            return self._ours.recv()
        except (EOFError, OSError):
            self.close()
            self._start()
            raise

    def _used_s(self) -> float:
        try:
            times = psutil.Process(self._process.pid).cpu_times()
        except psutil.Error:
            return 0.0
        return float(times.user + times.system)

    def close(self) -> None:
        """Stop the process."""
        self._process.kill()
        self._process.join()
        self._ours.close()


def _answer_all(prepare: Callable[[], Callable[[Any], Any]], given: Connection) -> None:
    answer = prepare()
    given.send("ready")
    while True:
        given.send(answer(given.recv()))
