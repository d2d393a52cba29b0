"""The time that a command still takes is known within a factor of two, and a bar keeps its line."""

import io
import re
import sys

import numpy as np
import pytest

from rock2d import compiling
from rock2d.compiling import COMPILING
from rock2d.progress import Bars


class Clock:
    """A clock that work moves."""

    def __init__(self) -> None:
        self.now_s = 0.0

    def __call__(self) -> float:
        return self.now_s


def left_while(stages, pace=lambda now_s: 1.0, planned=None, skip_first=False):
    """(n, 2) time, and what the bars say is left, after each unit of stages (name -> durations of its units at pace 1).

    planned : name -> its work; default: what it takes"""
    clock = Clock()
    bars = Bars(False, planned or {name: sum(units) for name, units in stages.items()}, clock)
    found = []
    for name, units in stages.items():
        with bars.stage(name, len(units), "units") as bar:
            for seconds in units:
                clock.now_s += seconds * pace(clock.now_s)
                bar.update()
                found.append((clock.now_s, bars.times_s()[1]))
    return np.array(found)


def ratios(found, share=0.1):
    """Estimate over truth between this share of the time and 95 % of it."""
    end = found[-1, 0]
    own = found[(found[:, 0] >= share * end) & (found[:, 0] <= 0.95 * end)]
    return own[:, 1] / (end - own[:, 0])


@pytest.fixture
def rng():
    return np.random.default_rng(5)


def within_a_factor_of_two(found, share=0.1):
    own = ratios(found, share)
    return len(own) > 5 and own.min() > 0.5 and own.max() < 2.0


def test_stages_of_known_work_are_estimated_within_a_factor_of_two(rng):
    for _ in range(100):
        stages = {
            f"stage {k}": rng.uniform(0.5, 1.5, rng.integers(20, 60)) * 10.0 ** rng.uniform(-1, 1) for k in range(5)
        }
        assert within_a_factor_of_two(left_while(stages))


def test_work_that_is_planned_half_as_large_again_does_not_leave_the_factor(rng):
    for _ in range(100):
        stages = {f"stage {k}": rng.uniform(0.5, 1.5, 40) for k in range(5)}
        planned = {name: sum(units) * rng.uniform(0.75, 1.35) for name, units in stages.items()}
        assert within_a_factor_of_two(left_while(stages, planned=planned))


