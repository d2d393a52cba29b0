"""Evidence: how probable it is that an effect is one of the causes. The film itself is the judge.

Each member of the best set must pass three tests, in a model with the other members and the learnt changes. A member
that may be the same in every release is tested together with what is learnt of it, see `PERMANENT`.

- Chance: what would the best of all effects gain if no effect acted? The residuals of each release get a random
  sign. That keeps their sizes and their correlations within a release, and removes what is systematic.
- Imitation: what do smooth changes gain that are learnt in its place? An effect that only imitates an unknown cause
  explains a part of what they explain. They hardly gain more than a true cause. No change of a contact law explains
  how blocks lie at rest.
- Rivals: which effects gain as much in its place? They share its probability."""

from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import ndtr  # scipy.stats takes over a second to import

from rock2d.arrays import Array
from rock2d.diagnosis.budget import GapBootstrap, ResidualSizes
from rock2d.diagnosis.cause_sets import TWINS, Reduction, Search
from rock2d.diagnosis.cross_validation import Validated, by_release, held_out_gain, rests_z
from rock2d.diagnosis.data import Data
from rock2d.diagnosis.derivatives import START_SCATTER, residual_covariance
from rock2d.diagnosis.fitting import Fit
from rock2d.diagnosis.learnt import Change, Learnt, learn
from rock2d.diagnosis.levers import FLIGHT, LAW, LEVERS, PROFILE, WIDTHS, Levers, state_units
from rock2d.diagnosis.likelihood import fit_scatter, flight_log_likelihood, log_likelihood
from rock2d.diagnosis.linear_model import LinearModel, Screening
from rock2d.diagnosis.model import BASE_WIDTH, LeverResponse
from rock2d.diagnosis.quantities import Basis
from rock2d.diagnosis.significance import (
    FORM_STEEPNESS,
    Gain,
    SummedGain,
    chance_p_value,
    largest_bayes_factor,
    logistic,
    probability_from_p_value,
)
from rock2d.diagnosis.visibility import (
    DISTORTIONS,
    SPIN_TWINS,
    TURNS,
    is_negligible,
    is_out_of_range,
    lost_in_first_flights,
    only_gravity_is_turned,
    p_of_size,
    relative_size,
)
from rock2d.effects.effect import Effect
from rock2d.progress import Bar
from rock2d.records.columns import RATES

