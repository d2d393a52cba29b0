"""Search for the set of causes: effects are added, removed and exchanged as long as the score on held-out releases
rises.

An effect that gains little alone may gain much together with another one, and an effect that gains alone may be
superfluous together with the true causes. So after each addition every other member of the set is left out once, and at
the end each member is exchanged for its rivals. `Screening` selects the additions that are worth a fit."""

from __future__ import annotations

import hashlib
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from rock2d.arrays import Array
from rock2d.diagnosis.cross_validation import Names, Validated, held_out_gain, load_fit, rests_z, save_fit
from rock2d.diagnosis.data import Data
from rock2d.diagnosis.exploring import (
    REFIT_GAIN,
    WIDE_SCAN,
    Explored,
    explore_on_some,
    fit_effects,
    narrowed_starts,
    not_below,
    total_on_some,
)
from rock2d.diagnosis.fitting import Convergence, Fit, extended, fit, some_releases
from rock2d.diagnosis.likelihood import total_log_likelihood
from rock2d.diagnosis.linear_model import Expected, Screening
from rock2d.diagnosis.model import BASE_WIDTH, Model
from rock2d.diagnosis.significance import Gain
from rock2d.diagnosis.visibility import DISTORTIONS
from rock2d.diagnosis.workload import ALONE, EXPLORING, SETS, USUAL_SETS, DiagnosisBars
from rock2d.effects import catalogue
from rock2d.effects.effect import Effect
from rock2d.files.saved_arrays import load_arrays, save_arrays
from rock2d.processes import Processes

MOST_CAUSES = 5  # in a set
ADDED_AT_ONCE = 4  # additions that are fitted at each step
EXCHANGED_AT_ONCE = 2  # rivals that are fitted in place of each member
LEAST_PROMISE = 3.0  # log likelihood that screening must promise of an addition
LEAST_SCATTER_GAIN = 3.0  # log likelihood that an effect that only widens the scatter must gain alone
REFIT_SHARE = 0.5  # an addition is fitted again if it gains this share of the largest gain
EXCHANGE_GAIN = 1.0  # log likelihood that an exchange must gain
MOST_EXCHANGES = 3
MISSED_BY_FORM = 0.1  # share of the gain of a cause that a law of a slightly different form may miss
MISSED_BY_TWIN = 0.25  # the same for its twin: only contacts tell it apart, where a law is least exact
KEPT_BESIDE_OTHER = 0.75  # share of its gain that a cause keeps beside an effect that explains something else
# Effects that change gravity in flights in the same way: only contacts tell them apart.
TWINS = {"scale_error": "frame_rate_error", "frame_rate_error": "scale_error"}
# of each of them the first parameter, and the power of it by which gravity in flights changes
GRAVITY_POWERS = {"scale_error": ("scale", 1), "frame_rate_error": ("time_scale", 2)}
VALLEY_POINTS = 25  # tried sizes of a twin beside the other one


