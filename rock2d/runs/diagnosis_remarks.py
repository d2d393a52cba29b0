"""Remarks for the user on a scenario that runs with a diagnosis, and its entry in run.json."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from rock2d.effects import catalogue
from rock2d.files.diagnosed_model import NOT_FITTED, DiagnosedModel
from rock2d.runs.acting_effects import ROUGHNESS, ActingEffects, camera_errors, corrects_film

if TYPE_CHECKING:
    from collections.abc import Mapping

    from rock2d.files.diagnosis_keys import BlockScale
    from rock2d.files.scenario import Scenario
    from rock2d.scene.blocks import Block

NOT_FITTED_WARNING = f"warning: the contact law of this diagnosis is {NOT_FITTED}"
FARTHEST_SCALE = 2.0  # largest factor of mass or size to which a diagnosis is applied without a warning


def diagnosis_entry(scenario: Scenario) -> dict[str, Any]:
    """The entry of the diagnosis in run.json; empty without a diagnosis."""
    diagnosed = scenario.diagnosed
    if diagnosed is None:
        return {}
    acting = {
        name: {key: parameter.value for key, parameter in parameters.items()}
        for name, parameters in diagnosed.model.effects.items()
        if not catalogue()[name].camera
    }
    return {
        "diagnosis": {
            "path": diagnosed.given, "sha256": diagnosed.fingerprint, "schema": diagnosed.schema,
            "experiment": diagnosed.experiment, "verdict": diagnosed.verdict,
            "soil": diagnosed.model.soil.model_dump(exclude_none=True), "acting": acting,
            "remarks": diagnosis_remarks(scenario),
        }
    }  # fmt: skip


def diagnosis_remarks(scenario: Scenario) -> list[str]:
    """Sentences on what the scenario takes from the diagnosis and what not; empty without a diagnosis."""
    diagnosed = scenario.diagnosed
    if diagnosed is None:
        return []
    soil = ", ".join(f"{name} {value:.4g}" for name, value in diagnosed.model.soil if type(value) is float)
    remarks = [
        f"diagnosis {diagnosed.given} (experiment {diagnosed.experiment}): verdict {diagnosed.verdict}; soil {soil}"
    ]
    if not diagnosed.fitted:
        remarks.append(NOT_FITTED_WARNING)
    remarks += _verdict_remarks(diagnosed)
    if diagnosed.unused:
        remarks.append(f"these causes are possible, too, and do not act: {'; '.join(diagnosed.unused)}")
    if diagnosed.learnt:
        remarks.append(
            f"warning: this run is without the changes learnt from the film: {diagnosed.learnt}. They hold for the "
            "set-up of the film only; `rock2d predict` uses them there"
        )
    for model in diagnosed.alternatives:
        acting = ActingEffects.of(model, scenario)
        remarks += [_effect_remark(name, acting) for name in model.effects]
    remarks += _film_remarks(scenario, diagnosed)
    remarks += _interval_remarks(scenario, diagnosed)
    return remarks + scale_remarks(diagnosed.blocks, scenario.make_blocks())


def _verdict_remarks(diagnosed: DiagnosedModel) -> list[str]:
    if diagnosed.undecided:
        named = ", ".join(f"{'/'.join(model.effects)} ({model.p:.2f})" for model in diagnosed.alternatives)
        return [
            f"the data cannot tell these effects apart: {named}. The releases use {diagnosed.soil_in_words}, alone; "
            "before_after.csv shows each effect, and with the key uncertainty each possible site has one of them"
        ]
    if diagnosed.model.effects:
        return []
    why = {"unknown": "no effect explains the gap", "none": "no effect was found"}
    found = why.get(diagnosed.verdict, "no cause is more likely than not")
    return [f"{found}: only {diagnosed.soil_in_words} is used"]


def _effect_remark(name: str, acting: ActingEffects) -> str:
    effect, values = catalogue()[name], acting.model.effects[name]
    if effect.camera:
        return f"{name} does not act: it is an error of the film, not a property of block or ground"
    numbers = ", ".join(
        f"{key} = {value.value:.4g} [{value.low95:.4g}, {value.high95:.4g}]" + ("" if q.unit == "1" else f" {q.unit}")
        for q in effect.parameters
        for key, value in values.items()
        if key.startswith(f"{q.name}.") or (key == q.name and not all(f"{key}.{b}" in values for b in acting.blocks))
    )
    if name == ROUGHNESS:
        return f"{name} acts as ground with slopes that vary, sd {numbers}: {_pieces(acting)}"
    if name in acting.without_change():
        why = {
            "soil_compaction": "each release is the first of its series",
            "zone_contrast": "no zone of this cross-section belongs to an embankment alone",
            "embankment_yield": "no zone of this cross-section belongs to an embankment alone",
            "rounded_edges": "no block has edges",
        }.get(name, "its value is neutral here")
        return f"{name} changes nothing: {why}"
    more = {
        "geometry_error": "; it was found on the set-up of the film, and changes this cross-section in the same way",
        "mass_eccentricity": ("; the offset in m is that of the blocks of the film" if acting.fitted_scale else "")
        + "; crossings, stops and impacts are those of the centre of mass",
    }.get(name, "")
    return f"{name} acts: {numbers}{more}"


def _film_remarks(scenario: Scenario, diagnosed: DiagnosedModel) -> list[str]:
    errors = ", ".join(camera_errors(scenario))
    if scenario.experiment is None or not errors:
        return []
    if corrects_film(scenario):
        return [f"the frames are corrected for {errors} before the starts are fitted to them and compared with"]
    return [
        f"warning: the starts are fitted to the frames of {scenario.experiment.name} as they were recorded: the "
        f"diagnosis found {errors} in another film, {diagnosed.experiment}"
    ]


def _pieces(acting: ActingEffects) -> str:
    roughness = acting.roughness()
    if not roughness:
        return "its value is 0"
    piece = next(iter(roughness.values())).length_m
    length = np.hypot(*np.diff(acting.cross_section.points_m, axis=0).T)
    short = int((length < piece).sum())
    note = f"; {short} facets are shorter and stay smooth" if short else ""
    return f"each release has its own surface of pieces of {piece:.3g} m, the mean size of the blocks{note}"


def _interval_remarks(scenario: Scenario, diagnosed: DiagnosedModel) -> list[str]:
    if scenario.uncertainty is None:
        unknown = diagnosed.unknown()
        return ["the fitted values are used; to use their intervals, add the key uncertainty"] if unknown else []
    return [
        "the diagnosis gives no intervals for the parameters of the soil: they count as known unless uncertainty.site "
        "gives distributions"
    ]


def scale_remarks(diagnosed: Mapping[str, BlockScale], blocks: Mapping[str, Block]) -> list[str]:
    """Warnings on blocks to which the diagnosis may not apply: stiffnesses in N/m scale with mass over size."""
    if not diagnosed:
        return [
            "warning: the diagnosis does not name its blocks: whether it holds for blocks of this mass and size "
            "cannot be checked"
        ]
    remarks = []
    for name, block in blocks.items():
        for what, value, unit, known in (
            ("mass", block.mass_kg, "kg", [scale.mass_kg for scale in diagnosed.values()]),
            ("size", block.size_m, "m", [scale.size_m for scale in diagnosed.values()]),
        ):
            if value > FARTHEST_SCALE * max(known) or value < min(known) / FARTHEST_SCALE:
                remarks.append(
                    f"warning: block {name} has a {what} of {value:.3g} {unit}, those of the diagnosis "
                    f"{min(known):.3g} to {max(known):.3g} {unit}: stiffnesses and effects do not hold at this scale"
                )
                break
    return remarks