LARGEST_LUCK = 10.0  # log likelihood that a fit may gain by luck, beyond what a linear model expects of it
SURE_GAIN = 40.0  # log likelihood from which on luck does not matter
# Gain over the gain of what is learnt in its place at which the probability of an effect is 0.5. True causes mostly
# have 0.9 or more (0.75 where something else acts), imitators 0.55 to 0.8.
EVEN_RATIO = 0.65
# The same for an effect that widens the scatter, relative to a free scatter: the law of a true effect says which
# velocities vary together. A weak effect must gain more than a free scatter, because the forms of the other laws may
# leave as much; a strong one need not.
EVEN_SCATTER_RATIO, EVEN_SCATTER_RATIO_BESIDE = 0.8, 1.25
LEAST_RESTS_Z = 3.0  # standard errors from which on the preference of blocks at rest counts
RELEARN_CHANGE = 0.2  # relative change of a gain after which the changes in its place are learnt again
RATIO_STEEPNESS = 8.0  # slope of the logarithm of the odds over the logarithm of the ratio
RIVAL_Z = 2.0  # effects within so many standard errors cannot be separated
# An effect with many parameters can absorb another one whose form is not that of the catalogue. Where that one gains
# this share in its place, they are not told apart. In 20 films it gained 0.46 or more if it was the cause, else 0.32 or
# less.
OTHER_FORMS, OTHER_FORM_Z, OTHER_FORM_SHARE = {"zone_contrast": ("embankment_yield",)}, 1.5, 1.0 / 3.0
# effect that widens the scatter -> the lever that it changes with the place if it is the same in every release
PERMANENT = {"surface_roughness": PROFILE}
CONTAINED = {PROFILE: "geometry_error"}  # lever -> effect that is a change of it, too, without detail
CONTAINED_SHARE = 0.5  # share of what the others gain that such an effect may gain as a part of it
# `Evidence.even_ratio` of effects that a curve over the place contains: a true one predicts better than it; and of
# smooth changes of the picture, which imitate much: true ones had 1.1 or more, an imitator 0.68
EVEN_RATIOS = {"geometry_error": 1.0, "zone_contrast": 1.0, "lens_distortion": 0.8, "keystone_distortion": 0.8}
# the same for a learnt profile and one parameter of the law that follows the place: heights move positions, too
EVEN_SOFT_PLACE_RATIO = 1.4
# effects that depend on the place: the forms of their laws may leave a profile
OF_A_PLACE = ("geometry_error", "zone_contrast", "embankment_yield")
# laws of one resistance: the true one may have an exponent between theirs, or brake the spin less than the speed
RESISTANCES = SPIN_TWINS | {twin: name for name, twin in SPIN_TWINS.items()}
MOST_RIVALS = 2  # rivals that may share the name of a member
NAMED_PROBABILITY = 0.5  # smallest probability of an effect and its rivals at which it is named as a cause
# Shares of the gain of causes that may remain because the form of their laws is not exact: for learnt changes (causes
# in the world, causes in the camera), and for another effect; but no law leaves what grows from release to release.
FORM_SHARE, CAMERA_SHARE, EFFECT_FORM_SHARE = 0.25, 0.05, 0.05
GRAVITY_FORM_SHARE = 0.2  # of learnt accelerations: what their form misses may look like another gravity
SPLIT_Z = 3.0  # standard errors from which on other values of a camera in flights than in impacts count


@dataclass(frozen=True)
class Evidence:
    """Evidence for a member of a set of causes.

    Attributes
    ----------
    own_gain : gain of the set over the set without the member; beside the twin of another member if that is less
    replacement_gain : gain of changes that are learnt in its place; for an effect that widens the scatter, of a free
        scatter
    left_by_forms : log likelihood that the effect may gain only because the forms of other laws are not exact, or
        because it has other values in flights than in impacts
    p_chance : probability that chance gives as large a gain, or as large a size
    rival_z : rival -> standard errors by which the set is better than with the rival in its place, the closest first
    rival_share : share of its gain that the best of the rivals that gain more has in its place; 0 without one
    even_ratio : ratio of `own_gain` to `replacement_gain` at which the probability is 0.5
    rests_z : standard errors by which blocks at rest prefer the set to what is learnt in place of the member
    p_no_closure : probability that the member closes no part of the gap
    negligible : whether it is too small to matter
    out_of_range : whether its size lies at the end of the plausible range"""

    own_gain: Gain
    replacement_gain: Gain
    left_by_forms: float
    p_chance: float
    rival_z: Mapping[str, float]
    rival_share: float = 0.0
    even_ratio: float = EVEN_RATIO
    rests_z: float = 0.0
    p_no_closure: float = 0.0
    negligible: bool = False
    out_of_range: bool = False

    @property
    def possible(self) -> bool:
        """Whether its size is neither negligible nor at the end of the plausible range."""
        return not (self.negligible or self.out_of_range)

    @property
    def p(self) -> float:
        """Probability that it or one of its rivals is a cause."""
        if not self.possible:
            return 0.0
        gain = max(self.own_gain.total, 1e-9)
        ratio = gain / max(self.replacement_gain.total, 1e-9) / self.even_ratio
        if self.rival_share:  # what imitates an unknown cause gains only a part of what a better imitation gains
            ratio = min(ratio, 1.0 / self.rival_share / EVEN_RATIO)
        of_rests = largest_bayes_factor(float(ndtr(-self.rests_z))) if self.rests_z > LEAST_RESTS_Z else 1.0
        true = logistic(ratio, RATIO_STEEPNESS, of_rests)
        beyond_form = logistic(gain / max(self.left_by_forms, 1e-9), FORM_STEEPNESS)
        return self.p_acts * (1.0 - self.p_no_closure) * true * beyond_form

    @property
    def p_acts(self) -> float:
        """Probability that its gain is not chance, whatever causes it."""
        return probability_from_p_value(self.p_chance)

    @property
    def group(self) -> list[str]:
        """The closest rivals, with which it may share a name."""
        return list(self.rival_z)[:MOST_RIVALS]

    def probabilities(self, name: str) -> dict[str, float]:
        """Probability of the member `name` and of each rival; the odds of a rival are exp(-z)."""
        odds = {name: 1.0} | {rival: float(np.exp(-max(z, 0.0))) for rival, z in self.rival_z.items()}
        return {effect: self.p * odd / sum(odds.values()) for effect, odd in odds.items()}

    def named(self, name: str) -> bool:
        """Whether the member and its closest rivals are probable enough to be named."""
        probabilities = self.probabilities(name)
        return sum(probabilities[effect] for effect in (name, *self.group)) >= NAMED_PROBABILITY


