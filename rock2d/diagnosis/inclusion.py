"""How probable each effect is as a member of the set of causes, and something outside the catalogue beside them.

The best model with an effect is compared with the best model without it, on held-out releases. Where effects can stand
for each other, each gains little over the other: then neither is sure. The comparison does not give a probability by
itself, because no law of the model is exactly true. A logistic regression turns it into one. It is trained on films
whose causes are known (`rock2d blind train`), and so is that of a cause outside the catalogue.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from rock2d.diagnosis.cause_sets import Names, Search
from rock2d.diagnosis.classification import chance, weights
from rock2d.diagnosis.cross_validation import held_out_gain
from rock2d.diagnosis.discrepancy import Discrepancy
from rock2d.diagnosis.learnt import Learnt
from rock2d.diagnosis.significance import Gain
from rock2d.effects import catalogue

Array = np.ndarray

INCLUDED, OUTSIDE = "included", "outside"  # the questions of the two regressions
LARGEST_MISSED = 0.1  # of what a learnt change explains that it may miss of its cause
LEAST_OF_LEARNT = 0.5  # of what is learnt in its place that an effect must explain alone
SMALLEST_INCLUSION = 0.01  # an effect keeps a chance where no effect is included
LARGEST_Z, LEAST_Z = 20.0, -10.0  # standard errors; more count as this
LEAST_LOG_GAIN = 1.0  # `signed_log` of a gain above which it is compared with others
SIGNIFICANT_LEFT_Z = 2.0  # standard errors of a dependence that is more than chance
SHARE, OF_GROUP = (
    "share",
    "group_",
)  # of a member and its rivals: the share of one of them, and what they gain together


@dataclass(frozen=True)
class BesideLearnt:
    """An effect beside learnt changes: held-out gains.

    Attributes
    ----------
    added : that it adds to the learnt changes beside it
    alone : that it has without them
    instead : of what would be learnt in its place
    """

    added: Gain
    alone: Gain
    instead: Gain

    @property
    def needless(self) -> bool:
        """Whether what is learnt in its place explains much more, and it adds no more than the learnt change may miss:
        that is smooth, where the cause need not be."""
        missed = LARGEST_MISSED * self.instead.total
        adds = self.added.significant and self.added.total > missed
        return not adds and self.alone.total < LEAST_OF_LEARNT * self.instead.total


def inclusion(
    causes: Mapping[str, Mapping[str, float]], known: Mapping[str, Any] | None = None
) -> dict[str, float]:
    """Effect -> probability that it is one of the causes, from `inclusion_statistics`; `known`: other weights than the
    own."""
    question = (weights() if known is None else known)[INCLUDED]
    return {name: _chance_with_rivals(question, values) for name, values in causes.items()}


def _chance_with_rivals(question: Mapping[str, Any], values: Mapping[str, float]) -> float:
    """The probability of an effect by itself, or its share in that of a member and its rivals."""
    by_itself = chance(question, values)
    if SHARE not in values:
        return by_itself
    together = {name: values.get(OF_GROUP + name, own) for name, own in values.items()}
    return max(by_itself, values[SHARE] * chance(question, together))


def explained_away(chances: Mapping[str, float], included: Mapping[str, float]) -> dict[str, float]:
    """Probabilities of the single answers, from those that the gains alone give and the inclusion probabilities: an
    effect whose gain other effects explain gives its share to them. "none" and "unknown" keep theirs."""
    likely = {
        name: p * (included[name] + SMALLEST_INCLUSION) for name, p in chances.items() if name in included
    }
    share = sum(chances[name] for name in likely) / sum(likely.values())
    return {name: share * likely[name] if name in likely else p for name, p in chances.items()}


def outside(values: Mapping[str, float], known: Mapping[str, Any] | None = None) -> float:
    """Probability that something outside the catalogue acts, from `outside_statistics`."""
    return chance((weights() if known is None else known)[OUTSIDE], values)


def inclusion_statistics(
    search: Search,
    beside_learnt: Mapping[str, BesideLearnt],
    nameless: Mapping[str, float],
    case: Mapping[str, float],
    rivals: Mapping[str, Sequence[str]],
) -> dict[str, dict[str, float]]:
    """Effect -> name of a statistic -> value.

    `beside_learnt`: what members add beside the learnt changes, where there are any; `nameless`: of
    `outside_statistics`; `case`: statistics of the film; `rivals`: member of the best set -> effects that can stand for
    it.
    """
    found = {}
    ahead = {names: search.gain(own, search.best).gain for names, own in search.known.items()}
    for name, effect in search.effects.items():
        over = _with_over_without(search, name, ahead)
        beside = beside_learnt.get(name, BesideLearnt(over, over, over))
        added = beside.added
        if beside.needless:  # what it explains, the learnt change explains, too
            over = added = Gain(np.zeros_like(over.gain))
        found[name] = {
            "z": float(np.clip(over.significance, LEAST_Z, LARGEST_Z)),
            "log_gain": signed_log(over.total),
            "beside_learnt_z": float(np.clip(added.significance, LEAST_Z, LARGEST_Z)),
            "scatter": float(effect.scatter),
        }
    found = with_rest(found, nameless, case)
    together = {}
    for name, less in search.without(search.best).items():
        of_group = search.gain(search.best, less)
        together[name] = {
            **found[name],
            "z": float(np.clip(of_group.significance, LEAST_Z, LARGEST_Z)),
            "log_gain": signed_log(of_group.total),
        }
        if name not in beside_learnt:
            together[name]["beside_learnt_z"] = together[name]["z"]
    return with_groups(found, with_rest(found | together, nameless, case), rivals)


def with_rest(
    causes: Mapping[str, Mapping[str, float]], nameless: Mapping[str, float], case: Mapping[str, float]
) -> dict[str, dict[str, float]]:
    """The statistics of each effect, with those of the rest of the film.

    What gains more: the largest gain of an effect over its own, and that of what has no name. A little gain beside a
    cause that explains much more may be what the model of that cause misses. And what is left where the effect acts, in
    flights and in impacts: an effect that leaves a dependence there may stand for the cause of both.
    """
    unnamed = max(nameless["learnt_log"], nameless["left_log"], 0.0)
    largest = max(values["log_gain"] for values in causes.values())
    left = {
        phase: signed_log(max(case[f"left_{phase}_z"] - SIGNIFICANT_LEFT_Z, 0.0))
        for phase in ("flight", "impact")
    }
    effects, found = catalogue(), {}
    for name, values in causes.items():
        gains, own = values["log_gain"] > LEAST_LOG_GAIN, values["log_gain"]
        found[name] = {
            **values,
            "largest_over": largest - own if gains else 0.0,
            "nameless_over": unnamed - own if gains else 0.0,
            "flight_left_z": left["flight"] if gains and effects[name].phase in ("flight", "all") else 0.0,
            "impact_left_z": left["impact"] if gains and effects[name].phase in ("impact", "all") else 0.0,
        }
    return found


def with_groups(
    causes: Mapping[str, Mapping[str, float]],
    together: Mapping[str, Mapping[str, float]],
    rivals: Mapping[str, Sequence[str]],
) -> dict[str, dict[str, float]]:
    """The statistics of each effect, for members with rivals and for these also with those of the group.

    `together`: of each member without a rival in its place. The odds of a member against one rival are exp(z), if it is
    z standard errors ahead of the best set without it.
    """
    found = {name: dict(values) for name, values in causes.items()}
    for member, others in sorted(rivals.items(), key=lambda item: together[item[0]]["log_gain"]):
        if not others:
            continue
        of_group = {OF_GROUP + name: value for name, value in together[member].items()}
        share = 1.0 / (1.0 + len(others) * np.exp(-causes[member]["z"]))
        for other in others:
            found[other] |= of_group | {SHARE: float((1.0 - share) / len(others))}
        found[member] |= of_group | {SHARE: float(share)}
    return found


def outside_statistics(
    search: Search, learnt: Learnt, left: Sequence[Discrepancy], case: Mapping[str, float]
) -> dict[str, float]:
    """Name of a statistic of whether something outside the catalogue acts -> value.

    `left`: the dependences in the residuals of the best set, the strongest first; `case`: statistics of the film.
    """
    best = search.best
    added = held_out_gain(search.data, learnt, best)
    named = search.gain(best, search.base).total
    z = [d.significance for d in left]
    strongest = left[0]
    return {
        "learnt_log": signed_log(added.total),
        "learnt_z": float(np.clip(added.significance, 0.0, LARGEST_Z)),
        "learnt_share": float(added.total / max(added.total + named, 1.0)),
        "left_log": signed_log(strongest.total),
        "left_z": float(np.clip(max(z), 0.0, LARGEST_Z)),
        "left_over_named": signed_log(strongest.total) - signed_log(named),
        "left_share": case["left_share"],
    }


def _with_over_without(search: Search, name: str, ahead: Mapping[Names, Array]) -> Gain:
    """Gain of the best model with an effect over the best one without it. Where the former was not fitted, screening
    says what to expect of it. `ahead`: gain of each known set over the best one."""
    own = max((names for names in ahead if name in names), key=lambda names: float(ahead[names].sum()))
    other = max((names for names in ahead if name not in names), key=lambda names: float(ahead[names].sum()))
    expected = {
        names: found[name].gain
        for names, found in search.expected.items()
        if name in found and names | {name} not in search.known
    }
    likely = max(expected, key=lambda names: float((ahead[names] + expected[names]).sum()), default=None)
    without = search.known[other]
    if likely is None or (ahead[likely] + expected[likely]).sum() <= ahead[own].sum():
        return search.gain(search.known[own], without)
    return search.gain(search.known[likely], without).plus(expected[likely])


def signed_log(value: float) -> float:
    """log(1 + |value|) with the sign of the value."""
    return float(np.copysign(np.log1p(abs(value)), value))
