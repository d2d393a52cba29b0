"""What a user must know about a scenario that runs with a diagnosis, in sentences; and what run.json says of it."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from rock2d.effects import catalogue
from rock2d.files.diagnosed_model import DiagnosedModel, FittedModel
from rock2d.runs.found_causes import ROUGHNESS, Causes

if TYPE_CHECKING:
    from collections.abc import Mapping

    from rock2d.files.scenario import Scenario
    from rock2d.scene.blocks import Block

FARTHEST_SCALE = 2.0  # factor of mass or size up to which a diagnosis is taken to hold


def diagnosis_about(scenario: Scenario) -> dict[str, Any]:
    """What run.json says of the diagnosis; empty without one."""
    own = scenario.diagnosed
    if own is None:
        return {}
    return {
        "diagnosis": {
            "path": own.given, "sha256": own.fingerprint, "schema": own.schema, "experiment": own.experiment,
            "verdict": own.verdict, "soil": dict(own.model.soil),
            "acting": {name: _plain(own.model, name) for name in own.model.effects if not catalogue()[name].camera},
            "remarks": diagnosis_remarks(scenario),
        }
    }  # fmt: skip


def _plain(model: FittedModel, effect: str) -> dict[str, float]:
    return {name: own.value for name, own in model.effects[effect].items()}


def diagnosis_remarks(scenario: Scenario) -> list[str]:
    """Sentences on what the diagnosis brings into the scenario, and what not; empty without one."""
    own = scenario.diagnosed
    if own is None:
        return []
    soil = ", ".join(
        f"{name} {value:.4g}" for name, value in own.model.soil.items() if not isinstance(value, bool)
    )
    remarks = [f"diagnosis {own.given} (experiment {own.experiment}): verdict {own.verdict}; soil {soil}"]
    remarks += _answer_remarks(own)
    if own.learnt:
        remarks.append(
            f"warning: no release of this run has what was learnt from the film: {own.learnt}. It holds for the film's "
            "own set-up; `rock2d predict` uses it there"
        )
    blocks, ground = scenario.make_blocks(), scenario.make_cross_section()
    for model in own.alternatives:
        causes = Causes(model, blocks, ground, scenario.gravity_m_s2)
        remarks += [_effect_remark(name, causes) for name in model.effects]
    remarks += _interval_remarks(scenario, own)
    return remarks + _scale_remarks(own, blocks)


def _answer_remarks(own: DiagnosedModel) -> list[str]:
    if own.undecided:
        named = ", ".join(f"{'/'.join(model.effects)} ({model.p:.2f})" for model in own.alternatives)
        return [
            f"the data cannot tell these effects apart: {named}. The releases meet the refitted soil alone; "
            "before_after.csv shows each, and with the key uncertainty each possible site has one of them"
        ]
    if own.model.effects:
        return []
    if own.verdict == "unknown":
        return [
            "there is a gap that no effect explains: only the refitted soil is used, what causes the gap is not"
        ]
    if own.verdict != "none":
        return ["no cause is more likely than not: only the refitted soil is used"]
    return ["no effect was found: only the refitted soil is used"]


def _effect_remark(name: str, causes: Causes) -> str:
    effect, values = catalogue()[name], causes.model.effects[name]
    if effect.camera:
        return f"{name} does not act: it says something about the film, not about the block"
    numbers = ", ".join(
        f"{q.name} = {values[q.name].value:.4g} [{values[q.name].low95:.4g}, {values[q.name].high95:.4g}]"
        + ("" if q.unit == "1" else f" {q.unit}")
        for q in effect.parameters
    )
    if name == ROUGHNESS:
        return f"{name} acts as ground with slopes that vary, sd {numbers}: {_pieces(causes)}"
    if name in causes.without_effect():
        why = {
            "soil_compaction": "each release is an event of its own, the first of its series",
            "zone_contrast": "no zone of this cross-section belongs to an embankment alone",
            "embankment_yield": "no zone of this cross-section belongs to an embankment alone",
            "rounded_edges": "no block has edges",
        }.get(name, "its value is neutral here")
        return f"{name} changes nothing: {why}"
    more = {
        "geometry_error": "; it was found on the set-up as built, and changes this cross-section likewise",
        "mass_eccentricity": "; crossings, stops and impacts are those of the centre of mass",
    }.get(name, "")
    return f"{name} acts: {numbers}{more}"


def _pieces(causes: Causes) -> str:
    roughness = causes.roughness()
    if not roughness:
        return "its value is 0"
    piece = next(iter(roughness.values())).length_m
    length = np.hypot(*np.diff(causes.cross_section.points_m, axis=0).T)
    short = int((length < piece).sum())
    note = f"; {short} facets are shorter and stay smooth" if short else ""
    return f"each release has its own surface of pieces of {piece:.3g} m, the mean size of the blocks{note}"


def _interval_remarks(scenario: Scenario, own: DiagnosedModel) -> list[str]:
    if scenario.uncertainty is None:
        unknown = own.unknown()
        return (
            ["values are the fitted ones; the key uncertainty brings their intervals in"] if unknown else []
        )
    return [
        "the diagnosis gives no interval of the soil's parameters: it counts as known unless uncertainty.site says how "
        "sure it is"
    ]


def _scale_remarks(own: DiagnosedModel, blocks: Mapping[str, Block]) -> list[str]:
    """Warnings on blocks to which the diagnosis may not apply: stiffnesses in N/m go with mass over size."""
    if not own.blocks:
        return [
            "warning: the diagnosis does not name its blocks: whether it holds for blocks of this mass and size "
            "cannot be checked"
        ]
    remarks = []
    for name, block in blocks.items():
        for what, value, unit, known in (
            ("mass", block.mass_kg, "kg", [scale.mass_kg for scale in own.blocks.values()]),
            ("size", block.size_m, "m", [scale.size_m for scale in own.blocks.values()]),
        ):
            if value > FARTHEST_SCALE * max(known) or value < min(known) / FARTHEST_SCALE:
                remarks.append(
                    f"warning: block {name} has a {what} of {value:.3g} {unit}, those of the diagnosis "
                    f"{min(known):.3g} to {max(known):.3g} {unit}: stiffnesses and effects do not hold at this scale"
                )
                break
    return remarks
