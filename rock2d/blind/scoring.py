"""The score of a trial: the labels are opened and compared with the diagnoses."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from rock2d.blind.case_files import read_labels
from rock2d.blind.running import RESULTS
from rock2d.errors import InputError
from rock2d.files.text_files import read_json
from rock2d.statistics import wilson_interval

if TYPE_CHECKING:
    import pandas as pd

Array = np.ndarray

SIGNAL_TO_NOISE_EDGES = (0.0, 2.0, 5.0, 15.0, 50.0, np.inf)
CLEAR_SIGNAL_TO_NOISE = 5.0  # from which on the data should allow a verdict
CONFIDENT_PROBABILITY = 0.8  # with which no wrong cause should be named
CALIBRATION_BINS = 10  # of equal numbers of cases
LEAST_PROBABILITY = 1e-4  # for the log score


def read_results(folder: Path) -> dict[str, dict[str, Any]]:
    """Results of a trial, case -> JSON; raises `InputError` if there are none."""
    paths = sorted((folder / RESULTS).glob("*.json"))
    if not paths:
        raise InputError("found no results; `rock2d blind run` writes them", folder)
    return {path.stem: read_json(path) for path in paths}


def score_table(folder: Path) -> pd.DataFrame:
    """One row for each case: hidden causes, verdict with its probability, share of the gap closed."""
    import pandas as pd

    labels, rows = read_labels(folder), []
    for name, result in read_results(folder).items():
        try:
            rows.append(_row(name, labels[name], result))
        except (KeyError, IndexError, TypeError, ValueError, AttributeError, ZeroDivisionError):
            path = folder / RESULTS / f"{name}.json"
            raise InputError("expected a result of `rock2d blind run`", path, code="wrong_kind") from None
    return pd.DataFrame(rows)


def _row(name: str, label: Mapping[str, Any], result: Mapping[str, Any]) -> dict[str, Any]:
    """The row of one case."""
    diagnosis = result["diagnosis"]
    p = dict(diagnosis["probabilities"])
    ranked = sorted(p, key=lambda effect: -p[effect])
    truth = set(label["label"].split("+"))
    verdict = ranked[0]
    closures = result.get("closures") or {}
    effect = next(iter(truth)) if len(truth) == 1 else None
    others = [v for k, v in closures.items() if "+" not in k and k not in truth]
    held = result.get("heldout") or {}
    return {
        "case": name, "label": label["label"], "verdict": verdict, "p": p[verdict],
        "right": verdict in truth, "top3": bool(truth & set(ranked[:3])),
        "p_truth": min(sum(p.get(t, 0.0) for t in truth), 1.0), "p_none": p["none"], "p_unknown": p["unknown"],
        "brier": sum((p[k] - (k in truth) / len(truth)) ** 2 for k in p),
        "signal_to_noise": label["signal_to_noise"], "kind": label["kind"], "releases": label["releases"],
        "noise": label["position_noise_m"] / label["block_size_m"], "fps": label["fps"],
        "form": label["hidden"][0]["form"] if label["hidden"] else -1,
        "diagnosed": diagnosis["gap"].get("base") is not None, "seconds": result["seconds"],
        "closure": closures.get(effect, np.nan) if effect else np.nan,
        "runner_up": max(others, default=np.nan), "gap_closure": diagnosis["gap"]["closure"],
        "phase": diagnosis["where"][0]["phase"] if diagnosis["where"] else "",
        "phases": "+".join(label.get("phases", [])),
        "regression_closure": result.get("regression_closure", np.nan),
        "heldout_base": held.get("base", np.nan), "heldout_diagnosed": held.get("diagnosed", np.nan),
    }  # fmt: skip


def summary(cases: pd.DataFrame) -> dict[str, Any]:
    """The numbers of a trial: shares with 95 % Wilson intervals [share, low, high, count]."""
    import pandas as pd

    single = cases[~cases["label"].isin(["none", "unknown"]) & ~cases["label"].str.contains("+", regex=False)]
    pairs = cases[cases["label"].str.contains("+", regex=False)]
    nulls, outside = cases[cases["label"] == "none"], cases[cases["label"] == "unknown"]
    clear = single[single["signal_to_noise"] >= CLEAR_SIGNAL_TO_NOISE]
    known = ~cases["verdict"].isin(["none", "unknown"])
    wrong = cases[~cases["right"] & (cases["p"] > CONFIDENT_PROBABILITY)]
    named = clear[clear["diagnosed"] & (clear["phases"] != "")]
    in_phase = [p in truth.split("+") for p, truth in zip(named["phase"], named["phases"], strict=True)]
    levels = {}
    for low, high in itertools.pairwise(SIGNAL_TO_NOISE_EDGES):
        own = single[(single["signal_to_noise"] >= low) & (single["signal_to_noise"] < high)]
        levels[f"{low:g} to {high:g}"] = {
            "top1": wilson_share(own["right"]),
            "top3": wilson_share(own["top3"]),
        }
    strong = outside[outside["signal_to_noise"] >= CLEAR_SIGNAL_TO_NOISE]
    return {
        "cases": len(cases),
        "top1_clear": wilson_share(clear["right"]),
        "top3_clear": wilson_share(clear["top3"]),
        "by_signal_to_noise": levels,
        "pairs_one_of_both": wilson_share(pairs["right"]),
        "false_attribution_on_nulls": wilson_share(known[nulls.index]),
        "nulls_called_none": wilson_share(nulls["right"]),
        "outside_called_unknown": wilson_share(outside["right"]),
        "outside_clear_called_unknown": wilson_share(strong["right"]),
        "auroc_unknown": auroc(
            cases["p_unknown"].to_numpy(), cases["label"].str.contains("unknown").to_numpy()
        ),
        "wrong_and_sure": wrong[["case", "label", "verdict", "p", "signal_to_noise"]].to_dict("records"),
        "ece": calibration_error(cases["p"].to_numpy(), cases["right"].to_numpy(float)),
        "ece_if_calibrated": chance_error(cases["p"].to_numpy()),
        "log_score": float(np.log(np.maximum(cases["p_truth"], LEAST_PROBABILITY)).mean()),
        "brier": float(cases["brier"].mean()),
        "phase_right_clear": wilson_share(pd.Series(in_phase, dtype=bool)),
        "median_closure_clear": _median(clear["closure"]),
        "median_closure_of_runner_up": _median(clear["runner_up"]),
        "median_closure_of_regression": _median(clear["regression_closure"]),
        "heldout_median_ratio_clear": _median(
            (clear["heldout_diagnosed"] / clear["heldout_base"])[clear["right"]]
        ),
        "median_seconds": _median(cases["seconds"]),
    }


def wilson_share(hits: Sequence[bool] | Array | pd.Series) -> list[float]:
    """Share of the hits with its 95 % Wilson interval: [share, low, high, count]."""
    count, total = int(np.sum(hits)), len(hits)
    if total == 0:
        return [float("nan"), 0.0, 1.0, 0]
    low, high = wilson_interval(count, total)
    return [count / total, float(low), float(high), total]


def share_text(share: Sequence[float]) -> str:
    """A `wilson_share` in words."""
    if share[3] == 0:
        return "no case"
    return f"{100 * share[0]:.1f} % [{100 * share[1]:.1f}, {100 * share[2]:.1f}] of {share[3]}"


def _median(values: pd.Series) -> float:
    return float(np.nanmedian(values)) if values.notna().any() else float("nan")


def auroc(score: Array, positive: Array) -> float:
    """Area under the ROC curve."""
    from sklearn.metrics import roc_auc_score

    return float(roc_auc_score(positive, score)) if 0 < np.sum(positive) < len(positive) else float("nan")


def calibration_error(p: Array, right: Array) -> float:
    """Expected calibration error over bins of equal mass (Naeini et al. 2015)."""
    parts = np.array_split(np.argsort(p, kind="stable"), min(CALIBRATION_BINS, len(p)))
    return float(sum(len(i) * abs(p[i].mean() - right[i].mean()) for i in parts) / len(p))


def chance_error(p: Array, draws: int = 400) -> float:
    """Median calibration error of calibrated forecasts: what chance alone gives with this number of cases."""
    rng = np.random.default_rng(0)
    return float(
        np.median([calibration_error(p, (rng.random(len(p)) < p).astype(float)) for _ in range(draws)])
    )


def confusion(cases: pd.DataFrame) -> pd.DataFrame:
    """Counts, label by verdict, of cases that hide at most one effect."""
    import pandas as pd

    one = cases[~cases["label"].str.contains("+", regex=False)]
    return pd.crosstab(one["label"], one["verdict"])


def confused_pairs(folder: Path, cases: pd.DataFrame) -> list[dict[str, Any]]:
    """Pairs of a hidden effect and a wrong verdict that occurred more than once.

    "cosine" is the likeness of the two effects in these cases (`signal_to_noise.likeness`, median); None where the
    verdict was "none" or "unknown".
    """
    from rock2d.blind.case_files import redraw
    from rock2d.blind.signal_to_noise import likeness

    single = cases[~cases["label"].isin(["none", "unknown"]) & ~cases["label"].str.contains("+", regex=False)]
    out = []
    for (label, verdict), own in single[~single["right"]].groupby(["label", "verdict"]):
        if len(own) > 1:
            alike = None
            if verdict not in ("none", "unknown"):
                alike = float(
                    np.median([likeness(redraw(folder, name), str(verdict)) for name in own["case"]])
                )
            strengths = float(own["signal_to_noise"].median())
            out.append({"label": label, "verdict": verdict, "count": len(own), "cosine": alike,
                        "median_signal_to_noise": strengths})  # fmt: skip
    return sorted(out, key=lambda pair: -pair["count"])