def evidence_of_members(
    search: Search, learnt: Learnt, permanent: Learnt, known: Mapping[str, Evidence], bar: Bar
) -> dict[str, Evidence]:
    """Evidence for each member of the best set.

    `learnt`: that set with learnt changes; `permanent`: the same with those alone that are the permanent part of a
    member, see `PERMANENT`, mostly none; `known`: evidence from larger sets, whose `replacement_gain` is reused where
    the gain of the member has changed little."""
    best, data, contained = search.best, search.data, {CONTAINED[change.lever] for change in permanent.changes}
    evidence_of, to_relearn, doubted = dict[str, Evidence](), dict[str, tuple[Validated, Validated]](), set[str]()
    smaller, linear = _without_each(search, learnt, best.names), LinearModel(best.fit, data)
    for name in sorted(best.names):
        left = max(_left_by_forms(search, learnt, name), _least_gain_of_camera(search.effects[name], linear))
        before = known.get(name)
        rivals = before.group if before is not None else ()
        without = smaller[name]
        evidence = _evidence_of_member(search, learnt, without, name, left, rivals)
        scatter = search.effects[name].scatter
        if not (scatter or evidence.named(name)) and learnt.changes and search.without(best)[name].fit.free:
            # The learnt changes may have taken its place. It then must gain nearly as much without them, and either
            # more than changes learnt in its place, or more than the forms of the other laws leave to be learnt.
            # Without a fitted base no changes can be learnt.
            doubted.add(name)
            without = _without_each(search, permanent, [name])[name]
            evidence = _evidence_of_member(search, permanent, without, name, left, rivals)
        if name in PERMANENT and permanent.changes:
            evidence = max(evidence, _evidence_of_permanent(search, permanent, name), key=lambda found: found.p)
            share = _share_of_soft_places(data, best.fit, permanent.changes[0].basis)
            soft = replace(
                evidence, replacement_gain=Gain(share * evidence.own_gain.gain), even_ratio=EVEN_SOFT_PLACE_RATIO
            )
            evidence = min(evidence, soft, key=lambda found: found.p)
        if name in contained:
            evidence = replace(evidence, left_by_forms=_left_by_forms(search, learnt, name, CONTAINED_SHARE))
        elif contained:  # as a rival it would gain what the profile gains
            beside = {rival: z for rival, z in evidence.rival_z.items() if rival not in contained}
            evidence = replace(evidence, rival_z=beside)
        evidence_of[name] = evidence
        if not scatter and evidence.named(name):
            known_there = _with_known_replacement(evidence, before, name)
            if known_there is None:
                to_relearn[name] = permanent if name in doubted else learnt, without
                continue
            evidence_of[name] = known_there
        bar.step(name)
    jobs = [(*both, search.effects[name].phase, evidence_of[name].own_gain.total) for name, both in to_relearn.items()]
    for k, (gain, z) in search.processes.as_finished(_replacement, jobs):
        name = list(to_relearn)[k]
        # a distortion moves blocks at rest, as any block or ground does that is not as stated
        of_rests = 0.0 if name in DISTORTIONS else z
        evidence_of[name] = replace(evidence_of[name], replacement_gain=gain, rests_z=of_rests)
        bar.step(name)
    for name in sorted(name for name in best.names & TWINS.keys() if TWINS[name] in search.effects.keys() - best.names):
        evidence_of |= beside_twin(search, name, evidence_of)
    not_there = {  # how blocks are released may change first flights, so a small loss is no proof
        name
        for name in best.names & TWINS.keys()
        if lost_in_first_flights(best.fit, data, name) > EFFECT_FORM_SHARE * evidence_of[name].own_gain.total
    }
    for name in not_there | (TURNS if only_gravity_is_turned(best.fit) else set()):
        evidence_of[name] = replace(evidence_of[name], p_no_closure=1.0)
    evidence_of = {name: beside_better_rivals(search, name, own) for name, own in evidence_of.items()}
    for name in doubted:
        if not evidence_of[name].own_gain.total > evidence_of[name].replacement_gain.total > 0.0:
            left = max(evidence_of[name].left_by_forms, _left_by_forms(search, learnt, name, FORM_SHARE))
            evidence_of[name] = replace(evidence_of[name], left_by_forms=left)
    return evidence_of


