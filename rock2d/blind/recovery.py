"""Injection and recovery: which causes a record would show, and from which size on.

Known causes of known sizes are added to the record, which is diagnosed again. The detection curves of the linear model
(`diagnosis.detection`) are corrected by the effects that were named."""

import json
import re
import tempfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from rock2d.blind.case_files import CASES
from rock2d.blind.injection import injected
from rock2d.blind.trial_diagnoses import RESULTS
from rock2d.diagnosis.detection import TRUTH, Curve, detection_curves, limits_of
from rock2d.diagnosis.diagnose import Diagnosis, diagnose
from rock2d.diagnosis.diagnosis_content import effect_values
from rock2d.diagnosis.known_causes import largest_size, size_parameter, two_sided, values_of_size
from rock2d.diagnosis.model import from_scale, to_scale
from rock2d.effects import catalogue
from rock2d.effects.effect import Parameter
from rock2d.errors import InputError
from rock2d.files.checked_yaml import shown
from rock2d.files.experiment import load_experiment, write_experiment
from rock2d.files.folders import atomic_folder, write_whole
from rock2d.files.text_files import read_json

# largest added effect, and largest sum with that of the record, as a share of the plausible range
LARGEST_SHARE_OF_RANGE = 0.9
# largest error of an effect that the original record has, too, as a share of the added size
LARGEST_RELATIVE_ERROR = 0.5


@dataclass(frozen=True)
class Plan:
    """The cases of a study: the first `cases` of all effects × sizes, the effects in turn.

    Attributes
    ----------
    cases : largest number of cases
    sizes : (factor, "seen50" or "seen90") of each size: a multiple of the size that a linear model expects to be seen
        with a probability of 50 or 90 %
    seed : for the order of the effects, and for effects that vary from impact to impact"""

    cases: int
    sizes: tuple[tuple[float, str], ...] = ((1.0, "seen50"), (1.0, "seen90"))
    seed: int = 0

    def of(self, limits: Mapping[str, Mapping[str, Any]]) -> list[tuple[str, float]]:
        """(effect, size) of each case, from the limits of each effect."""
        rng = np.random.default_rng(np.random.SeedSequence(self.seed))
        order, found = rng.permutation(sorted(limits)).tolist(), []
        for turn in range(len(self.sizes)):
            for k, name in enumerate(order):
                factor, of = self.sizes[(k + turn) % len(self.sizes)]
                found.append((name, factor * limits[name][of]))
        return found[: self.cases]


def read_sizes(text: str) -> tuple[tuple[float, str], ...]:
    """Sizes of a plan from a text "seen50,2*seen90,...". Raises InputError for another text."""
    found = []
    for word in text.split(","):
        match = re.fullmatch(r"(?:(\d+\.?\d*|\.\d+)\*)?(seen50|seen90)", word.strip())
        if match is None or float(match[1] or 1.0) <= 0.0:
            raise InputError(f"expected sizes like seen50 or 2*seen90, found {shown(word)}", code="bad_value")
        found.append((float(match[1] or 1.0), match[2]))
    return tuple(found)


def make_cases(
    result: Diagnosis,
    effects: Sequence[str],
    plan: Plan,
    out: Path,
    options: Mapping[str, Any],
    on_case: Callable[[], Any] = lambda: None,
) -> None:
    """Write the experiments cases/NNN, and truth.json with the added causes and the expected curves.

    With a cause of the motion, the last experiment is the record in pieces without a cause: a piece shows less of its
    motion than a release, so its diagnosis may name other effects.
    `options`: kept in truth.json. Sizes are limited to plausible ones."""
    attribution, known, cases = result.found, catalogue(), {}
    assert attribution is not None
    curves, settled = detection_curves(result, effects), attribution.settled
    planned = plan.of(limits_of(curves))
    moved = next((known[name] for name, _ in planned if not known[name].camera), None)
    with atomic_folder(out / CASES, "study") as folder:
        for k, (name, size) in enumerate(planned):
            effect, parameter = known[name], size_parameter(known[name], result.setup)
            has, below = curves[name].value, bool(k % 2) and two_sided(parameter)
            most = LARGEST_SHARE_OF_RANGE * largest_size(parameter)
            size = min(size, most, _largest_addition(parameter, has, below))
            values = values_of_size(effect, size, result.setup, below)
            changed = injected(result.experiment, settled.model, settled.p, effect, values, plan.seed + k)
            write_experiment(folder / f"{k:03d}", changed.experiment)
            # expected with the value of the original record, named or not
            added = values[parameter.name]
            expected = from_scale(parameter, to_scale(parameter, added) + to_scale(parameter, has))
            expected = float(np.hypot(has, added)) if effect.scatter else expected
            # in a record of pieces, an effect that grows does so from piece to piece
            growth = changed.releases / changed.pieces if effect.grows else 1.0
            cases[f"{k:03d}"] = {
                "effect": name, "size": size, "values": values, "releases": changed.releases,
                "pieces": changed.pieces, "cut": changed.cut, "expected": expected * growth,
            }  # fmt: skip
            on_case()
        if moved is not None:
            nothing = values_of_size(moved, 0.0, result.setup)
            pieces = injected(result.experiment, settled.model, settled.p, moved, nothing).experiment
            write_experiment(folder / f"{len(cases):03d}", pieces)
    truth = {
        **options, "named": sorted(attribution.named), "curves": {n: asdict(c) for n, c in curves.items()},
        "cases": cases, "without_cause": None if moved is None else f"{len(cases):03d}",
    }  # fmt: skip
    write_whole(out / TRUTH, json.dumps(truth, indent=1) + "\n")


