"""A scenario file for a profile. It is complete and runs; comments mark everything that is assumed."""

import json
import re
from collections.abc import Mapping, Sequence

import numpy as np

from rock2d.arrays import Array
from rock2d.files.surveys.profile import Profile
from rock2d.files.surveys.release_area import ReleaseArea
from rock2d.files.surveys.zones import DEFAULT_ZONE
from rock2d.scene.cross_section import BACK_ZONE, CREST_ZONE, FACING_ZONE
from rock2d.scene.soils import ROUGHNESS_LENGTH_M, SOIL_CLASSES, rough_zones

DEFAULT_CLASS = "medium_scree"
FILL_CLASS = "compacted_fill"  # of an embankment
EMBANKMENT_ZONES = (FACING_ZONE, CREST_ZONE, BACK_ZONE)
CLASS_OF_WORD = {
    "rock": "bedrock", "cliff": "bedrock", "scree": "medium_scree", "talus": "coarse_talus", "meadow": "deep_soil",
    "soil": "deep_soil", "run_out": "deep_soil", "road": "asphalt", "forest": "shallow_soil",
}  # fmt: skip
WORDS_OF_YAML = ("null", "true", "false", "yes", "no", "on", "off", "y", "n")
ABOUT_ROUGHNESS = f"""\
# Rough ground: sd_deg is the slope reduction of the soil class over the root of 3, an assumed number (documentation,
# Soil classes). Pieces are as long as the radius of a block of 1 m. If you have mapped the heights h of obstacles, as
# Rockyfor3D asks for (rg70, rg20, rg10), sd_deg is arctan(h / {ROUGHNESS_LENGTH_M:g} m) / 1.73. Point masses take the
# slope reduction instead.
"""
DIAMETER_M, DENSITY_KG_M3, DROP_M = 1.0, 2700.0, 1.0


def likely_class(zone: str) -> str:
    """The soil class that the name of a zone suggests, else the default class."""
    if zone in SOIL_CLASSES:
        return zone
    if zone in EMBANKMENT_ZONES:
        return FILL_CLASS
    return next((soil for word, soil in CLASS_OF_WORD.items() if word in zone.lower()), DEFAULT_CLASS)


def template_text(
    profile: Profile, name: str, ground: tuple[Array, Sequence[str]], start: ReleaseArea, smooth: bool = False
) -> str:
    """The text of a scenario file for this profile: a ball of 1 m starts in the release area `start`, on rough ground
    unless `smooth`. `ground` is the points (n, 2) in m and the zones (n - 1) of the facets."""
    points, names = ground
    left, right = points[0, 0], points[-1, 0]
    mass = DENSITY_KG_M3 * np.pi / 6.0 * DIAMETER_M**3
    pairs = ", ".join(f"[{x:z.3f}, {y:z.3f}]" for x, y in points)
    remarks = "".join(f"# {remark}\n" for remark in profile.remarks)
    classes = {zone: likely_class(zone) for zone in dict.fromkeys(names)}
    fill = "".join(f"    # {zone}: {FILL_CLASS}\n" for zone in EMBANKMENT_ZONES if zone not in classes)
    return f"""# Profile from {profile.source}.
{remarks}name: {_key(name)}
about: A ball of 1 m on a profile; everything except the profile is a first guess.
assumed:
  - "Blocks, soil and start are first guesses: replace them."
  - "Soil classes by the names of the zones; rock2d soils lists them."
  - "{"Smooth ground." if smooth else "Roughness of the ground by soil class."}"
engine: batch
releases: 200
seed: 1
cross_section:
  points_m: [{pairs}]
  zones: [{", ".join(map(_key, names))}]
# An embankment: remove the # at the beginning of the lines, and set the sizes.
# embankment: {{x_m: {left + 0.8 * (right - left):.1f}, height_m: 4, crest_m: 3, uphill_deg: 60, downhill_deg: 34}}
# ditch: {{width_m: 5, depth_m: 0.5, uphill_deg: 45}}
blocks:
  ball: {{shape: circle, diameter_m: {DIAMETER_M:g}, mass_kg: {mass:.0f}, inertia: solid_sphere}}
model:
  soils:
    default: {DEFAULT_CLASS}
    # The embankment, if it is of compacted soil:
{fill}{_soils_and_roughness(classes, smooth)}incident:
  default:
    above_ground:
      # {start.why}
      x_m: {{uniform: {{low: {start.low_m:z.3f}, high: {start.high_m:z.3f}}}}}
      clearance_m: {{uniform: {{low: 0.1, high: {DROP_M:g}}}}}
      theta_rad: {{uniform: {{low: -3.14159, high: 3.14159}}}}
      vx_m_s: 0.5
      vy_m_s: 0.0
outputs: {{fps: 50}}
"""


def _soils_and_roughness(classes: Mapping[str, str], smooth: bool) -> str:
    """The soil of each zone and, unless `smooth`, its roughness."""
    rough = {} if smooth else rough_zones(classes)
    soils = "".join(f"    {_key(zone)}: {soil}\n" for zone, soil in classes.items() if zone != DEFAULT_ZONE)
    if not rough:
        return soils
    lines = "".join(
        f"  {_key(zone)}: {{sd_deg: {keys['sd_deg']:g}, length_m: {keys['length_m']:g}}}"
        f"  # obstacles of {SOIL_CLASSES[classes[zone]].obstacle_height_m:.2f} m\n"
        for zone, keys in rough.items()
    )
    return f"{soils}{ABOUT_ROUGHNESS}roughness:\n{lines}"


def _key(name: str) -> str:
    """A name in YAML, in quotes unless it is a plain word."""
    plain = re.fullmatch(r"[A-Za-z_][\w-]*", name) and name.lower() not in WORDS_OF_YAML
    return name if plain else json.dumps(name, ensure_ascii=False)
