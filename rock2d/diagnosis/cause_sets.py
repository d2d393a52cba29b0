"""Sets of causes: effects are added to the base law, taken away and exchanged, as long as held-out releases gain.

What adds little alone may add much beside another cause, and what looks like a cause alone may be needless beside the
true ones. So after each addition every other member of the set is left out once, and at the end each member is
exchanged for its rivals. `screening` says which additions are worth a fit.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from rock2d.diagnosis.cross_validation import HeldOut, cross_validate, held_out_gain, load_fit, save_fit
from rock2d.diagnosis.data import Data
from rock2d.diagnosis.exploring import REFIT_GAIN, Explored, explored, fit_effects, fit_to_some
from rock2d.diagnosis.fitting import Fit, fit
from rock2d.diagnosis.model import BASE_WIDTH, Model
from rock2d.diagnosis.screening import Expected, Screening
from rock2d.diagnosis.significance import Gain
from rock2d.diagnosis.workload import ALONE, EXPLORING, SETS, USUAL_SETS, DiagnosisBars
from rock2d.effects import catalogue
from rock2d.effects.effect import Effect
from rock2d.files.saved_arrays import load_arrays, save_arrays
from rock2d.processes import Processes

Array = np.ndarray
Names = frozenset[str]

MOST_CAUSES = 5  # in one set
ADDED_AT_ONCE = 4  # additions that are fitted at each step
EXCHANGED_AT_ONCE = 2  # rivals of each member that are fitted
LEAST_EXPECTED_GAIN = 1.0  # log likelihood that screening must expect of an addition
LEAST_SCATTER_GAIN = 3.0  # log likelihood that an effect which only widens the scatter must gain alone
REFIT_SHARE = 0.5  # share of the largest gain among additions that one must gain to be fitted again
EXCHANGE_GAIN = 1.0  # log likelihood that an exchange must gain
MOST_EXCHANGES = 3
MISSED_BY_FORM = 0.1  # share of what a cause gains that a form which is not quite its own may miss
# effects of which a set has one at most: in flights they change gravity alike, and only heights of contacts tell them
# apart
TWINS = {"scale_error": "frame_rate_error", "frame_rate_error": "scale_error"}


@dataclass
class CauseSet:
    """The base law with a set of effects.

    Attributes
    ----------
    fit, held_out : the joint fit, and its residuals and scores on held-out releases
    """

    fit: Fit
    held_out: HeldOut

    @property
    def names(self) -> Names:
        """Names of the effects."""
        return frozenset(self.fit.model.places)


@dataclass
class Search:
    """All sets that were fitted, and the best of them.

    Attributes
    ----------
    data : of the fits; also in every worker of `processes`
    effects : of the catalogue
    base : the base law
    bars : of the diagnosis
    folder : keeps finished fits
    known : names -> set
    best : the set from which no addition, omission or exchange gains more
    expected : names of a set -> what screening expects of each effect beside it
    """

    data: Data
    effects: Mapping[str, Effect]
    processes: Processes
    base: CauseSet
    bars: DiagnosisBars
    folder: Path | None = None
    known: dict[Names, CauseSet] = field(init=False)
    best: CauseSet = field(init=False)
    expected: dict[Names, dict[str, Expected]] = field(init=False)

    def __post_init__(self) -> None:
        self.known, self.best, self.expected = {frozenset(): self.base}, self.base, {}

    def try_alone(self) -> None:
        """Fit the base law with each effect alone. All are explored first: no fit goes on far behind another one."""
        base, on_some = self.base.fit, fit_to_some(self.base.fit, self.data)
        found, gain = dict[int, Explored](), -np.inf
        jobs = [(_Addition(base, name, None), on_some, self.folder) for name in self.effects]
        with self.bars.stage(EXPLORING, len(jobs), "effects") as bar:
            self.bars.starts()
            for k, own in self.processes.as_finished(_explore_step, jobs):
                found[k] = own
                gain = max(gain, own.gain)
                self.bars.explored(len(found) / len(jobs), gain)
                bar.step(jobs[k][0].name)
        rival = base.total() + gain
        steps = [_Addition(base, name, None, found[k], rival) for k, name in enumerate(self.effects)]
        with self.bars.stage(ALONE, len(steps), "effects"):
            self._fit(steps)

    def measure_over(self, base: CauseSet) -> None:
        """Measure gains over another fit of the base law; the effects that were tried stay as they are."""
        self.base = self.best = self.known[frozenset()] = base

    @property
    def alone(self) -> dict[str, CauseSet]:
        """The sets of one effect; name -> set."""
        return {name: self.known[frozenset({name})] for name in self.effects}

    def run(self) -> None:
        """Find the best set, once each effect was tried alone."""
        with self.bars.stage(SETS, USUAL_SETS, "fits"):
            self._grow()
            for _ in range(MOST_EXCHANGES):
                if not self._exchange():
                    break
                self._grow()

    def without(self, own: CauseSet) -> dict[str, CauseSet]:
        """The sets that leave out one member each; name of the member -> set."""
        missing = [name for name in sorted(own.names) if own.names - {name} not in self.known]
        self._fit([Reduction(own.fit, name) for name in missing])
        return {name: self.known[own.names - {name}] for name in sorted(own.names)}

    def rivals(self, own: CauseSet, name: str, z: float) -> dict[str, float]:
        """Effect -> standard errors, less than z, by which the set is better than with it in the place of a member; the
        closest first. A rival gains at least half of what the member gains; a share that the form of a law may miss
        counts as no difference."""
        less, found = self.without(own)[name], dict[str, float]()
        alone = self.gain(own, less).total
        for rival in self.effects.keys() - own.names:
            if (ahead := self._ahead(own, less, rival)) is None or ahead.total > 0.5 * alone:
                continue
            found[rival] = min(ahead.significance, ahead.total / (MISSED_BY_FORM * alone))
        return {
            rival: found[rival] for rival in sorted(found, key=lambda r: (found[r], r)) if found[rival] < z
        }

    def gain(self, own: CauseSet, other: CauseSet) -> Gain:
        """Gain of a set over another one."""
        return held_out_gain(self.data, own, other)

    def _ahead(self, own: CauseSet, less: CauseSet, name: str) -> Gain | None:
        """Gain of a set over another one with one more effect, fitted or expected; None if neither is known."""
        if (found := self.known.get(less.names | {name})) is not None:
            return self.gain(own, found)
        expected = self.expected.get(less.names, {}).get(name)
        return None if expected is None else self.gain(own, less).plus(-expected.gain)

    def joint(self, names: Names) -> CauseSet:
        """The set of these effects."""
        own = self.best
        for name in sorted(own.names - names):
            own = self.without(own)[name]
        for name in sorted(names - own.names):
            own = self._with([name], own)[0]
        return own

    def within(self, names: Names) -> dict[Names, CauseSet]:
        """The known sets whose effects are all among `names`."""
        self.without(self.known[names])
        return {subset: own for subset, own in self.known.items() if subset <= names}

    def beside(self, own: CauseSet) -> dict[str, Expected]:
        """What screening expects of each further effect."""
        if own.names not in self.expected:
            alone = {name: found.fit.p for name, found in self.alone.items()}
            self.expected[own.names] = Screening(own.fit, self.data).all(self.effects, alone)
        return self.expected[own.names]

    def _grow(self) -> None:
        """Add effects, and leave out what they make needless, until nothing gains or a set comes back: significance
        is not transitive, so effects can replace each other in turn."""
        seen = set[Names]()
        while len(self.best.names) < MOST_CAUSES and self.best.names not in seen:
            seen.add(self.best.names)
            found = self._additions(self.best, self.best.names, ADDED_AT_ONCE)
            if self.best.names:
                found += self._with([n for n in self._scatters() if n not in self.best.names], self.best)
            gains = [(self.gain(own, self.best), own) for own in found]
            better = [(gain.total, own) for gain, own in gains if gain.significant]
            if not better:
                return
            known, self.best = self.best, max(better, key=lambda pair: pair[0])[1]
            self._prune(self.best.names - known.names)

    def _additions(self, own: CauseSet, but: Names, most: int, ahead: float = 0.0) -> list[CauseSet]:
        """The sets with one more effect, none of `but`: the `most` of them from which screening expects most.

        `ahead`: see `_fit`.
        """
        if not own.names:  # all effects were fitted alone
            return [found for name, found in self.alone.items() if name not in but]
        expected = {name: e.total for name, e in self.beside(own).items() if name not in but}
        if own is self.best:
            self.bars.found(len(own.names), MOST_CAUSES, sum(max(gain, 0.0) for gain in expected.values()))
        ranked = sorted(expected, key=lambda name: -expected[name])
        return self._with([n for n in ranked if expected[n] > LEAST_EXPECTED_GAIN][:most], own, ahead)

    def _with(self, names: Sequence[str], own: CauseSet, ahead: float = 0.0) -> list[CauseSet]:
        """A set with each of these effects in addition."""
        names = [name for name in names if TWINS.get(name) not in own.names]
        new = [name for name in names if own.names | {name} not in self.known]
        self._fit([_Addition(own.fit, name, self._start(own, name)) for name in new], ahead)
        return [self.known[own.names | {name}] for name in names]

    def _prune(self, kept: Names) -> None:
        """Leave out members that add nothing, the least useful first."""
        while len(self.best.names) > 1:
            smaller = {name: own for name, own in self.without(self.best).items() if name not in kept}
            least = min(smaller, key=lambda name: self.gain(self.best, smaller[name]).total, default=None)
            if least is None or self.gain(self.best, smaller[least]).significant:
                return
            self.best = smaller[least]

    def _exchange(self) -> bool:
        """Exchange a member for a rival that gains more; whether there is one."""
        rivals: list[CauseSet] = []
        for own in self.without(self.best).values():
            ahead = self.best.fit.total() - own.fit.total()
            rivals += self._additions(own, self.best.names, EXCHANGED_AT_ONCE, ahead)
        best = max(rivals, key=lambda own: self.gain(own, self.best).total, default=None)
        if best is None or self.gain(best, self.best).total < EXCHANGE_GAIN:
            return False
        self.best = best
        return True

    def _scatters(self) -> list[str]:
        """Effects that only widen the scatter, and do so alone."""
        return [
            name for name, found in self.alone.items()
            if self.effects[name].scatter and self.gain(found, self.base).total > LEAST_SCATTER_GAIN
        ]  # fmt: skip

    def _start(self, own: CauseSet, name: str) -> Array | None:
        return None if self.effects[name].scatter else self.beside(own)[name].p

    def _fit(self, steps: Sequence[_Addition | Reduction], ahead: float = 0.0) -> None:
        """Fit models that differ from known ones in one effect. The additions that gain most are fitted again with
        their own noise: that of a fit far from the truth is wrong, too.

        `ahead`: what the set that they are compared with gains over the known one.
        """
        results = self._finished(steps)
        gains = {
            k: results[k].fit.total() - step.before.total()
            for k, step in enumerate(steps)
            if isinstance(step, _Addition) and not self.effects[step.name].scatter
        }
        least = max(REFIT_GAIN, REFIT_SHARE * max([ahead, *gains.values()]))
        again = [k for k, gain in gains.items() if gain > least]
        refitted = self._finished([_Refit(results[k].fit) for k in again])
        for k, own in zip(again, refitted, strict=True):
            results[k] = own
        for own in results:
            self.known[own.names] = own

    def _finished(self, steps: Sequence[_Addition | Reduction | _Refit]) -> list[CauseSet]:
        """What the steps fit, in their order, however many processes there are."""
        results: dict[int, CauseSet] = {}
        self.bars.fits(len(steps))
        for k, (fitted, out) in self.processes.as_finished(
            _fit_step, [(step, self.folder) for step in steps]
        ):
            results[k] = CauseSet(fitted, out)
            self.bars.fitted(" + ".join(steps[k].names))
        return [results[k] for k in range(len(steps))]


@dataclass
class _Addition:
    """A fit, the effect that is added to it, and parameters to start from; without these they are explored.

    `found`: what exploring found, if it is known; `rival`: log likelihood that another addition will reach.
    """

    before: Fit
    name: str
    start: Array | None
    found: Explored | None = None
    rival: float = -np.inf

    @property
    def names(self) -> list[str]:
        return [*(e.name for e in self.before.model.effects), self.name]

    @property
    def model(self) -> Model:
        known = self.before.model
        return replace(known, effects=[catalogue()[n] for n in self.names], beside=self.before.p)

    def explored(self, data: Data, on_some: float = -np.inf) -> Explored:
        """Where to start; `on_some`: log likelihood of `fit_to_some` of the fit before."""
        return explored(self.model, data, self.before, on_some)

    def fitted(self, data: Data) -> Fit:
        if self.start is not None:
            return fit(self.model, data, self.start, old=self.before)
        return fit_effects(self.model, data, self.before, self.found or self.explored(data), self.rival)


@dataclass
class _Refit:
    """A fit whose noise is computed again."""

    before: Fit

    @property
    def names(self) -> list[str]:
        return [e.name for e in self.before.model.effects]

    @property
    def model(self) -> Model:
        return self.before.model

    def fitted(self, data: Data) -> Fit:
        return fit(self.model, data, self.before.p, old=self.before, renew_noise=True)


@dataclass
class Reduction:
    """A fit, and the effect that is taken out of it."""

    before: Fit
    name: str

    @property
    def names(self) -> list[str]:
        return [e.name for e in self.before.model.effects if e.name != self.name]

    @property
    def model(self) -> Model:
        known = self.before.model
        fewer = [effect for effect in known.effects if effect.name != self.name]
        return replace(known, effects=fewer, beside=self.before.p)

    def fitted(self, data: Data) -> Fit:
        before, model = self.before, self.model
        kept, scatter = np.ones(before.model.size, bool), np.ones(len(before.scatter), bool)
        kept[before.model.places[self.name]] = False
        for k, effect in enumerate(before.model.scatter_effects, len(BASE_WIDTH)):
            scatter[k] = effect.name != self.name
        p, slope = before.p[kept], before.jacobian.only(kept)
        slope.scatter = slope.scatter[..., scatter]
        # noise and derivatives of the fit before are near those of the new one
        old = replace(before, model=model, p=p, scatter=before.scatter[scatter], jacobian=slope)
        return fit(model, data, p, old=old)


def _explore_step(data: Data, step: _Addition, on_some: float, folder: Path | None) -> Explored:
    """Explore an addition, or read the result if it is kept."""
    path = None if folder is None else folder / f"explored_{_name(step)}.npz"
    if path is not None and (kept := load_arrays(path)) is not None:
        return Explored(kept["p"], float(kept["gain"]), bool(kept["useful"]))
    found = step.explored(data, on_some)
    if path is not None:
        save_arrays(path, **{name: np.asarray(part) for name, part in found._asdict().items()})
    return found


def _fit_step(data: Data, step: _Addition | Reduction | _Refit, folder: Path | None) -> tuple[Fit, HeldOut]:
    """Fit and cross-validate, or read the result if it is kept."""
    path = None if folder is None else folder / f"{_name(step)}.npz"
    if path is not None and (found := load_fit(path, step.model)) is not None:
        return found
    fitted = step.fitted(data)
    out = cross_validate(fitted, data)
    if path is not None:
        save_fit(path, fitted, out)
        # read back, so that a resumed diagnosis uses arrays with the same memory layout
        return load_fit(path, fitted.model) or (fitted, out)
    return fitted, out


def _name(step: _Addition | Reduction | _Refit) -> str:
    """Name of what a step fits, and from where."""
    parts = (step.before.p, getattr(step, "start", None))
    key = hashlib.sha256(b"".join(part.tobytes() for part in parts if part is not None)).hexdigest()[:8]
    return f"{'+'.join(step.names)}_{key}"
