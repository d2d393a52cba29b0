"""Attribution: the base law against the law with each effect of the catalogue, on held-out releases.

The parameters of the base are free in every model. The gain in log likelihood on held-out releases decides. It is
compared release by release, so a few unusual impacts cannot decide it. The verdict is "none" if no gain is significant,
and "unknown" if the residuals of even the best effect can be predicted (`residual_regression`).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence, Set
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from rock2d.diagnosis.budget import Draws, Sizes
from rock2d.diagnosis.candidate import Candidate
from rock2d.diagnosis.cause_sets import CauseSet, Names, Search
from rock2d.diagnosis.classification import probabilities, statistics
from rock2d.diagnosis.cross_validation import HeldOut, cross_validate, held_out_gain
from rock2d.diagnosis.data import Data
from rock2d.diagnosis.discrepancy import Discrepancy, discrepancies
from rock2d.diagnosis.exploring import REFIT_GAIN
from rock2d.diagnosis.film_data import FilmData
from rock2d.diagnosis.fitting import EXPLORING_ITERATIONS, Enough, Fit, fit, some_releases
from rock2d.diagnosis.inclusion import (
    BesideLearnt,
    explained_away,
    inclusion,
    inclusion_statistics,
    outside_statistics,
)
from rock2d.diagnosis.learnt import Learnt, best_predicting, learn
from rock2d.diagnosis.likelihood import LARGEST_CHI_SQUARE
from rock2d.diagnosis.model import LARGEST_LOG_K_L, Model
from rock2d.diagnosis.predicted_gap import harmless
from rock2d.diagnosis.residual_regression import RegressedResiduals, regress
from rock2d.diagnosis.workload import BASE, LEARNT, DiagnosisBars
from rock2d.effects import catalogue
from rock2d.effects.effect import Effect
from rock2d.laws.contact import INDENTATION
from rock2d.processes import Processes
from rock2d.progress import Bar, Bars
from rock2d.scene.world import World

Array = np.ndarray

SIGNIFICANT_DEPENDENCE_Z = 2.0  # standard errors of a dependence that remains to be explained
NAMED_PROBABILITY = 0.5  # from which on an effect is one of the causes
GROUP_Z = 2.0  # standard errors between effects that the data cannot separate
BASE_STARTS = 2  # places from which the base law is fitted
MOST_RIVALS = 2  # effects that may stand for one that is named
CLEAR_GAIN_Z = 3.0  # standard errors that an effect must gain which only widens the scatter
MOST_RESTARTS = 2  # with a better base law


@dataclass
class Attribution:
    """Result of the attribution.

    Attributes
    ----------
    base, base_held_out : the base law refitted
    candidates : name -> candidate
    chain : the effects of the best set, the one that gains most alone first. Each has the joint fit of all of them, and
        its gain over the set without it. Where no effect gains significantly, the best one
    base_regressed, best_regressed : flexible regression of the residuals of the base and of the last model of the
        chain
    probabilities : over the catalogue, "none" and "unknown"; `statistics`: the numbers that they follow from
    group : effects that the data cannot separate from the best, the best first
    unexplained : significant dependences in the residuals of the last model of the chain, the strongest first
    learnt : what was learnt beside these effects, or beside the base law if they do not; beside others, too, if that
        predicts better (`uncertain`)
    left_regressed : flexible regression of what is left beside the learnt changes
    named : the effects that are probable, all of them in the chain; there may be none
    rivals : each of these -> effects that these data cannot tell from it
    sets : residuals and scores of the sets that tell what each of these closes
    """

    base: Fit
    base_held_out: HeldOut
    candidates: dict[str, Candidate]
    chain: list[Candidate]
    base_regressed: RegressedResiduals
    best_regressed: RegressedResiduals
    probabilities: dict[str, float]
    group: list[str]
    statistics: dict[str, Any]
    unexplained: list[Discrepancy]
    learnt: Learnt
    left_regressed: RegressedResiduals
    named: Names
    rivals: dict[str, list[str]]
    sets: dict[Names, HeldOut]

    @property
    def best(self) -> str:
        return self.chain[0].effect.name

    @property
    def final(self) -> Candidate:
        return self.chain[-1]

    @property
    def uncertain(self) -> list[str]:
        """Effects that act with the learnt changes, although they are not probable."""
        return [e.name for e in self.learnt.fit.model.effects if e.name not in self.named]

    @property
    def verdict(self) -> str:
        return max(self.probabilities, key=lambda name: self.probabilities[name])


def fit_base(
    setup: World, base: Array, data: Data, registered: World | None = None, bars: Bars | None = None
) -> Fit:
    """The paper's law with its own parameters refitted.

    The fit explores a coarse grid around `base` on some releases and then fits all of them. Both readings of the
    rolling resistance are tried (`ContactParameters.rolling_in_indentation`); the better one stays in the set-up.

    If the film was segmented in another world than the stated one (`registered`), the law is fitted there and used
    without a further fit on the stated set-up, where blocks would fall into the ground. The gains of effects over such
    a base are no measure of their size.
    """
    bars = bars or Bars(False)
    if not len(data.impact_release):  # nothing shows the law: it stays as it is stated
        flown = [name for b, name in enumerate(setup.blocks) if b in data.flight_block]
        return fit(Model(setup, base, flown=flown), data)
    with bars.stage(BASE, 2 * BASE_STARTS + 1, "fits") as bar:
        return _fitted_base(setup, base, data, registered, bar)


def _fitted_base(setup: World, base: Array, data: Data, registered: World | None, bar: Bar) -> Fit:
    found = []
    some = data.only(some_releases(data))
    for reading in (0.0, 1.0):
        rows = setup.contact.copy()
        rows[..., INDENTATION] = reading
        model = Model(replace(registered or setup, contact=rows), base)
        corners = [
            np.array([min(stiffness, LARGEST_LOG_K_L), restitution, stiffness, friction, 0.0])
            for stiffness in (0.0, -2.0, 2.0, 4.0)
            for restitution in (0.0, -0.7, 0.7)
            for friction in (0.0, -0.5, 0.5)
        ]
        residuals = [model.residuals(p, some).impacts for p in corners]
        # channels in units of their median residual over all corners
        scale = np.nanmedian(np.abs(np.concatenate(residuals)), axis=0)
        scale[scale == 0.0] = 1.0  # of what was not measured
        misfit = [np.log1p(np.nan_to_num(np.abs(r) / scale, nan=LARGEST_CHI_SQUARE)).sum() for r in residuals]
        for i in np.argsort(misfit)[:BASE_STARTS]:
            found.append(fit(model, some, corners[i], rounds=EXPLORING_ITERATIONS))
            bar.step("some releases")
    best = max(found, key=Fit.total)
    best = fit(best.model, data, best.p)
    bar.step("all releases")
    if registered is None:
        return fit(best.model, data, best.p, old=best, renew_noise=True)
    stated = Model(replace(setup, contact=best.model.setup.contact), base)
    return replace(fit(stated, data, best.p, enough=Enough(np.inf)), free=False)


def attribute(
    base: Fit,
    data: Data,
    effects: Mapping[str, Effect],
    *,
    workers: int = 1,
    folder: Path | None = None,
    bars: DiagnosisBars | None = None,
) -> Attribution:
    """Try every effect against the base law, and then search the set of effects that explains most.

    Where the law of the best candidate fits better without the effect than the base, and predicts held-out releases
    better, it becomes the base and everything is tried again.

    `folder` keeps finished fits.
    """
    bars = bars or DiagnosisBars(False, len(effects), workers)
    with Processes(workers, (data,)) as processes:
        search = Search(data, effects, processes, CauseSet(base, cross_validate(base, data)), bars, folder)
        search.try_alone()
        for _ in range(MOST_RESTARTS if base.free else 0):
            better = _better_base(search)
            if better is None:
                break
            search = replace(search, base=better)
            search.try_alone()
        search.run()
        return _attribution(search)


def _better_base(search: Search) -> CauseSet | None:
    """The law of the best candidate without its effect, if it is better than the base."""
    base, data = search.base, search.data
    best = max(search.alone.values(), key=lambda own: search.gain(own, base).total)
    better = fit(base.fit.model, data, best.fit.p[: len(base.fit.p)])
    if better.total() < base.fit.total() + REFIT_GAIN:
        return None
    found = CauseSet(better, cross_validate(better, data))
    return found if search.gain(found, base).significant else None


def _attribution(search: Search) -> Attribution:
    with search.bars.stage(LEARNT, len(search.best.names) + 2, "sets") as bar:
        return _attributed(search, bar)


def _attributed(search: Search, bar: Bar) -> Attribution:
    base, data = search.base, search.data
    found = Dependences(data)
    learnt, beside_learnt, tried = _learn_beside(search, found, bar)
    candidates = {name: _candidate(search, own, name) for name, own in search.alone.items()}
    best = max(candidates, key=lambda name: candidates[name].total)
    chain = _chain(search, candidates) or [candidates[best]]
    final = chain[-1]
    regressed = _regressed(search, final, learnt)
    left = found.of(final.fit)
    ahead = {
        name: held_out_gain(data, candidates[best], other).significance for name, other in candidates.items()
    }
    numbers = statistics(candidates, best, ahead, regressed.base, regressed.best, found.of(base.fit), left)
    numbers["outside"] = outside_statistics(search, learnt, left, numbers["case"])
    rivals = search.rivals(search.best, GROUP_Z)
    numbers["causes"] = inclusion_statistics(
        search, beside_learnt, numbers["outside"], numbers["case"], rivals
    )
    included = inclusion(numbers["causes"])
    chances = explained_away(probabilities(numbers), included)
    likeliest = max(chances, key=lambda name: chances[name])
    probable = {name for name, p in included.items() if p >= NAMED_PROBABILITY}
    probable |= {likeliest} & candidates.keys()
    named = _that_matter(search, probable, rivals)
    if likeliest in probable - named:  # what closes nothing, or could be many others, is no answer
        gap = learnt.changes or any(_is_significant(d) for d in left)
        answer = "unknown" if named or gap else "none"
        chances = {**chances, answer: chances[answer] + chances[likeliest], likeliest: 0.0}
    settled = learnt if named == search.best.names else None
    if settled is None:
        search.best = search.joint(named)
        rivals = search.rivals(search.best, GROUP_Z)
        learnt = tried.get(named) or learn(
            search.best.fit, search.best.held_out, data, found.of(search.best.fit)
        )
        chain = _chain(search, candidates) or [candidates[best]]
        final = chain[-1]
        left = found.of(final.fit)
    learnt = best_predicting(data, learnt, [own for names, own in tried.items() if names > named])
    if isinstance(data, FilmData):
        learnt = harmless(data, learnt)
    if learnt is not settled:
        regressed = _regressed(search, final, learnt)
    group = [best] + [
        name
        for name, other in sorted(candidates.items(), key=lambda item: -item[1].total)
        if name != best and ahead[name] < GROUP_Z
    ]
    return Attribution(
        base.fit, base.held_out, candidates, chain, regressed.base, regressed.best, chances, group,
        numbers, [d for d in left if _is_significant(d)], learnt, regressed.left, named, rivals,
        {names: own.held_out for names, own in search.within(named).items()},
    )  # fmt: skip


def _that_matter(search: Search, probable: Set[str], rivals: Mapping[str, Sequence[str]]) -> Names:
    """The effects that may be named: at most MOST_RIVALS can stand for each, and it surely closes a part of the gap,
    alone or beside the others of the best set. One that widens the scatter closes nothing and must gain instead."""
    sizes = Sizes(search.data, search.best.fit.covariance())
    draws = Draws(sizes, seed=0)

    def gap(own: CauseSet) -> Array:
        return draws.gap(sizes.of(own.held_out.residuals))

    def matters(name: str) -> bool:
        pairs = [(search.alone[name], search.base)]
        if name in search.best.names:
            pairs.append((search.best, search.without(search.best)[name]))
        if search.effects[name].scatter:
            return any(search.gain(*pair).significance > CLEAR_GAIN_Z for pair in pairs)
        return any(np.quantile((gap(less) - gap(own))[1:], 0.025) > 0.0 for own, less in pairs)

    return frozenset(name for name in probable if len(rivals.get(name, ())) <= MOST_RIVALS and matters(name))


class Regressed(NamedTuple):
    """Flexible regressions of the residuals of the base, of the best set, and of what is left beside the learnt."""

    base: RegressedResiduals
    best: RegressedResiduals
    left: RegressedResiduals


def _regressed(search: Search, final: Candidate, learnt: Learnt) -> Regressed:
    base, data = search.base, search.data
    setup, covariance = base.fit.model.setup, final.fit.covariance()
    of_base = regress(setup, data, base.held_out.residuals, covariance)
    of_best = regress(setup, data, final.held_out.residuals, covariance)
    known = {id(base.fit): of_base, id(final.fit): of_best}
    left = known.get(id(learnt.fit)) or regress(setup, data, learnt.held_out.residuals, covariance)
    return Regressed(of_base, of_best, left)


class Dependences:
    """Dependences in the residuals of fits, searched once for each fit."""

    def __init__(self, data: Data) -> None:
        self._data = data
        self._known: dict[int, tuple[Fit, list[Discrepancy]]] = {}

    def of(self, fit: Fit) -> list[Discrepancy]:
        """In the residuals of a fit, the strongest first."""
        if id(fit) not in self._known:  # the fit is kept, so that its id stays its own
            self._known[id(fit)] = fit, discrepancies(fit, self._data)
        return self._known[id(fit)][1]


def _learn_beside(
    search: Search, found: Dependences, bar: Bar
) -> tuple[Learnt, dict[str, BesideLearnt], dict[Names, Learnt]]:
    """Learn what the best set leaves unexplained, and leave out its members that add nothing beside that; what each of
    them adds, and what was learnt beside each set.

    A learnt change can often do what an effect does. So a member stays if alone it explains about as much as what would
    be learnt in its place. That cannot gain more than the member and what is learnt beside it, so a member that gains
    more than the latter is not tried.
    """
    data, beside = search.data, dict[str, BesideLearnt]()
    learnt = learn(search.best.fit, search.best.held_out, data, found.of(search.best.fit))
    bar.step(_said(search.best.names))
    tried = {search.best.names: learnt}
    waiting: list[str] | None = None  # members to be tried; None: all of the best set
    while learnt.changes:
        best = search.best
        smaller = search.without(best)
        gains = {name: search.gain(best, own) for name, own in smaller.items()}
        beside_best = held_out_gain(data, learnt, best)
        if waiting is None:
            waiting = sorted(gains, key=lambda name: gains[name].total)
        if not waiting or gains[waiting[0]].total > beside_best.total:
            break
        name = waiting.pop(0)
        own = smaller[name]
        other = tried[own.names] = learn(own.fit, own.held_out, data, found.of(own.fit))
        bar.step(_said(own.names))
        beside[name] = BesideLearnt(
            held_out_gain(data, learnt, other),
            gains[name],
            held_out_gain(data, other, own),
        )
        if beside[name].needless:
            search.best, learnt, waiting = own, other, None
    return learnt, beside, tried


def _said(names: Names) -> str:
    return f"beside {' + '.join(sorted(names)) or 'the base law'}"


def _chain(search: Search, candidates: Mapping[str, Candidate]) -> list[Candidate]:
    """The members of the best set, the one that gains most alone first; each has the joint fit, and its gain over the
    set without it."""
    best, known = search.best, catalogue()
    if len(best.names) < 2:
        return [candidates[name] for name in best.names]
    smaller = search.without(best)
    order = sorted(best.names, key=lambda name: -candidates[name].total)
    return [
        Candidate(known[name], best.fit, best.held_out, search.gain(best, smaller[name]).gain)
        for name in order
    ]


def _candidate(search: Search, own: CauseSet, name: str) -> Candidate:
    return Candidate(catalogue()[name], own.fit, own.held_out, search.gain(own, search.base).gain)


def _is_significant(dependence: Discrepancy) -> bool:
    """Whether a dependence is significant."""
    return dependence.significance > SIGNIFICANT_DEPENDENCE_Z
