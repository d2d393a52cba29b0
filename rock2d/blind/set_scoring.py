"""The score of named sets: how often each effect is in the named set and in truth, and what else is said of the gap.

The named set of a case holds the effects that the diagnosis names. A named effect is right if it, or an effect that it
shares its name with, is hidden, whatever its strength. Results without "causes" (of older versions) are left out.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from rock2d.blind.case_files import read_labels
from rock2d.blind.running import RESULTS
from rock2d.blind.scoring import (
    CLEAR_SIGNAL_TO_NOISE,
    SIGNAL_TO_NOISE_EDGES,
    auroc,
    calibration_error,
    chance_error,
    read_results,
    wilson_share,
)
from rock2d.blind.size_errors import SizeError, size_errors, size_summary
from rock2d.effects import catalogue
from rock2d.errors import InputError

CLAIMED_PROBABILITY = 0.5  # from which on an outside cause is claimed
SURE_PROBABILITY = 0.9  # with which no wrong effect should be named
# own signal-to-noise of a hidden effect: below the first it counts as absent, from the second on as present, between
# them as undecidable
ABSENT_SIGNAL_TO_NOISE, PRESENT_SIGNAL_TO_NOISE = 0.5, 2.0
CLOSURE_MARGIN = 0.15  # share of the gap by which a claimed closure may miss the true one
RELEASE_GROUPS = {"below 30": (0, 30), "30 to 80": (30, 81), "above 80": (81, np.inf)}
COUNT_GROUPS = {"1": (1, 2), "2 to 4": (2, 5)}  # hidden effects of the catalogue
LABEL_KINDS = ("nothing", "one effect", "2 to 4 effects", "outside cause")


@dataclass(frozen=True)
class SetCase:
    """A case with what it hides and what the diagnosis says.

    Attributes
    ----------
    hidden : effects of the catalogue -> own signal-to-noise
    outside : own signal-to-noise of the cause from outside the catalogue; None without one
    p : inclusion probabilities of the listed effects, most probable first
    names : each named effect with those that it shares its name with
    claimed, true : share of the gap closed, as the diagnosis says and in truth; None if unknown
    sizes : of named effects that are hidden, where they can be compared
    """

    name: str
    hidden: Mapping[str, float]
    outside: float | None
    p: Mapping[str, float]
    names: Sequence[frozenset[str]]
    p_outside: float
    releases: int
    claimed: float | None
    true: float | None
    sizes: Sequence[SizeError] = ()

    @property
    def kind(self) -> str:
        """One of LABEL_KINDS."""
        if self.outside is not None:
            return "outside cause"
        return LABEL_KINDS[min(len(self.hidden), 2)]


def set_cases(folder: Path) -> list[SetCase]:
    """The cases of a trial whose results name sets; raises `InputError`."""
    labels, found = read_labels(folder), []
    for name, result in read_results(folder).items():
        try:
            if "causes" in result["diagnosis"]:
                found.append(set_case(name, labels[name], result))
        except (KeyError, TypeError, ValueError, AttributeError):
            path = folder / RESULTS / f"{name}.json"
            raise InputError("expected a result of `rock2d blind run`", path, code="wrong_kind") from None
    return found


def set_case(name: str, label: Mapping[str, Any], result: Mapping[str, Any]) -> SetCase:
    """A case from its label and its result. Of a film that was refused, nothing is named, and what is "unknown" counts
    as the probability of an outside cause."""
    diagnosis = result["diagnosis"]
    outside_p = (diagnosis["outside"] or {"p": diagnosis["probabilities"]["unknown"]})["p"]
    strengths = {str(h["name"]): float(h["signal_to_noise"]) for h in label["hidden"]}
    hidden = {effect: z for effect, z in strengths.items() if effect in catalogue()}
    outside = [z for cause, z in strengths.items() if cause not in hidden]
    p = {str(cause["effect"]): float(cause["p"]) for cause in diagnosis["causes"]}
    names = [frozenset([own["effect"], *own["group"]]) for own in diagnosis["causes"] if own["named"]]
    claimed, true = diagnosis["gap"]["closure"], result.get("true_closure")
    return SetCase(
        name, hidden, max(outside, default=None), dict(sorted(p.items(), key=lambda item: -item[1])), names,
        float(outside_p), int(label["releases"]), _number(claimed), _number(true),
        size_errors(label, diagnosis["causes"]),
    )  # fmt: skip


def _number(value: Any) -> float | None:
    return float(value) if value is not None and np.isfinite(float(value)) else None


def set_summary(cases: Sequence[SetCase]) -> dict[str, Any]:
    """The numbers of the named sets: shares with 95 % Wilson intervals [share, low, high, count]."""
    return {
        "cases": len(cases),
        "inclusion": inclusion(cases),
        "recall": {
            beside: {
                count: _by_strength(_found([c for c in own if low <= len(c.hidden) < high]))
                for count, (low, high) in COUNT_GROUPS.items()
            }
            for beside, own in _by_outside(cases).items()
        },
        "first_right_single": _by_strength(
            [
                (z, next(iter(c.p), None) == effect)
                for c in cases
                if c.kind == "one effect"
                for effect, z in c.hidden.items()
            ]
        ),
        "precision": {"all": _precision(cases)}
        | {beside: _precision(own) for beside, own in _by_outside(cases).items()},
        "nulls_with_a_cause_named": _nulls_named(cases),
        "by_releases": {
            name: _of_releases([c for c in cases if low <= c.releases < high])
            for name, (low, high) in RELEASE_GROUPS.items()
        },
        "outside": _outside(cases),
        "wrong_and_sure": _wrong_and_sure(cases),
        "closure": closures(cases),
        "sizes": size_summary(error for case in cases for error in case.sizes),
    }


def inclusion_pairs(cases: Iterable[SetCase]) -> list[tuple[str, float, bool]]:
    """(effect, probability, whether present) of every case and effect of the catalogue, without the undecidable."""
    pairs = []
    for case in cases:
        for effect in catalogue():
            z = case.hidden.get(effect, 0.0)
            if not ABSENT_SIGNAL_TO_NOISE <= z < PRESENT_SIGNAL_TO_NOISE:
                pairs.append((effect, case.p.get(effect, 0.0), z >= PRESENT_SIGNAL_TO_NOISE))
    return pairs


def inclusion(cases: Sequence[SetCase]) -> dict[str, Any]:
    """How good the inclusion probabilities are, over all cases and effects, and for each effect."""
    pairs = inclusion_pairs(cases)
    effects = {name: [pair for pair in pairs if pair[0] == name] for name in catalogue()}
    undecidable = len(cases) * len(catalogue()) - len(pairs)
    return (
        _calibration(pairs)
        | {"undecidable": undecidable}
        | {"by_effect": {name: _calibration(own) for name, own in effects.items() if own}}
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


def _by_outside(cases: Iterable[SetCase]) -> dict[str, list[SetCase]]:
    cases = list(cases)
    return {
        "without_outside": [c for c in cases if c.outside is None],
        "with_outside": [c for c in cases if c.outside is not None],
    }


def _found(cases: Iterable[SetCase]) -> list[tuple[float, bool]]:
    """(own signal-to-noise, whether named) of every hidden effect."""
    return [
        (z, any(effect in own for own in case.names)) for case in cases for effect, z in case.hidden.items()
    ]


def _by_strength(found: Sequence[tuple[float, bool]]) -> dict[str, list[float]]:
    return {
        f"{low:g} to {high:g}": wilson_share([hit for z, hit in found if low <= z < high])
        for low, high in itertools.pairwise(SIGNAL_TO_NOISE_EDGES)
    }


def _precision(cases: Iterable[SetCase]) -> list[float]:
    return wilson_share([bool(own & case.hidden.keys()) for case in cases for own in case.names])


def _nulls_named(cases: Iterable[SetCase]) -> list[float]:
    return wilson_share([bool(case.names) for case in cases if case.kind == "nothing"])


def _of_releases(cases: Sequence[SetCase]) -> dict[str, list[float]]:
    present = [hit for z, hit in _found(cases) if z >= PRESENT_SIGNAL_TO_NOISE]
    return {
        "recall": wilson_share(present),
        "precision": _precision(cases),
        "nulls_with_a_cause_named": _nulls_named(cases),
    }


def _outside(cases: Iterable[SetCase]) -> dict[str, Any]:
    """Clear outside causes against cases without one; weaker ones are left out."""
    groups = _by_outside(cases)
    clear = [c for c in groups["with_outside"] if (c.outside or 0.0) >= CLEAR_SIGNAL_TO_NOISE]
    compared = [*clear, *groups["without_outside"]]

    def claimed(own: Iterable[SetCase]) -> list[float]:
        return wilson_share([c.p_outside >= CLAIMED_PROBABILITY for c in own])

    return {
        "auroc": auroc(
            np.array([c.p_outside for c in compared]), np.array([c.outside is not None for c in compared])
        ),
        "recall_clear": claimed(clear),
        "false_alarms": claimed(groups["without_outside"]),
    }


def _wrong_and_sure(cases: Iterable[SetCase]) -> list[dict[str, Any]]:
    return [
        {"case": c.name, "effect": effect, "p": p, "hidden": dict(c.hidden), "outside": c.outside}
        for c in cases
        for effect, p in c.p.items()
        if p > SURE_PROBABILITY and effect not in c.hidden
    ]


def known_closures(cases: Iterable[SetCase]) -> list[tuple[str, float, float]]:
    """(kind of label, claimed, true) of the cases in which both are known."""
    return [(c.kind, c.claimed, c.true) for c in cases if c.claimed is not None and c.true is not None]


def closures(cases: Iterable[SetCase]) -> dict[str, Any]:
    """Claimed less true closure: of all cases, and of each kind of label."""
    known = known_closures(cases)
    groups = {"all": known} | {kind: [own for own in known if own[0] == kind] for kind in LABEL_KINDS}
    out = {}
    for name, own in groups.items():
        off = np.array([claimed - true for _, claimed, true in own])
        out[name] = {
            "median_claimed_less_true": float(np.median(off)) if len(off) else float("nan"),
            "within_15_points": wilson_share(np.abs(off) <= CLOSURE_MARGIN),
        }
    return out