def beside_twin(search: Search, name: str, evidence_of: Mapping[str, Evidence]) -> dict[str, Evidence]:
    """Evidence for the other members that gain less beside the twin of a member, if the twin explains as much.

    A part of the twin gains much beside the member alone: a ground at a wrong height beside a wrong frame rate is a
    part of a wrong scale."""
    other = search.set_of(search.best.names - {name} | {TWINS[name]})
    if search.gain(search.best, other).significance >= RIVAL_Z:
        return {}
    gains = {member: search.gain(other, less) for member, less in search.without(other).items()}
    return {
        member: replace(own, own_gain=gain, p_chance=max(own.p_chance, gain.p_of_addition))
        for member, own in evidence_of.items()
        if member != name and (gain := gains[member]).total < own.own_gain.total
    }


def beside_better_rivals(search: Search, name: str, own: Evidence) -> Evidence:
    """Evidence in which a rival that gains more counts as another imitation, also one of impossible size."""
    shares = [search.share_in_place(name, rival) for rival in search.find_rivals(search.best, name, 0.0)]
    return replace(own, rival_share=max(shares, default=0.0))


def _with_known_replacement(evidence: Evidence, before: Evidence | None, name: str) -> Evidence | None:
    """Evidence with what was learnt in the place of the member beside a larger set, `before`; None if its gain has
    changed, or if it would be refused: only what is learnt beside the same set may do that."""
    if before is None or not before.replacement_gain.gain.any():
        return None
    change = abs(evidence.own_gain.total - before.own_gain.total)
    known = replace(evidence, replacement_gain=before.replacement_gain, rests_z=before.rests_z)
    return known if known.named(name) and change < RELEARN_CHANGE * before.own_gain.total else None


def _replacement(data: Data, whole: Validated, without: Validated, phase: str, own_gain: float) -> tuple[Gain, float]:
    """Gain of changes that are learnt in the place of an effect of this phase, and `Evidence.rests_z` of the `whole`
    model. Learning ends where they will not gain as much as the effect, `own_gain`: its probability is then more than
    0.95."""
    levers = {"flight": {FLIGHT}, "impact": {*LEVERS} - {FLIGHT}}.get(phase, {*LEVERS})
    learnt = learn(without, data, levers, own_gain)
    return held_out_gain(data, learnt, without), rests_z(data, whole, learnt)


