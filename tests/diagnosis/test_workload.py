"""The time that a diagnosis still takes, on the work of real diagnoses, replayed on a fake clock."""

from dataclasses import dataclass

import pytest

from rock2d.diagnosis import workload
from rock2d.diagnosis.cause_sets import MOST_CAUSES

EFFECTS = 22


@dataclass
class Diagnosed:
    """What a diagnosis with two processes took, in evaluations.

    share : of the releases, on which effects are explored
    before : imports, reading, base law, start of the processes
    rounds : fits of sets in each round, and what further effects are expected to gain before it"""

    share: float
    before: tuple[float, float, float, float]
    explored: float
    alone: float
    rounds: list[tuple[int, float]]
    sets: float
    learnt: list[float]
    regressions: float
    gap: float
    report: float


TILTED = [(6, 29.8), (6, 34.3), (10, 14.4)]
SQUARES = [(7, 583.9), (8, 235.2), (10, 156.0), (14, 179.7)]
FILMS = {
    "no cause": Diagnosed(0.5, (255, 390, 305, 530), 495, 325, [], 0, [160], 260, 90, 700),
    "a cause at a place": Diagnosed(1.0, (140, 162, 300, 300), 572, 155, [(6, 20.0)], 225, [90], 214, 55, 526),
    "a tilted camera": Diagnosed(0.33, (130, 168, 300, 280), 477, 273, TILTED, 880, [120], 350, 45, 480),
    "a cause from outside": Diagnosed(
        0.5, (200, 260, 343, 420), 559, 320, [(8, 300.0), (8, 200.0), (12, 150.0)], 1560, [655] * 4, 460, 70, 627
    ),
    "real squares": Diagnosed(0.25, (140, 142, 233, 290), 196, 230, SQUARES, 1840, [1040] * 5, 300, 240, 717),
    # on two cores that others use, too
    "no cause, busy": Diagnosed(0.5, (356, 400, 300, 340), 982, 777, [], 0, [245], 300, 95, 668),
    "a tilted camera, busy": Diagnosed(0.33, (176, 170, 300, 270), 770, 700, TILTED, 1380, [130], 400, 50, 445),
    "real squares, busy": Diagnosed(0.25, (163, 170, 300, 163), 420, 643, SQUARES, 2790, [1400] * 5, 360, 283, 820),
}


def replayed(film: Diagnosed):
    """(time, what the bars say is left) after each unit, if an evaluation takes a second."""
    now, found = [0.0], []
    bars = workload.DiagnosisBars(False, EFFECTS, 2, lambda: now[0])
    imports, reading, base, start = film.before

    def works(evaluations):
        now[0] += evaluations

    def one_more(evaluations, advance):
        works(evaluations)
        advance()
        found.append((imports + now[0], bars.times_s()[1]))

    def stage(name, units, evaluations):
        with bars.stage(name, units, "units") as bar:
            for _ in range(units):
                one_more(evaluations / units, bar.update)

    with bars.stage(workload.READING, 2, "steps") as bar:
        bars.starts()
        works(reading / 2)
        bar.update()
        one_more(reading / 2, bar.update)
    bars.read(film.share)
    stage(workload.BASE, 5, base)
    with bars.stage(workload.EXPLORING, EFFECTS, "effects") as bar:
        bars.starts()
        works(start)
        for k in range(EFFECTS):
            bars.explored(k / EFFECTS, 100.0 if film.rounds and k >= EFFECTS / 4 else 0.0)
            one_more(film.explored / EFFECTS, bar.update)
        bars.explored(1.0, 100.0 if film.rounds else 0.0)
    stage(workload.ALONE, EFFECTS, film.alone)
    with bars.stage(workload.SETS, workload.USUAL_SETS, "fits"):
        fits = sum(count for count, _ in film.rounds)
        for k, (count, gain) in enumerate(film.rounds):
            bars.found(k + 1, MOST_CAUSES, gain)
            bars.fits(count)
            for _ in range(count):
                one_more(film.sets / fits, lambda: bars.fitted("names"))
    with bars.stage(workload.EVIDENCE, len(film.rounds) + 2, "sets") as bar:
        for evaluations in film.learnt:
            one_more(evaluations, bar.update)
        works(film.regressions)
    stage(workload.GAP, 2, film.gap)
    stage(workload.REPORT, 5, film.report)
    return found


@pytest.mark.parametrize("name", FILMS)
@pytest.mark.parametrize(("share", "factor"), [(0.1, 4.0), (0.25, 2.5), (0.5, 2.5)])
def test_what_is_left_is_known_within_a_factor(name, share, factor):
    """After a tenth of the time nobody knows yet whether there is nothing to search or five sets to learn beside."""
    found = replayed(FILMS[name])
    end = found[-1][0]
    shown = [left for time, left in found if time <= share * end]
    assert shown or share == 0.1  # a tenth of a short diagnosis are imports
    if shown:
        assert 1.0 / factor < shown[-1] / (end - share * end) < factor
