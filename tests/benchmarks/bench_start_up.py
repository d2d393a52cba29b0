"""How long a user waits: from the start of a process to its first result, with compiled code in the cache."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest
from bench_engines import FOLDER, row

ROUNDS = 5
FIRST = f"""
import numpy as np
from rock2d.files.scenario import load_scenario
from rock2d.runs.conditions import incident_states
scenario = load_scenario({str(FOLDER / "paper_setup.yaml")!r})
ground, block = scenario.make_cross_section(), scenario.make_blocks()["cube"]
states = np.array([s.state for s in incident_states(scenario, 1, 10) if s.block == "cube"])
"""
BATCH = """
from rock2d.laws.contact import parameter_table
from rock2d.engines.batch import Ensemble, run_batch
table = parameter_table(scenario.contact_parameters(block), ground.zone_names)
print(run_batch(Ensemble([block], [ground], [table]), states).ends[0])
"""
POINT_MASS = """
from rock2d.engines.point_mass_batch import run_point_mass_batch
law = scenario.rebound_parameters(block)
print(run_point_mass_batch(block, ground, law, states, np.arange(10), time_limit_s=3.0).ends[0])
"""


@pytest.mark.parametrize(
    ("what", "command"),
    [
        ("ten releases of the batch engine", [sys.executable, "-c", FIRST + BATCH]),
        ("ten releases of the point-mass ensemble", [sys.executable, "-c", FIRST + POINT_MASS]),
        ("rock2d --help", [str(Path(sys.executable).with_name("rock2d")), "--help"]),
    ],
    ids=["batch", "point_mass", "help"],
)
def test_start_to_first_result(benchmark, what, command):
    # the first start, which may have to compile, warms up
    benchmark.pedantic(
        subprocess.run, (command,), {"check": True, "capture_output": True}, rounds=ROUNDS, warmup_rounds=1
    )
    benchmark.extra_info["rows"] = [row(what, benchmark.stats.stats.data, "s")]
