"""Parameters of the impact laws for a block, from the soil classes and the numbers of a scenario file.

Values of a zone take precedence over values of all zones. For the same zone, numbers take precedence over a soil class.
Parameters that the file does not give come from the diagnosis, if there is one."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

from rock2d.files.scenario_keys import Soil, SoilKeys
from rock2d.scene.blocks import Block
from rock2d.scene.soils import SOIL_CLASSES, SoilClass


class GivenParameters(NamedTuple):
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


def of_soils(soils: Mapping[str, Soil] | None, law: Any, block: Block) -> dict[str, Any]:
    """Zone name, or default -> parameters that the soil class gives for the block, by a law of `laws.soil_scaling`."""
    return {zone: law(_soil(soil), block.mass_kg, block.size_m) for zone, soil in (soils or {}).items()}


def _soil(given: str | SoilKeys) -> SoilClass:
    if isinstance(given, str):
        return SOIL_CLASSES[given]
    return replace(SOIL_CLASSES[given.like], **given.model_dump(exclude_none=True, exclude={"like"}))
