"""What runs in the interpreter of the peers for `compare_peers`: a set-up as JSON in, legs of each release out.

A leg goes from one contact to the next: x, y, vx, vy after the first, x of the second, whether the block rolls or
slides, v² at the end if so. Nothing of the peers is changed, except that PlatRock stores its output in double
precision, loads no model of trees, and draws the greatest angle of roughness each time where the angle is constant."""

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np

LEG_NUMBERS = 7

PLATROCK = """
import json, os, sys, tempfile
given = json.load(sys.stdin)
os.chdir(tempfile.mkdtemp())
import numpy as np
import platrock
import platrock.Common.BounceModels as models
from platrock.Common import Outputs
from platrock.TwoD import Objects, Simulations

models.Toe_Tree_2022.__init__ = lambda self: None  # else it loads a model of trees from the network
platrock.SICONOS_FOUND, Outputs.float_type = False, np.float64
radius, gravity = given["radius_m"], given["gravity"]
roughness = radius * np.tan(np.radians(given["alpha_deg"]))
values = [given[key] for key in ("model", "r_n", "r_t", "phi_deg", "half_m_s", "mu_r")] + [roughness]
with open("ground.csv", "w") as file:
    print("X", "Z", "bounce_model_number", "R_n", "R_t", "phi", "v_half", "mu_r", "roughness", sep="\\t", file=file)
    for point in given["points_m"]:
        print(*point, *map(repr, map(float, values)), sep="\\t", file=file)
starts = np.array(given["starts_m"])
volume, (vx, vz) = 4 / 3 * np.pi * radius**3, given["velocity_m_s"]
run = Simulations.Simulation(
    terrain=Objects.Terrain("ground.csv"), gravity=gravity, enable_forest=False, name="run", random_seed=given["seed"],
    rocks_start_params={"nb_rocks": len(starts), "rocks_min_vol": volume, "rocks_max_vol": volume,
                        "rocks_density": given["density"], "rocks_vx": vx, "rocks_vz": vz},
)
run.rocks_start_x, run.rocks_start_z = starts.T
if given["angle"] == "constant":  # the angle of roughness is rand() times its greatest
    run.random_generator = type("Greatest", (), {"rand": lambda self: 1.0})()
os.makedirs("run")
run.run()
assert run.status == "finished", run.status
result = []
for i in range(len(starts)):
    kind, at, v = run.output.get_contacts_types(i), run.output.get_contacts_pos(i), run.output.get_contacts_vels(i)
    rolls, square = kind[:-1] == Outputs.ROLL, (v[:-1] ** 2).sum(axis=1)
    (dx, dy) = np.diff(at, axis=0).T
    end = np.maximum(square + 10 / 7 * gravity * (-dy - given["mu_r"] * abs(dx)), 0.0)
    result.append(np.column_stack([at[:-1], v[:-1], at[1:, 0], rolls, end]).tolist())
print()
print(json.dumps(result))
"""

PYROCKFALL = """
import json, sys
given = json.load(sys.stdin)
import numpy as np
from pyrockfall import Analysis, Geometry, Material, Rock, Seeder, Slope, stats

points, starts = np.array(given["points_m"], float), np.array(given["starts_m"])
angle = given["alpha_deg"] if given["angle"] == "constant" else stats.Uniform(0.0, given["alpha_deg"])
soil = Material("", given["r_n"], given["r_t"], given["slide_deg"], angle)
at = np.array([starts[:, 0], np.interp(starts[:, 0], *points.T) + starts[:, 1]])
mass = given["density"] * 4 / 3 * np.pi * given["radius_m"] ** 3
seeder = Seeder(at, [Rock("", mass, given["density"])])
seeder.translationalVelocity, seeder.numberOfRocks = given["velocity_m_s"], len(starts)
analysis = Analysis()
analysis.slope, analysis.seeders, analysis.gravity = Slope(Geometry(points), soil), [seeder], -given["gravity"]
analysis.useSpecificSeed, analysis.specificSeed, analysis.maxIter = True, given["seed"], 4000
np.random.seed(given["seed"])  # of the angles
analysis.run()
paths = analysis.trajectories
t, x, v, a = paths.timeHistory, paths.positionHistory, paths.velocityHistory, paths.accelerationHistory
result = []
for i in range(len(starts)):
    moved = np.flatnonzero(np.diff(t[:, i]) > 0.0)
    dt, end = np.diff(t[:, i])[moved, None], v[moved + 1, :, i]
    begin, slides = end - a[moved + 1, :, i] * dt, a[moved + 1, 1, i] != -given["gravity"]
    rows = [x[moved, :, i], begin, x[moved + 1, :1, i], slides[:, None], (end**2).sum(axis=1)[:, None]]
    result.append(np.hstack(rows).tolist())
print(json.dumps(result))
"""

PEERS = {"PlatRock": PLATROCK, "PyRockfall": PYROCKFALL}


def peer_legs(name, given):
    """Legs (n, LEG_NUMBERS) of each release, from a peer in a process of its own."""
    python = os.environ.get("ROCK2D_PEER_PYTHON", sys.executable)
    beside = {"PATH": f"{Path(python).absolute().parent}{os.pathsep}{os.environ['PATH']}"}
    command = [python, "-c", PEERS[name.split(",")[0]]]
    done = subprocess.run(
        command, input=json.dumps(given), text=True, capture_output=True, env=os.environ | beside, check=False
    )
    if done.returncode != 0:
        why = (done.stderr.strip() or done.stdout.strip()).splitlines()[-1]
        print(
            f"{name} does not run in {python}; name an interpreter that has it by ROCK2D_PEER_PYTHON: {why}",
            file=sys.stderr,
        )
        raise SystemExit(2)
    return [np.array(legs).reshape(-1, LEG_NUMBERS) for legs in json.loads(done.stdout.splitlines()[-1])]
