"""Comparison of two diagnoses: what agrees, what differs, and what cannot be compared."""

from collections.abc import Callable, Iterable, Mapping
from math import hypot
from typing import Any

from rock2d.diagnosis.model import BASE_NAMES
from rock2d.files.diagnosis import KNOWN_SCHEMAS
from rock2d.files.diagnosis_keys import DiagnosisFile
from rock2d.files.fitted_keys import FittedParameter

LEAST_PROBABILITY_OF_INTEREST = 0.05  # probability from which on the parameters of an effect are of interest
AGREEMENT = 1.0  # largest difference of equal values, over the half width of its 95 % interval
PLACE_KEYS = ("phase", "zone", "block", "channel")


def agree(a: FittedParameter, b: FittedParameter) -> bool | None:
    """Whether two values differ by no more than their 95 % intervals allow; None if both have no interval.

    The half intervals that face each other are added as independent errors."""
    if a.value == b.value:
        return True
    halves = [abs(own.ci95[own.value < other.value] - own.value) for own, other in ((a, b), (b, a))]
    half = hypot(halves[0], halves[1])
    return abs(a.value - b.value) <= AGREEMENT * half if half > 0 else None


def comparison(a: DiagnosisFile, b: DiagnosisFile) -> dict[str, Any]:
    """The content of comparison.json, with the keys "a" and "b" for the diagnoses A and B."""
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
    }


def _law(diagnosis: DiagnosisFile) -> dict[str, float]:
    return diagnosis.fitted_law.model_dump() if diagnosis.fitted_law is not None else {}


def diagnosed(diagnosis: DiagnosisFile) -> bool:
    """Whether effects were tried: the experiment passed the sanity checks."""
    return not diagnosis.sanity.faults and diagnosis.gap.base is not None


def notes(a: DiagnosisFile, b: DiagnosisFile) -> list[str]:
    """Sentences on what can be compared and what cannot."""
    sentences = []
    for name, diagnosis in (("A", a), ("B", b)):
        if not diagnosed(diagnosis):
            reason = f" ({'; '.join(diagnosis.sanity.faults)})" if diagnosis.sanity.faults else ""
            sentences.append(
                f"{name} could not be diagnosed{reason}. Its probabilities are not based on a fit: do not compare them."
            )
    if a.experiment == b.experiment:
        sentences.append(
            "Both files state the same name of the experiment. They do not show whether both are of the same film: if "
            "not, read them as different experiments."
        )
    else:
        sentences.append(
            "The experiments differ. Verdicts, probabilities and shares can be compared: each says what its own "
            "film shows. Parameters need not agree: those of the camera belong to a set-up, those of the soil to "
            "its state. Base, augmented and noise floor cannot be compared: each is in units of its own noise and "
            "scatter."
        )
    if a.schema_ != b.schema_:
        sentences.append(
            f"The files have different schemas, {a.schema_} and {b.schema_}. Only what both have is compared; "
            "causes, what lies outside the catalogue and the kinds of noise floor are left out."
        )
    newer = [diagnosis.schema_ for diagnosis in (a, b) if diagnosis.schema_ not in KNOWN_SCHEMAS]
    if newer:
        sentences.append(f"Schema {max(newer)} is newer than this rock2d. Keys that it does not know are left out.")
    if a.beside or b.beside:
        sentences.append(
            "If effects were found in addition to the verdict, the parameters compared here are still those of each "
            "effect alone."
        )
    if a.gap.unit != b.gap.unit:
        sentences.append("The gaps have different units: compare only the share closed.")
    sentences += _one_sided("effects", a.probabilities, b.probabilities, "were not in the catalogue of the other")
    for key in ("zone", "block"):
        in_a, in_b = ({getattr(place, key) for place in diagnosis.where} for diagnosis in (a, b))
        if in_a and in_b:
            sentences += _one_sided(f"{key}s", in_a, in_b, "have no share of the gap in the other, or are not there")
    return sentences


