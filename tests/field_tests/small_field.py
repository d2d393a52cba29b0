"""A field test on a slope of 60 m that the project's own engine has made: cheap, and its soil is known."""

from pathlib import Path

import numpy as np

TRUE_RESTITUTION = 0.45
SCENARIO = """
name: small_field
engine: batch
releases: 20
seed: 3
time_limit_s: 60
field_test:
  folder: small
  block_ids: {cube: 1, box: 2}
  zones: {slope: 15, run_out: -90}
  edge_m: 4
  beyond_deg: 0
  calibrate_on: [cube]
blocks:
  cube: {shape: square, side_m: 0.5, mass_kg: 300, inertia: uniform}
  box:
    shape: polygon
    vertices_m: [[0.25, -0.2], [0.25, 0.2], [-0.25, 0.2], [-0.25, -0.2]]
    mass_kg: 200
    inertia: uniform
model:
  soils:
    default: medium_scree
    slope: {like: medium_scree, restitution: 0.45, friction_angle_deg: 30}
    run_out: {like: deep_soil, restitution: 0.2}
roughness:
  slope: {sd_deg: 8, length_m: 1.0}
  run_out: {sd_deg: 10, length_m: 1.0}
incident:
  default:
    above_ground:
      x_m: 0.0
      clearance_m: {uniform: {low: 0.0, high: 0.2}}
      theta_rad: {uniform: {low: -3, high: 3}}
      vx_m_s: 1.0
      vy_m_s: 0.0
uncertainty:
  sites: 4
  releases: 20
  site:
    model.soils.slope.restitution: {uniform: {low: 0.1, high: 0.8}}
    roughness.run_out.sd_deg: {uniform: {low: 3, high: 18}}
"""
HEADER = "release,block_id,mass_kg,release_x_m,release_y_m,release_ground_m,stop_x_m,stop_y_m,stop_ground_m"


def write_terrain(folder: Path) -> None:
    """A slope of 35 degrees towards the east that ends at x = 50 m in level ground; cells of 5 m."""
    x = np.arange(-47.5, 150.0, 5.0)
    heights = np.maximum((50.0 - x) * np.tan(np.radians(35.0)), 0.0)
    rows = "\n".join(" ".join(f"{height:.6f}" for height in heights) for _ in range(12))
    head = f"ncols {len(x)}\nnrows 12\nxllcorner -50\nyllcorner -30\ncellsize 5\nnodata_value -9999\n"
    (folder / "terrain.asc").write_text(head + rows + "\n")


def write_releases(file: Path, distances: dict[str, list[float]]) -> None:
    """Releases at (0, 0) whose blocks stop at these distances, 5 degrees to the left and to the right in turn."""
    rows, ids = [HEADER], {"cube": 1, "box": 2}
    for block, own in distances.items():
        for i, distance in enumerate(own):
            turn = np.radians(5.0) * (-1) ** i
            x, y = distance * np.cos(turn), distance * np.sin(turn)
            rows.append(f"{block}{i},{ids[block]},100,0,0,35,{x:.6f},{y:.6f},0")
    file.write_text("\n".join(rows) + "\n")


def write_field(root: Path, distances: dict[str, list[float]]) -> Path:
    """The scenario file of a field test with these stops; its data lie in root/small."""
    folder = root / "small"
    folder.mkdir(parents=True, exist_ok=True)
    write_terrain(folder)
    write_releases(folder / "releases.csv", distances)
    (root / "small.yaml").write_text(SCENARIO)
    return root / "small.yaml"