@dataclass
class Search:
    """All fitted sets of causes, and the best one.

    Attributes
    ----------
    data : data of the fits; every worker of `processes` has them, too
    effects : the catalogue
    base : the base law
    bars : progress bars of the diagnosis
    folder : keeps finished fits
    known : names -> fitted set
    best : the best set so far
    expected : names of a set -> gain that screening expects of each further effect
    reduced : (names of a set, member) from which the set without the member was fitted"""

    data: Data
    effects: Mapping[str, Effect]
    processes: Processes
    base: Validated
    bars: DiagnosisBars
    folder: Path | None = None
    known: dict[Names, Validated] = field(init=False)
    best: Validated = field(init=False)
    expected: dict[Names, dict[str, Expected]] = field(init=False)
    reduced: set[tuple[Names, str]] = field(init=False)

    def __post_init__(self) -> None:
        self.known, self.best, self.expected, self.reduced = {frozenset(): self.base}, self.base, {}, set()

    def try_alone(self) -> None:
        """Fit the base law with each effect alone. All are explored first, so that a fit far behind another one ends
        early."""
        base, on_some = self.base.fit, total_on_some(self.base.fit, self.data)
        found, gain = dict[int, Explored](), -np.inf
        jobs = [(_Addition(base, name, None), on_some, self.folder) for name in self.effects]
        with self.bars.stage(EXPLORING, len(jobs), "effects") as bar:
            self.bars.starts()
            for k, own in self.processes.as_finished(_explore_step, jobs):
                found[k] = own
                gain = max(gain, own.gain)
                self.bars.explored(len(found) / len(jobs), gain)
                bar.step(jobs[k][0].name)
        rival_total = base.total() + gain
        steps = [_Addition(base, name, None, found[k], rival_total) for k, name in enumerate(self.effects)]
        with self.bars.stage(ALONE, len(steps), "effects"):
            self._fit(steps)

    @property
    def alone(self) -> dict[str, Validated]:
        """The sets of one effect; name -> set."""
        return {name: self.known[frozenset({name})] for name in self.effects}

    def run(self) -> None:
        """Find the best set, after `try_alone`."""
        with self.bars.stage(SETS, USUAL_SETS, "fits"):
            self._grow()
            for _ in range(MOST_EXCHANGES):
                if not self._exchange():
                    break
                self._grow()

    def without(self, cause_set: Validated) -> dict[str, Validated]:
        """The sets that leave out one member each; name of the member -> set.

        Known ones that fit much worse are fitted again from this set, once: what the member seems to gain may be the
        way out of a worse optimum."""
        smaller = {name: cause_set.names - {name} for name in sorted(cause_set.names)}
        self._fit([Reduction(cause_set.fit, name) for name, names in smaller.items() if names not in self.known])
        least = cause_set.fit.total() - REFIT_GAIN
        again = [
            name for name, names in smaller.items()
            if names and self.known[names].fit.total() < least and (cause_set.names, name) not in self.reduced
        ]  # fmt: skip
        self.reduced |= {(cause_set.names, name) for name in smaller}
        for own in self._results([Reduction(cause_set.fit, name) for name in again]):
            if own.fit.total() > self.known[own.names].fit.total() + REFIT_GAIN:
                self._replace(own, {cause_set.names, self.best.names})
        return {name: self.known[names] for name, names in smaller.items()}

    def _replace(self, better: Validated, kept: Collection[Names]) -> None:
        """Put a better fit in place of a known set. Larger sets that began at the old one are forgotten, but for those
        `kept`."""
        stale = {names for names in self.known if names > better.names} - {*kept}
        self.known = {names: own for names, own in self.known.items() if names not in stale} | {better.names: better}
        self.reduced = {(names, member) for names, member in self.reduced if names not in stale}
        screened = better.names in self.expected
        self.expected = {
            names: own for names, own in self.expected.items() if names not in stale and names != better.names
        }
        if screened:  # rivals of the members are read from it
            self.expected_beside(better)

    def find_rivals(self, cause_set: Validated, name: str, z: float, fitted: Collection[str] = ()) -> dict[str, float]:
        """Rivals of a member of a set: effect -> standard errors by which the set is better than with the effect in
        place of the member, if less than z; the closest first.

        A rival gains at least half of what the member gains. One that gains more must explain the same: beside it the
        member loses gain, see KEPT_BESIDE_OTHER. A difference within the share MISSED_BY_FORM, or MISSED_BY_TWIN,
        counts as less than one standard error; that of the rests counts in full. The twin of the member, the effects
        `fitted`, and the first that promise as much are fitted in its place: what screening expects of an effect can be
        far too little."""
        smaller, found = self.without(cause_set)[name], dict[str, float]()
        twin, alone = TWINS.get(name, name), self.gain(cause_set, smaller).total
        expected = self.expected.get(smaller.names, {})
        first = sorted(expected.keys() - cause_set.names, key=lambda n: (-expected[n].promise, n))[:EXCHANGED_AT_ONCE]
        rivals = {*fitted, twin, *(n for n in first if expected[n].promise > 0.5 * alone > 0.0)}
        possible = self.effects.keys() - cause_set.names
        self._with_each(sorted(rivals & possible), smaller)
        for rival in possible:
            if (lead := self._lead_over(cause_set, smaller, rival)) is None or lead.total > 0.5 * alone:
                continue
            missed = MISSED_BY_TWIN if rival == twin else MISSED_BY_FORM
            found[rival] = min(lead.significance, lead.total / (missed * alone))
            if (other := self.known.get(smaller.names | {rival})) is not None:
                found[rival] += rests_z(self.data, cause_set, other)
        closest = [rival for rival in sorted(found, key=lambda r: (found[r], r)) if found[rival] < z]
        return {
            rival: found[rival] for rival in closest
            if found[rival] >= 0.0 or not self._explains_something_else(cause_set, name, rival)
        }  # fmt: skip

    def gain(self, cause_set: Validated, other: Validated) -> Gain:
        """Gain of a set over another one."""
        return held_out_gain(self.data, cause_set, other)

    def share_in_place(self, name: str, other: str) -> float:
        """Share of the gain of a member of the best set that another effect gains in its place."""
        smaller = self.without(self.best)[name]
        in_place = self._with_each([other], smaller)[0]
        return self.gain(in_place, smaller).total / max(self.gain(self.best, smaller).total, 1e-9)

    def _explains_something_else(self, cause_set: Validated, name: str, rival: str) -> bool:
        """Whether a member of a set keeps its gain beside a rival. The twin of the member is never beside it."""
        if rival == TWINS.get(name):
            return False
        smaller = self.without(cause_set)[name]
        (both,), (in_place,) = (self._with_each([rival], each) for each in (cause_set, smaller))
        least = KEPT_BESIDE_OTHER * self.gain(cause_set, smaller).total
        return self.gain(both, in_place).total > least

    def _lead_over(self, cause_set: Validated, less: Validated, name: str) -> Gain | None:
        """Gain of a set over the set `less` with one more effect, fitted or expected; None if neither is known."""
        if (found := self.known.get(less.names | {name})) is not None:
            return self.gain(cause_set, found)
        expected = self.expected.get(less.names, {}).get(name)
        return None if expected is None or expected.promise <= 0.0 else self.gain(cause_set, less).plus(-expected.gain)

    def set_of(self, names: Names) -> Validated:
        """The set of these effects, fitted by way of smaller and larger sets if it is new."""
        cause_set = self.best
        for name in sorted(cause_set.names - names):
            cause_set = self.without(cause_set)[name]
        for name in sorted(names - cause_set.names):
            cause_set = self._with_each([name], cause_set)[0]
        return cause_set

    def known_subsets(self, names: Names) -> dict[Names, Validated]:
        """The known sets with effects among `names`, after each of `names` was left out once."""
        self.without(self.known[names])
        return {subset: cause_set for subset, cause_set in self.known.items() if subset <= names}

    def expected_beside(self, cause_set: Validated) -> dict[str, Expected]:
        """Gain that screening expects of each effect in addition to a set."""
        if cause_set.names not in self.expected:
            alone = {name: found.fit.p for name, found in self.alone.items()}
            self.expected[cause_set.names] = Screening(cause_set.fit, self.data).all(self.effects, alone)
        return self.expected[cause_set.names]

    def _grow(self) -> None:
        """Add effects, and remove those that become superfluous, until nothing gains or a set occurs again:
        significance is not transitive, so effects can replace each other in turn."""
        seen = set[Names]()
        while len(self.best.names) < MOST_CAUSES and self.best.names not in seen:
            seen.add(self.best.names)
            found = self.promising_additions(self.best, self.best.names, ADDED_AT_ONCE)
            if self.best.names:
                wider = [name for name in self.effects.keys() - self.best.names if self.effects[name].scatter]
                alone = {name: self.gain(self.known[frozenset({name})], self.base).total for name in sorted(wider)}
                found += self._with_each([n for n, gain in alone.items() if gain > LEAST_SCATTER_GAIN], self.best)
            found += self._with_both_twins()
            gains = [(self.gain(addition, self.best), addition) for addition in found]
            better = [(gain.total, addition) for gain, addition in gains if gain.significant_addition]
            if not better:
                return
            previous, self.best = self.best, max(better, key=lambda pair: pair[0])[1]
            self._prune(self.best.names - previous.names)
            refitted = self.known.get(previous.names) or self.set_of(previous.names)
            if refitted is not previous and not self.gain(self.best, refitted).significant_addition:
                self.best = refitted
                seen.remove(refitted.names)

    def _with_both_twins(self) -> list[Validated]:
        """The best set with both twins in addition, if it has room for them. Where gravity gave the frame rate, it
        hides a wrong scale: neither of the two gains anything alone."""
        both, names = self.best, self.best.names
        if names & TWINS.keys() or len(names) + 2 > MOST_CAUSES or not TWINS.keys() <= self.effects.keys():
            return []
        for name in sorted(TWINS, reverse=True):
            both = self._with_each([name], both)[0]
        return [both]

    def promising_additions(
        self, cause_set: Validated, excluded: Names, most: int, lead: float = 0.0
    ) -> list[Validated]:
        """The sets with one more effect that is not in `excluded`: the `most` of them that promise most, and the twin
        of a member: both explain gravity alike along a bent valley, so screening expects too little of it.

        `lead`: see `_fit`."""
        if not cause_set.names:  # all effects were fitted alone
            return [found for name, found in self.alone.items() if name not in excluded]
        twins = sorted({TWINS[name] for name in cause_set.names & TWINS.keys()} & self.effects.keys() - excluded)
        expected = {name: e for name, e in self.expected_beside(cause_set).items() if name not in excluded}
        if cause_set is self.best:
            self.bars.found(len(cause_set.names), MOST_CAUSES, sum(max(e.total, 0.0) for e in expected.values()))
        ranked = sorted(expected, key=lambda name: -expected[name].promise)
        first = [n for n in ranked if expected[n].promise > LEAST_PROMISE and n not in twins][:most]
        return self._with_each(first + twins, cause_set, lead)

    def _with_each(self, names: Sequence[str], cause_set: Validated, lead: float = 0.0) -> list[Validated]:
        """The set with each of these effects in addition, one at a time; `lead`: see `_fit`."""
        new = [name for name in names if cause_set.names | {name} not in self.known]
        before, rival_total = cause_set.fit, cause_set.fit.total() + lead if lead > 0.0 else -np.inf
        starts = [None if self.effects[name].scatter else self.expected_beside(cause_set)[name].p for name in new]
        self._fit(
            [_Addition(before, name, at, rival_total=rival_total) for name, at in zip(new, starts, strict=True)], lead
        )
        return [self.known[cause_set.names | {name}] for name in names]

    def _prune(self, kept: Names) -> None:
        """Remove members that do not gain significantly, the least useful first; `kept` stay."""
        while len(self.best.names) > 1:
            smaller = {name: own for name, own in self.without(self.best).items() if name not in kept}
            least = min(smaller, key=lambda name: self.gain(self.best, smaller[name]).total, default=None)
            if least is None or self.gain(self.best, smaller[least]).significant_addition:
                return
            self.best = smaller[least]

    def _exchange(self) -> bool:
        """Exchange a member for a rival that gains more, or for two; returns whether there is one."""
        exchanged: list[Validated] = []
        for name, smaller in self.without(self.best).items():
            lead = self.best.fit.total() - smaller.fit.total()
            rivals = self.promising_additions(smaller, self.best.names, EXCHANGED_AT_ONCE, lead)
            if name in DISTORTIONS and rivals and len(self.best.names) < MOST_CAUSES:  # it can stand for two causes
                nearest = max(rivals, key=lambda one: one.fit.total())
                rivals += self.promising_additions(nearest, self.best.names, EXCHANGED_AT_ONCE)
            exchanged += rivals
        best = max(exchanged, key=lambda one: self.gain(one, self.best).total, default=None)
        if best is None or self.gain(best, self.best).total < EXCHANGE_GAIN:
            return False
        self.best = best
        return True

    def _fit(self, steps: Sequence[_Addition | Reduction], lead: float = 0.0) -> None:
        """Fit models that differ from known ones in one effect. The additions that gain most are fitted again with
        the noise covariance at their own parameters.

        `lead`: gain in log likelihood of the set that they are compared with over the known one."""
        results = self._results(steps)
        gains = {
            k: results[k].fit.total() - step.before.total()
            for k, step in enumerate(steps)
            if isinstance(step, _Addition) and not self.effects[step.name].scatter
        }
        least = max(REFIT_GAIN, REFIT_SHARE * max([lead, *gains.values()]))
        again = [k for k, gain in gains.items() if gain > least]
        refitted = self._results([_Refit(results[k].fit) for k in again])
        for k, own in zip(again, refitted, strict=True):
            results[k] = own
        for own in results:
            self.known[own.names] = own
        self._fit_from_twins(results)

    def _fit_from_twins(self, fitted: Sequence[Validated]) -> None:
        """Fit sets again from those with the twin of a member, where these explain much more: contacts can keep a fit
        near no effect, and what was fitted beside the twin is far from where it belongs."""
        steps = list[_Addition]()
        for own in fitted:
            for name in sorted(n for n, other in TWINS.items() if n in own.names and other not in own.names):
                rest = own.names - {name}
                smaller, twin = self.known.get(rest), self.known.get(rest | {TWINS[name]})
                if smaller is not None and twin is not None and twin.fit.total() > own.fit.total() + REFIT_GAIN:
                    step = _Addition(smaller.fit, name, None)
                    steps.append(replace(step, start=_start_from_twin(step.model, name, twin.fit)))
        for again in self._results([_Refit(found.fit) for found in self._results(steps)]):
            self.known[again.names] = max(again, self.known[again.names], key=lambda one: one.fit.total())

    def _results(self, steps: Sequence[_Addition | Reduction | _Refit]) -> list[Validated]:
        """The fitted sets of the steps, in the order of the steps."""
        results: dict[int, Validated] = {}
        self.bars.fits(len(steps))
        jobs = [(step, self.folder) for step in steps]
        for k, found in self.processes.as_finished(_fit_step, jobs):
            results[k] = found
            self.bars.fitted(" + ".join(steps[k].model.positions))
        return [results[k] for k in range(len(steps))]


