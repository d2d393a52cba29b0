"""Classification: from the scores of the attribution to probabilities over the catalogue, "none" and "unknown".

Three logistic regressions on a few statistics of the attribution (`statistics`) answer three questions: is there an
effect at all; if so, is it one of the catalogue; if so, which one. They are trained on films of the independent reality
engine (`rock2d blind train`) whose causes are known. `weights.json` holds their coefficients and the share of films
with an effect among those in which nothing is visible. A small share of the probability always follows the prior,
because the training cannot contain every case.
"""

from __future__ import annotations

import functools
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from rock2d.diagnosis.candidate import Candidate
from rock2d.diagnosis.discrepancy import Discrepancy
from rock2d.diagnosis.levers import FLIGHT
from rock2d.diagnosis.residual_regression import RegressedResiduals

Array = np.ndarray

WEIGHTS = Path(__file__).with_name("weights.json")
ANY, KNOWN, WHICH = "any", "known", "which"  # the three questions
UNSEEN = "unseen"  # share of films with an effect that is too faint to be visible
PRIOR_SHARE = 0.02  # of the probability follows the prior
PRIOR = {"none": 0.25, "unknown": 0.15}  # probabilities of the prior
PRIOR_CATALOGUE = 0.6
LARGEST_Z = 30.0  # standard errors; more count as this
LARGEST_DEPENDENCE_Z = 6.0  # the same for one of many dependences
# logarithms of gains: chance or a rough law may give the one, not the other
FAINT_LOG_GAIN, CLEAR_LOG_GAIN = 2.5, 5.0
FAINT_Z, CLEAR_Z = 1.5, 4.0  # of the largest of many gains: chance often gives the one, never the other


def predictable(found: RegressedResiduals) -> float:
    """Mean square per residual that the regression predicts."""
    taken = (found.impacts**2 - found.impacts_remaining**2).sum() + (
        found.flights**2 - found.flights_remaining**2
    ).sum()
    return float(taken / (found.impacts.size + found.flights.size))


def mean_square(found: RegressedResiduals) -> float:
    """Mean square of the residuals, in units of noise and scatter."""
    return float(
        ((found.impacts**2).sum() + (found.flights**2).sum()) / (found.impacts.size + found.flights.size)
    )


def statistics(
    candidates: Mapping[str, Candidate],
    best: str,
    ahead: Mapping[str, float],
    base_regressed: RegressedResiduals,
    best_regressed: RegressedResiduals,
    base_dependences: Sequence[Discrepancy],
    best_dependences: Sequence[Discrepancy],
) -> dict[str, Any]:
    """The statistics of the three regressions: {"case": {name: value}, "effects": {effect: {name: value}}}.

    `ahead`: standard errors by which the best one is better than each;
    `base_regressed`, `best_regressed`: residuals of the base and of the last model;
    `base_dependences`, `best_dependences`: dependences in the residuals of each, the strongest first.
    """
    winner = candidates[best]
    effects = {}
    for name, other in candidates.items():
        behind = winner.total - other.total
        effects[name] = {
            "behind_z": min(ahead[name], LARGEST_Z),
            "behind_share": float(np.clip(behind / max(winner.total, 1.0), 0.0, 2.0)),
            "behind_log": float(np.log1p(max(behind, 0.0))),
            "scatter": float(other.effect.scatter),
            "gain": other.total,
            "error": other.error,
        }
    strongest, remaining_dependence = base_dependences[0], best_dependences[0]
    remaining, gap = predictable(best_regressed), predictable(base_regressed)
    base, final = mean_square(base_regressed), mean_square(best_regressed)
    reducible = max(base - final + max(remaining, 0.0), gap, 1e-9)
    flights = np.mean(best_regressed.flights**2) if best_regressed.flights.size else 1.0
    gain_z = winner.significance
    in_flight = [d.significance for d in best_dependences if d.lever == FLIGHT]
    in_impacts = [d.significance for d in best_dependences if d.lever != FLIGHT]
    case = {
        "gain_z": float(np.clip(gain_z, 0.0, LARGEST_Z)),
        "gain_seen": visible(gain_z),
        "gain_size": float(np.clip(log_gain(winner.total), FAINT_LOG_GAIN, CLEAR_LOG_GAIN) - FAINT_LOG_GAIN),
        "hidden_seen": visible(strongest.significance),
        "left_hidden_z": float(np.clip(remaining_dependence.significance, 0.0, LARGEST_Z)),
        "left_hidden_over_gain": log_gain(remaining_dependence.total) - log_gain(winner.total),
        "left_flight_z": float(np.clip(max(in_flight, default=0.0), 0.0, LARGEST_DEPENDENCE_Z)),
        "left_impact_z": float(np.clip(max(in_impacts, default=0.0), 0.0, LARGEST_DEPENDENCE_Z)),
        "left_share": float(np.clip(remaining / reducible, 0.0, 1.0)),
        "flights_log": float(np.log(max(flights, 1e-3))),
        "scatter": float(winner.effect.scatter),
    }
    dependences = {
        when: {d.name: [d.total, d.error] for d in found}
        for when, found in (("base", base_dependences), ("best", best_dependences))
    }
    return {"case": case, "effects": effects, "dependences": dependences}


def visible(z: float) -> float:
    """Standard errors above what chance often gives, up to where there is no doubt."""
    return float(np.clip(z, FAINT_Z, CLEAR_Z) - FAINT_Z)


def log_gain(total: float) -> float:
    """Gain in log likelihood on a logarithmic scale; 0 for no gain or a loss."""
    return float(np.log(max(total, 0.0) + 1.0))


@functools.cache
def weights() -> dict[str, Any]:
    """The trained regressions, question -> {"features", "mean", "scale", "coefficients", "intercept"}, and UNSEEN."""
    return dict(json.loads(WEIGHTS.read_text(encoding="utf-8")))


def chance(question: Mapping[str, Any], values: Mapping[str, float]) -> float:
    """Probability that a regression gives to "yes"."""
    x = np.array([values[name] for name in question["features"]])
    z = (x - np.array(question["mean"])) / np.array(question["scale"])
    return float(1.0 / (1.0 + np.exp(-(z @ np.array(question["coefficients"]) + question["intercept"]))))


def probabilities(found: Mapping[str, Any], known: Mapping[str, Any] | None = None) -> dict[str, float]:
    """Probabilities over the effects, "none" and "unknown" from `statistics`; `known`: other weights than the own."""
    known = weights() if known is None else known
    some, catalogued = chance(known[ANY], found["case"]), chance(known[KNOWN], found["case"])
    odds = {}
    for name, values in found["effects"].items():
        p = chance(known[WHICH], values)
        odds[name] = p / (1.0 - p)
    total = sum(odds.values())
    expected = PRIOR | dict.fromkeys(odds, PRIOR_CATALOGUE / len(odds))
    faint = (1.0 - some) * known[UNSEEN] / (1.0 - PRIOR["none"])
    out = {"none": (1.0 - some) * (1.0 - known[UNSEEN])}
    out["unknown"] = some * (1.0 - catalogued) + faint * expected["unknown"]
    out |= {name: some * catalogued * o / total + faint * expected[name] for name, o in odds.items()}
    return {name: (1.0 - PRIOR_SHARE) * p + PRIOR_SHARE * expected[name] for name, p in out.items()}
