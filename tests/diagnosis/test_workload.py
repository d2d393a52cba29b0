"""The time that a diagnosis still takes, on the work of real diagnoses, replayed on a fake clock."""

from __future__ import annotations

from dataclasses import dataclass

import pytest

from rock2d.diagnosis.cause_sets import MOST_CAUSES
from rock2d.diagnosis.workload import (
    ALONE,
    BASE,
    EXPLORING,
    GAP,
    LEARNT,
    READING,
    REPORT,
    SETS,
    USUAL_SETS,
    DiagnosisBars,
)

EFFECTS = 22


@dataclass
class Diagnosed:
    """What a diagnosis with two processes took, in evaluations.

    rounds : fits of sets in each round, and what further effects are expected to gain before it
    """

    explored: float
    alone: float
    rounds: list[tuple[int, float]]
    sets: float
    learnt: list[float]
    reading: float = 180.0
    base: float = 300.0
    regressions: float = 350.0
    gap: float = 90.0
    report: float = 600.0


FILMS = {
    "no cause": Diagnosed(495, 325, [], 0, [160], report=700),
    "a cause at a place": Diagnosed(940, 256, [(6, 20.0)], 370, [150], base=493, report=865),
    "a tilted camera": Diagnosed(477, 273, [(6, 29.8), (6, 34.3), (10, 14.4)], 880, [120, 80], report=480),
    "a cause from outside": Diagnosed(559, 320, [(8, 300.0), (8, 200.0), (12, 150.0)], 1560, [655] * 4),
    "real squares": Diagnosed(
        196, 230, [(7, 583.9), (8, 235.2), (10, 156.0), (14, 179.7)], 1840, [1040] * 5, base=233, report=717
    ),
}


def replayed(film: Diagnosed):
    """(time, what the bars say is left) after each unit, if an evaluation takes a second."""
    now, found = [0.0], []
    bars = DiagnosisBars(False, EFFECTS, 2, lambda: now[0])

    def works(evaluations):
        now[0] += evaluations

    def stage(name, units, evaluations):
        with bars.stage(name, units, "units") as bar:
            for _ in range(units):
                works(evaluations / units)
                bar.update()
                found.append((now[0], bars.times_s()[1]))

    stage(READING, 2, film.reading)
    stage(BASE, 5, film.base)
    with bars.stage(EXPLORING, EFFECTS, "effects") as bar:
        for k in range(EFFECTS):
            works(film.explored / EFFECTS)
            bars.explored((k + 1) / EFFECTS, 0.0 if k < EFFECTS / 4 or not film.rounds else 100.0)
            bar.update()
            found.append((now[0], bars.times_s()[1]))
    stage(ALONE, EFFECTS, film.alone)
    with bars.stage(SETS, USUAL_SETS, "fits"):
        fits = sum(count for count, _ in film.rounds)
        for k, (count, gain) in enumerate(film.rounds):
            bars.found(k + 1, MOST_CAUSES, gain)
            bars.fits(count)
            for _ in range(count):
                works(film.sets / fits)
                bars.fitted("names")
                found.append((now[0], bars.times_s()[1]))
    with bars.stage(LEARNT, len(film.rounds) + 2, "sets") as bar:
        for evaluations in film.learnt:
            works(evaluations)
            bar.update()
            found.append((now[0], bars.times_s()[1]))
        works(film.regressions)
    stage(GAP, 2, film.gap)
    stage(REPORT, 5, film.report)
    return found


@pytest.mark.parametrize("name", FILMS)
def test_what_is_left_is_known_within_a_factor_of_two(name):
    """At 10, 25 and 50 % of the time, for films with nothing to search and with five sets to learn beside."""
    found = replayed(FILMS[name])
    end = found[-1][0]
    for share in (0.1, 0.25, 0.5):
        left = [state[1] for state in found if state[0] <= share * end][-1]
        assert 0.5 < left / (end - share * end) < 2.0, (share, left, end)
