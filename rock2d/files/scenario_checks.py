"""Checks of a scenario that involve several keys: names, parameters, plausible values."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from rock2d.arrays import Array
from rock2d.errors import InputError
from rock2d.files.checked_yaml import did_you_mean, shown
from rock2d.files.places import number_at, place_of, value_at
from rock2d.files.scatter_keys import SCATTERED
from rock2d.scene.cross_section import CrossSectionError, by_zone
from rock2d.scene.earthworks import EarthworkError
from rock2d.scene.plausibility import (
    USUAL_FRICTION_DEG,
    USUAL_SLOPE_REDUCTION_DEG,
    Doubt,
    angle_doubts,
    block_doubts,
    contact_doubts,
    earthwork_doubts,
    highest_speed_m_s,
    rough_ground_doubts,
    rough_point_doubts,
    site_doubts,
    start_doubts,
)
from rock2d.scene.soils import SOIL_CLASSES

if TYPE_CHECKING:
    from rock2d.files.scenario import Scenario
    from rock2d.files.scenario_keys import Incident, Soil
    from rock2d.scene.cross_section import CrossSection

POSSIBLE_STARTS = 200  # drawn starts of a block that are checked for plausibility


def check_scenario(scenario: Scenario) -> None:
    """Raise InputError, with its place in the file, at the first mistake."""
    _check_earthworks(scenario)
    _check_plausible(scenario)
    _check_names(scenario)
    _check_field_test(scenario)
    _check_diagnosis(scenario)
    _check_parameters(scenario)
    _check_incident(scenario)
    _check_scatter(scenario)
    _check_uncertainty(scenario)


def _check_earthworks(scenario: Scenario) -> None:
    _check_ditches(scenario)
    try:
        scenario.make_cross_section()
    except EarthworkError as error:
        number = () if error.number is None else (str(error.number),)
        raise scenario.error(str(error), error.part, *number, error.key, code="bad_cross_section") from None
    except CrossSectionError as error:
        place = (error.line,) if error.line is not None else ()
        raise scenario.error(str(error), "cross_section", error.key, *place, code="bad_cross_section") from None


def _check_ditches(scenario: Scenario) -> None:
    """Refuse a ditch without an embankment."""
    embankment, ditch = scenario.embankment, scenario.ditch
    if ditch is None:
        return
    if embankment is None:
        message = "a ditch lies before an embankment: missing key 'embankment'"
        raise scenario.error(message, "ditch", at="key", code="missing_key", key="embankment")
    if isinstance(embankment, dict) and not isinstance(ditch, dict):
        message = "before which of the embankments? Write {1: {width_m: ...}} for a ditch before embankment 1"
        raise scenario.error(message, "ditch", at="key", code="wrong_kind")
    for number in ditch if isinstance(ditch, dict) else ():
        if not isinstance(embankment, dict) or number not in embankment:
            message = f"there is no embankment {shown(number)}"
            raise scenario.error(message, "ditch", number, at="key", code="unknown_name", name=number)


def _check_plausible(scenario: Scenario) -> None:
    """Refuse what no site has."""
    for doubt in _site_and_blocks(scenario, scenario.make_cross_section()):
        if doubt.impossible:
            raise scenario.error(doubt.text, *doubt.key, at="key", code="implausible")


def _site_and_blocks(scenario: Scenario, ground: CrossSection) -> Iterator[Doubt]:
    """Doubts about site and blocks, which may be impossible. Cheap, because every variant of a site is checked."""
    yield from site_doubts(ground, scenario.gravity_m_s2)
    for block in scenario.make_blocks().values():
        yield from _in_file(scenario, block_doubts(block, ground))


def _in_file(scenario: Scenario, of_block: Iterable[Doubt]) -> Iterator[Doubt]:
    """Doubts about a block, at the key of its population if it is of one."""
    for doubt in of_block:
        population = doubt.key[1] in scenario.populations
        yield replace(doubt, key=("populations", *doubt.key[1:])) if population else doubt


def doubts(scenario: Scenario, engine: str | None = None) -> list[Doubt]:
    """Unusual values of a scenario: site, blocks, starts, and contacts or roughness for the law of `engine` (default:
    the engine of the scenario)."""
    engine = engine or scenario.engine
    ground, gravity = scenario.make_cross_section(), scenario.gravity_m_s2
    zones = ground.zone_names
    found = list(_site_and_blocks(scenario, ground))
    if (unknown := scenario.uncertainty) is not None and unknown.sites != unknown.base_sites:
        text = f"{unknown.sites} sites count as {unknown.base_sites}, the next power of two"
        found.append(Doubt(text, ("uncertainty", "sites")))
    for name, block in scenario.make_blocks().items():
        found += _in_file(scenario, earthwork_doubts(block, ground))
        incident = scenario.incident_of(name)
        if incident.from_experiment is not None:
            continue
        states = _possible_starts(incident, ground)
        key = ("incident", name if name in scenario.incident else "default")
        found += start_doubts(block, states, ground, gravity, key)
        if engine == "point_mass":
            rebound = by_zone(scenario.rebound_parameters(block), zones, "rebound")
            reduction = {zone: soil.slope_reduction_deg for zone, soil in zip(zones, rebound, strict=True)}
            found += angle_doubts("slope reduction", reduction, USUAL_SLOPE_REDUCTION_DEG)
            friction = {zone: soil.friction_angle_deg for zone, soil in zip(zones, rebound, strict=True)}
        else:
            contact = by_zone(scenario.contact_parameters(block), zones, "contact")
            stiffness = {zone: soil.k_l_N_m for zone, soil in zip(zones, contact, strict=True)}
            found += contact_doubts(block, stiffness, highest_speed_m_s(states, ground, gravity))
            friction = {zone: soil.friction_angle_deg for zone, soil in zip(zones, contact, strict=True)}
        found += angle_doubts("friction angle", friction, USUAL_FRICTION_DEG)
    if engine != "point_mass":
        found += rough_ground_doubts(ground, {zone: keys.make() for zone, keys in scenario.roughness.items()})
    elif scenario.field_test is None:  # point masses of a field test use smooth ground
        found += rough_point_doubts(rough_without_slope_reduction(scenario))
    return list(dict.fromkeys(found))  # several blocks share the ground


def engine_remarks(scenario: Scenario, engine: str | None) -> list[str]:
    """Warnings that hold for another engine than that of the scenario; none if the file lacks the law of that
    engine."""
    if engine is None:
        return []
    try:
        known = doubts(scenario)
        found = [doubt for doubt in doubts(scenario, engine) if doubt not in known]
    except InputError:
        return []
    return [f"warning: {engine}: {doubt.text}" for doubt in found]


def rough_without_slope_reduction(scenario: Scenario) -> list[str]:
    """Rough zones without slope reduction of the rebound law for some block."""
    laws = [scenario.rebound_parameters(block) for block in scenario.make_blocks().values()]
    return [
        zone
        for zone in scenario.roughness
        if any((law.get(zone) or law["default"]).slope_reduction_deg == 0.0 for law in laws)
    ]


def _possible_starts(incident: Incident, ground: CrossSection) -> Array:
    """(n, 6) drawn states at the start."""
    states = np.array(incident.draw(np.random.default_rng(0), POSSIBLE_STARTS), float)
    if incident.above_ground is not None:
        x = ground.points_m[:, 0]
        states[:, 1] += ground.height_m(np.clip(states[:, 0], x.min(), x.max()))
    return states


def _check_names(scenario: Scenario) -> None:
    zones = {"default", *scenario.make_cross_section().zone_names}
    blocks = {"default", *scenario.make_blocks()}
    laws, known = scenario.model, partial(_check_known, scenario)
    if "default" in scenario.make_cross_section().zone_names:
        raise scenario.error("a zone must not be called default", "cross_section", "zones")
    if "default" in scenario.make_blocks():
        raise scenario.error("a block must not be called default", "blocks", "default", at="key")
    if laws.soils is not None:
        known(laws.soils, zones, "zone", "model", "soils")
        _check_soil_classes(scenario, laws.soils)
    if laws.deterministic is not None:
        known(laws.deterministic.named(), zones, "zone", "model", "deterministic")
    if laws.probabilistic is not None:
        known(laws.probabilistic.named(), blocks, "block", "model", "probabilistic")
        for block, table in laws.probabilistic.named().items():
            known(table.named(), zones, "zone", "model", "probabilistic", block)
    known(scenario.incident, blocks, "block", "incident")
    for name in sorted(blocks - {"default"} - set(scenario.incident)):
        if "default" not in scenario.incident:
            message = f"block {shown(name)} has no incident state, neither its own nor a default"
            raise scenario.error(message, "incident", at="key", code="missing_key", key=name)


def _check_known(
    scenario: Scenario, names: Iterable[str], among: Iterable[str], what: str, *path: str, at: str = "key"
) -> None:
    """Refuse a name of a zone or block that the scenario does not have."""
    for name in names:
        if name not in among:
            choices = ", ".join(sorted({*among} - {"default"}))
            message = f"unknown {what}{did_you_mean(name, among)}; {what}s of this scenario: {choices}"
            own = (name,) if at == "key" else ()
            raise scenario.error(message, *path, *own, at=at, code="unknown_name", name=name)


def _check_soil_classes(scenario: Scenario, soils: dict[str, Soil]) -> None:
    for zone, given in soils.items():
        name, place = (given, (zone,)) if isinstance(given, str) else (given.like, (zone, "like"))
        if name not in SOIL_CLASSES:
            message = f"unknown soil class {shown(name)}{did_you_mean(name, SOIL_CLASSES)}; soil classes: "
            message += ", ".join(SOIL_CLASSES)
            raise scenario.error(message, "model", "soils", *place, code="unknown_name", name=name)


def _check_diagnosis(scenario: Scenario) -> None:
    if scenario.diagnosed is None:
        return
    if scenario.model.soils is not None and "default" in scenario.model.soils:
        message = "the diagnosis gives the soil of all zones that have no class of their own: remove one of the two"
        raise scenario.error(message, "model", "soils", "default", at="key", code="wrong_kind")
    check_engine(scenario, scenario.engine)


def check_engine(scenario: Scenario, engine: str) -> None:
    """Refuse the point-mass engine if the contact law comes from a diagnosis."""
    if scenario.diagnosed is not None and engine == "point_mass":
        message = "a diagnosis is about the contact law, which engine point_mass does not have; use batch or pymunk"
        raise scenario.error(message, "model", "diagnosis", at="key", code="wrong_kind", engine=engine)


def _check_field_test(scenario: Scenario) -> None:
    keys = scenario.field_test
    if keys is None:
        return
    blocks = scenario.blocks or {}
    for place, names in (("block_ids", keys.block_ids), ("calibrate_on", keys.calibrate_on)):
        _check_known(scenario, names, blocks, "block", "field_test", place, at="value")
    if scenario.cross_section is not None:
        message = "the ground is the terrain of the field test: remove cross_section"
        raise scenario.error(message, "cross_section", at="key", code="wrong_kind")
    for name, incident in scenario.incident.items():
        if incident.above_ground is None:
            message = "releases of a field test start above the ground: expected above_ground"
            raise scenario.error(message, "incident", name, code="wrong_kind")


def _check_parameters(scenario: Scenario) -> None:
    laws = scenario.model
    for block in scenario.make_blocks().values():
        if laws.deterministic is not None or scenario.engine in ("pymunk", "batch"):
            scenario.contact_parameters(block)
        if laws.probabilistic is not None or scenario.engine == "point_mass":
            scenario.rebound_parameters(block)


def _check_incident(scenario: Scenario) -> None:
    """Refuse a fixed start below the ground or outside the cross-section."""
    ground = scenario.make_cross_section()
    points = ground.points_m
    left, right = points[:, 0].min(), points[:, 0].max()
    for name, item in scenario.incident.items():
        if item.fixed is None:
            continue
        path = ("incident", name, "fixed")
        if not left <= item.fixed.x_m <= right:
            message = f"outside the cross-section, which reaches from {left:g} to {right:g}"
            raise scenario.error(message, *path, "x_m", code="bad_state", key="x_m")
        if ground.covers(np.array([[item.fixed.x_m, item.fixed.y_m]])).any():
            raise scenario.error("below the ground", *path, "y_m", code="bad_state", key="y_m")


def _check_scatter(scenario: Scenario) -> None:
    for name in scenario.populations:
        if scenario.blocks is not None and name in scenario.blocks:
            raise scenario.error(f"{name} is also under blocks", "populations", name, at="key")
        if scenario.experiment is not None:
            message = "the blocks of a filmed experiment are known"
            raise scenario.error(message, "populations", at="key", code="wrong_kind")
    zones = scenario.make_cross_section().zone_names
    _check_known(scenario, scenario.roughness, zones, "zone", "roughness")
    for place in scenario.scatter:
        message = ""
        if place.partition(".")[0] not in SCATTERED:
            message = f"only numbers under {' and '.join(SCATTERED)} vary from release to release"
        elif number_at(scenario.document.data, place) is None:
            message = _no_number(scenario, place)
        if message:
            raise scenario.error(message, "scatter", place, at="key", code="unknown_name", name=place)


def _no_number(scenario: Scenario, place: str) -> str:
    """Message: there is no number at a place; for a soil class, it says what to write instead."""
    data = scenario.document.data
    path = place_of(data, place)
    found = None if path is None else value_at(data, path)
    message = "there is no number at this place of the file"
    if path is not None and path[:2] == ("model", "soils") and isinstance(found, str):
        zone = f"{path[-1]}: {{like: {found}, stiffness: ...}}"
        return f"{message}, but the soil class {found}. Write {zone} there, and vary {place}.stiffness"
    return message if found is None else f"{message}, but {shown(found)}"


def _check_uncertainty(scenario: Scenario) -> None:
    if scenario.uncertainty is None:
        return
    if scenario.experiment is not None:
        message = "releases that restart a film have no other possible sites"
        raise scenario.error(message, "uncertainty", at="key", code="wrong_kind")
    if not scenario.make_cross_section().measure_lines:
        message = "possible sites are compared by their passing frequencies: missing key 'measure_lines'"
        raise scenario.error(message, "uncertainty", at="key", code="missing_key", key="measure_lines")

    if not scenario.unknown():
        message = "no value is uncertain: missing key 'site'"
        if scenario.diagnosed is not None:
            message += "; the diagnosis has no uncertain value that influences the motion of a block"
        raise scenario.error(message, "uncertainty", at="key", code="missing_key", key="site")
    if scenario.posterior is not None:
        for place in scenario.posterior.places:
            if number_at(scenario.document.data, place) is None or place in scenario.uncertainty.site:
                why = (
                    "is also under site"
                    if place in scenario.uncertainty.site
                    else "is not the place of a number in this file"
                )
                message = f"column {shown(place)} {why}"
                raise scenario.error(message, "uncertainty", "posterior", code="unknown_name", name=place)
    for place in scenario.uncertainty.site:
        if number_at(scenario.document.data, place) is None:
            message = _no_number(scenario, place)
            raise scenario.error(message, "uncertainty", "site", place, at="key", code="unknown_name", name=place)
