"""Parameters of the impact laws for a block, from the soil classes and the numbers of a scenario file.

Values of a zone take precedence over values of all zones. For the same zone, numbers take precedence over a soil class.
Parameters that the file does not give come from the diagnosis, if there is one."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import fields, replace
from typing import TYPE_CHECKING, Any, NamedTuple

from rock2d.errors import ParameterError
from rock2d.files.checked_yaml import shown
from rock2d.files.scenario_keys import ContactKeys, ReboundKeys, SoilKeys
from rock2d.scene.blocks import Block
from rock2d.scene.soils import SOIL_CLASSES, SoilClass

if TYPE_CHECKING:
    from rock2d.files.scenario import Scenario
    from rock2d.laws.contact import ContactParameters
    from rock2d.laws.rebound import ReboundParameters


class _Given(NamedTuple):
    """Keys and parameters by zone, or default.

    Attributes
    ----------
    soils : parameters that the soil classes give for the block
    numbers : keys of the file for all blocks
    own : keys of the file for this block
    rest : what holds if the file gives nothing"""

    soils: Mapping[str, Any]
    numbers: Mapping[str, Any]
    own: Mapping[str, Any]
    rest: tuple[Any, ...]

    def values(self, zone: str, names: Sequence[str]) -> list[Any]:
        """The parameters of these names in a zone, each from the first place that gives it; None if none does."""
        places = (
            self.own.get(zone), self.own.get("default"), self.numbers.get(zone), self.soils.get(zone),
            self.numbers.get("default"), self.soils.get("default"), *self.rest,
        )  # fmt: skip
        giving = [place for place in places if place is not None]
        return [
            next((value for place in giving if (value := getattr(place, name, None)) is not None), None)
            for name in names
        ]


def contact_parameters(scenario: Scenario, block: Block) -> dict[str, ContactParameters]:
    """Zone name -> parameters of the deterministic law for `block`; "default" serves every other zone."""
    from rock2d.laws.contact import ContactParameters
    from rock2d.laws.soil_scaling import soil_contact

    model, diagnosed = scenario.model, scenario.diagnosed
    if model.deterministic is None and model.soils is None and diagnosed is None:
        message = "missing key 'deterministic', which the engines pymunk and batch need"
        raise scenario.error(message, "model", code="missing_key", key="deterministic")
    numbers = model.deterministic.named() if model.deterministic is not None else {}
    switches = ContactKeys(rolling_cap=False, rolling_in_indentation=False)
    rest = (switches,) if diagnosed is None else (diagnosed.model.soil, switches)
    given = _Given(_soils(scenario, soil_contact, block), numbers, {}, rest)
    return _by_zone(scenario, ContactParameters, given, "deterministic")


def rebound_parameters(scenario: Scenario, block: Block) -> dict[str, ReboundParameters]:
    """Zone name -> parameters of the probabilistic law for `block`; "default" serves every other zone."""
    from rock2d.laws.rebound import ReboundParameters
    from rock2d.laws.soil_scaling import soil_rebound

    model = scenario.model
    if model.probabilistic is None and model.soils is None:
        message = "missing key 'probabilistic', which engine point_mass needs"
        raise scenario.error(message, "model", code="missing_key", key="probabilistic")
    blocks = model.probabilistic.named() if model.probabilistic is not None else {}
    numbers, own = (blocks[name].named() if name in blocks else {} for name in ("default", block.name))
    rest = (ReboundKeys(slope_reduction_deg=0.0, slope_reduction="constant"),)
    given = _Given(_soils(scenario, soil_rebound, block), numbers, own, rest)
    return _by_zone(scenario, ReboundParameters, given, "probabilistic", block.name)


def _soils(scenario: Scenario, law: Any, block: Block) -> dict[str, Any]:
    """Zone name, or default -> parameters that the soil class gives for the block."""
    soils = scenario.model.soils or {}
    return {zone: law(_soil(soil), block.mass_kg, block.size_m) for zone, soil in soils.items()}


def _soil(given: str | SoilKeys) -> SoilClass:
    if isinstance(given, str):
        return SOIL_CLASSES[given]
    return replace(SOIL_CLASSES[given.like], **given.model_dump(exclude_none=True, exclude={"like"}))


def _by_zone(scenario: Scenario, kind: Any, given: _Given, law: str, *block: str) -> dict[str, Any]:
    """Zone name -> parameters of class `kind`, whose keys in the file are `law` and `block`. "default" may be missing
    if every zone has its own soil class or numbers."""
    names = [field.name for field in fields(kind)]
    zones = list(dict.fromkeys(("default", *given.numbers, *given.own, *given.soils)))
    if given.soils and "default" not in given.soils and None in given.values("default", names):
        for zone in scenario.make_cross_section().zone_names:
            if zone not in zones:
                message = f"zone {shown(zone)} has no soil class, neither its own nor a default"
                raise scenario.error(message, "model", "soils", at="key", code="missing_key", key=zone)
        zones.remove("default")
    out = {}
    for zone in zones:
        path = ("model", law, *(block if zone in given.own else ("default",) * len(block)), zone)
        values = given.values(zone, names)
        if None in values:
            name = names[values.index(None)]
            message = f"{name} is given neither here nor under default"
            raise scenario.error(message, *path, at="key", code="missing_key", key=name)
        try:
            out[zone] = kind(*values)
        except ParameterError as error:
            raise scenario.error(error.message, *path, error.key, code="bad_parameter", key=error.key) from None
    return out
