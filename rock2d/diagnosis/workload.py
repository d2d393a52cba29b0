"""How much work the stages of a diagnosis are, in evaluations of all residuals: for the time that it still takes.

The numbers are typical of films with 200 to 450 impacts. How much there is to search and to learn becomes known on the
way: what further effects are expected to gain tells how much the best set leaves unexplained.
"""

from __future__ import annotations

from collections.abc import Callable
from time import perf_counter

from rock2d.progress import Bar, Bars

READING, BASE, EXPLORING, ALONE = "reading the film", "base law", "exploring effects", "effects alone"
SETS, EVIDENCE, GAP, REPORT = "sets of effects", "evidence", "gap", "report"
STARTING = "processes"  # start within the exploring

START = 300.0  # starting the processes
SHARED_CORES = 0.3  # processes are faster by this power of their number: others use the cores, too
BASE_ON_ALL, BASE_ON_SOME = 170.0, 320.0  # the latter if some releases are all of them
EXPLORED, FITTED = 70.0, 27.0  # for each effect; the first as before
ONE_OF_A_SET, SCREENED = 60.0, 18.0  # for each set: in one of the processes, and in this one
LEARNT_BESIDE_ONE = 800.0  # for each set, if there is something to learn
REGRESSED = 400.0  # dependences and regressions of residuals, whatever there is to learn
# log likelihood that all further effects together must be expected to gain, for there to be something
UNEXPLAINED_GAIN = 50.0
LEAST_GAIN = 15.0  # log likelihood of an effect that is worth more than chance gives
FEWEST_SETS, SETS_OF_A_CAUSE = 8, 6  # that are fitted
USUAL_SHARE = 0.4  # share of the releases on which effects are explored
USUAL_SETS, USUAL_LEARNT, USUAL_CAUSES = 10, 1.0, 3  # before anything is known
LIKELY_SETS, LIKELY_LEARNT = 10, 2.0  # if an effect gains something


class DiagnosisBars(Bars):
    """The bars of a diagnosis that tries so many `effects` with so many `workers`."""

    def __init__(
        self, shown: bool, effects: int, workers: int, clock: Callable[[], float] = perf_counter
    ) -> None:
        faster = workers**SHARED_CORES
        self._exploring = EXPLORED * effects / faster
        self._each_set = ONE_OF_A_SET / faster + SCREENED
        super().__init__(shown, {
            READING: 250.0, BASE: BASE_ON_ALL + USUAL_SHARE * BASE_ON_SOME, STARTING: START if workers > 1 else 0.0,
            EXPLORING: USUAL_SHARE * self._exploring, ALONE: FITTED * effects / faster,
            SETS: USUAL_SETS * self._each_set, EVIDENCE: REGRESSED + USUAL_LEARNT * LEARNT_BESIDE_ONE, GAP: 100.0,
            REPORT: 600.0,
        }, clock)  # fmt: skip

    def read(self, share: float) -> None:
        """The film is read; this is the share of its releases on which effects are explored."""
        self.expect(BASE, BASE_ON_ALL + share * BASE_ON_SOME)
        self.expect(EXPLORING, share * self._exploring)

    def explored(self, share: float, gain: float) -> None:
        """A share of the effects is explored, and one of them gains so much log likelihood. Where none does, there is
        nothing to search."""
        self.expect(STARTING, 0.0)
        sets, learnt = (1.0 - share) * USUAL_SETS, (1.0 - share) * USUAL_LEARNT
        if gain > LEAST_GAIN:
            sets, learnt = LIKELY_SETS, LIKELY_LEARNT
        self.expect(SETS, sets * self._each_set)
        self.expect(EVIDENCE, REGRESSED + learnt * LEARNT_BESIDE_ONE)

    def found(self, causes: int, most: int, further_gain: float) -> None:
        """The best set has so many `causes` of at most so many, and this is what further effects are expected to
        gain."""
        much = further_gain > UNEXPLAINED_GAIN
        learnt = (max(causes, USUAL_CAUSES) + 1) * LEARNT_BESIDE_ONE if much else 0.0
        self.expect(EVIDENCE, REGRESSED + learnt)
        sets = FEWEST_SETS + (SETS_OF_A_CAUSE * (most - causes) if much else 0)
        self.expect(SETS, sets * self._each_set, sets)

    def fits(self, count: int) -> None:
        """At least so many further fits follow."""
        if (bar := self._of_fits) is not None:
            bar.extend(count)

    def fitted(self, names: str) -> None:
        """One of these fits is done, that of the effects `names`."""
        if (bar := self._of_fits) is not None:
            bar.step(names)

    @property
    def _of_fits(self) -> Bar | None:
        """The bar that is open, if it counts fits."""
        return self.bar if self.bar is not None and self.bar.name in (ALONE, SETS) else None
