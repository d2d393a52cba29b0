"""Scenario files that tests write: a slope that runs out and what stands at its foot, cheap enough to be run often."""

from pathlib import Path

from rock2d.files.scenario import Scenario
from rock2d.files.scenario_reading import load_scenario

SHIPPED = Path(__file__).parents[1] / "scenarios"
TEXT = """
name: {name}
engine: {engine}
releases: {releases}
seed: {seed}
cross_section:
{ground}
{blocks}
model: {model}
incident:
  default:
    {incident}
{more}"""
SLOPE = "  points_m: [[0, 20], [20, 0], [60, 0]]\n  zones: [slope, run_out]\n"
EMBANKMENT = "embankment: {x_m: 26, height_m: 2.0, crest_m: 1.0, uphill_deg: 60, downhill_deg: 34}"
BALL = "{shape: circle, diameter_m: 0.6, mass_kg: 305, inertia: solid_sphere}"
ONE_BALL = f"blocks: {{ball: {BALL}}}"
LAWS = """
  deterministic:
    default: {k_l_N_m: 4.0e6, k_ul_N_m: 2.4e7, k_t_N_m: 1.0e6, friction_angle_deg: 30, k_r_Nm_rad: 4.0e3,
              rolling_cap: true}
  probabilistic:
    default: {default: {friction_angle_deg: 10, momentum_half_kg_m_s: 3.0e3, tangential_restitution: 0.9}}"""
THROWN = "x_m: {uniform: {low: 0.5, high: 2.0}}, y_m: {uniform: {low: 22.0, high: 26.0}}, "
THROWN += "vx_m_s: {uniform: {low: 1.0, high: 4.0}}, vy_m_s: 0.0"
UNKNOWN = """
uncertainty:
  sites: 4
  releases: 40
  site:
    model.deterministic.default.k_ul_N_m: {times: {uniform: {low: 0.7, high: 1.3}}}
    model.deterministic.default.friction_angle_deg: {normal: {mean: 30, sd: 2}}
"""


def scenario_file(
    folder: Path, name: str, *, engine: str = "batch", releases: int = 20, seed: int = 3,
    ground: str = SLOPE + EMBANKMENT, blocks: str = ONE_BALL, model: str = LAWS,
    incident: str = f"distribution: {{{THROWN}}}", more: str = "",
) -> Path:  # fmt: skip
    """A file of this name in `folder`: a ball that falls onto the slope above an embankment, but for what is given."""
    path = folder / f"{name}.yaml"
    path.write_text(TEXT.format(name=name, engine=engine, releases=releases, seed=seed, ground=ground, blocks=blocks,
                                model=model, incident=incident, more=more))  # fmt: skip
    return path


def small_site(folder: Path, unknown: str = UNKNOWN, engine: str = "batch") -> Scenario:
    """A small site whose embankment a few balls reach, loaded from `small.yaml` in `folder`."""
    return load_scenario(scenario_file(folder, "small", engine=engine, more=unknown))