@dataclass
class _Addition:
    """Add the effect `name` to the fit `before`, from the parameters `start`; if there are none, they are explored.

    `found`: result of exploring, if known; `rival_total`: log likelihood that another set reaches."""

    before: Fit
    name: str
    start: Array | None
    found: Explored | None = None
    rival_total: float = -np.inf

    @property
    def model(self) -> Model:
        known = self.before.model
        effects = [catalogue()[name] for name in (*known.positions, self.name)]
        return replace(known, effects=effects, known_p=self.before.p)

    def fitted(self, data: Data) -> Fit:
        if self.start is not None:
            convergence = Convergence(rival_total=self.rival_total)
            if TWINS.get(self.name) in self.before.model.positions:
                starts = _starts_beside_twin(self.model, data, self.name, self.before)
            else:
                starts = [self.start, *narrowed_starts(self.model, data.coarse(), self.before)]
            best = max((fit(self.model, data, p, self.before, convergence) for p in starts), key=Fit.total)
            return not_below(best, self.before, data, convergence)
        found = self.found or explore_on_some(self.model, data, self.before)
        return fit_effects(self.model, data, self.before, found, self.rival_total)


@dataclass
class _Refit:
    """Fit a model again, with the noise covariance computed at its parameters."""

    before: Fit

    @property
    def model(self) -> Model:
        return self.before.model

    def fitted(self, data: Data) -> Fit:
        return fit(self.model, data, self.before.p, self.before, renew_noise=True, residuals=self.before.residuals)


