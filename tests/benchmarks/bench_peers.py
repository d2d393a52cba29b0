"""Point masses on the same slope, beside PyRockfall and PlatRock (both from PyPI), which run in processes of their own.

They are never imported here. Install one of them or both into an environment of their own, and name its interpreter:

    ROCK2D_PEER_PYTHON=peers/bin/python make bench

PlatRock builds a part of itself, and needs GDAL (its 2D model does not). It loads a model of trees from the network as
soon as a simulation is made; there are no trees here, so that is left out."""

import json
import os
import subprocess
import sys
from time import process_time

import numba
import numpy as np
import pytest

from rock2d.engines.point_mass import run_point_mass_batch
from tests.benchmarks.bench_engines import POINT_MASS, ROUNDS, row, scenario_of
from tests.benchmarks.calibration import wait

PEER = os.environ.get("ROCK2D_PEER_PYTHON", sys.executable)
# restitution along the normal and the tangent, friction in degrees, roughness
REBOUND = [0.35, 0.85, 10.0, 0.0]
HALF_M_S = 8.0  # normal speed at which half of it is restituted
# What it is given comes on standard input; the processor time in s of each round goes to standard output.
PYROCKFALL = """
import json, sys, time
import numpy as np
from pyrockfall import Analysis, Geometry, Material, Rock, Seeder, Slope, stats

given = json.load(sys.stdin)
ground = Slope(Geometry(np.array(given["points_m"])), Material("", *given["material"]))
for n in (10, given["releases"]):  # the first to warm up
    seeder = Seeder(np.array(given["starts_m"]).T, [Rock("", given["mass_kg"], 2700.0)])
    seeder.translationalVelocity = [stats.Normal(*v) for v in given["velocity_m_s"]]
    seeder.numberOfRocks = n
    analysis = Analysis()
    analysis.slope, analysis.seeders = ground, [seeder]
    begin = time.process_time()
    analysis.run()
print(time.process_time() - begin)
"""


PLATROCK = """
import json, os, sys, tempfile, time
given = json.load(sys.stdin)
folder = tempfile.TemporaryDirectory()
os.chdir(folder.name)
import platrock
import platrock.Common.BounceModels as models
from platrock.TwoD import Objects, Simulations

models.Toe_Tree_2022.__init__ = lambda self: None
platrock.SICONOS_FOUND = False
names = ["X", "Z", "bounce_model_number", "R_n", "R_t", "phi", "roughness", "v_half"]
left = given["points_m"][0][0]
with open("ground.csv", "w") as file:
    print(*names, sep="\\t", file=file)
    for x, z in given["points_m"]:
        print(x - left, z, 2, *given["material"], given["half_m_s"], sep="\\t", file=file)
(low_x, high_x), (low_z, high_z) = given["starts_range_m"]
volume, (vx, vz) = given["mass_kg"] / 2700.0, [mean for mean, _ in given["velocity_m_s"]]
rocks = {
    "rocks_min_vol": volume, "rocks_max_vol": volume, "rocks_density": 2700.0, "rocks_vx": vx, "rocks_vz": vz,
    "rocks_min_x": low_x - left, "rocks_max_x": high_x - left, "rocks_min_z": low_z, "rocks_max_z": high_z,
}
for n in (10, given["releases"]):  # the first to warm up
    run = Simulations.Simulation(
        terrain=Objects.Terrain("ground.csv"), gravity=9.81, enable_forest=False, name="run",
        rocks_start_params=rocks | {"nb_rocks": n},
    )
    os.makedirs("run", exist_ok=True)
    begin = time.process_time()
    run.run()
    spent = time.process_time() - begin
    assert run.status == "finished", run.status
print(spent)
"""
PEERS = {"PyRockfall": (PYROCKFALL, 2000), "PlatRock": (PLATROCK, 100)}  # script, releases a round


@pytest.mark.parametrize("peer_name", PEERS)
def test_point_masses(benchmark, peer_name):
    """Both from starts of the same distribution or range, each with its own law of rebound; the peers with one material
    (PlatRock with the law of Bourrier and Hungr)."""
    find = f"import importlib.util, sys; sys.exit(importlib.util.find_spec('{peer_name.lower()}') is None)"
    if subprocess.run([PEER, "-c", find], check=False).returncode != 0:
        pytest.skip(f"{peer_name} is not installed: no row of it; see bench_peers.py")
    script, releases = PEERS[peer_name]
    scenario, states = scenario_of("slope_embankment")
    ground, block = scenario.make_cross_section(), scenario.make_blocks()["ball_1m"]
    law, threads = scenario.rebound_parameters(block), numba.get_num_threads()
    start = states["ball_1m"]
    many, seeds = np.resize(start, (POINT_MASS, 6)), np.arange(POINT_MASS, dtype=np.uint64)
    x, surface_m = start[:, 0], np.interp(start[:, 0], *ground.points_m.T)
    height = start[:, 1] - surface_m
    given = {
        "points_m": ground.points_m.tolist(), "starts_m": start[:, :2].tolist(), "material": REBOUND,
        "velocity_m_s": np.transpose([start.mean(axis=0), start.std(axis=0)])[3:5].tolist(),
        "starts_range_m": [[x.min(), x.max()], [height.min(), height.max()]],
        "mass_kg": block.mass_kg, "half_m_s": HALF_M_S, "releases": releases,
    }  # fmt: skip
    own, peer = [], []

    def a_round():
        begin = process_time()
        run_point_mass_batch(block, ground, law, many, seeds, time_limit_s=scenario.time_limit_s)
        own.append((process_time() - begin) / POINT_MASS)
        options = {"input": json.dumps(given), "text": True, "capture_output": True, "check": True}
        done = subprocess.run([PEER, "-c", script], **options)
        peer.append(float(done.stdout.split()[-1]) / releases)

    numba.set_num_threads(1)
    benchmark.pedantic(a_round, rounds=ROUNDS, warmup_rounds=1)
    numba.set_num_threads(threads)
    cost, beside = np.array(own[1:]), np.array(peer[1:])
    benchmark.extra_info["rows"] = [
        row(f"a point mass: {peer_name} / point-mass engine", beside / cost),
        row(f"{peer_name}, processor time of all its threads", 1 / beside, "releases/s"),
        row("point-mass engine, one thread", 1 / cost, "releases/s"),
    ]
    benchmark.extra_info["waits"] = [wait("a point mass, one thread", cost, beside, peer_name)]