def _left_by_forms(search: Search, learnt: Learnt, name: str, share: float = EFFECT_FORM_SHARE) -> float:
    """`Evidence.left_by_forms` of the member `name`: a `share` of what learnt changes gain, and of what other members
    gain whose laws may have another form, in the flights or impacts that the effect changes. Learnt changes of impacts
    stand for a cause without a name, and may miss more of it than a law: another effect of impacts can follow that."""
    best, effects = search.best, search.effects
    phase, of_learnt = effects[name].phase, share
    if name in TWINS and any(change.lever == FLIGHT for change in learnt.changes):
        of_learnt = max(share, GRAVITY_FORM_SHARE)
    unnamed = {change.lever for change in learnt.changes} - {FLIGHT, *PERMANENT.values()}
    if name in DISTORTIONS or (unnamed and phase == "impact" and not effects[name].scatter):
        of_learnt = max(share, FORM_SHARE)
    left = of_learnt * max(_gain_in(phase, learnt, best), 0.0) if learnt.changes else 0.0
    return left + share * sum(
        _form_share(effects[other]) / FORM_SHARE * _gain_in(phase, best, without)
        for other, without in search.without(best).items()
        if other != name
    )


def _least_gain_of_camera(effect: Effect, linear: LinearModel) -> float:
    """Log likelihood that a member of the best set must gain so that values of its own in flights gain no more than
    EFFECT_FORM_SHARE of it; 0 if they gain nothing, or it is no effect of the camera on flights and impacts.

    `linear`: of the best set"""
    if not (effect.camera and effect.phase == "all"):
        return 0.0
    apart = linear.gain_of_own_values_in_flights(effect.name)
    return apart.total / EFFECT_FORM_SHARE if apart.significance > SPLIT_Z else 0.0


def _gain_in(phase: str, model: Validated, reference: Validated) -> float:
    """Gain in log likelihood of a model over another, in the segments that an effect of this phase changes."""
    gain = 0.0
    for sign, scored in ((1.0, model), (-1.0, reference)):
        residuals = scored.held_out.residuals
        if phase != "flight":
            gain += sign * float(log_likelihood(residuals.impacts, scored.fit.covariance()).sum())
        if phase != "impact":
            gain += sign * float(flight_log_likelihood(residuals.flights).sum())
    return gain


def _without_each(search: Search, learnt: Learnt, names: Collection[str]) -> dict[str, Validated]:
    """The best set with the learnt changes, without each of the members `names`; name -> model."""
    smaller = search.without(search.best)
    if not learnt.changes:
        return smaller
    jobs = {name: (Reduction(learnt.fit, name, smaller[name].fit), learnt.changes) for name in sorted(names)}
    found = dict(search.processes.as_finished(_reduced, list(jobs.values())))
    return {name: found[k] for k, name in enumerate(jobs)}


def _reduced(data: Data, reduction: Reduction, changes: list[Change]) -> Learnt:
    """A model with learnt changes, without a member."""
    return replace(Learnt.of(reduction.fitted(data), data), changes=changes)


def _evidence_of_member(
    search: Search, learnt: Learnt, without: Validated, name: str, left: float, rivals: Collection[str]
) -> Evidence:
    """Evidence for a member of the best set with the learnt changes, without the gain of changes in its place.

    `without`: the model without the member; `left`: `Evidence.left_by_forms`; `rivals`: its closest rivals in a larger
    set."""
    best, data, effect = search.best, search.data, search.effects[name]
    own_gain = held_out_gain(data, learnt, without)
    of_size = [p_of_size(fit, name) for fit in (best.fit, learnt.fit)]
    p_chance, p_no_closure = max(own_gain.p_of_addition, *of_size), 0.0
    if not effect.scatter:  # a scatter closes no gap, and random signs do not change it
        others_chance_gains = [own.chance_gains for own in search.expected_beside(best).values()]
        if others_chance_gains:
            gain = gain_beyond_luck(search, name, own_gain.total)
            p_chance = max(p_chance, chance_p_value(gain, np.max(others_chance_gains, axis=0)))
        p_no_closure = probability_of_no_closure(search, name, learnt, without)
    rival_z = plausible_rivals(search, name, own_gain, rivals)
    if learnt.changes and (twin := TWINS.get(name, "")) in search.effects.keys() - best.names:
        # only contacts tell them apart, and something there is not understood
        rival_z = _first(twin, min(0.0, rival_z.get(twin, 0.0)), rival_z)
    for other in OTHER_FORMS.get(name, ()):
        if other in search.effects.keys() - best.names and search.share_in_place(name, other) > OTHER_FORM_SHARE:
            rival_z = _first(other, min(OTHER_FORM_Z, rival_z.get(other, np.inf)), rival_z)
    sizes = [relative_size(fit, name) for fit in (best.fit, learnt.fit)]
    negligible = is_negligible(effect, sizes, own_gain.significance)
    out_of_range = any(is_out_of_range(fit, name) for fit in (best.fit, learnt.fit))
    evidence = Evidence(
        own_gain, Gain(np.zeros_like(own_gain.gain)), 0.0 if effect.grows else left, p_chance, rival_z,
        p_no_closure=p_no_closure, negligible=negligible,
        even_ratio=EVEN_RATIOS.get(name, EVEN_RATIO), out_of_range=out_of_range,
    )  # fmt: skip
    if (resistance := RESISTANCES.get(name)) is not None and resistance in best.names:
        gain = search.gain(search.alone[resistance], search.base).total
        evidence = beyond_other_law(evidence, gain)
    if effect.scatter:
        weak = own_gain.total < FORM_SHARE / EFFECT_FORM_SHARE * left
        even_ratio = EVEN_SCATTER_RATIO_BESIDE if weak else EVEN_SCATTER_RATIO
        evidence = replace(evidence, replacement_gain=_gain_of_free_scatter(data, without), even_ratio=even_ratio)
    return evidence