@dataclass
class Reduction:
    """Remove the effect `name` from the fit `before`. A fit that ends below `smaller`, the same effects without learnt
    changes, starts again from there."""

    before: Fit
    name: str
    smaller: Fit | None = None

    @property
    def model(self) -> Model:
        known = self.before.model
        fewer = [effect for effect in known.effects if effect.name != self.name]
        return replace(known, effects=fewer, known_p=self.before.p)

    def fitted(self, data: Data) -> Fit:
        before, model = self.before, self.model
        kept, scatter = np.ones(before.model.size, bool), np.ones(len(before.scatter), bool)
        kept[before.model.positions[self.name]] = False
        for k, effect in enumerate(before.model.scatter_effects, len(BASE_WIDTH)):
            scatter[k] = effect.name != self.name
        p, slope = before.p[kept], before.jacobian.only(kept).scattered_by(scatter)
        # noise and derivatives of the fit before are near those of the new one
        old = replace(before, model=model, p=p, scatter=before.scatter[scatter], jacobian=slope)
        found = fit(model, data, p, old=old)
        if self.smaller is None or found.total() >= self.smaller.total():
            return found
        return max(found, fit(model, data, _start_from(model, self.smaller), old=found), key=Fit.total)


def _start_from(model: Model, known: Fit) -> Array:
    """Parameters of a model from a fit of the law with some of its effects."""
    start, places = model.start(), known.model.positions
    start[: len(BASE_WIDTH)] = known.p[: len(BASE_WIDTH)]
    for shared in model.positions.keys() & places.keys():
        start[model.positions[shared]] = known.p[places[shared]]
    return start