def _largest_addition(parameter: Parameter, has: float, below: bool) -> float:
    """The largest size that can be added to a record that has the value `has`, so that a fit can find the sum."""
    end = parameter.low if below or parameter.high <= parameter.neutral else parameter.high
    most = to_scale(parameter, parameter.neutral + LARGEST_SHARE_OF_RANGE * (end - parameter.neutral))
    addition = from_scale(parameter, most - to_scale(parameter, has))
    return max((addition - parameter.neutral) * np.sign(end - parameter.neutral), 0.0)


def diagnose_case(every_fit: Path, case: Path, out: Path) -> None:
    """Diagnose a case, and write the named effects and their parameters."""
    with tempfile.TemporaryDirectory(dir=every_fit) as fits:
        found = diagnose(load_experiment(case), folder=Path(fits)).found
    kept: dict[str, Any] = {"named": {}, "parameters": {}}
    if found is not None:
        kept = {
            "named": {name: found.group(name) for name in sorted(found.named)},
            "parameters": effect_values(found.final.fit) if found.named else {},
        }
    write_whole(out, json.dumps(kept, indent=1) + "\n")


def recovered(folder: Path) -> tuple[list[dict[str, Any]], dict[str, dict[str, Any]]]:
    """The cases with their results, and the limits of each effect that can be seen.

    A case has the keys of truth.json, `seen`, `found` (its size parameter, None if it was not named) and `false` (named
    effects that neither the case nor the record has). An effect that the original record has, too, is seen if the sum
    is found. The record of a case with a cause of the motion is the one in pieces."""
    truth, known, cases = read_json(folder / TRUTH), catalogue(), []
    original = set(truth["named"])
    without_cause = _named(folder, truth["without_cause"])[0] if truth.get("without_cause") else {}
    of_pieces = original.union(*without_cause.values())
    for name, case in truth["cases"].items():
        effect, (groups, parameters) = case["effect"], _named(folder, name)
        has = original if known[effect].camera else of_pieces
        value = None
        if effect in groups and effect in parameters:
            value = parameters[effect][known[effect].parameters[0].name]["value"]
        seen = any(effect in group for group in groups.values())
        if value is not None and effect in has:
            seen = abs(value - case["expected"]) <= LARGEST_RELATIVE_ERROR * case["size"]
        false = sorted(own for own, group in groups.items() if not group & {effect, *has})
        cases.append({"case": name, **case, "seen": seen, "found": value, "false": false})
    curves = {name: Curve(**parameters) for name, parameters in truth["curves"].items()}
    results = [(case["effect"], case["size"], case["seen"]) for case in cases]
    return cases, limits_of(curves, results)


def _named(folder: Path, case: str) -> tuple[dict[str, set[str]], dict[str, Any]]:
    """Each named effect of a case -> it and the effects with which it shares its name; and `effect_values`."""
    result = read_json(folder / RESULTS / f"{case}.json")
    return {name: {name, *group} for name, group in result["named"].items()}, result["parameters"]


def case_lines(cases: Sequence[Mapping[str, Any]], limits: Mapping[str, Any], tried: Sequence[str]) -> list[str]:
    """Sentences on the results of the cases, and on effects that no plausible size would show."""
    found = [case for case in cases if case["found"] is not None]
    lines = [f"{sum(case['seen'] for case in cases)} of {len(cases)} known causes were seen"]
    if found:
        off = np.median([abs(case["found"] - case["expected"]) / case["size"] for case in found])
        lines.append(f"their sizes are {100 * off:.0f} % off (median)")
    lines.append(f"names that are false: {sum(len(case['false']) for case in cases)}")
    hidden = [name for name in tried if name not in limits]
    return lines + ([f"no plausible size would be seen of: {', '.join(hidden)}"] if hidden else [])
