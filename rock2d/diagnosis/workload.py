"""How much work the stages of a diagnosis are, in evaluations of all residuals: for the time that it still takes.

The numbers are typical of films with 200 to 450 impacts. How much there is to search and to learn becomes known on the
way: what further effects are expected to gain tells how much the best set leaves unexplained.
"""

from __future__ import annotations

from collections.abc import Callable
from time import perf_counter

from rock2d.progress import Bar, Bars

READING, BASE, EXPLORING, ALONE = "reading the film", "base law", "exploring effects", "effects alone"
SETS, LEARNT, GAP, REPORT = "sets of effects", "learnt changes", "gap", "report"

EXPLORED, FITTED = 40.0, 27.0  # evaluations for each effect
ONE_OF_A_SET, SCREENED = 60.0, 18.0  # for each set: in one of the processes, and in this one
LEARNT_BESIDE_ONE = 800.0  # for each set, if there is something to learn
REGRESSED = 400.0  # dependences and regressions of residuals, whatever there is to learn
# log likelihood that all further effects together must be expected to gain, for there to be something
UNEXPLAINED_GAIN = 50.0
LEAST_GAIN = 15.0  # log likelihood of an effect that is worth more than chance gives
FEWEST_SETS, SETS_OF_A_CAUSE = 8, 6  # that are fitted
USUAL_SETS, USUAL_LEARNT, USUAL_CAUSES = 10, 1.0, 3  # before anything is known


class DiagnosisBars(Bars):
    """The bars of a diagnosis that tries so many `effects` with so many `workers`."""

    def __init__(
        self, shown: bool, effects: int, workers: int, clock: Callable[[], float] = perf_counter
    ) -> None:
        self._each_set = ONE_OF_A_SET / workers + SCREENED
        super().__init__(shown, {
            READING: 250.0, BASE: 300.0, EXPLORING: EXPLORED * effects / workers, ALONE: FITTED * effects / workers,
            SETS: USUAL_SETS * self._each_set, LEARNT: REGRESSED + USUAL_LEARNT * LEARNT_BESIDE_ONE, GAP: 100.0,
            REPORT: 600.0,
        }, clock)  # fmt: skip

    def explored(self, share: float, gain: float) -> None:
        """A share of the effects is explored, and one of them gains so much log likelihood. Where none does, there is
        nothing to search."""
        likely = 1.0 if gain > LEAST_GAIN else 1.0 - share
        self.expect(SETS, likely * USUAL_SETS * self._each_set)
        self.expect(LEARNT, REGRESSED + likely * USUAL_LEARNT * LEARNT_BESIDE_ONE)

    def found(self, causes: int, most: int, further_gain: float) -> None:
        """The best set has so many `causes` of at most so many, and this is what further effects are expected to
        gain."""
        much = further_gain > UNEXPLAINED_GAIN
        learnt = (max(causes, USUAL_CAUSES) + 1) * LEARNT_BESIDE_ONE if much else 0.0
        self.expect(LEARNT, REGRESSED + learnt)
        sets = FEWEST_SETS + (SETS_OF_A_CAUSE * (most - causes) if much else 0)
        self.expect(SETS, sets * self._each_set, sets)

    def fits(self, count: int) -> None:
        """At least so many further fits follow."""
        if (bar := self._of_fits) is not None:
            bar.extend(count)

    def fitted(self, names: str) -> None:
        """One of them is done: of these effects."""
        if (bar := self._of_fits) is not None:
            bar.step(names)

    @property
    def _of_fits(self) -> Bar | None:
        """The bar that is open, if it counts fits."""
        return self.bar if self.bar is not None and self.bar.name in (ALONE, SETS) else None