def _start_from_twin(model: Model, name: str, twin: Fit) -> Array:
    """Parameters of a set with the effect `name`, from the fit of the set with its twin, with the same gravity."""
    start, other = _start_from(model, twin), TWINS[name]
    (_, power), (_, power_of_twin) = GRAVITY_POWERS[name], GRAVITY_POWERS[other]
    # both are factors, of which `Model` has the logarithms
    start[model.positions[name].start] = twin.p[twin.model.positions[other].start] * power_of_twin / power
    return start


def _starts_beside_twin(model: Model, data: Data, name: str, before: Fit) -> list[Array]:
    """Starts of a set with both twins, from the fit of the set without `name`: the best points, on some releases, of
    the valley in which gravity in flights stays, with the further parameters of the twin as they are and neutral."""
    (low, high), fitted, other = model.bounds(), extended(before, model), TWINS[name]
    (_, power), (_, power_of_twin) = GRAVITY_POWERS[name], GRAVITY_POWERS[other]
    own, of_twin = model.positions[name].start, model.positions[other]
    some, plain, best = some_releases(data), fitted.copy(), list[Array]()
    few, wide = data.only(some).coarse(), WIDE_SCAN * before.only(some, data).covariance()
    plain[of_twin] = model.start()[of_twin]
    for start in (fitted, plain):
        points = np.tile(start, (VALLEY_POINTS, 1))
        points[:, own] = np.linspace(low[own], high[own], VALLEY_POINTS)
        points[:, of_twin.start] = fitted[of_twin.start] - points[:, own] * power / power_of_twin
        totals = [total_log_likelihood(model.residuals(p, few), wide) for p in points.clip(low, high)]
        best.append(points[int(np.argmax(totals))])
    return best