def _one_sided(what: str, a: Iterable[str], b: Iterable[str], why: str) -> list[str]:
    parts = [(f"{side}: {', '.join(sorted(only))}") for side, only in (("A", {*a} - {*b}), ("B", {*b} - {*a})) if only]
    return [f"Some {what} {why}. Only in {'; only in '.join(parts)}."] if parts else []


def _paired(names: Iterable[str], a: Mapping[str, Any], b: Mapping[str, Any]) -> list[dict[str, Any]]:
    """A row for each quantity, with its values in A and B; None if a diagnosis does not have it."""
    return [{"name": name, "a": a.get(name), "b": b.get(name)} for name in names]


def _probabilities(a: DiagnosisFile, b: DiagnosisFile) -> list[dict[str, Any]]:
    """Probability of every answer, that with the largest one in either diagnosis first."""
    names = list(dict.fromkeys([*a.probabilities, *b.probabilities]))
    pairs = _paired(names, a.probabilities, b.probabilities)
    return sorted(pairs, key=lambda pair: -max(pair["a"] or 0.0, pair["b"] or 0.0))


def _effects_of_interest(diagnosis: DiagnosisFile) -> set[str]:
    likely = {name for name, p in diagnosis.probabilities.items() if p >= LEAST_PROBABILITY_OF_INTEREST}
    return {diagnosis.verdict, *diagnosis.group, *likely, *(further.effect for further in diagnosis.beside)}


def _parameters(a: DiagnosisFile, b: DiagnosisFile) -> list[dict[str, Any]]:
    """Parameters of every effect that was tried in both or in one; those of interest first."""
    ranks = {pair["name"]: i for i, pair in enumerate(_probabilities(a, b))}
    wanted = _effects_of_interest(a) | _effects_of_interest(b)
    names = sorted({*a.effects, *b.effects}, key=lambda n: (n not in wanted, ranks.get(n, len(ranks)), n))
    rows = []
    for name in names:
        sides = [d.effects[name].parameters if name in d.effects else {} for d in (a, b)]
        for key in dict.fromkeys([*sides[0], *sides[1]]):
            first, second = (parameters_of_side.get(key) for parameters_of_side in sides)
            comparable = first is not None and second is not None and first.unit == second.unit
            rows.append({
                "effect": name, "parameter": key, "of_interest": name in wanted,
                "a": _value(first), "b": _value(second),
                "agree": agree(first, second) if first and second and comparable else None,
            })  # fmt: skip
    return rows


def _value(parameter: FittedParameter | None) -> dict[str, Any] | None:
    return parameter.model_dump(include={"value", "ci95", "unit"}) if parameter else None


def _closures(a: DiagnosisFile, b: DiagnosisFile) -> list[dict[str, Any]]:
    """Share of the gap that each effect closes alone, in the order of the probabilities."""
    names = [pair["name"] for pair in _probabilities(a, b) if pair["name"] in {*a.effects, *b.effects}]

    def closed(own: DiagnosisFile, name: str) -> dict[str, Any] | None:
        tried = own.effects.get(name)
        return None if tried is None else {"closure": tried.closure, "ci95": tried.closure_ci95}

    return [{"effect": name, "a": closed(a, name), "b": closed(b, name)} for name in names]


def _places(a: DiagnosisFile, b: DiagnosisFile) -> list[dict[str, Any]]:
    """Share of the gap in every place of A or B, largest first; 0 if a diagnosis has none there."""
    shares: dict[tuple[str, ...], dict[str, float]] = {}
    for side, own in (("a", a), ("b", b)):
        for place in own.where:
            key = tuple(getattr(place, name) for name in PLACE_KEYS)
            here = shares.setdefault(key, {"a": 0.0, "b": 0.0})
            here[side] += place.share
    ordered = sorted(shares.items(), key=lambda item: (-max(item[1].values()), item[0]))
    return [dict(zip(PLACE_KEYS, key, strict=True)) | own for key, own in ordered]
