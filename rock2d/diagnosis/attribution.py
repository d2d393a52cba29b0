"""Attribution: the base law against the law with each effect of the catalogue, on held-out releases.

The parameters of the base are free in every model. The gain in log likelihood on held-out releases decides. It is
compared release by release, so a few unusual impacts cannot decide it. The verdict is "none" if no gain is significant,
and "unknown" if the residuals of even the best effect can be predicted (`residual_regression`).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from rock2d.diagnosis.candidate import Candidate
from rock2d.diagnosis.classification import probabilities, statistics
from rock2d.diagnosis.cross_validation import HeldOut, cross_validate
from rock2d.diagnosis.data import Data, model_residuals
from rock2d.diagnosis.discrepancy import Discrepancy, discrepancies
from rock2d.diagnosis.exploring import REFIT_GAIN
from rock2d.diagnosis.fitting import EXPLORING_ITERATIONS, Fit, fit, some_releases
from rock2d.diagnosis.likelihood import LARGEST_CHI_SQUARE
from rock2d.diagnosis.model import LARGEST_LOG_K_L, Model
from rock2d.diagnosis.parallel import Job, try_all
from rock2d.diagnosis.residual_regression import RegressedResiduals, regress
from rock2d.diagnosis.significance import significance, standard_error
from rock2d.effects.effect import Effect
from rock2d.laws.contact import INDENTATION
from rock2d.scene.world import World

Array = np.ndarray

SIGNIFICANT_GAIN_Z = 3.0  # standard errors of a gain
SIGNIFICANT_DEPENDENCE_Z = 2.0  # standard errors of a dependence that remains to be explained
GROUP_Z = 2.0  # standard errors between effects that the data cannot separate
FIRST_EFFECT_GAIN = 0.01  # log likelihood per segment that the first effect must gain at least
MOST_EFFECTS = 3  # in one model
BASE_STARTS = 2  # places from which the base law is fitted
FURTHER_EFFECTS_TRIED = 6  # beside the best one
FURTHER_EFFECT_GAIN = 0.05  # the same for a further effect


@dataclass
class Attribution:
    """Result of the attribution.

    Attributes
    ----------
    base, base_held_out : the base law refitted
    candidates : name -> candidate
    chain : the effect with the largest gain, then at each step the effect that adds the largest significant gain. Each
        has the joint fit of all effects up to it, and its gain over the step before
    base_regressed, best_regressed : flexible regression of the residuals of the base and of the last model of the
        chain
    probabilities : over the catalogue, "none" and "unknown"; `statistics`: the numbers that they follow from
    group : effects that the data cannot separate from the best, the best first
    unexplained : significant dependences in the residuals of the last model of the chain, the strongest first
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

    @property
    def best(self) -> str:
        return self.chain[0].effect.name

    @property
    def final(self) -> Candidate:
        return self.chain[-1]

    @property
    def verdict(self) -> str:
        return max(self.probabilities, key=lambda name: self.probabilities[name])


def fit_base(setup: World, base: Array, data: Data, registered: World | None = None) -> Fit:
    """The paper's law with its own parameters refitted.

    The fit explores a coarse grid around `base` on some releases and then fits all of them. Both readings of the
    rolling resistance are tried (`ContactParameters.rolling_in_indentation`); the better one stays in the set-up.

    If the film was segmented in another world than the stated one (`registered`), the law is fitted there and used
    without a further fit on the stated set-up, where blocks would fall into the ground. The gains of effects over such
    a base are no measure of their size.
    """
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
        residuals = [model_residuals(model, p, some).impacts for p in corners]
        # channels in units of their median residual over all corners
        scale = np.nanmedian(np.abs(np.concatenate(residuals)), axis=0)
        misfit = [np.log1p(np.nan_to_num(np.abs(r) / scale, nan=LARGEST_CHI_SQUARE)).sum() for r in residuals]
        found += [
            fit(model, some, corners[i], rounds=EXPLORING_ITERATIONS)
            for i in np.argsort(misfit)[:BASE_STARTS]
        ]
    best = max(found, key=Fit.total)
    best = fit(best.model, data, best.p)
    if registered is None:
        return best
    stated = Model(replace(setup, contact=best.model.setup.contact), base)
    return replace(fit(stated, data, best.p, enough=np.inf), free=False)


