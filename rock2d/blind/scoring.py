"""The score of a trial: the labels are opened and compared with the effects that the diagnoses name.

A named effect is right if it, or an effect that it shares its name with, is hidden, whatever its strength. Effects that
the original record of a case contains count neither as right nor as wrong."""

import itertools
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from rock2d.arrays import Array
from rock2d.blind.case_files import read_labels
from rock2d.blind.size_errors import SizeError, median, size_errors, size_summary
from rock2d.blind.trial_diagnoses import RESULTS
from rock2d.diagnosis.predicted_gap import HARMFUL_TAIL, closed_share
from rock2d.effects import catalogue
from rock2d.errors import InputError
from rock2d.files.text_files import read_json
from rock2d.statistics import wilson_share

SIGNAL_TO_NOISE_EDGES = (0.0, 2.0, 5.0, 15.0, 50.0, np.inf)
CLEAR_SIGNAL_TO_NOISE = 5.0  # from which on the data should allow to name the cause
CALIBRATION_BINS = 10  # bins with equal numbers of cases
CHANCE_DRAWS = 400  # drawn outcomes of calibrated forecasts
CLAIMED_PROBABILITY = 0.5  # from which on an outside cause is claimed
SURE_PROBABILITY = 0.9  # wrong effects with a larger probability are listed
# own signal-to-noise of a hidden effect: below the first it counts as absent, from the second on as present, between
# them as undecidable
ABSENT_SIGNAL_TO_NOISE, PRESENT_SIGNAL_TO_NOISE = 0.5, 2.0
CLOSURE_MARGIN = 0.15  # largest accepted error of a claimed closure, as a share of the gap
RELEASE_GROUPS = {"below 30": (0, 30), "30 to 80": (30, 81), "above 80": (81, np.inf)}
COUNT_GROUPS = {"1": (1, 2), "2 to 4": (2, 5)}  # hidden effects of the catalogue
LABEL_KINDS = ("nothing", "one effect", "2 to 4 effects", "outside cause")
MISS_KEYS = {"base", "base_tail", "diagnosed", "diagnosed_tail", "floor"}  # misses of predictions that are compared
MADE = "made"  # base of a case of the reality engine


@dataclass(frozen=True)
class ScoredCase:
    """A case with its hidden causes and the result of the diagnosis.

    Attributes
    ----------
    label : the hidden effects, and "unknown" for a cause outside the catalogue, joined by "+"; or "none"
    hidden : effects of the catalogue -> own signal-to-noise
    outside : own signal-to-noise of the cause from outside the catalogue; None without one
    strength : signal-to-noise of all hidden causes together
    verdict, p_verdict : the single answer, and its probability
    p : inclusion probabilities of the listed effects, most probable first
    names : each named effect with the effects that it shares its name with
    claimed, true : share of the gap closed, by the diagnosis and in truth; None if unknown. The truth is at most 1: the
        null twin may have a larger floor than the film
    claimed_predicted, found_predicted : share of the gap of predictions closed, by the diagnosis and in the held-out
        film; None if unknown
    misses : misses of predictions of the held-out film, see `trial_diagnoses`; empty without those of the tail
    sizes : errors of the sizes of named effects that are hidden, if they can be compared
    base : name of the real record on which the case is based, or MADE
    of_record : effects that the original record contains"""

    name: str
    label: str
    hidden: Mapping[str, float]
    outside: float | None
    strength: float
    verdict: str
    p_verdict: float
    p: Mapping[str, float]
    names: Sequence[frozenset[str]]
    p_outside: float
    releases: int
    seconds: float
    claimed: float | None
    true: float | None
    claimed_predicted: float | None = None
    found_predicted: float | None = None
    misses: Mapping[str, float] = field(default_factory=dict)
    sizes: Sequence[SizeError] = ()
    base: str = MADE
    of_record: frozenset[str] = frozenset()

    @property
    def kind(self) -> str:
        """One of LABEL_KINDS."""
        if self.outside is not None:
            return "outside cause"
        return LABEL_KINDS[min(len(self.hidden), 2)]

    @property
    def right(self) -> bool | None:
        """Whether the verdict is right; None if it is an effect of the original record."""
        hit = self.verdict in self.label.split("+")
        return None if not hit and self.verdict in self.of_record else hit

    @property
    def most_probable(self) -> str | None:
        """The most probable effect, without those of the original record."""
        return next((effect for effect in self.p if effect not in self.of_record - self.hidden.keys()), None)

    @property
    def scored_names(self) -> list[frozenset[str]]:
        """The names, without those of effects of the original record."""
        return [own for own in self.names if own & self.hidden.keys() or not own & self.of_record]


