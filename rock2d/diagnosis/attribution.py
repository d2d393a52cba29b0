"""Attribution: the base law compared with the law with each effect of the catalogue, on held-out releases.

The parameters of the base are free in every model. The criterion is the gain in log likelihood on held-out releases,
compared release by release, so that a few unusual impacts cannot decide. The verdict is "none" if no gain is
significant, and "unknown" if the residuals of even the best effect can be predicted (`residual_regression`)."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import compress
from pathlib import Path
from typing import NamedTuple

import numpy as np

from rock2d.arrays import Array
from rock2d.diagnosis.base_law import ends_at, fit_from_grid
from rock2d.diagnosis.cause_sets import ADDED_AT_ONCE, Search
from rock2d.diagnosis.checks import Checks, predictive_checks
from rock2d.diagnosis.cross_validation import Names, Validated, held_out_gain
from rock2d.diagnosis.data import Data, FilmData
from rock2d.diagnosis.evidence import (
    FORM_SHARE,
    NAMED_PROBABILITY,
    PERMANENT,
    Evidence,
    evidence_of_members,
    gain_left_by_forms,
    plausible_rivals,
)
from rock2d.diagnosis.exploring import REFIT_GAIN
from rock2d.diagnosis.fitting import Convergence, Fit, fit
from rock2d.diagnosis.learnt import Learnt, best_predicting, learn
from rock2d.diagnosis.levers import Dependence, find_dependences
from rock2d.diagnosis.model import BASE_WIDTH
from rock2d.diagnosis.moving_frame import MOTIONS, frame_of_each_release
from rock2d.diagnosis.predicted_gap import without_harmful_changes
from rock2d.diagnosis.residual_regression import RegressedResiduals, regress
from rock2d.diagnosis.significance import Gain, SummedGain, outside_probability
from rock2d.diagnosis.workload import EVIDENCE, DiagnosisBars
from rock2d.effects import catalogue
from rock2d.effects.effect import Effect
from rock2d.processes import Processes

SIGNIFICANT_DEPENDENCE_Z = 2.0  # standard errors from which on a dependence counts as unexplained
LEAST_EXPLAINED_SHARE = 0.5  # share of the largest gain; a model that gains less does not count
BETTER_RIVAL_Z = 1.0  # standard errors by which a rival must gain more than a member
EQUAL_Z = 0.5  # standard errors that it may gain less than a negligible one: a small scale error is no weaker lens
MOST_RESTARTS = 2  # restarts with a better base law
PRIOR = {"none": 0.25, "unknown": 0.15}  # the effects share the rest
PRIOR_SHARE = 0.02  # share of a probability that follows the prior
SAME_LAW = 0.1  # largest change of the law's parameters with which a grid around it need not be tried again


@dataclass
class Candidate(Validated, SummedGain):
    """A validated fit with an effect.

    Attributes
    ----------
    effect : the effect under test; the fit may contain others, too
    gain : (releases,) gain in log likelihood over the base, or over the fit without this effect"""

    effect: Effect
    gain: Array


@dataclass
class Attribution:
    """Result of the attribution.

    Attributes
    ----------
    base : the refitted base law
    candidates : name -> candidate
    chain : the effects of the best set, first the one with the largest gain alone. Each has the joint fit of all of
        them, and its gain over the set without it. If no effect gains significantly, only the best one
    base_regressed, best_regressed : flexible regression of the residuals of the base and of the last model of the
        chain
    probabilities : probabilities of the single answers: the effects, "none" and "unknown"
    evidence : evidence for each effect that was in a best set, including those that are not named
    outside : probability that something outside the catalogue acts
    checks : whether the model with the learnt changes would have made these data
    unexplained : significant dependences in the residuals of the last model of the chain, and a frame that moves in
        each release beside what is learnt, the strongest first
    learnt : the changes learnt with the named effects; with further effects if that predicts better (`uncertain`)
    learnt_regressed : flexible regression of the residuals of the model with the learnt changes
    named : the effects that are named, all of them in the chain; there may be none
    sets : names -> set, for the share that each named effect closes: no effect, all, each alone, and all but one; for
        up to three effects all subsets"""

    base: Validated
    candidates: dict[str, Candidate]
    chain: list[Candidate]
    base_regressed: RegressedResiduals
    best_regressed: RegressedResiduals
    probabilities: dict[str, float]
    evidence: dict[str, Evidence]
    outside: float
    checks: Checks
    unexplained: list[Dependence]
    learnt: Learnt
    learnt_regressed: RegressedResiduals
    named: Names
    sets: dict[Names, Validated]

    @property
    def strongest(self) -> str:
        """The effect of the chain with the largest gain alone."""
        return self.chain[0].effect.name

    @property
    def final(self) -> Candidate:
        return self.chain[-1]

    @property
    def settled(self) -> Fit:
        """The fit with all named effects; the base if there are none."""
        return self.final.fit if self.named else self.base.fit

    @property
    def uncertain(self) -> list[str]:
        """Effects of the model with the learnt changes that are not named."""
        return [e.name for e in self.learnt.fit.model.effects if e.name not in self.named]

    @property
    def verdict(self) -> str:
        """The most probable answer; a named one if two are equal."""
        return max(self.probabilities, key=lambda name: (self.probabilities[name], name in self.named))

    @property
    def answer(self) -> Candidate | None:
        """The verdict in the chain; None if it is another effect, or none."""
        return next((c for c in self.chain if c.effect.name == self.verdict), None)

    def group(self, name: str) -> list[str]:
        """Effects that these data cannot distinguish from a cause."""
        return self.evidence[name].group if name in self.evidence else []


class WeighedSet(NamedTuple):
    """A set of causes; the same with learnt changes; with those changes alone that belong to members, see
    `evidence.PERMANENT`; and the evidence for each member."""

    cause_set: Validated
    learnt: Learnt
    permanent: Learnt
    evidence: dict[str, Evidence]


def attribute(
    base: Fit,
    data: Data,
    effects: Mapping[str, Effect],
    *,
    refitted: Fit | None = None,
    workers: int = 1,
    folder: Path | None = None,
    bars: DiagnosisBars | None = None,
    seed: int = 0,
) -> Attribution:
    """Compare every effect with the base law, then search for the set of effects that explains most.

    If the law of the best candidate, without its effect, fits the data and predicts held-out releases better than the
    base, it becomes the base and the search starts again. The same happens if a law that is fitted anew with the best
    effects fits much better.

    `refitted`: the base law for measuring gains, if effects are fitted from another one;
    `folder`: keeps finished fits; `seed`: of the replicates of the checks."""
    bars = bars or DiagnosisBars(False, len(effects), workers)
    with Processes(workers, (data,)) as processes:
        search = Search(data, effects, processes, Validated.of(base, data), bars, folder)
        search.try_alone()
        if refitted is not None:
            search.base = search.best = search.known[frozenset()] = Validated.of(refitted, data)
        for _ in range(MOST_RESTARTS if search.base.fit.free else 0):
            better = _better_base(search)
            if better is None:
                break
            search = replace(search, base=better)
            search.try_alone()
        largest = max(search.alone.values(), key=lambda candidate: search.gain(candidate, search.base).total)
        search = _restarted_from_grid(search, largest)
        search.run()
        laws = [own.fit.p[: len(BASE_WIDTH)] for own in (search.best, search.known[largest.names])]
        if np.abs(laws[0] - laws[1]).max() > SAME_LAW:
            again = _restarted_from_grid(search, search.best)
            if again is not search:
                again.run()
            search = again
        return _attribution(search, seed)


def _better_base(search: Search) -> Validated | None:
    """The law of the best candidate without its effect, if it is better than the base."""
    base, data = search.base, search.data
    best = max(search.alone.values(), key=lambda candidate: search.gain(candidate, base).total)
    start, least = best.fit.p[: len(base.fit.p)], base.fit.total()
    # the noise of the base is sufficient to see whether the fit leads back to it
    rough = fit(base.fit.model, data, start, old=base.fit, convergence=Convergence(rival_total=least + REFIT_GAIN))
    if ends_at(rough, base.fit):
        return None
    refit = fit(base.fit.model, data, start)
    if refit.total() < least + REFIT_GAIN:
        return None
    found = Validated.of(refit, data)
    return found if search.gain(found, base).significant else None


def _restarted_from_grid(search: Search, cause_set: Validated) -> Search:
    """Restart the search from a set if its fit is much better when the law starts from a grid. The base law may have
    adapted to the effects of the set, so that a fit that starts from it stays in a worse optimum."""
    base, data, first = search.base.fit, search.data, len(BASE_WIDTH)
    if not (cause_set.names and base.free and len(data.impact_release)):
        return search
    model = replace(cause_set.fit.model, known_p=None)
    anew = fit_from_grid(model, data, search.processes, known=cause_set.fit)
    if anew is None or anew.total() < cause_set.fit.total() + REFIT_GAIN:
        return search
    law = fit(replace(base.model, setup=anew.model.setup), data, anew.p[:first])
    restarted = replace(search, base=Validated.of(law, data))
    restarted.try_alone()
    restarted.best = restarted.known[cause_set.names] = Validated.of(anew, data)
    return restarted


def _attribution(search: Search, seed: int) -> Attribution:
    data = search.data
    evidence, of_final, of_first = _evidence_of_sets(search)
    best = search.best
    models = [of_final] if of_first is of_final else [of_final, of_first]
    moving = [frame_of_each_release(model.learnt.fit, data) for model in models]
    learnt = best_predicting(data, of_final.learnt, of_first.learnt)
    if learnt.dependences is None:  # learning ended by the number that evidence needs; predictions can use more
        learnt = learn(learnt, data)
    if isinstance(data, FilmData):
        learnt = without_harmful_changes(data, learnt, search.base)
        if learnt.names != best.names and not learnt.changes:  # no file holds such a model
            learnt = without_harmful_changes(data, of_final.learnt, search.base)
    checks = predictive_checks(data, search.base.fit, learnt.fit, seed)
    p_outside = max(_outside_probability(search, models, moving), unexplained_probability(evidence), checks.p_outside)
    candidates = {
        name: Candidate(own.fit, own.held_out, catalogue()[name], search.gain(own, search.base).gain)
        for name, own in search.alone.items()
    }
    largest = max(candidates, key=lambda name: candidates[name].total)
    chain = _chain(search, best, candidates) or [candidates[largest]]
    of_base, of_best, left = _regressions(search, chain[-1], learnt)
    dependences = sorted([moving[0], *_dependences(chain[-1].fit, learnt, data)], key=lambda d: -d.total)
    return Attribution(
        search.base, candidates, chain, of_base, of_best,
        single_answers(evidence, p_outside, catalogue()), evidence, p_outside, checks,
        [d for d in dependences if d.significance > SIGNIFICANT_DEPENDENCE_Z],
        learnt, left, best.names, search.known_subsets(best.names),
    )  # fmt: skip


def _outside_probability(search: Search, models: Sequence[WeighedSet], moving: Sequence[Dependence]) -> float:
    """Probability that something outside the catalogue acts: the smallest over models, of which each has its frame that
    is `moving` in each release. Models that explain much less than the best one do not count; one with a member that
    may be chance is not the best. What is learnt as a part of a cause that is named is not outside."""
    data, permanent_is_named = search.data, search.best.names & PERMANENT.keys()
    explained = [held_out_gain(data, model.learnt, search.base).total for model in models]
    sure = [all(member.p_acts > NAMED_PROBABILITY for member in model.evidence.values()) for model in models]
    most = max(compress(explained, sure), default=max(explained))
    probabilities = []
    for model, frame, total in zip(models, moving, explained, strict=True):
        if total < LEAST_EXPLAINED_SHARE * most:
            continue
        left = gain_left_by_forms(search, model.cause_set)
        if permanent_is_named:
            left += FORM_SHARE * max(held_out_gain(data, model.permanent, model.cause_set).total, 0.0)
        known = model.permanent if permanent_is_named else model.cause_set
        of_learnt = outside_probability(held_out_gain(data, model.learnt, known), left)
        probabilities.append(max(of_learnt, outside_probability(frame, left, MOTIONS)))
    return min(probabilities)


def _weighed(search: Search, known: Mapping[str, Evidence], removed: Collection[str]) -> WeighedSet:
    """The best set with its evidence. If something is learnt that may belong to an effect of the catalogue, the effect
    becomes a member, unless it was `removed`."""
    with search.bars.stage(EVIDENCE, len(search.best.names) + 1, "models") as bar:
        data, learnt = search.data, learn(search.best, search.data)
        levers = {change.lever for change in learnt.changes}
        belongs = {name: lever for name, lever in PERMANENT.items() if lever in levers and name in search.effects}
        if joining := belongs.keys() - search.best.names - {*removed}:
            search.best = search.set_of(search.best.names | joining)
        best = search.best
        permanent = Learnt(best.fit, best.held_out)
        if own := [lever for name, lever in belongs.items() if name in best.names]:
            permanent = learn(permanent, data, own)
            learnt = learn(permanent, data)
        bar.step("what is left")
        return WeighedSet(best, learnt, permanent, evidence_of_members(search, learnt, permanent, known, bar))


def _evidence_of_sets(search: Search) -> tuple[dict[str, Evidence], WeighedSet, WeighedSet]:
    """Evidence for all effects that were in a weighed set; the last weighed set, and the first.

    Members are exchanged for better rivals before a set is weighed, see `_exchange_member`. Then members that cannot
    be named are removed, first those of impossible size, then those that gain less, half of them at once; a removed
    rival gives its place back to the member that it had replaced. The evidence for the remaining members is computed
    again. When all are named, an effect that gains beside them is weighed, too: one that the search passed by for what
    is removed now; then the removed member that gains most, since what stood beside it then may have hidden it, and so
    on until one of each kind is removed again."""
    evidence, by_set = dict[str, Evidence](), dict[Names, WeighedSet]()
    removed, tried = set[str](), set[Names]()
    replaced: dict[str, str] = {}  # rival -> the member whose place it took
    # the last effect that joined, the last that the search had passed by, and the last that was removed before
    joining: str | None = None
    passed_by: str | None = None
    again: str | None = None
    spared = set[str]()  # members that may join again, with what is learnt of them, see `PERMANENT`
    while True:
        names = search.best.names
        found = by_set[names].evidence if names in by_set else {}
        evidence |= found
        tried.add(names)
        if _exchange_member(search, found, tried, removed, replaced):
            continue
        if names not in by_set:
            weighed = _weighed(search, evidence, removed)  # an effect may have joined the set
            by_set[search.best.names] = weighed
            continue
        refused = sorted(
            (name for name, own in found.items() if not own.named(name)),
            key=lambda n: (found[n].possible, found[n].own_gain.total),
        )
        if not refused:
            joining = None
            if passed_by not in removed:
                joining = passed_by = _passed_by(search, removed, by_set)
            if joining is None and again not in removed:
                joining = again = _removed_that_gains(search, removed, by_set)
            if joining is None:
                return evidence, by_set[names], next(iter(by_set.values()))
            removed.discard(joining)
            search.best = search.set_of(names | {joining})
            continue
        leaving = {joining} if joining in refused else set(refused[: (len(refused) + 1) // 2])
        joins = set() if by_set[names].permanent.changes else leaving & PERMANENT.keys() - spared
        removed |= leaving - joins
        spared |= joins
        back = {replaced[name] for name in leaving & replaced.keys()}
        search.best = search.set_of((names - leaving) | (back - removed))


def _passed_by(search: Search, removed: set[str], weighed: Mapping[Names, WeighedSet]) -> str | None:
    """The effect that was never weighed and gains most beside the best set, if it gains significantly, and more than
    the forms of learnt changes may leave: the search may have passed it by for a member that is removed now."""
    best = search.best
    if not best.names:
        return None
    learnt = weighed[best.names].learnt
    least = FORM_SHARE * held_out_gain(search.data, learnt, best).total if learnt.changes else 0.0
    gains = {
        wider.names: search.gain(wider, best)
        for wider in search.promising_additions(best, best.names | removed, ADDED_AT_ONCE)
        if wider.names not in weighed
    }
    if not gains:
        return None
    most = max(gains, key=lambda names: gains[names].total)
    gain = gains[most]
    return next(iter(most - best.names)) if gain.total >= least and gain.significant_addition else None


def _removed_that_gains(search: Search, removed: set[str], weighed: Collection[Names]) -> str | None:
    """The removed member that gains most beside the best set, if it gains significantly and was not weighed there."""
    best, gains = search.best, dict[str, Gain]()
    for name in sorted(removed - best.names):
        if best.names | {name} not in weighed:
            gains[name] = search.gain(search.set_of(best.names | {name}), best)
    again = max(gains, key=lambda name: gains[name].total, default=None)
    return again if again is not None and gains[again].significant else None


def _exchange_member(
    search: Search, found: Mapping[str, Evidence], tried: set[Names], removed: set[str], replaced: dict[str, str]
) -> bool:
    """Exchange a member of the best set for a rival that gains more. A member of impossible size that gains is replaced
    for good by a rival that gains as much. Returns whether a member was exchanged.

    `found`: evidence for the members, if the set was weighed; `tried`: sets that do not come in (again)."""
    best, options = search.best, list[tuple[float, str, str, bool]]()
    for name, without in search.without(best).items():
        own = found.get(name)
        rivals = plausible_rivals(search, name, search.gain(best, without)) if own is None else own.rival_z
        impossible = own is not None and own.own_gain.significant and not own.possible
        most_z = EQUAL_Z if own is not None and own.negligible else np.inf
        options += [
            (z, name, rival, impossible)
            for rival, z in rivals.items()
            if (z < -BETTER_RIVAL_Z or (impossible and z <= most_z))
            and rival not in removed
            and best.names - {name} | {rival} not in tried
        ]
    for _, name, rival, impossible in sorted(options):
        other = search.set_of(best.names - {name} | {rival})
        tried.add(other.names)
        # what screening expects of a rival can be too much
        if not impossible and search.gain(other, best).significance <= BETTER_RIVAL_Z:
            continue
        if impossible:
            removed.add(name)
        else:
            replaced[rival] = name
        search.best = other
        return True
    return False


def _dependences(fitted: Fit, learnt: Learnt, data: Data) -> list[Dependence]:
    """Dependences in the residuals of a fit; they are known if learning began there."""
    state: Learnt | None = learnt
    while state is not None:
        if state.fit is fitted and state.dependences is not None:
            return state.dependences
        state = state.before
    return find_dependences(fitted, data)


def _regressions(search: Search, final: Candidate, learnt: Learnt) -> list[RegressedResiduals]:
    """Flexible regressions of the residuals of the base, the best set, and the model with the learnt changes."""
    setup, covariance = search.base.fit.model.setup, final.fit.covariance()
    models = {id(model.fit): model for model in (search.base, final, learnt)}
    jobs = [(setup, model.held_out.residuals, covariance) for model in models.values()]
    of_fit = {list(models)[k]: found for k, found in search.processes.as_finished(regress, jobs)}
    return [of_fit[id(model.fit)] for model in (search.base, final, learnt)]


def _chain(search: Search, best: Validated, candidates: Mapping[str, Candidate]) -> list[Candidate]:
    """The members of a set, first the one with the largest gain alone. Each has the joint fit, and its gain over the
    set without it."""
    if len(best.names) < 2:
        return [candidates[name] for name in best.names]
    known, smaller = catalogue(), search.without(best)
    order = sorted(best.names, key=lambda name: -candidates[name].total)
    return [Candidate(best.fit, best.held_out, known[name], search.gain(best, smaller[name]).gain) for name in order]


# --- probabilities of the answers, from the evidence for members of the weighed sets -----------------------


def _refused(evidence: Mapping[str, Evidence]) -> list[Evidence]:
    """Members that are refused because something else explains them better, and are not negligible: each shows that
    something acts."""
    return [member for name, member in evidence.items() if not (member.named(name) or member.negligible)]


def unexplained_probability(evidence: Mapping[str, Evidence]) -> float:
    """Probability that something acts that is none of the effects: the largest over refused members. The gain of such a
    member is no chance, and neither it nor a rival explains it. 0 if an effect is named, because the form of its law
    may leave such a gain."""
    if any(member.named(name) for name, member in evidence.items()):
        return 0.0
    return max((member.p_acts - member.p for member in _refused(evidence)), default=0.0)


def inclusion_probabilities(evidence: Mapping[str, Evidence]) -> dict[str, float]:
    """Effect -> probability that it is one of the causes, for the effects with evidence and their rivals."""
    probabilities = dict[str, float]()
    for name, member in evidence.items():
        for other, p in member.probabilities(name).items():
            probabilities[other] = max(probabilities.get(other, 0.0), p)
    return probabilities


def single_answers(evidence: Mapping[str, Evidence], p_outside: float, effects: Collection[str]) -> dict[str, float]:
    """Probability of each effect as the cause that explains most, of "none", and of "unknown".

    An effect is the first cause if it acts and none with a larger gain does. A cause that cannot be named counts as
    "unknown". `p_outside`: probability that something outside the catalogue acts; `effects`: names of the catalogue."""
    answers, rest = {"none": 0.0, "unknown": 0.0, **dict.fromkeys(effects, 0.0)}, 1.0
    for name in sorted(evidence, key=lambda name: -evidence[name].own_gain.total):
        member = evidence[name]
        for other, p in member.probabilities(name).items() if member.named(name) else [("unknown", member.p)]:
            answers[other] += rest * p
        rest *= 1.0 - member.p
    p_unknown = max([p_outside, *(member.p_acts for member in _refused(evidence))])
    answers["unknown"] += rest * p_unknown
    answers["none"] += rest * (1.0 - p_unknown)
    expected = PRIOR | dict.fromkeys(effects, (1.0 - sum(PRIOR.values())) / len(effects))
    return {name: (1.0 - PRIOR_SHARE) * p + PRIOR_SHARE * expected[name] for name, p in answers.items()}
