"""The weights behind the probabilities: logistic regressions on trials whose labels are known."""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from rock2d.blind.scoring import read_results
from rock2d.blind.writing import read_labels
from rock2d.diagnosis.weighing import ANY, KNOWN, WHICH
from rock2d.folders import write_whole

Array = np.ndarray

FEATURES = {
    ANY: ("gain_z", "gain_log", "gain_total_log", "segments_log", "gap_log", "gap_sigma", "scatter", "final_log"),
    KNOWN: ("left_share", "left_sigma", "left_log", "closed_share", "gain_z", "final_log", "chain", "scatter",
            "gain_log", "second_z"),
    WHICH: ("behind_z", "behind_share", "behind_log", "scatter"),
}  # fmt: skip
STRENGTH = 1.0  # of the regularisation, inverse
SEEN = 2.0  # signal-to-noise below which a hidden effect leaves nothing to see: it is none


def examples(folders: Iterable[Path]) -> dict[str, tuple[list[dict[str, float]], list[bool]]]:
    """Question -> (statistics, answers) from trials that were run; see `running.run_trial` for `without_best`."""
    out: dict[str, tuple[list[dict[str, float]], list[bool]]] = {q: ([], []) for q in FEATURES}

    def add(question: str, values: dict[str, float], answer: bool) -> None:
        out[question][0].append(values)
        out[question][1].append(answer)

    for folder in folders:
        labels = read_labels(folder)
        for name, result in read_results(folder).items():
            found, label = result["statistics"], labels[name]["label"]
            if found is None:
                continue
            truth = set(label.split("+"))
            some = label != "none" and labels[name]["signal_to_noise"] >= SEEN
            add(ANY, found["case"], some)
            if not some:
                continue
            add(KNOWN, found["case"], label != "unknown")
            if label == "unknown":
                continue
            for effect, values in found["effects"].items():
                add(WHICH, values, effect in truth)
            without = result["without_best"]
            if without is not None and len(truth) == 1 and not truth & set(without["effects"]):
                add(ANY, without["case"], True)
                add(KNOWN, without["case"], False)
    return out


def regression(
    features: Sequence[str], values: list[dict[str, float]], answers: list[bool]
) -> dict[str, Any]:
    """A logistic regression as plain numbers."""
    from sklearn.linear_model import LogisticRegression

    x = np.array([[v[name] for name in features] for v in values])
    mean, scale = x.mean(axis=0), np.maximum(x.std(axis=0), 1e-6)
    model = LogisticRegression(C=STRENGTH, max_iter=1000).fit((x - mean) / scale, np.array(answers))
    return {
        "features": list(features),
        "mean": mean.round(6).tolist(),
        "scale": scale.round(6).tolist(),
        "coefficients": model.coef_[0].round(6).tolist(),
        "intercept": round(float(model.intercept_[0]), 6),
        "examples": len(answers),
    }


def train(folders: Iterable[Path]) -> dict[str, Any]:
    """Weights from trials whose labels may be read."""
    found = examples(folders)
    return {question: regression(FEATURES[question], *found[question]) for question in FEATURES}


def write_weights(weights: dict[str, Any], path: Path) -> None:
    """Write `weights.json`."""
    write_whole(path, json.dumps(weights, indent=1) + "\n")
