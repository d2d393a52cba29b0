"""Progress bars: one for each stage of a command, with its total, the elapsed time and the remaining time of the
command.

The remaining time is the remaining work, in a unit that is the same for all stages, times the time per unit in this
run, with more weight on recent work. Time for compilation does not count. In a terminal a bar keeps its line; in a log
file it writes a line now and then."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from math import exp, sqrt
from threading import RLock
from time import perf_counter
from typing import Any

from tqdm import tqdm

from rock2d.compiling import COMPILING, listening

MEMORY = 0.3  # time constant of the weights of past work, as a share of the elapsed time
LOG_INTERVAL_S, LOG_SHARE = 10.0, 0.1  # interval of lines in a log file, also as a share of the elapsed time
FORM = "{desc}: {percentage:3.0f}%|{bar}| {n_fmt}/{total_fmt} {unit}{times}{postfix}"


class Pace:
    """Time per unit of work, recently and in all."""

    def __init__(self, now_s: float) -> None:
        self._begin_s = self._last_s = now_s
        self._seconds = self._work = self._all_work = 0.0

    def did(self, work: float, now_s: float) -> None:
        """Note an amount of work that was done since the last call."""
        took, so_far = now_s - self._last_s, now_s - self._begin_s
        kept = exp(-took / (MEMORY * so_far)) if so_far > 0.0 else 1.0
        self._seconds, self._work = kept * self._seconds + took, kept * self._work + work
        self._all_work += work
        self._last_s = now_s

    def pause(self, seconds: float) -> None:
        """Exclude so much of the time since the last call of `did`."""
        self._begin_s += seconds
        self._last_s += seconds

    def skip(self, now_s: float) -> None:
        """Exclude all the time since the last call of `did`."""
        self.pause(now_s - self._last_s)

    def seconds(self, here: float, ahead: float) -> float | None:
        """That the work of this stage and of those ahead takes; None if none was done yet.

        A slow stage may be slow because the machine is, or because it is more work than was thought. Only the first
        holds for other stages, so these are expected between the recent pace and that so far."""
        if self._work <= 0.0:
            return None
        recent, so_far = self._seconds / self._work, (self._last_s - self._begin_s) / self._all_work
        return here * recent + ahead * sqrt(recent * so_far)


class Bars:
    """The bars of a command.

    Parameters
    ----------
    shown : whether there is anything to see
    work : stage -> its work, in one unit for all of them; that of a stage which is not named here is its total
    clock : in seconds

    Attributes
    ----------
    bar : the one that is open"""

    def __init__(
        self, shown: bool, work: Mapping[str, float] | None = None, clock: Callable[[], float] = perf_counter
    ) -> None:
        self.shown, self._clock = shown, clock
        self._ahead, self._each = dict(work or {}), dict[str, float]()
        self._begin_s, self._pace = clock(), Pace(clock())
        self.bar: Bar | None = None
        self._starts, self._compiling_s = False, 0.0  # since then

    @classmethod
    def of(cls, shown: bool | Bars) -> Bars:
        """Bars of one stage, if these are none."""
        return shown if isinstance(shown, Bars) else cls(shown)

    def expect(self, stage: str, work: float, units: float = 1) -> None:
        """Change the work of a stage that is to come, or what is left of the open one, in so many units."""
        if self.bar is not None and self.bar.name == stage:
            self.bar.total, self._each[stage] = self.bar.n + units, work / units
        elif stage in self._ahead:
            self._ahead[stage] = work

    @contextmanager
    def stage(self, name: str, total: float, unit: str, done: float = 0) -> Iterator[Bar]:
        """The bar of a stage, from `done` to `total`; a stage that ends early has all its work done."""
        if name in self._ahead:
            self._each[name] = self._ahead.pop(name) / max(total - done, 1)
        self._each.setdefault(name, 1.0)
        try:
            with Bar(self, name, total, unit, done) as bar, listening(self.compiling):
                self.bar = bar
                yield bar
                bar.total, bar.leave = bar.n, bar.n > done  # a stage without work leaves no line
        finally:
            self.bar = None

    def did(self, bar: Bar, units: float) -> None:
        """Some units of a bar are done."""
        if self._starts:
            self._pace.skip(self._clock())
        else:
            self._pace.did(units * self._each[bar.name], self._clock())
        self._starts = False

    def starts(self) -> None:
        """The next unit waits for a start (imports, processes), so its time tells nothing about others."""
        self._starts = True

    def compiling(self, begins: bool) -> None:
        """Numba begins or ends to compile."""
        now_s = self._clock()
        if not begins:
            self._pace.pause(now_s - self._compiling_s)
        self._compiling_s = now_s
        if self.bar is not None:
            self.bar.note_compiling(begins)

    def times_s(self) -> tuple[float, float | None]:
        """Time so far, and about how long the command still takes; None if nothing is known."""
        here = self.bar.left * self._each[self.bar.name] if self.bar is not None else 0.0
        return self._clock() - self._begin_s, self._pace.seconds(here, sum(self._ahead.values()))


class Bar(tqdm):
    """The bar of one stage."""

    _lock = RLock()  # that of tqdm for several processes leaks a semaphore if a worker is killed
    monitor_interval = 0  # every update is looked at, so no thread has to

    def __init__(self, bars: Bars, name: str, total: float, unit: str, done: float) -> None:
        self.bars, self.name = bars, name
        self._in_log, self._noted = not sys.stderr.isatty(), False
        super().__init__(
            desc=name, total=total, initial=done, unit=unit, disable=not bars.shown, miniters=1, bar_format=FORM,
            mininterval=LOG_INTERVAL_S if self._in_log else 0.1,
        )  # fmt: skip
        self.n = done

    def update(self, n: float | None = 1) -> bool | None:
        """`n` more units are done."""
        self.bars.did(self, n or 0)
        self.extend(n or 0)
        if self._in_log and not self.disable:
            self.mininterval = max(LOG_INTERVAL_S, LOG_SHARE * self.bars.times_s()[0])
        if self.disable:
            self.n += n or 0
        return super().update(n)

    def step(self, what: str) -> None:
        """One more unit is done: this one."""
        self.set_postfix_str(what, refresh=False)
        self.update()

    def counted(self, items: Iterable[Any]) -> Iterator[Any]:
        """The items; each is a unit."""
        for item in items:
            yield item
            self.update()

    def reach(self, done: float, total: float) -> None:
        """So many units of so many are done. If no total was known, they were done before."""
        if not self.total:
            self.n = self.initial = done
        self.total = total
        self.update(done - self.n)

    def extend(self, further: float) -> None:
        """At least so many further units are to be done."""
        self.total = max(self.total or 0, self.n + further)

    def omit(self, units: float) -> None:
        """So many units need not be done."""
        self.total = (self.total or 0) - units

    @property
    def left(self) -> float:
        """Units that are to be done."""
        return max((self.total or 0) - self.n, 0)

    def note_compiling(self, begins: bool) -> None:
        """Say so on the line of the bar; in a log file once."""
        again, self._noted = self._noted, True
        self.set_postfix_str(COMPILING if begins else "", refresh=not (self._in_log and again))

    def display(self, msg: str | None = None, pos: int | None = None) -> None:
        """Draw the bar; in a log file, only if there is something new to say."""
        if not self._in_log or self.n > self.last_print_n or self.postfix == COMPILING:
            super().display(msg, pos)

    @property
    def format_dict(self) -> dict[str, Any]:
        """What the bar shows."""
        so_far, left = self.bars.times_s()
        times = f" [{self.format_interval(so_far)}"
        times += f", about {self.format_interval(left)} left]" if left is not None and left >= 0.5 else "]"
        return {**super().format_dict, "total": self.total or None, "times": times}

    @staticmethod
    def status_printer(file: Any) -> Callable[[str], None]:
        """In a log file, each state has a line of its own; `close` ends the last one."""
        if file.isatty():
            return tqdm.status_printer(file)
        lines = 0

        def print_status(text: str) -> None:
            nonlocal lines
            file.write(f"\n{text}" if lines else text)
            file.flush()
            lines += 1

        return print_status
