"""What tells whether each effect is a member of the set of causes.

The best model with an effect is compared with the best model without it, on held-out releases. Where effects can stand
for each other, each gains little over the other: then neither is sure. The comparison does not give a probability by
itself, because no law of the model is exactly true. The statistics are kept for a regression on films whose causes are
known.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from rock2d.diagnosis.cause_sets import Gain, Search
from rock2d.diagnosis.discrepancy import Discrepancy
from rock2d.diagnosis.significance import significance

LARGEST_Z, LEAST_Z = 20.0, -10.0  # standard errors; more count as this


def inclusion_statistics(search: Search, left: Discrepancy) -> dict[str, dict[str, float]]:
    """Effect -> name of a statistic -> value; `left`: the strongest dependence in the residuals of the best set."""
    segments = len(search.data.impact_release) + len(search.data.flight_release)
    explained = max(search.best.gain(search.base).total, 1.0)
    found = {}
    for name, effect in search.effects.items():
        gain, fitted = _with_over_without(search, name)
        alone = search.alone[name].gain(search.base)
        found[name] = {
            "z": float(np.clip(significance(gain), LEAST_Z, LARGEST_Z)),
            "log_gain": signed_log(gain.total),
            "share": float(np.clip(gain.total / explained, -1.0, 1.0)),
            "log_gain_per_segment": signed_log(100.0 * gain.total / segments),
            "left_over_gain": signed_log(left.total) - signed_log(gain.total),
            "left_z": float(np.clip(significance(left), 0.0, LARGEST_Z)),
            "alone_z": float(np.clip(significance(alone), LEAST_Z, LARGEST_Z)),
            "fitted": float(fitted),
            "scatter": float(effect.scatter),
            "causes": float(len(search.best.names)),
        }
    return found


def _with_over_without(search: Search, name: str) -> tuple[Gain, bool]:
    """Gain of the best model with an effect over the best one without it; whether the former was fitted, or only
    expected by screening."""
    scores: dict[bool, list[Any]] = {True: [], False: []}
    for names, own in search.known.items():
        scores[name in names].append((own.held_out.score, True))
    for names, expected in search.expected.items():
        if name in expected and names | {name} not in search.known:
            scores[True].append((search.known[names].held_out.score + expected[name].gain, False))
    (best, fitted), (other, _) = (
        max(scores[k], key=lambda pair: float(pair[0].sum())) for k in (True, False)
    )
    return Gain(best - other), fitted


def signed_log(value: float) -> float:
    """log(1 + |value|) with the sign of the value."""
    return float(np.copysign(np.log1p(abs(value)), value))