def _explore_step(data: Data, step: _Addition, on_some: float, folder: Path | None) -> Explored:
    """Explore an addition, or read its saved result."""
    path = None if folder is None else folder / f"explored_{_file_name(step)}.npz"
    if path is not None and (kept := load_arrays(path)) is not None:
        return Explored(kept["p"], float(kept["gain"]), bool(kept["useful"]))
    found = explore_on_some(step.model, data, step.before, on_some)
    if path is not None:
        save_arrays(path, **{name: np.asarray(part) for name, part in found._asdict().items()})
    return found


def _fit_step(data: Data, step: _Addition | Reduction | _Refit, folder: Path | None) -> Validated:
    """Fit and cross-validate, or read the saved result."""
    path = None if folder is None else folder / f"{_file_name(step)}.npz"
    if path is not None and (found := load_fit(path, step.model)) is not None:
        return found
    found = Validated.of(step.fitted(data), data)
    if path is not None:
        save_fit(path, found)
        # read back, so that a resumed diagnosis uses arrays with the same memory layout
        return load_fit(path, found.fit.model) or found
    return found


def _file_name(step: _Addition | Reduction | _Refit) -> str:
    """Name of the saved result of a step, from its effects and its start."""
    parts = (step.before.p, getattr(step, "start", None))
    key = hashlib.sha256(b"".join(part.tobytes() for part in parts if part is not None)).hexdigest()[:8]
    return f"{'+'.join(step.model.positions)}_{key}"