def scored_cases(folder: Path) -> list[ScoredCase]:
    """The cases of a trial that have a result; raises `InputError` if there are none."""
    paths = sorted((folder / RESULTS).glob("*.json"))
    labels, cases = read_labels(folder), []
    if not paths:
        raise InputError("found no results; `rock2d blind run` writes them", folder)
    for path in paths:
        try:
            cases.append(scored_case(path.stem, labels[path.stem], read_json(path)))
        except (KeyError, TypeError, ValueError, AttributeError):
            raise InputError("expected a result of `rock2d blind run`", path, code="wrong_kind") from None
    return cases


def scored_case(name: str, label: Mapping[str, Any], result: Mapping[str, Any]) -> ScoredCase:
    """A case from its label and its result. For a film that was refused, no effect is named, and the probability of
    "unknown" counts as that of an outside cause."""
    diagnosis = result["diagnosis"]
    single = {str(effect): float(p) for effect, p in diagnosis["probabilities"].items()}
    verdict = max(single, key=lambda effect: single[effect])
    outside_p = (diagnosis["outside"] or {"p": single["unknown"]})["p"]
    strengths = {str(h["name"]): float(h["signal_to_noise"]) for h in label["hidden"]}
    hidden = {effect: z for effect, z in strengths.items() if effect in catalogue()}
    outside = [z for cause, z in strengths.items() if cause not in hidden]
    p = {str(cause["effect"]): float(cause["p"]) for cause in diagnosis["causes"]}
    names = [frozenset([own["effect"], *own["group"]]) for own in diagnosis["causes"] if own["named"]]
    misses = {str(key): float(miss) for key, miss in (result.get("heldout") or {}).items()}
    misses = misses if misses.keys() >= MISS_KEYS else {}
    typical = (diagnosis.get("predicted") or {}).get("typical") if misses else None
    claimed, found = (None, None) if typical is None else (_number(typical["closure"]), found_closure(misses))
    true = _number(result.get("true_closure"))
    return ScoredCase(
        name, str(label["label"]), hidden, max(outside, default=None), float(label["signal_to_noise"]), verdict,
        single[verdict], dict(sorted(p.items(), key=lambda item: -item[1])), names, float(outside_p),
        int(label["releases"]), float(result["seconds"]), _number(diagnosis["gap"]["closure"]),
        None if true is None else min(true, 1.0), claimed, found, misses, size_errors(label, diagnosis["causes"]),
        str(label.get("base", MADE)), frozenset(label.get("of_record", ())),
    )  # fmt: skip


def _number(value: Any) -> float | None:
    return float(value) if value is not None and np.isfinite(float(value)) else None


def case_table(cases: Iterable[ScoredCase]) -> pd.DataFrame:
    """One row for each case: hidden causes, named effects, the single verdict, and misses of predictions."""
    return pd.DataFrame([
        {
            "case": c.name, "base": c.base, "label": c.label, "signal_to_noise": c.strength, "releases": c.releases,
            "named": "+".join("|".join(sorted(own)) for own in c.names), "p_outside": c.p_outside,
            "verdict": c.verdict, "p": c.p_verdict, "right": c.right,
            "claimed": c.claimed, "true": c.true, "claimed_predicted": c.claimed_predicted,
            "found_predicted": c.found_predicted, **{f"heldout_{key}": miss for key, miss in c.misses.items()},
            "seconds": c.seconds,
        }
        for c in cases
    ])  # fmt: skip


def summary(cases: Sequence[ScoredCase]) -> dict[str, Any]:
    """The numbers of a trial: shares with 95 % Wilson intervals [share, low, high, count]."""
    bases = sorted({c.base for c in cases})
    by_base = {base: _main_numbers([c for c in cases if c.base == base]) for base in bases}
    return {
        "cases": len(cases),
        **_main_numbers(cases),
        **({"by_base": by_base} if set(bases) - {MADE} else {}),
        "verdict": _verdicts(cases),
        "inclusion": inclusion(cases),
        "by_releases": {
            name: _release_group_shares([c for c in cases if low <= c.releases < high])
            for name, (low, high) in RELEASE_GROUPS.items()
        },
        "outside": _outside(cases),
        "wrong_and_sure": _wrong_and_sure(cases),
        "closure": closures(cases),
        "predicted": prediction_scores(cases),
        "median_seconds": float(np.median([c.seconds for c in cases])),
    }


