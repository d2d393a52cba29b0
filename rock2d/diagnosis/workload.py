"""Work of the stages of a diagnosis, in evaluations of all residuals, for the estimate of the remaining time.

The numbers are typical of films with 200 to 450 impacts. The work of searching and learning is estimated again during
the diagnosis: the expected gains of further effects show how much the best set leaves unexplained."""

from collections.abc import Callable
from time import perf_counter

from rock2d.progress import Bar, Bars

READING, BASE, EXPLORING, ALONE = "reading the film", "base law", "exploring effects", "effects alone"
SETS, EVIDENCE, GAP, REPORT = "sets of effects", "evidence", "gap", "report"
STARTING = "processes"  # they start during the exploring

START = 300.0  # start of the processes
# speed grows with this power of the number of processes: other programs use the cores, too
SHARED_CORES = 0.3
BASE_ON_ALL, BASE_ON_SOME = 170.0, 320.0  # the latter if some releases are all of them
EXPLORED, FITTED = 70.0, 27.0  # for each effect; the first if some releases are all of them
ONE_OF_A_SET, SCREENED = 60.0, 18.0  # for each set: in a worker process, and in the main process
LEARNT_PER_SET = 800.0  # for each set, if there is something to learn
REGRESSED = 400.0  # dependences and regressions of residuals, in every diagnosis
# expected gain in log likelihood of all further effects together from which on there is something to learn
UNEXPLAINED_GAIN = 50.0
LEAST_GAIN = 15.0  # gain in log likelihood of an effect that is clearly more than chance
FEWEST_SETS, SETS_OF_A_CAUSE = 8, 6  # numbers of fitted sets
USUAL_SHARE = 0.4  # share of the releases on which effects are explored
USUAL_SETS, USUAL_LEARNT, USUAL_CAUSES = 10, 1.0, 3  # assumed at the start
LIKELY_SETS, LIKELY_LEARNT = 10, 2.0  # if an effect gains more than LEAST_GAIN


class DiagnosisBars(Bars):
    """The progress bars of a diagnosis with a number of `effects` and `workers`."""

    def __init__(self, shown: bool, effects: int, workers: int, clock: Callable[[], float] = perf_counter) -> None:
        faster = workers**SHARED_CORES
        self._exploring = EXPLORED * effects / faster
        self._each_set = ONE_OF_A_SET / faster + SCREENED
        super().__init__(shown, {
            READING: 250.0, BASE: BASE_ON_ALL + USUAL_SHARE * BASE_ON_SOME, STARTING: START if workers > 1 else 0.0,
            EXPLORING: USUAL_SHARE * self._exploring, ALONE: FITTED * effects / faster,
            SETS: USUAL_SETS * self._each_set, EVIDENCE: REGRESSED + USUAL_LEARNT * LEARNT_PER_SET, GAP: 100.0,
            REPORT: 600.0,
        }, clock)  # fmt: skip

    def read(self, share: float) -> None:
        """The film was read; `share`: share of its releases on which effects are explored."""
        self.expect(BASE, BASE_ON_ALL + share * BASE_ON_SOME)
        self.expect(EXPLORING, share * self._exploring)

    def explored(self, share: float, gain: float) -> None:
        """A `share` of the effects was explored; `gain`: largest gain in log likelihood so far. If it is small, there
        is nothing to search."""
        self.expect(STARTING, 0.0)
        sets, learnt = (1.0 - share) * USUAL_SETS, (1.0 - share) * USUAL_LEARNT
        if gain > LEAST_GAIN:
            sets, learnt = LIKELY_SETS, LIKELY_LEARNT
        self.expect(SETS, sets * self._each_set)
        self.expect(EVIDENCE, REGRESSED + learnt * LEARNT_PER_SET)

    def found(self, causes: int, most: int, further_gain: float) -> None:
        """The best set has a number of `causes`, at most `most`; `further_gain`: expected gain of further effects."""
        much = further_gain > UNEXPLAINED_GAIN
        learnt = (max(causes, USUAL_CAUSES) + 1) * LEARNT_PER_SET if much else 0.0
        self.expect(EVIDENCE, REGRESSED + learnt)
        sets = FEWEST_SETS + (SETS_OF_A_CAUSE * (most - causes) if much else 0)
        self.expect(SETS, sets * self._each_set, sets)

    def fits(self, count: int) -> None:
        """At least `count` further fits follow."""
        if (bar := self._bar_of_fits) is not None:
            bar.extend(count)

    def fitted(self, names: str) -> None:
        """The fit of the effects `names` is done."""
        if (bar := self._bar_of_fits) is not None:
            bar.step(names)

    @property
    def _bar_of_fits(self) -> Bar | None:
        """The open bar, if it counts fits."""
        return self.bar if self.bar is not None and self.bar.name in (ALONE, SETS) else None
