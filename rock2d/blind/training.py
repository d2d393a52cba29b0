"""The weights that turn scores into probabilities: logistic regressions on trials with known labels."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from rock2d.blind.case_files import read_labels
from rock2d.blind.scoring import read_results
from rock2d.diagnosis.classification import ANY, KNOWN, PRIOR, PRIOR_SHARE, UNSEEN, WHICH, chance
from rock2d.diagnosis.inclusion import INCLUDED, OUTSIDE
from rock2d.files.folders import write_whole

Array = np.ndarray

FEATURES = {
    ANY: ("gain_seen", "gain_size", "hidden_seen", "scatter"),
    KNOWN: (
        "left_hidden_over_gain",
        "left_hidden_z",
        "left_flight_z",
        "left_impact_z",
        "left_share",
        "flights_log",
        "scatter",
        "gain_z",
    ),
    WHICH: ("behind_z", "behind_share", "behind_log", "scatter"),
    INCLUDED: (
        "z",
        "log_gain",
        "beside_learnt_z",
        "scatter",
        "largest_over",
        "nameless_over",
        "flight_left_z",
        "impact_left_z",
    ),
    OUTSIDE: (
        "learnt_log",
        "learnt_z",
        "learnt_share",
        "left_log",
        "left_z",
        "left_over_named",
        "left_share",
    ),
}
INVERSE_REGULARISATION = 0.3
VISIBLE_SIGNAL_TO_NOISE = 2.0  # below it a hidden cause counts as none
INVISIBLE_SIGNAL_TO_NOISE = 0.5  # a cause between the two is no example of either answer


LabelledResult = tuple[dict[str, Any], dict[str, Any]]  # a case's label and its result


def labelled_results(folders: Iterable[Path]) -> list[LabelledResult]:
    """Labels and results of all diagnosed cases of these trials."""
    out = []
    for folder in folders:
        labels = read_labels(folder)
        out += [(labels[name], result) for name, result in read_results(folder).items()]
    return out


@dataclass
class Examples:
    """Statistics, answers and weights."""

    values: list[dict[str, float]] = field(default_factory=list)
    answers: list[bool] = field(default_factory=list)
    weights: list[float] = field(default_factory=list)


def examples(cases: Iterable[LabelledResult]) -> dict[str, Examples]:
    """Question -> examples.

    Cases that were diagnosed without their best effect too (`without_best` of `running.run_trial`) are examples of
    "unknown". They and the cases with an outside cause share the weight of the latter, so that the frequency of
    "unknown" does not change.
    """
    cases = list(cases)
    out = {question: Examples() for question in FEATURES}
    outside = sum("unknown" in label["label"].split("+") for label, _ in cases)
    without_effect = sum(bool(result["without_best"]) for _, result in cases)
    half, share = (0.5, 0.5 * outside / without_effect) if without_effect else (1.0, 0.0)

    def add(question: str, values: dict[str, float], answer: bool, weight: float = 1.0) -> None:
        out[question].values.append(values)
        out[question].answers.append(answer)
        out[question].weights.append(weight)

    for label, result in cases:
        found, truth = result["statistics"], set(label["label"].split("+"))
        if found is None:
            continue
        _add_causes(label, found, add)
        some = label["label"] != "none" and label["signal_to_noise"] >= VISIBLE_SIGNAL_TO_NOISE
        add(ANY, found["case"], some)
        if not some:
            continue
        known = "unknown" not in truth
        add(KNOWN, found["case"], known, 1.0 if known else half)
        if not known:
            continue
        for effect, values in found["effects"].items():
            add(WHICH, values, effect in truth)
        without = result["without_best"]
        if without is not None and len(truth) == 1 and not truth & set(without["effects"]):
            add(ANY, without["case"], True, share)
            add(KNOWN, without["case"], False, share)
    return out


def _add_causes(
    label: Mapping[str, Any], found: Mapping[str, Any], add: Callable[[str, dict[str, float], bool], None]
) -> None:
    """Examples of effects that are among the causes, or not, and of causes outside the catalogue."""
    sizes = {cause["name"]: cause["signal_to_noise"] for cause in label["hidden"]}
    for effect, values in found["causes"].items():
        size = sizes.get(effect, 0.0)
        if not INVISIBLE_SIGNAL_TO_NOISE <= size < VISIBLE_SIGNAL_TO_NOISE:
            add(INCLUDED, values, size >= VISIBLE_SIGNAL_TO_NOISE)
    largest = max((size for name, size in sizes.items() if name not in found["causes"]), default=0.0)
    if not INVISIBLE_SIGNAL_TO_NOISE <= largest < VISIBLE_SIGNAL_TO_NOISE:
        add(OUTSIDE, found["outside"], largest >= VISIBLE_SIGNAL_TO_NOISE)


def regression(features: Sequence[str], given: Examples) -> dict[str, Any]:
    """A logistic regression as plain numbers."""
    from sklearn.linear_model import LogisticRegression

    x = np.array([[v[name] for name in features] for v in given.values])
    mean, scale = x.mean(axis=0), np.maximum(x.std(axis=0), 1e-6)
    model = LogisticRegression(C=INVERSE_REGULARISATION, max_iter=1000).fit(
        (x - mean) / scale, np.array(given.answers), np.array(given.weights)
    )
    return {
        "features": list(features),
        "mean": mean.round(6).tolist(),
        "scale": scale.round(6).tolist(),
        "coefficients": model.coef_[0].round(6).tolist(),
        "intercept": round(float(model.intercept_[0]), 6),
        "examples": len(given.answers),
    }


def train(cases: Iterable[LabelledResult]) -> dict[str, Any]:
    """Weights from cases with known labels."""
    cases = list(cases)
    found = examples(cases)
    weights: dict[str, Any] = {
        question: regression(FEATURES[question], found[question]) for question in FEATURES
    }
    return weights | {UNSEEN: unseen(cases, weights[ANY])}


def unseen(cases: Iterable[LabelledResult], some: dict[str, Any]) -> float:
    """The share of the films without a visible effect that hide a cause: the most probable one given the labels.

    `some` is the regression for visible effects.
    """
    from scipy.optimize import minimize_scalar

    looked = [(label, found["statistics"]) for label, found in cases if found["statistics"] is not None]
    nothing = np.array([1.0 - chance(some, found["case"]) for _, found in looked])
    none = np.array([label["label"] == "none" for label, _ in looked])

    def cost(share: float) -> float:
        p = (1.0 - PRIOR_SHARE) * nothing * (1.0 - share) + PRIOR_SHARE * PRIOR["none"]
        return float(-np.log(np.where(none, p, 1.0 - p)).sum())

    return round(float(minimize_scalar(cost, bounds=(0.0, 0.9), method="bounded").x), 4)


def write_weights(weights: dict[str, Any], path: Path) -> None:
    """Write `weights.json`."""
    write_whole(path, json.dumps(weights, indent=1) + "\n")