def attribute(
    base: Fit,
    data: Data,
    effects: Mapping[str, Effect],
    *,
    workers: int = 1,
    folder: Path | None = None,
    on_progress: Callable[[str], None] = lambda name: None,
) -> Attribution:
    """Try every effect against the base law, and further ones beside the best while the residuals depend on something.

    Where the law of the best candidate fits better without the effect than the base, it becomes the base and
    everything is tried again.

    `on_progress` is called with the name of each model when it is done; `folder` keeps finished fits.
    """
    setup, base_out = base.model.setup, cross_validate(base, data)
    job = Job(setup, data, base, folder=folder)
    results = try_all(job, [(name,) for name in effects], workers, on_progress)
    candidates = {
        name: Candidate(effects[name], own, out, out.score - base_out.score)
        for (name,), (own, out) in results.items()
    }
    best = max(candidates, key=lambda name: candidates[name].total)
    if base.free:
        # the fit of an effect may have found a better law
        better = fit(base.model, data, candidates[best].fit.p[: len(base.p)])
        if better.total() > base.total() + REFIT_GAIN:
            return attribute(better, data, effects, workers=workers, folder=folder, on_progress=on_progress)
    chain = [candidates[best]]
    segments = len(data.impact_release) + len(data.flight_release)
    if _significant(chain[0], FIRST_EFFECT_GAIN * segments):
        while len(chain) < MOST_EFFECTS and _residuals_depend(data, chain[-1]):
            following = _next(job, chain, candidates, workers, on_progress)
            if following is None or not _significant(following, FURTHER_EFFECT_GAIN * segments):
                break
            chain.append(following)
    covariance = chain[-1].fit.covariance()
    base_regressed = regress(setup, data, base_out.residuals, covariance)
    best_regressed = regress(setup, data, chain[-1].held_out.residuals, covariance)
    base_dependences, best_dependences = discrepancies(base, data), discrepancies(chain[-1].fit, data)
    numbers = statistics(candidates, best, base_regressed, best_regressed, base_dependences, best_dependences)
    winner = candidates[best]
    group = [best] + [
        name
        for name, other in sorted(candidates.items(), key=lambda item: -item[1].total)
        if name != best and winner.total - other.total < GROUP_Z * standard_error(winner.gain - other.gain)
    ]
    return Attribution(
        base, base_out, candidates, chain, base_regressed, best_regressed, probabilities(numbers), group, numbers,
        [d for d in best_dependences if _is_significant(d)],
    )  # fmt: skip


def _significant(candidate: Candidate, least: float) -> bool:
    """Whether a gain is significant and larger than `least`."""
    return candidate.total > SIGNIFICANT_GAIN_Z * candidate.error + least


def _residuals_depend(data: Data, candidate: Candidate) -> bool:
    """Whether the residuals of a model still depend on something."""
    return _is_significant(discrepancies(candidate.fit, data)[0])


def _is_significant(dependence: Discrepancy) -> bool:
    """Whether a dependence is significant."""
    return significance(dependence) > SIGNIFICANT_DEPENDENCE_Z


def _next(
    job: Job,
    chain: list[Candidate],
    candidates: Mapping[str, Candidate],
    workers: int,
    on_progress: Callable[[str], None],
) -> Candidate | None:
    """The effect that gains most beside those of the chain, of the effects without scatter that gained most alone."""
    names = tuple(c.effect.name for c in chain)
    others = [c for c in candidates.values() if c.effect.name not in names and not c.effect.scatter]
    others = sorted(others, key=lambda c: -c.total)[:FURTHER_EFFECTS_TRIED]
    before = chain[-1]
    start = Job(job.setup, job.data, before.fit, folder=job.folder)
    tried = try_all(start, [(*names, c.effect.name) for c in others], workers, on_progress)
    found = [
        Candidate(other.effect, own, out, out.score - before.held_out.score)
        for other, (own, out) in zip(others, tried.values(), strict=True)
    ]
    return max(found, key=lambda c: c.total, default=None)
