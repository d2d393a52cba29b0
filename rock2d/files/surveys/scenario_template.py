"""The scenario that starts from a profile: complete, so that it runs, and with everything marked that is assumed."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from rock2d.errors import InputError
from rock2d.files.surveys.profile import Profile
from rock2d.scene.soils import SOIL_CLASSES

Array = np.ndarray

DEFAULT_ZONE = "slope"
RELEASE_SHARE = 0.05  # share of the length, at the top, in which blocks start
DEFAULT_CLASS = "medium_scree"
CLASS_OF_WORD = {
    "rock": "bedrock", "cliff": "bedrock", "scree": "medium_scree", "talus": "coarse_talus", "meadow": "deep_soil",
    "soil": "deep_soil", "run_out": "deep_soil", "road": "asphalt", "forest": "shallow_soil",
}  # fmt: skip
DIAMETER_M, DENSITY_KG_M3, DROP_M = 1.0, 2700.0, 1.0


class ZoneRange(NamedTuple):
    """A zone between two stations in m."""

    start_m: float
    end_m: float
    name: str


def facets_with_zones(points_m: Array, zones: Sequence[ZoneRange]) -> tuple[Array, list[str]]:
    """The points with further ones where a zone begins or ends, and the zone of each facet; facets in no range are
    "slope". Raises InputError if ranges overlap."""
    ordered = sorted(zones)
    for one, other in itertools.pairwise(ordered):
        if other.start_m < one.end_m:
            raise InputError(f"zones {one.name} and {other.name} overlap at {other.start_m:g} m")
    x = points_m[:, 0]
    if ordered and not (np.diff(x) > 0.0).all():
        raise InputError(
            "a profile with overhangs or vertical faces has no zones by station: edit the scenario instead"
        )
    bounds = [bound for zone in ordered for bound in zone[:2] if x[0] < bound < x[-1]]
    stations = np.union1d(x, bounds) if ordered else x
    points = np.column_stack([stations, np.interp(stations, x, points_m[:, 1])]) if ordered else points_m
    names = []
    for middle in 0.5 * (points[1:, 0] + points[:-1, 0]):
        names.append(next((z.name for z in ordered if z.start_m <= middle <= z.end_m), DEFAULT_ZONE))
    return points, names


def _likely_class(zone: str) -> str:
    """The soil class that the name of a zone suggests, else the default."""
    if zone in SOIL_CLASSES:
        return zone
    return next((soil for word, soil in CLASS_OF_WORD.items() if word in zone.lower()), DEFAULT_CLASS)


def scenario_of(profile: Profile, name: str, zones: Sequence[ZoneRange] = ()) -> str:
    """The text of a scenario file on this profile: a ball of 1 m from its upper end."""
    points, names = facets_with_zones(profile.points_m, zones)
    left, right = points[0, 0], points[-1, 0]
    low, high = left + 0.2 * RELEASE_SHARE * (right - left), left + RELEASE_SHARE * (right - left)
    mass = DENSITY_KG_M3 * np.pi / 6.0 * DIAMETER_M**3
    pairs = ", ".join(f"[{x:.3f}, {y:.3f}]" for x, y in points)
    remarks = "".join(f"# {remark}\n" for remark in profile.remarks)
    own = "".join(
        f"    {zone}: {_likely_class(zone)}\n" for zone in dict.fromkeys(names) if zone != DEFAULT_ZONE
    )
    return f"""# Profile from {profile.source}.
{remarks}name: {name}
about: A ball of 1 m on a profile; everything but the profile is a first guess.
assumed:
  - "Blocks, soil and start are first guesses: replace them."
  - "Soil classes by the names of the zones; rock2d soils lists them."
engine: batch
releases: 200
seed: 1
cross_section:
  points_m: [{pairs}]
  zones: [{", ".join(names)}]
# An embankment: remove the signs at the beginning of the lines, and set the sizes.
# embankment: {{x_m: {left + 0.8 * (right - left):.1f}, height_m: 4, crest_m: 3, uphill_deg: 60, downhill_deg: 34}}
# ditch: {{width_m: 5, depth_m: 0.5, uphill_deg: 45}}
blocks:
  ball: {{shape: circle, diameter_m: {DIAMETER_M:g}, mass_kg: {mass:.0f}, inertia: solid_sphere}}
model:
  soils:
    default: {DEFAULT_CLASS}
{own}incident:
  default:
    above_ground:
      x_m: {{uniform: {{low: {low:.3f}, high: {high:.3f}}}}}
      clearance_m: {{uniform: {{low: 0.1, high: {DROP_M:g}}}}}
      theta_rad: {{uniform: {{low: -3.14159, high: 3.14159}}}}
      vx_m_s: 0.5
      vy_m_s: 0.0
outputs: {{fps: 50}}
"""