def _main_numbers(cases: Sequence[ScoredCase]) -> dict[str, Any]:
    return {
        "recall": {
            name: {
                count: _by_strength(_named_hidden([c for c in group if low <= len(c.hidden) < high]))
                for count, (low, high) in COUNT_GROUPS.items()
            }
            for name, group in _by_outside(cases).items()
        },
        "first_right_single": _by_strength(
            [(z, c.most_probable == effect) for c in cases if c.kind == "one effect" for effect, z in c.hidden.items()]
        ),
        "precision": {"all": _precision(cases)}
        | {name: _precision(group) for name, group in _by_outside(cases).items()},
        "nulls_with_a_cause_named": _nulls_named(cases),
        "sizes": size_summary(error for case in cases for error in case.sizes),
    }


def _verdicts(cases: Sequence[ScoredCase]) -> dict[str, list[float]]:
    """Share of the single answers that are right, without answers that are an effect of the original record."""
    groups = {
        "one_clear_effect": [c for c in cases if c.kind == "one effect" and c.strength >= CLEAR_SIGNAL_TO_NOISE],
        "nothing": [c for c in cases if c.kind == "nothing"],
        "outside_cause_alone": [c for c in cases if c.kind == "outside cause" and not c.hidden],
    }
    return {name: wilson_share([c.right for c in group if c.right is not None]) for name, group in groups.items()}


def inclusion_pairs(cases: Iterable[ScoredCase]) -> list[tuple[str, float, bool]]:
    """(effect, probability, whether present) of every case and effect of the catalogue, without the undecidable."""
    pairs = []
    for case in cases:
        for effect in sorted(catalogue().keys() - (case.of_record - case.hidden.keys())):
            z = case.hidden.get(effect, 0.0)
            if not ABSENT_SIGNAL_TO_NOISE <= z < PRESENT_SIGNAL_TO_NOISE:
                pairs.append((effect, case.p.get(effect, 0.0), z >= PRESENT_SIGNAL_TO_NOISE))
    return pairs


def inclusion(cases: Sequence[ScoredCase]) -> dict[str, Any]:
    """Calibration of the inclusion probabilities, over all cases and effects, and for each effect."""
    pairs = inclusion_pairs(cases)
    effects = {name: [pair for pair in pairs if pair[0] == name] for name in catalogue()}
    undecidable = len(cases) * len(catalogue()) - len(pairs) - sum(len(c.of_record - c.hidden.keys()) for c in cases)
    return (
        _calibration(pairs)
        | {"undecidable": undecidable}
        | {"by_effect": {name: _calibration(of_effect) for name, of_effect in effects.items() if of_effect}}
    )


def _calibration(pairs: Sequence[tuple[str, float, bool]]) -> dict[str, Any]:
    p, present = np.array([pair[1] for pair in pairs]), np.array([pair[2] for pair in pairs], float)
    return {
        "pairs": len(pairs),
        "present": int(present.sum()),
        "auroc": auroc(p, present),
        "brier": float(np.mean((p - present) ** 2)),
        "ece": calibration_error(p, present),
        "ece_if_calibrated": chance_error(p),
    }


def _by_outside(cases: Iterable[ScoredCase]) -> dict[str, list[ScoredCase]]:
    cases = list(cases)
    return {
        "without_outside": [c for c in cases if c.outside is None],
        "with_outside": [c for c in cases if c.outside is not None],
    }


def _named_hidden(cases: Iterable[ScoredCase]) -> list[tuple[float, bool]]:
    """(own signal-to-noise, whether named) of every hidden effect."""
    return [(z, any(effect in own for own in case.names)) for case in cases for effect, z in case.hidden.items()]


def _by_strength(found: Sequence[tuple[float, bool]]) -> dict[str, list[float]]:
    return {
        f"{low:g} to {high:g}": wilson_share([hit for z, hit in found if low <= z < high])
        for low, high in itertools.pairwise(SIGNAL_TO_NOISE_EDGES)
    }


def _precision(cases: Iterable[ScoredCase]) -> list[float]:
    return wilson_share([bool(own & case.hidden.keys()) for case in cases for own in case.scored_names])


def _nulls_named(cases: Iterable[ScoredCase]) -> list[float]:
    return wilson_share([bool(case.scored_names) for case in cases if case.kind == "nothing"])


def _release_group_shares(cases: Sequence[ScoredCase]) -> dict[str, list[float]]:
    present = [hit for z, hit in _named_hidden(cases) if z >= PRESENT_SIGNAL_TO_NOISE]
    return {
        "recall": wilson_share(present),
        "precision": _precision(cases),
        "nulls_with_a_cause_named": _nulls_named(cases),
    }


