"""How long a user waits: from the start of a process to its first result, with compiled code in the cache."""

from __future__ import annotations

import os
import resource
import subprocess
import sys
from pathlib import Path

import pytest

from tests.benchmarks.bench_engines import row
from tests.scenarios_of_tests import SHIPPED

ROUNDS = 5
FIRST = f"""
import numpy as np
from rock2d.files.scenario import load_scenario
from rock2d.runs.conditions import incident_states
scenario = load_scenario({str(SHIPPED / "paper_setup.yaml")!r})
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

PYMUNK = """
from rock2d.engines.pymunk_engine import run_pymunk
print(run_pymunk(block, ground, scenario.contact_parameters(block), states[0], time_limit_s=0.1).stop)
"""


@pytest.mark.parametrize(
    ("what", "program"),
    [("batch engine", BATCH), ("point-mass ensemble", POINT_MASS), ("pymunk engine", PYMUNK)],
    ids=["batch", "point_mass", "pymunk"],
)
def test_compiling(benchmark, what, program, tmp_path):
    """Processor time of the first result with an empty cache, and what of it the second start does not need."""
    environment = {**os.environ, "XDG_CACHE_HOME": str(tmp_path)}
    environment.pop("NUMBA_CACHE_DIR", None)

    def processor_s():
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        subprocess.run(
            [sys.executable, "-c", FIRST + program], env=environment, check=True, capture_output=True
        )
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime

    first, second = benchmark.pedantic(lambda: (processor_s(), processor_s()), rounds=1)
    benchmark.extra_info["rows"] = [
        row(f"{what}: first start, processor time", [first], "s"),
        row(f"{what}: compiling, processor time", [first - second], "s"),
    ]


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