def _first(rival: str, z: float, rival_z: Mapping[str, float]) -> dict[str, float]:
    """Rivals with one that comes first, at z standard errors."""
    return {rival: z} | {other: own for other, own in rival_z.items() if other != rival}


def plausible_rivals(search: Search, name: str, gain: SummedGain, fitted: Collection[str] = ()) -> dict[str, float]:
    """`Search.find_rivals` of a member of the best set with this `gain`, without those of impossible size."""
    others = search.best.names - {name}
    return {
        rival: z
        for rival, z in search.find_rivals(search.best, name, RIVAL_Z, fitted).items()
        if (own := search.known.get(others | {rival})) is None
        or not (
            is_negligible(search.effects[rival], [relative_size(own.fit, rival)], gain.significance)
            or is_out_of_range(own.fit, rival)
        )
    }


def gain_beyond_luck(search: Search, name: str, gain: float) -> float:
    """The gain of a member that chance gains can be compared with. The likelihood of impacts is rugged, so that a fit
    can find up to LARGEST_LUCK where a linear model, as that of the chance gains, finds nothing."""
    if gain > SURE_GAIN:
        return gain
    best = search.best.fit
    own_p = np.concatenate([best.p[: len(BASE_WIDTH)], best.p[best.model.positions[name]]])
    expected = Screening(search.without(search.best)[name].fit, search.data).expected(search.effects[name], own_p)
    return min(gain, max(expected.total, gain - LARGEST_LUCK))


def beyond_other_law(evidence: Evidence, other_gain: float) -> Evidence:
    """Evidence that counts only beyond what the form of another law of the same force, with this gain alone, may
    leave."""
    return replace(evidence, left_by_forms=max(evidence.left_by_forms, FORM_SHARE * other_gain))


def _evidence_of_permanent(search: Search, permanent: Learnt, name: str) -> Evidence:
    """Evidence for a member that is the same in every release: it gains by its scatter and by its lever, over the set
    without both, where other changes may be learnt in its place."""
    data, best, smaller = search.data, search.best, search.without(search.best)
    without = smaller[name]
    own_gain = held_out_gain(data, permanent, without)
    others = learn(without, data, {*LEVERS} - {PERMANENT[name]})
    shares = {
        other: min(_form_share(search.effects[other]), FORM_SHARE if other in OF_A_PLACE else EFFECT_FORM_SHARE)
        for other in smaller.keys() - {name}
    }
    left = sum(share * _gain_in("impact", best, smaller[other]) for other, share in sorted(shares.items()))
    return Evidence(
        own_gain, held_out_gain(data, others, without), left, own_gain.p_of_addition, {},
        negligible=is_negligible(search.effects[name], [_size_with_profile(permanent.fit, name)], 0.0),
    )  # fmt: skip


