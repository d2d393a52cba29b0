"""Point masses on the same slope, beside PyRockfall (from PyPI), which runs in a process of its own.

It is never imported here. Install it into an environment of its own, and name its interpreter:

    ROCK2D_PEER_PYTHON=peers/bin/python make bench

PlatRock (from PyPI, too) is not run: it has to be built, with GDAL.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from time import process_time

import numba
import numpy as np
import pytest

from rock2d.engines.point_mass_batch import run_point_mass_batch
from tests.benchmarks.bench_engines import POINT_MASS, ROUNDS, row, scenario_of

PEER = os.environ.get("ROCK2D_PEER_PYTHON", sys.executable)
RELEASES = 2000  # a round of the peer
# restitution along the normal and the tangent, friction in degrees, roughness
REBOUND = [0.35, 0.85, 10.0, 0.0]
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


def test_point_masses(benchmark):
    """Both from starts of the same distribution, each with its own law of rebound; PyRockfall with one material."""
    find = "import importlib.util, sys; sys.exit(importlib.util.find_spec('pyrockfall') is None)"
    if subprocess.run([PEER, "-c", find], check=False).returncode != 0:
        pytest.skip("PyRockfall is not installed: no row of it; see bench_peers.py")
    scenario, states = scenario_of("slope_embankment")
    ground, block = scenario.make_cross_section(), scenario.make_blocks()["ball_1m"]
    law, threads = scenario.rebound_parameters(block), numba.get_num_threads()
    start = states["ball_1m"]
    many, seeds = np.resize(start, (POINT_MASS, 6)), np.arange(POINT_MASS, dtype=np.uint64)
    given = {
        "points_m": ground.points_m.tolist(), "starts_m": start[:, :2].tolist(), "material": REBOUND,
        "velocity_m_s": np.transpose([start.mean(axis=0), start.std(axis=0)])[3:5].tolist(),
        "mass_kg": block.mass_kg, "releases": RELEASES,
    }  # fmt: skip
    own, peer = [], []

    def a_round():
        begin = process_time()
        run_point_mass_batch(block, ground, law, many, seeds, time_limit_s=scenario.time_limit_s)
        own.append((process_time() - begin) / POINT_MASS)
        done = subprocess.run(
            [PEER, "-c", PYROCKFALL], input=json.dumps(given), text=True, capture_output=True, check=True
        )
        peer.append(float(done.stdout) / RELEASES)

    numba.set_num_threads(1)
    benchmark.pedantic(a_round, rounds=ROUNDS, warmup_rounds=1)
    numba.set_num_threads(threads)
    cost, beside = np.array(own[1:]), np.array(peer[1:])
    benchmark.extra_info["rows"] = [
        row("a point mass: PyRockfall / point-mass engine", beside / cost),
        row("PyRockfall, processor time of all its threads", 1 / beside, "releases/s"),
        row("point-mass engine, one thread", 1 / cost, "releases/s"),
    ]
