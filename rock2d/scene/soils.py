"""Soil classes: kinds of ground with numbers for both impact laws that hold for every block size.

`rock2d.laws.soil_scaling` computes the parameters of a law for a block from a class. docs/theory/soil-classes.md
derives the numbers and says which of them are assumed."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

ROCKYFOR3D = "Dorren (2016), Rockyfor3D (v5.2) revealed, soil type {}"
PAPER = "the paper, Tables 3 and 4"

ROUGHNESS_LENGTH_M = 0.5  # length of a piece of rough ground: the radius of a block of 1 m, for which α holds

Range = tuple[float, float]


@dataclass(frozen=True)
class SoilClass:
    """A class of ground.

    Attributes
    ----------
    name : name in scenario files
    description : what it looks like
    restitution, restitution_range : normal restitution at the reference impact, in (0, 1), and its range
    friction_angle_deg, friction_range_deg : friction angle of both laws, and its range
    stiffness, stiffness_range : κ = k_l d / (m g), without unit, and its range
    tangential_restitution : r_t of the rebound law, in [0, 1]
    slope_reduction_deg : roughness, for the rebound law: α, drawn from U(0, α) at every impact
    rolling_share : k_r / (k_l d²), without unit
    source : source of description and restitution
    assumed : the numbers that no source gives"""

    name: str
    description: str
    restitution: float
    restitution_range: Range
    friction_angle_deg: float
    friction_range_deg: Range
    stiffness: float
    stiffness_range: Range
    tangential_restitution: float
    slope_reduction_deg: float
    rolling_share: float
    source: str
    assumed: str

    @property
    def roughness_sd_deg(self) -> float:
        """Standard deviation σ = α / √3 of the local slope of rough ground, the root mean square of U(0, α), for pieces
        of length ROUGHNESS_LENGTH_M. Use it instead of `slope_reduction_deg`, not together with it."""
        return self.slope_reduction_deg / 3.0**0.5

    @property
    def obstacle_height_m(self) -> float:
        """Height in m of the obstacles that correspond to α: tan α = height / ROUGHNESS_LENGTH_M."""
        return ROUGHNESS_LENGTH_M * math.tan(math.radians(self.slope_reduction_deg))


ASSUMED = "stiffness, friction, tangential restitution, roughness"
# of each class: name, description / restitution, friction angle in ° and κ, each with its range / r_t, α in °, rolling
# share / source, assumed
_CLASSES = (
    SoilClass("swamp", "river, swamp, anything that a block sinks into",
              0.05, (0.03, 0.1), 20.0, (10.0, 30.0), 50.0, (25.0, 100.0), 0.5, 0.0, 0.004, ROCKYFOR3D.format(0),
              "restitution (0 in the source, which no law allows) and all other numbers"),
    SoilClass("deep_soil", "fine soil, deeper than about 1 m",
              0.23, (0.21, 0.25), 30.0, (26.0, 35.0), 100.0, (40.0, 250.0), 0.8, 8.0, 0.004,
              ROCKYFOR3D.format(1), ASSUMED),
    SoilClass("shallow_soil", "fine soil, less than about 1 m deep, or a mix of sand and gravel",
              0.28, (0.25, 0.31), 32.0, (30.0, 35.0), 200.0, (80.0, 400.0), 0.83, 10.0, 0.004,
              ROCKYFOR3D.format(2), ASSUMED),
    SoilClass("medium_scree", "scree of stones up to about 10 cm, medium compact soil with small stones, forest road",
              0.33, (0.3, 0.36), 35.0, (32.0, 40.0), 350.0, (150.0, 700.0), 0.85, 14.0, 0.004,
              ROCKYFOR3D.format(3), ASSUMED),
    SoilClass("coarse_talus", "talus of stones above about 10 cm, compact soil with large stones",
              0.38, (0.34, 0.42), 38.0, (34.0, 45.0), 600.0, (300.0, 1200.0), 0.87, 20.0, 0.004,
              ROCKYFOR3D.format(4), ASSUMED),
    SoilClass("covered_bedrock", "bedrock with a thin layer of weathered material or soil",
              0.43, (0.39, 0.47), 33.0, (28.0, 40.0), 1000.0, (500.0, 2000.0), 0.88, 14.0, 0.002, ROCKYFOR3D.format(5),
              f"{ASSUMED}, rolling"),
    SoilClass("bedrock", "bedrock",
              0.53, (0.48, 0.58), 30.0, (25.0, 40.0), 1700.0, (900.0, 3200.0), 0.9, 18.0, 0.001, ROCKYFOR3D.format(6),
              "friction, tangential restitution, roughness, rolling"),
    SoilClass("asphalt", "asphalt road",
              0.35, (0.32, 0.39), 35.0, (30.0, 40.0), 1000.0, (500.0, 2000.0), 0.9, 0.0, 0.001, ROCKYFOR3D.format(7),
              f"{ASSUMED}, rolling"),
    SoilClass("compacted_fill", "embankment of sand and gravel, compacted in layers",
              0.38, (0.3, 0.42), 30.0, (28.0, 40.0), 600.0, (200.0, 1160.0), 0.87, 0.0, 0.004,
              f"{PAPER}; restitution: {ROCKYFOR3D.format('3 to 4')}",
              "stiffness (its greatest value is that of Table 4), range of friction"),
)  # fmt: skip
SOIL_CLASSES: Mapping[str, SoilClass] = MappingProxyType({soil.name: soil for soil in _CLASSES})


def rough_zones(classes: Mapping[str, str]) -> dict[str, dict[str, float]]:
    """Zone -> keys `sd_deg` and `length_m` of its roughness, from zone -> soil class. Zones of smooth classes are left
    out."""
    sd_deg = {zone: round(SOIL_CLASSES[name].roughness_sd_deg, 2) for zone, name in classes.items()}
    return {zone: {"sd_deg": sd, "length_m": ROUGHNESS_LENGTH_M} for zone, sd in sd_deg.items() if sd > 0.0}