def _share_of_soft_places(data: Data, fit: Fit, basis: Basis) -> float:
    """What one parameter of the law that depends on the place gains, as a share of the gain of a profile on the same
    basis; both as a linear model expects it."""
    levers, linear = Levers(fit, data), LinearModel(fit, data)

    def gain(lever: str, response: LeverResponse) -> float:
        return max(float(linear.best_gain(levers.columns(response), WIDTHS[lever])[0].sum()), 0.0)

    law = levers.response(LAW, basis).law
    assert law is not None
    soft = max(gain(LAW, LeverResponse(part.shape[-1], law=part)) for part in np.split(law, len(BASE_WIDTH), axis=-1))
    return soft / max(gain(PROFILE, levers.response(PROFILE, basis)), 1e-9)


def _size_with_profile(fit: Fit, name: str) -> float:
    """`relative_size` of a permanent roughness: of its scatter and the slopes of its learnt profile together."""
    model = fit.model
    slope_rad = sum(
        response.slope @ coefficients
        for response, coefficients in zip(model.responses, model.coefficients(fit.p), strict=True)
        if response.slope is not None
    )
    of_profile = np.sqrt(np.mean(np.square(slope_rad))) / model.parameters_of(name)[0].high
    return float(np.hypot(relative_size(fit, name), of_profile))


def _gain_of_free_scatter(data: Data, model: Validated) -> Gain:
    """Gain of a model if each velocity after an impact has a free scatter of its own."""
    fit, units = model.fit, state_units(model.fit.model.setup)[RATES]
    columns = np.zeros((*fit.residuals.impacts.shape, len(units)))
    columns[:, -len(units) :] = np.diag(units)
    before_last = [len(fit.scatter) - 1] * len(units)
    parts = (("scatter", columns), ("later", 0.0), ("bend", 0.0))
    wider = {name: np.insert(getattr(fit.jacobian, name), before_last, part, axis=-1) for name, part in parts}
    slope, start = replace(fit.jacobian, **wider), np.insert(fit.scatter, before_last, START_SCATTER)
    wide = residual_covariance(slope, fit_scatter(fit.residuals.impacts, slope, start))
    scores = [by_release(data, model.held_out.residuals, covariance) for covariance in (wide, fit.covariance())]
    return Gain(scores[0] - scores[1])


def probability_of_no_closure(search: Search, name: str, learnt: Validated, without: Validated) -> float:
    """Probability that an effect closes no part of the gap: neither alone, nor as a member of the best set, nor beside
    the learnt changes (`learnt`; the same model without the effect: `without`)."""
    sizes = ResidualSizes(search.data, search.best.fit.covariance())
    draws = GapBootstrap(sizes, seed=0)

    def gap(with_effect: Validated) -> Array:
        return draws.gap(sizes.of_joint_channels(with_effect.held_out.residuals))

    best = search.best
    pairs = [(search.alone[name], search.base), (best, search.without(best)[name]), (learnt, without)]
    return min(float(np.mean(gap(without) <= gap(with_effect))) for with_effect, without in pairs)


def _form_share(effect: Effect) -> float:
    """Share of the gain of a cause that may remain because the form of its law is not exact; 0 for a choice."""
    if effect.parameters[0].must_choose:
        return 0.0
    return CAMERA_SHARE if effect.camera else FORM_SHARE


def gain_left_by_forms(search: Search, cause_set: Validated) -> float:
    """Log likelihood that learnt changes may gain because the forms of the laws of a set are not exact."""
    gains = {
        name: max(search.gain(cause_set, without).total, 0.0) for name, without in search.without(cause_set).items()
    }
    shares = {name: _form_share(search.effects[name]) for name in gains}
    left = sum(shares[name] * gain for name, gain in gains.items()) / max(sum(gains.values()), 1e-9)
    return left * max(search.gain(cause_set, search.base).total, 0.0)
