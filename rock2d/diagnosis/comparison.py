"""Two diagnoses side by side: what they agree on, where they differ, and what of them can be compared at all."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from math import hypot
from typing import Any

from rock2d.diagnosis.model import BASE_NAMES
from rock2d.files.diagnosis import KNOWN_SCHEMAS
from rock2d.files.diagnosis_keys import DiagnosisFile
from rock2d.files.fitted_keys import FittedParameter

FEWEST_PROBABILITY = 0.05  # probability from which on the parameters of an effect are of interest
AGREEMENT = 1.0  # largest difference over the half width of its 95 % interval
PLACE_KEYS = ("phase", "zone", "block", "channel")


def agree(a: FittedParameter, b: FittedParameter) -> bool | None:
    """Whether two values differ by no more than their 95 % intervals allow; None where no interval is stated.

    The sides of the intervals that face each other are added as independent errors.
    """
    if a.value == b.value:
        return True
    sides = [abs(own.ci95[own.value < other.value] - own.value) for own, other in ((a, b), (b, a))]
    half = hypot(sides[0], sides[1])
    return abs(a.value - b.value) <= AGREEMENT * half if half > 0 else None


def comparison(a: DiagnosisFile, b: DiagnosisFile) -> dict[str, Any]:
    """The content of comparison.json; A and B are told apart by the keys "a" and "b"."""
    both = {"a": a, "b": b}

    def each(value: Callable[[DiagnosisFile], Any]) -> dict[str, Any]:
        return {key: value(own) for key, own in both.items()}

    return {
        "schema": 1,
        "diagnosis_schema": each(lambda d: d.schema_),
        "experiment": each(lambda d: d.experiment),
        "diagnosed": each(diagnosed),
        "notes": notes(a, b),
        "verdict": {**each(lambda d: d.verdict), "same": a.verdict == b.verdict},
        "group": {**each(lambda d: d.group), "common": [name for name in a.group if name in b.group]},
        "beside": each(lambda d: [found.effect for found in d.beside]),
        "probabilities": _probabilities(a, b),
        "parameters": _parameters(a, b),
        "base": _paired(BASE_NAMES, _law(a), _law(b)),
        "gap": each(lambda d: d.gap.model_dump()),
        "closures": _closures(a, b),
        "where": _places(a, b),
        "next_release": each(lambda d: d.next_release),
    }  # fmt: skip


def _law(own: DiagnosisFile) -> dict[str, float]:
    return own.fitted_law.model_dump() if own.fitted_law is not None else {}


def diagnosed(own: DiagnosisFile) -> bool:
    """Whether effects were tried: its film passed the sanity checks."""
    return not own.sanity.faults and own.gap.base is not None


def notes(a: DiagnosisFile, b: DiagnosisFile) -> list[str]:
    """What can be compared and what cannot, in sentences."""
    said = []
    for name, own in (("A", a), ("B", b)):
        if not diagnosed(own):
            reason = f" ({'; '.join(own.sanity.faults)})" if own.sanity.faults else ""
            said.append(
                f"{name} could not be diagnosed{reason}. Its probabilities rest on no fit: compare nothing with them."
            )
    if a.experiment == b.experiment:
        said.append(
            "Both state the same name of the experiment. The files do not say whether they are of the same film: if "
            "they are not, read them as different experiments."
        )
    else:
        said.append(
            "The experiments differ. Verdicts, probabilities and shares can be compared: each says what its own "
            "film shows. Parameters need not agree: those of the camera belong to a set-up, those of the soil to "
            "its state. Base, augmented and noise floor cannot be compared: each is in units of its own noise and "
            "scatter."
        )
    if a.schema_ != b.schema_:
        said.append(
            f"The files have different schemas, {a.schema_} and {b.schema_}. Only what both have is compared; "
            "causes, what lies outside the catalogue and the kinds of noise floor are left out."
        )
    newer = [own.schema_ for own in (a, b) if own.schema_ not in KNOWN_SCHEMAS]
    if newer:
        said.append(
            f"Schema {max(newer)} is newer than this rock2d. Keys that it does not know are left out."
        )
    if a.beside or b.beside:
        said.append(
            "Where effects were found beside the verdict, the parameters compared here are still those of each "
            "effect alone."
        )
    if a.gap.unit != b.gap.unit:
        said.append("The gaps have different units: compare only the share closed.")
    said += _one_sided("effects", a.probabilities, b.probabilities, "were not in the catalogue of the other")
    for key in ("zone", "block"):
        in_a, in_b = ({getattr(place, key) for place in own.where} for own in (a, b))
        if in_a and in_b:
            said += _one_sided(
                f"{key}s", in_a, in_b, "have no share of the gap in the other, or are not there"
            )
    return said


def _one_sided(what: str, a: Iterable[str], b: Iterable[str], why: str) -> list[str]:
    parts = [
        (f"{side}: {', '.join(sorted(only))}")
        for side, only in (("A", {*a} - {*b}), ("B", {*b} - {*a}))
        if only
    ]
    return [f"Some {what} {why}. Only in {'; only in '.join(parts)}."] if parts else []


def _paired(names: Iterable[str], a: Mapping[str, Any], b: Mapping[str, Any]) -> list[dict[str, Any]]:
    """A quantity of A and of B in each row; None where a diagnosis does not have it."""
    return [{"name": name, "a": a.get(name), "b": b.get(name)} for name in names]


def _probabilities(a: DiagnosisFile, b: DiagnosisFile) -> list[dict[str, Any]]:
    """Probability of every answer, that with the largest one in either diagnosis first."""
    names = list(dict.fromkeys([*a.probabilities, *b.probabilities]))
    pairs = _paired(names, a.probabilities, b.probabilities)
    return sorted(pairs, key=lambda pair: -max(pair["a"] or 0.0, pair["b"] or 0.0))


def _of_interest(own: DiagnosisFile) -> set[str]:
    likely = {name for name, p in own.probabilities.items() if p >= FEWEST_PROBABILITY}
    return {own.verdict, *own.group, *likely, *(found.effect for found in own.beside)}


def _parameters(a: DiagnosisFile, b: DiagnosisFile) -> list[dict[str, Any]]:
    """Parameters of every effect that was tried in both or in one; those of interest first."""
    ranks = {pair["name"]: i for i, pair in enumerate(_probabilities(a, b))}
    wanted = _of_interest(a) | _of_interest(b)
    names = sorted({*a.effects, *b.effects}, key=lambda n: (n not in wanted, ranks.get(n, len(ranks)), n))
    rows = []
    for name in names:
        own = [d.effects[name].parameters if name in d.effects else {} for d in (a, b)]
        for key in dict.fromkeys([*own[0], *own[1]]):
            first, second = (side.get(key) for side in own)
            comparable = first is not None and second is not None and first.unit == second.unit
            rows.append({
                "effect": name, "parameter": key, "of_interest": name in wanted,
                "a": _value(first), "b": _value(second),
                "agree": agree(first, second) if first and second and comparable else None,
            })  # fmt: skip
    return rows


def _value(own: FittedParameter | None) -> dict[str, Any] | None:
    return own.model_dump(include={"value", "ci95", "unit"}) if own else None


def _closures(a: DiagnosisFile, b: DiagnosisFile) -> list[dict[str, Any]]:
    """Share of the gap that each effect closes alone, in the order of the probabilities."""
    names = [pair["name"] for pair in _probabilities(a, b) if pair["name"] in {*a.effects, *b.effects}]

    def closed(own: DiagnosisFile, name: str) -> dict[str, Any] | None:
        tried = own.effects.get(name)
        return None if tried is None else {"closure": tried.closure, "ci95": tried.closure_ci95}

    return [{"effect": name, "a": closed(a, name), "b": closed(b, name)} for name in names]


def _places(a: DiagnosisFile, b: DiagnosisFile) -> list[dict[str, Any]]:
    """Share of the gap in every place of either, largest first; 0 where a diagnosis has none there."""
    shares: dict[tuple[str, ...], dict[str, float]] = {}
    for side, own in (("a", a), ("b", b)):
        for place in own.where:
            key = tuple(getattr(place, name) for name in PLACE_KEYS)
            here = shares.setdefault(key, {"a": 0.0, "b": 0.0})
            here[side] += place.share
    ordered = sorted(shares.items(), key=lambda item: (-max(item[1].values()), item[0]))
    return [dict(zip(PLACE_KEYS, key, strict=True)) | own for key, own in ordered]
