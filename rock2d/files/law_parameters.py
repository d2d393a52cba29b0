"""Parameters of the impact laws for a block, from the soil classes and the numbers of a scenario file.

Values of a zone take precedence over values of all zones. For the same zone, numbers take precedence over a soil class.
Parameters that the file does not give come from the diagnosis, if there is one.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import asdict, replace
from typing import TYPE_CHECKING, Any

from rock2d.errors import ParameterError
from rock2d.files.checked_yaml import Table, shown
from rock2d.files.scenario_keys import SoilKeys
from rock2d.scene.blocks import Block
from rock2d.scene.soils import SOIL_CLASSES, SoilClass

if TYPE_CHECKING:
    from rock2d.files.scenario import Scenario
    from rock2d.laws.contact import ContactParameters
    from rock2d.laws.rebound import ReboundParameters

Values = dict[str, Any]


def contact_parameters(scenario: Scenario, block: Block) -> dict[str, ContactParameters]:
    """Zone name -> parameters of the deterministic law for `block`; "default" serves every other zone."""
    from rock2d.laws.contact import ContactParameters
    from rock2d.laws.soil_scaling import soil_contact

    model = scenario.model
    if model.deterministic is None and model.soils is None and scenario.diagnosed is None:
        message = "missing key 'deterministic', which the engines pymunk and batch need"
        raise scenario.error(message, "model", code="missing_key", key="deterministic")
    defaults: Values = {"rolling_cap": False, "rolling_in_indentation": False}
    if scenario.diagnosed is not None:
        defaults |= scenario.diagnosed.model.soil
    classes = _classes(scenario, soil_contact, block)
    numbers = _numbers(model.deterministic)
    common = defaults | classes.get("default", {}) | numbers.get("default", {})
    out = {}
    for zone in _zones(scenario, ContactParameters, common, classes, numbers):
        values = common | classes.get(zone, {}) | numbers.get(zone, {}) if zone != "default" else common
        out[zone] = _checked(scenario, ContactParameters, values, ("model", "deterministic", zone))
    return out


def rebound_parameters(scenario: Scenario, block: Block) -> dict[str, ReboundParameters]:
    """Zone name -> parameters of the probabilistic law for `block`; "default" serves every other zone."""
    from rock2d.laws.rebound import ReboundParameters
    from rock2d.laws.soil_scaling import soil_rebound

    model = scenario.model
    if model.probabilistic is None and model.soils is None:
        message = "missing key 'probabilistic', which engine point_mass needs"
        raise scenario.error(message, "model", code="missing_key", key="probabilistic")
    blocks = model.probabilistic.named() if model.probabilistic is not None else {}
    defaults: Values = {"slope_reduction_deg": 0.0, "slope_reduction": "constant"}
    classes = _classes(scenario, soil_rebound, block)
    numbers, of_block = _numbers(blocks.get("default")), _numbers(blocks.get(block.name))
    base = defaults | classes.get("default", {}) | numbers.get("default", {})
    common = base | of_block.get("default", {})
    out = {}
    for zone in _zones(scenario, ReboundParameters, common, classes, {**numbers, **of_block}):
        values = common
        if zone != "default":  # values of a block take precedence over values of a zone
            values = base | classes.get(zone, {}) | numbers.get(zone, {})
            values = values | of_block.get("default", {}) | of_block.get(zone, {})
        path = (block.name, zone) if zone in of_block else ("default", zone)
        out[zone] = _checked(scenario, ReboundParameters, values, ("model", "probabilistic", *path))
    return out


def _classes(scenario: Scenario, law: Any, block: Block) -> dict[str, Values]:
    """Zone name, or default -> parameters that the soil class gives for the block."""
    soils = scenario.model.soils or {}
    return {zone: asdict(law(_soil(soil), block.mass_kg, block.size_m)) for zone, soil in soils.items()}


def _soil(given: str | SoilKeys) -> SoilClass:
    if isinstance(given, str):
        return SOIL_CLASSES[given]
    return replace(SOIL_CLASSES[given.like], **given.model_dump(exclude_none=True, exclude={"like"}))


def _numbers(table: Table | None) -> dict[str, Values]:
    """Zone name, or default -> parameters that the file gives as numbers."""
    named = table.named() if table is not None else {}
    return {zone: keys.model_dump(exclude_none=True) for zone, keys in named.items()}


def _zones(
    scenario: Scenario, kind: Any, common: Values, classes: Iterable[str], numbers: Iterable[str]
) -> list[str]:
    """The zones that the result names. "default" may be missing if every zone has its own class or numbers."""
    zones = list(dict.fromkeys(("default", *numbers, *classes)))
    soils = scenario.model.soils
    if soils is None or "default" in soils or not _missing(kind, common):
        return zones
    for zone in scenario.make_cross_section().zone_names:
        if zone not in zones:
            message = f"zone {shown(zone)} has no soil class, neither its own nor a default"
            raise scenario.error(message, "model", "soils", at="key", code="missing_key", key=zone)
    return zones[1:]


def _missing(kind: Any, values: Values) -> list[str]:
    return [name for name in kind.__dataclass_fields__ if name not in values]


def _checked(scenario: Scenario, kind: Any, values: Values, path: tuple[str, ...]) -> Any:
    for name in _missing(kind, values):
        message = f"{name} is given neither here nor under default"
        raise scenario.error(message, *path, at="key", code="missing_key", key=name)
    try:
        return kind(**values)
    except ParameterError as error:
        raise scenario.error(error.message, *path, error.key, code="bad_parameter", key=error.key) from None
