"""Answers: probabilities of causes, of "none" and of "unknown", from the evidence for members of the weighed sets."""

from collections.abc import Collection, Mapping

from rock2d.diagnosis.evidence import Evidence

PRIOR = {"none": 0.25, "unknown": 0.15}  # the effects share the rest
PRIOR_SHARE = 0.02  # share of a probability that follows the prior


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
