"""A small site whose embankment a few balls reach: cheap enough to be simulated often."""

from __future__ import annotations

from pathlib import Path

from rock2d.files.scenario import Scenario, load_scenario

TEXT = """
name: small
engine: {engine}
releases: 20
seed: 3
cross_section:
  points_m: [[0, 20], [20, 0], [60, 0]]
  zones: [slope, run_out]
embankment: {{x_m: 26, height_m: 2.0, crest_m: 1.0, uphill_deg: 60, downhill_deg: 34}}
blocks:
  ball: {{shape: circle, diameter_m: 0.6, mass_kg: 305, inertia: solid_sphere}}
model:
  deterministic:
    default: {{k_l_N_m: 4.0e6, k_ul_N_m: 2.4e7, k_t_N_m: 1.0e6, friction_angle_deg: 30, k_r_Nm_rad: 4.0e3,
              rolling_cap: true}}
  probabilistic:
    default: {{default: {{friction_angle_deg: 10, momentum_half_kg_m_s: 3.0e3, tangential_restitution: 0.9}}}}
incident:
  default:
    distribution:
      x_m: {{uniform: {{low: 0.5, high: 2.0}}}}
      y_m: {{uniform: {{low: 22.0, high: 26.0}}}}
      vx_m_s: {{uniform: {{low: 1.0, high: 4.0}}}}
      vy_m_s: 0.0
"""
UNKNOWN = """
uncertainty:
  sites: 4
  releases: 40
  site:
    model.deterministic.default.k_ul_N_m: {times: {uniform: {low: 0.7, high: 1.3}}}
    model.deterministic.default.friction_angle_deg: {normal: {mean: 30, sd: 2}}
"""


def small_site(folder: Path, unknown: str = UNKNOWN, engine: str = "batch") -> Scenario:
    """The site, loaded from a file in `folder`."""
    path = folder / "small.yaml"
    path.write_text(TEXT.format(engine=engine) + unknown)
    return load_scenario(path)