@pytest.mark.parametrize("factor", [3.0, 1.0 / 3.0])
def test_a_machine_that_changes_its_speed_is_followed(factor):
    """A third of the time so far later, the estimate is right within a factor of two; the average would not be."""
    changes_s = 100.0
    found = left_while({"one": np.ones(400), "two": np.ones(300)}, lambda now_s: factor if now_s >= changes_s else 1.0)
    later = found[found[:, 0] > 1.35 * changes_s]
    off = later[:, 1][:-10] / (found[-1, 0] - later[:, 0])[:-10]
    assert off.min() > 0.5 and off.max() < 2.0
    assert abs(np.log(off[len(off) // 2])) < 0.2


def test_results_that_come_in_bursts_do_not_shake_the_estimate():
    """Processes finish in pairs, and short jobs wait for a long one."""
    assert within_a_factor_of_two(left_while({"one": [0.0, 0.0, 0.0, 4.0] * 30, "two": [1.0] * 60}))


def test_compiling_and_starting_do_not_count():
    clock = Clock()
    bars = Bars(False, {"one": 100.0}, clock)
    with bars.stage("one", 100, "units") as bar:
        bars.starts()
        clock.now_s += 10.0
        bar.update()
        for k in range(49):
            if k == 3:
                with compiling.compiling(), compiling.compiling():
                    clock.now_s += 60.0
            clock.now_s += 1.0
            bar.update()
        so_far, left = bars.times_s()
    assert so_far == 119.0
    assert left == pytest.approx(50.0)


def test_what_was_done_before_tells_nothing_about_the_pace():
    clock = Clock()
    bars = Bars(False, clock=clock)
    with bars.stage("cases", 0, "cases") as bar:
        bar.reach(100, 200)
        assert bars.times_s() == (0.0, None)
        for done in range(101, 111):
            clock.now_s += 2.0
            bar.reach(done, 200)
        assert bars.times_s() == (20.0, pytest.approx(180.0))


def test_nothing_is_said_before_something_is_known():
    bars = Bars(False, clock=Clock())
    with bars.stage("one", 10, "units"):
        assert bars.times_s() == (0.0, None)


def test_what_becomes_known_of_a_stage_counts_at_once():
    clock = Clock()
    bars = Bars(False, {"one": 10.0, "two": 100.0, "three": 5.0}, clock)
    with bars.stage("one", 10, "units") as bar:
        for _ in range(10):
            clock.now_s += 1.0
            bar.update()
    bars.expect("two", 20.0)
    assert bars.times_s()[1] == pytest.approx(25.0)
    with bars.stage("two", 4, "units") as bar:
        bars.expect("two", 40.0, 8)
        assert bars.times_s()[1] == pytest.approx(45.0)
        clock.now_s += 5.0
        bar.update()
        assert (bar.n, bar.total) == (1, 8)
        assert bars.times_s()[1] == pytest.approx(40.0)
    assert bars.times_s()[1] == pytest.approx(5.0)  # it ended early
    bars.expect("one", 100.0)  # is over
    assert bars.times_s()[1] == pytest.approx(5.0)


class Terminal(io.StringIO):
    """A terminal that keeps what is written."""

    def isatty(self) -> bool:
        return True


def bars_in(file, monkeypatch):
    """What is written by two bars, in the first of which code is compiled."""
    monkeypatch.setattr(sys, "stderr", file)
    bars = Bars(True, {"one": 2.0, "two": 3.0})
    with bars.stage("one", 2, "units") as bar:
        for _ in range(2):
            with compiling.compiling():
                pass
            bar.step("a note")
    with bars.stage("nothing", 4, "units"):
        pass
    with bars.stage("two", 3, "units") as bar:
        bar.update(3)
    return file.getvalue()


def test_compiling_stands_on_the_line_of_the_bar(monkeypatch):
    text = bars_in(Terminal(), monkeypatch)
    assert COMPILING in text
    lines = [line.split("\r")[-1].rstrip() for line in text.split("\n")]
    assert [line.partition(":")[0] for line in lines if line] == ["one", "two"]
    assert "100%" in lines[0] and "2/2 units" in lines[0] and COMPILING not in lines[0]
    assert all(part.startswith(("one: ", "two: ", "nothing: ", " ")) for part in re.split("[\r\n]", text) if part)


def test_a_log_file_has_few_plain_lines(monkeypatch):
    text = bars_in(io.StringIO(), monkeypatch)
    assert "\r" not in text
    lines = text.splitlines()
    assert [line.partition(":")[0] for line in lines] == ["one", "one", "two"]
    assert [COMPILING in line for line in lines] == [True, False, False]
    assert text.endswith("\n")


def test_an_interrupted_bar_says_what_was_left(monkeypatch):
    monkeypatch.setattr(sys, "stderr", file := Terminal())
    clock = Clock()
    with pytest.raises(KeyboardInterrupt), Bars(True, clock=clock).stage("one", 100, "units") as bar:
        clock.now_s = 30.0
        bar.update(20)
        raise KeyboardInterrupt
    assert file.getvalue().split("\r")[-1].rstrip().endswith("20/100 units [00:30, about 02:00 left]")


def test_a_bar_that_is_not_shown_writes_nothing(monkeypatch):
    monkeypatch.setattr(sys, "stderr", file := Terminal())
    with Bars(False).stage("one", 2, "units") as bar, compiling.compiling():
        bar.step("a note")
        bar.reach(2, 5)
    assert file.getvalue() == ""
    assert (bar.n, bar.total) == (2, 2)