def _outside(cases: Iterable[ScoredCase]) -> dict[str, Any]:
    """Cases with a clear outside cause compared with cases without one; weaker outside causes are left out."""
    groups = _by_outside(cases)
    clear = [c for c in groups["with_outside"] if (c.outside or 0.0) >= CLEAR_SIGNAL_TO_NOISE]
    compared = [*clear, *groups["without_outside"]]

    def claimed(group: Iterable[ScoredCase]) -> list[float]:
        return wilson_share([c.p_outside >= CLAIMED_PROBABILITY for c in group])

    return {
        "auroc": auroc(np.array([c.p_outside for c in compared]), np.array([c.outside is not None for c in compared])),
        "recall_clear": claimed(clear),
        "false_alarms": claimed(groups["without_outside"]),
    }


def _wrong_and_sure(cases: Iterable[ScoredCase]) -> list[dict[str, Any]]:
    return [
        {"case": c.name, "effect": effect, "p": p, "hidden": dict(c.hidden), "outside": c.outside}
        for c in cases
        for effect, p in c.p.items()
        if p > SURE_PROBABILITY and effect not in c.hidden and effect not in c.of_record
    ]


def _by_kind(cases: Iterable[ScoredCase]) -> dict[str, list[ScoredCase]]:
    cases = list(cases)
    return {"all": cases} | {kind: [c for c in cases if c.kind == kind] for kind in LABEL_KINDS}


def found_closure(misses: Mapping[str, float]) -> float:
    """Share of the gap of predictions that is closed in a held-out film."""
    return float(closed_share(*np.array([misses[key] for key in ("base", "diagnosed", "floor")])))


def known_closures(cases: Iterable[ScoredCase]) -> list[tuple[str, float, float]]:
    """(kind of label, claimed, true) of the cases in which both are known."""
    return [(c.kind, c.claimed, c.true) for c in cases if c.claimed is not None and c.true is not None]


def closures(cases: Iterable[ScoredCase]) -> dict[str, Any]:
    """Claimed minus true closure of the gap, for all cases and for each kind of label."""
    return {
        name: _closure_errors((claimed, true) for _, claimed, true in known_closures(group))
        for name, group in _by_kind(cases).items()
    }


def _closure_errors(pairs: Iterable[tuple[float, float]]) -> dict[str, Any]:
    """How far claimed closures are from found ones."""
    errors = [claimed - found for claimed, found in pairs]
    return {
        "median_claimed_less_true": median(errors),
        "within_15_points": wilson_share([abs(error) <= CLOSURE_MARGIN for error in errors]),
        "claimed_too_much": wilson_share([error > CLOSURE_MARGIN for error in errors]),
    }


def prediction_scores(cases: Sequence[ScoredCase]) -> dict[str, Any]:
    """Predictions of held-out films compared with the base law, for all cases and for each kind of label: median
    relative reduction of the typical miss, share of the cases in which the tail is not worse, share of those in which
    the diagnosis states a closure, and claimed minus found closure."""
    out = {}
    for name, group in _by_kind(cases).items():
        known = [c.misses for c in group if c.misses]
        out[name] = {
            "median_smaller": median([1.0 - m["diagnosed"] / m["base"] for m in known]),
            "tail_not_worse": wilson_share([m["diagnosed_tail"] <= HARMFUL_TAIL * m["base_tail"] for m in known]),
            "stated": wilson_share([c.claimed_predicted is not None for c in group if c.found_predicted is not None]),
            **_closure_errors(
                (c.claimed_predicted, c.found_predicted)
                for c in group
                if c.claimed_predicted is not None and c.found_predicted is not None
            ),
        }
    return out


def auroc(score: Array, positive: Array) -> float:
    """Area under the ROC curve."""
    from sklearn.metrics import roc_auc_score

    return float(roc_auc_score(positive, score)) if 0 < np.sum(positive) < len(positive) else float("nan")


def calibration_error(p: Array, right: Array) -> float:
    """Expected calibration error over bins of equal mass (Naeini et al. 2015)."""
    parts = np.array_split(np.argsort(p, kind="stable"), min(CALIBRATION_BINS, len(p)))
    return float(sum(len(i) * abs(p[i].mean() - right[i].mean()) for i in parts) / len(p))


def chance_error(p: Array) -> float:
    """Median calibration error of calibrated forecasts with this number of cases, which is due to chance."""
    rng = np.random.default_rng(0)
    return float(np.median([calibration_error(p, (rng.random(len(p)) < p).astype(float)) for _ in range(CHANCE_DRAWS)]))
