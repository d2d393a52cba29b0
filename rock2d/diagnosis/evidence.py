"""Evidence: how probable it is that an effect is one of the causes. The film itself is the judge.

Each member of the best set must stand three questions, beside the others and beside what is learnt without a name.

- Chance: what would the best of all effects gain if nothing acted? The residuals of each release get a random
  sign. That keeps their sizes, and what is alike within a release, and breaks all that is systematic.
- Imitation: what do smooth changes gain that are learnt in its place? An effect that stands for something without a
  name explains a part of what they explain; a true cause is hardly beaten.
- Rivals: which effects do as well in its place? They share its probability.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import norm

from rock2d.diagnosis.budget import Draws, Sizes
from rock2d.diagnosis.cause_sets import TWINS, CauseSet, Reduction, Search
from rock2d.diagnosis.cross_validation import Validated, by_release, cross_validate, held_out_gain
from rock2d.diagnosis.data import Data
from rock2d.diagnosis.derivatives import residual_covariance
from rock2d.diagnosis.fitting import START_SCATTER, Fit
from rock2d.diagnosis.learnt import Learnt, learn
from rock2d.diagnosis.levers import FLIGHT, LEVERS, state_units
from rock2d.diagnosis.likelihood import flight_log_likelihood, log_likelihood
from rock2d.diagnosis.significance import Gain
from rock2d.diagnosis.soil_scatter import fit_scatter
from rock2d.effects.changes import AIM_PARAMETERS
from rock2d.effects.effect import Effect
from rock2d.progress import Bar
from rock2d.records.columns import RATES

Array = np.ndarray

PRIOR_ODDS = 1.0 / 8.0  # a gain that chance exceeds in 1 % of films makes an effect as probable as not
LEAST_CHANCE = 1e-6
EVEN_RATIO = 0.5  # gain over that of what is learnt in its place at which an effect is as probable as not
# the same of an effect that scatters, over any scatter: the law of a true one says which velocities vary together. A
# weak one must gain more than any scatter, as the forms of the others may leave as much; a strong one need not
EVEN_SCATTER_RATIO, EVEN_SCATTER_RATIO_BESIDE = 0.8, 1.25
SAME_GAIN = 0.2  # share by which a gain may change before what is learnt in its place is learnt again
RATIO_STEEPNESS = 8.0  # slope of the logarithm of the odds over the logarithm of the ratio
RIVAL_Z = 2.0  # standard errors between effects that the data cannot separate
# An effect of many parameters takes on what another does in a form that is not the catalogue's.
OTHER_FORMS, OTHER_FORM_Z = {"zone_contrast": ("embankment_yield",)}, 1.5
MOST_RIVALS = 2  # effects that may stand for one that is named
NAMED_PROBABILITY = 0.5  # from which on an effect, with its rivals, is one of the causes
# shares of what causes gain that the forms of their laws may leave: to be learnt (causes in the world, causes in the
# camera), and for another effect to explain
FORM_SHARE, CAMERA_SHARE, EFFECT_FORM_SHARE = 0.25, 0.05, 0.05
FORM_STEEPNESS = 3.0
# sizes as shares of the plausible range on either side: a smaller one is of no use to anybody, unless its gain is
# plain, and one at the end of the range fits nothing
LEAST_SIZE, LARGEST_SIZE = 0.015, 0.999
PLAIN_Z = 20.0  # standard errors of a gain
TRIED_DEPENDENCES = 60  # number of dependences of which the best is learnt
UNSEEN = 0.03  # probability that something acts that is not seen
PRIOR = {"none": 0.25, "unknown": 0.15}  # the effects share the rest
PRIOR_SHARE = 0.02  # share of a probability that follows the prior


@dataclass(frozen=True)
class Evidence:
    """Evidence for a member of a set of causes.

    Attributes
    ----------
    alone : what it gains beside all others
    instead : what is gained by what is learnt in its place, or by any scatter in that of a scatter
    others : log likelihood that is gained by what is learnt beside all, and by other members whose laws may have
        another form, in the flights or impacts in which the effect shows
    chance : probability that chance gives as large a gain, or that it closes no part of the gap
    ahead : rival -> standard errors by which the set is better than with the rival in its place, the closest first
    form_share : share of `others` that may only repair the forms of their laws
    even_ratio : ratio of the gains `alone` and `instead` at which it is as probable as not
    negligible : whether its size is of no use to anybody
    possible : whether its size is neither negligible nor at the end of the plausible range
    """

    alone: Gain
    instead: Gain
    others: float
    chance: float
    ahead: Mapping[str, float]
    form_share: float = EFFECT_FORM_SHARE
    even_ratio: float = EVEN_RATIO
    negligible: bool = False
    possible: bool = True

    @property
    def p(self) -> float:
        """Probability that it or one of its rivals is a cause."""
        if not self.possible:
            return 0.0
        gain = max(self.alone.total, 1e-9)
        imitates = _logistic(gain / max(self.instead.total, 1e-9) / self.even_ratio, RATIO_STEEPNESS)
        beyond_form = _logistic(gain / max(self.form_share * self.others, 1e-9), FORM_STEEPNESS)
        return self.acts * imitates * beyond_form

    @property
    def acts(self) -> float:
        """Probability that it stands for something, whatever that is."""
        return against_chance(self.chance)

    @property
    def group(self) -> list[str]:
        """The closest rivals, with which it may share a name."""
        return list(self.ahead)[:MOST_RIVALS]

    def shares(self, name: str) -> dict[str, float]:
        """The probability of the member and of each rival; odds fall as exp(-z)."""
        odds = {name: 1.0} | {rival: float(np.exp(-max(z, 0.0))) for rival, z in self.ahead.items()}
        return {own: self.p * odd / sum(odds.values()) for own, odd in odds.items()}

    def named(self, name: str) -> bool:
        """Whether the member and its closest rivals are probable enough to be named."""
        shares = self.shares(name)
        return sum(shares[own] for own in (name, *self.group)) >= NAMED_PROBABILITY


def _logistic(ratio: float, steepness: float) -> float:
    odds = min(ratio, 1e3) ** steepness
    return odds / (1.0 + odds)


def against_chance(p: float) -> float:
    """Probability of a cause from the p value of its gain: the bound of Sellke, Bayarri and Berger (2001, The American
    Statistician 55(1), 62-71) on the odds that a p value can give."""
    p = min(max(p, LEAST_CHANCE), np.exp(-1.0))
    odds = PRIOR_ODDS / (-math.e * p * np.log(p))
    return float(odds / (1.0 + odds))


def exceeded(gain: float, draws: Array) -> float:
    """Share of gains by chance (draws,) that reach a gain; beyond the draws their upper half falls exponentially."""
    middle = float(np.median(draws))
    tail = float(np.mean(draws[draws > middle] - middle)) if (draws > middle).any() else 1.0
    share = float(np.mean(draws >= gain))
    return share if share > 0.05 else min(0.5 * float(np.exp(-(gain - middle) / max(tail, 1e-9))), 0.05)


def weigh(search: Search, learnt: Learnt, known: Mapping[str, Evidence], bar: Bar) -> dict[str, Evidence]:
    """Evidence of each member of the best set; `learnt`: beside that set, `known`: beside a larger one."""
    best = search.best
    found, fewer, doubted = dict[str, Evidence](), dict[str, Validated](), set[str]()
    for name in sorted(best.names):
        others = _gain_of_others(search, learnt, name)
        own, less = _beside(search, learnt, name, others)
        scatter = search.effects[name].scatter
        if not (scatter or own.named(name)) and learnt.changes and search.without(best)[name].fit.free:
            # What is learnt may have taken its place: then it must do nearly as well without that, and better than what
            # is learnt in its place, or explain more than what the forms of the other laws leave to be learnt. Beside a
            # base that is not fitted nothing can be learnt.
            doubted.add(name)
            own, less = _beside(search, Learnt(best.fit, best.held_out, []), name, others)
        found[name], before = own, known.get(name)
        if not scatter and own.named(name):
            if before is None or abs(own.alone.total - before.alone.total) >= SAME_GAIN * before.alone.total:
                fewer[name] = less
                continue
            found[name] = replace(own, instead=before.instead)
        bar.step(name)
    jobs = [(less, search.effects[name].phase) for name, less in fewer.items()]
    for k, gain in search.processes.as_finished(_learnt_instead, jobs):
        name = list(fewer)[k]
        found[name] = replace(found[name], instead=gain)
        bar.step(name)
    for name in doubted:
        if not found[name].alone.total > found[name].instead.total > 0.0:
            found[name] = replace(found[name], form_share=FORM_SHARE)
    return found


def _learnt_instead(data: Data, less: Validated, phase: str) -> Gain:
    """What is gained by changes that are learnt in the place of an effect of a phase."""
    levers = {"flight": {FLIGHT}, "impact": {*LEVERS} - {FLIGHT}}.get(phase, {*LEVERS})
    return held_out_gain(data, learn(less, data, levers), less)


def _gain_of_others(search: Search, learnt: Learnt, name: str) -> float:
    """What is learnt beside the best set gains, and other members whose laws may have another form, where an effect
    shows."""
    best, phase = search.best, search.effects[name].phase
    gain = max(_gain_in(phase, learnt, best), 0.0) if learnt.changes else 0.0
    return gain + sum(
        _form_share(search.effects[other]) / FORM_SHARE * _gain_in(phase, best, less)
        for other, less in search.without(best).items()
        if other != name
    )


def _gain_in(phase: str, own: Validated, other: Validated) -> float:
    """Log likelihood that a model gains over another one in the segments in which an effect of a phase shows."""
    gain = 0.0
    for sign, model in ((1.0, own), (-1.0, other)):
        residuals = model.held_out.residuals
        if phase != "flight":
            gain += sign * float(log_likelihood(residuals.impacts, model.fit.covariance()).sum())
        if phase != "impact":
            gain += sign * float(flight_log_likelihood(residuals.flights).sum())
    return gain


def _beside(search: Search, learnt: Learnt, name: str, others: float) -> tuple[Evidence, Validated]:
    """Evidence of a member beside the others of the best set and what is learnt, before anything is learnt in its
    place; and the model without it."""
    best, data, effect = search.best, search.data, search.effects[name]
    less: Learnt | CauseSet = search.without(best)[name]
    if learnt.changes:
        fitted = Reduction(learnt.fit, name).fitted(data)
        less = Learnt(fitted, cross_validate(fitted, data), learnt.changes)
    alone = held_out_gain(data, learnt, less)
    chance = float(norm.sf(alone.significance))
    if not effect.scatter:  # which closes nothing, and to which signs do not matter
        others_by_chance = [own.by_chance for own in search.beside(best).values()]
        if others_by_chance:
            chance = max(chance, exceeded(alone.total, np.max(others_by_chance, axis=0)))
        chance = max(chance, closes_nothing(search, name))
    plain, beside = alone.significance >= PLAIN_Z, best.names - {name}
    ahead = {
        rival: z
        for rival, z in search.rivals(best, name, RIVAL_Z).items()
        if (own := search.known.get(beside | {rival})) is None
        or all(possible_size(search.effects[rival], [size(own.fit, rival)], plain))
    }
    if learnt.changes and (twin := TWINS.get(name)) is not None:
        # contacts alone could tell them apart, and something in these is not understood
        ahead = {twin: 0.0} | ahead
    for other in OTHER_FORMS.get(name, ()):
        if other in search.effects and other not in best.names:
            ahead = {other: min(OTHER_FORM_Z, ahead.get(other, np.inf))} | ahead
    large, inside = possible_size(effect, [size(fit, name) for fit in (best.fit, learnt.fit)], plain)
    found = Evidence(
        alone, Gain(np.zeros_like(alone.gain)), others, chance, ahead, negligible=not large, possible=large and inside
    )  # fmt: skip
    if effect.scatter:
        left = alone.total < FORM_SHARE * others
        even = EVEN_SCATTER_RATIO_BESIDE if left else EVEN_SCATTER_RATIO
        found = replace(found, instead=_any_scatter(data, less), even_ratio=even)
    return found, less


def _any_scatter(data: Data, less: Validated) -> Gain:
    """What a model gains if the velocities after impacts scatter as they like, each by itself."""
    own, units = less.fit, state_units(less.fit.model.setup)[RATES]
    columns = np.zeros((*own.residuals.impacts.shape, len(units)))
    columns[:, -len(units) :] = np.diag(units)
    slope = replace(own.jacobian, scatter=np.concatenate([own.jacobian.scatter, columns], axis=-1))
    start = np.concatenate([own.scatter, np.full(len(units), START_SCATTER)])
    wide = residual_covariance(slope, fit_scatter(own.residuals.impacts, slope, start))
    scores = [
        by_release(data, less.held_out.residuals, covariance) for covariance in (wide, own.covariance())
    ]
    return Gain(scores[0] - scores[1])


def size(fit: Fit, name: str) -> float:
    """The largest size among the parameters of an effect, over the plausible range on its side; that of an effect that
    is a choice is 1. Where the camera aims, and a choice of the place where an effect acts, are no size."""
    low, high = fit.model.bounds()
    sizes = []
    for k, parameter in enumerate(fit.model.parameters_of(name), fit.model.places[name].start):
        if parameter not in AIM_PARAMETERS and not parameter.implied:
            room = high[k] if fit.p[k] > 0.0 else -low[k]
            sizes.append(1.0 if parameter.must_choose else abs(fit.p[k]) / max(room, 1e-9))
    return float(max(sizes))


def possible_size(effect: Effect, sizes: Sequence[float], plain: bool) -> tuple[bool, bool]:
    """Whether an effect with these sizes, see `size`, is large enough to be of use, and lies within the plausible
    range; a `plain` one may be small."""
    return min(sizes) >= LEAST_SIZE or plain, max(sizes) <= LARGEST_SIZE or effect.parameters[0].must_choose


def closes_nothing(search: Search, name: str) -> float:
    """Probability that an effect closes no part of the gap, neither alone nor beside the others of the best set."""
    sizes = Sizes(search.data, search.best.fit.covariance())
    draws = Draws(sizes, seed=0)

    def gap(own: CauseSet) -> Array:
        return draws.gap(sizes.joint(own.held_out.residuals))

    pairs = [(search.alone[name], search.base), (search.best, search.without(search.best)[name])]
    return min(float(np.mean(gap(less) <= gap(own))) for own, less in pairs)


def _form_share(effect: Effect) -> float:
    """Share of what a cause gains that the form of its law may leave; 0 for a choice."""
    if effect.parameters[0].must_choose:
        return 0.0
    return CAMERA_SHARE if effect.camera else FORM_SHARE


def left_by_form(search: Search, own: CauseSet) -> float:
    """Log likelihood that the forms of the laws of a set may leave to be learnt."""
    gains = {name: max(search.gain(own, less).total, 0.0) for name, less in search.without(own).items()}
    shares = {name: _form_share(search.effects[name]) for name in gains}
    left = sum(shares[name] * gain for name, gain in gains.items()) / max(sum(gains.values()), 1e-9)
    return left * max(search.gain(own, search.base).total, 0.0)


def outside(learnt: Gain, left: float) -> float:
    """Probability that something outside the catalogue acts, from what is learnt beside the causes, and what the forms
    of their laws may leave."""
    if learnt.total <= 0.0:
        return UNSEEN
    p = against_chance(TRIED_DEPENDENCES * float(norm.sf(learnt.significance)))
    p *= _logistic(learnt.total / max(left, 1e-9), FORM_STEEPNESS)
    return max(p, UNSEEN)


def inclusion(evidence: Mapping[str, Evidence]) -> dict[str, float]:
    """Effect -> probability that it is one of the causes; of others there is no evidence."""
    found = dict[str, float]()
    for name, own in evidence.items():
        for other, p in own.shares(name).items():
            found[other] = max(found.get(other, 0.0), p)
    return found


def single_answers(
    evidence: Mapping[str, Evidence], p_outside: float, effects: Collection[str]
) -> dict[str, float]:
    """Probability of each effect as the cause that explains most, of "none", and of "unknown", which is also a cause
    that cannot be named. In the order of their gains, each is the first if it acts and none before it does."""
    found, rest = {"none": 0.0, "unknown": 0.0, **dict.fromkeys(effects, 0.0)}, 1.0
    for name in sorted(evidence, key=lambda name: -evidence[name].alone.total):
        own = evidence[name]
        for other, p in own.shares(name).items() if own.named(name) else [("unknown", own.p)]:
            found[other] += rest * p
        rest *= 1.0 - own.p
    # what is refused because something else explains it better, and is not negligible, shows that something acts
    refused = [own.acts for name, own in evidence.items() if not (own.named(name) or own.negligible)]
    p_unknown = max([p_outside, *refused])
    found["unknown"] += rest * p_unknown
    found["none"] += rest * (1.0 - p_unknown)
    expected = PRIOR | dict.fromkeys(effects, (1.0 - sum(PRIOR.values())) / len(effects))
    return {name: (1.0 - PRIOR_SHARE) * p + PRIOR_SHARE * expected[name] for name, p in found.items()}
