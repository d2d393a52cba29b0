"""How long a person waits for a command, and what of a first start is compiling.

Each round has the calibration kernel before it. With the variable ROCK2D_DATA, practice films are diagnosed, too."""

import os
import resource
import subprocess
import sys
from pathlib import Path

import pytest

from rock2d.effects import catalogue
from rock2d.files.experiment import write_experiment
from tests.benchmarks.bench_engines import row
from tests.benchmarks.calibration import kernel_s, wait
from tests.kinematics.synthetic_films import film, series_order, world
from tests.scenarios_of_tests import SHIPPED

ROCK2D = str(Path(sys.executable).with_name("rock2d"))
RUN = ("run", str(SHIPPED / "slope_embankment.yaml"), "--releases", "200", "--quiet", "--overwrite")
DESIGN = ("design", str(SHIPPED / "design_site.yaml"), "--range", "2", "8", "--quiet", "--overwrite")
COMMANDS = {  # what is measured: arguments without --out, rounds
    "rock2d --help": (("--help",), 5),
    "rock2d run slope_embankment, 200 releases, batch": ((*RUN, "--engine", "batch"), 5),
    "rock2d run slope_embankment, 200 releases, point_mass": ((*RUN, "--engine", "point_mass"), 5),
    "rock2d demo": (("demo", "--quiet"), 3),
    "rock2d design, one range, three blocks": (DESIGN, 3),
}
FILMED = 30  # releases of each block, in the generated film
PRACTICE = sorted(Path(os.environ.get("ROCK2D_DATA", os.devnull)).glob("practice/*/fit"))
FIRST = f"""
import numpy as np
from rock2d.files.scenario_reading import load_scenario
from rock2d.runs.conditions import incident_states
scenario = load_scenario({str(SHIPPED / "paper_setup.yaml")!r})
ground, block = scenario.make_cross_section(), scenario.make_blocks()["cube"]
states = np.array([s.state for s in incident_states(scenario, 1, 10) if s.block == "cube"])
"""
BATCH = """
from rock2d.laws.contact import contact_table
from rock2d.engines.batch import Ensemble, run_batch
table = contact_table(scenario.contact_parameters(block), ground.zone_names)
print(run_batch(Ensemble([block], [ground], [table]), states).ends[0])
"""
POINT_MASS = """
from rock2d.engines.point_mass import run_point_mass_batch
law = scenario.rebound_parameters(block)
print(run_point_mass_batch(block, ground, law, states, np.arange(10), time_limit_s=3.0).ends[0])
"""

PYMUNK = """
from rock2d.engines.pymunk_engine import run_pymunk
print(run_pymunk(block, ground, scenario.contact_parameters(block), states[0], time_limit_s=0.1).stop)
"""


def empty_cache(folder):
    """The environment of a first start: nothing is compiled yet."""
    environment = {**os.environ, "XDG_CACHE_HOME": str(folder)}
    environment.pop("NUMBA_CACHE_DIR", None)
    return environment


@pytest.mark.parametrize(
    ("what", "program"),
    [("batch engine", BATCH), ("point-mass ensemble", POINT_MASS), ("pymunk engine", PYMUNK)],
    ids=["batch", "point_mass", "pymunk"],
)
def test_compiling(benchmark, what, program, tmp_path):
    """Processor time of the first result with an empty cache, and what of it the second start does not need."""
    environment = empty_cache(tmp_path)

    def processor_s():
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        subprocess.run([sys.executable, "-c", FIRST + program], env=environment, check=True, capture_output=True)
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime

    first, second = benchmark.pedantic(lambda: (processor_s(), processor_s()), rounds=1)
    benchmark.extra_info["rows"] = [
        row(f"{what}: first start, processor time", [first], "s"),
        row(f"{what}: compiling, processor time", [first - second], "s"),
    ]


def timed(benchmark, what, arguments, rounds, environment=None):
    """Note how long `rock2d` takes with these arguments; without a warm-up if there is one round."""
    kernels: list[float] = []
    command = [ROCK2D, *arguments]

    def run():
        subprocess.run(command, check=True, capture_output=True, env=environment)

    benchmark.pedantic(run, setup=lambda: kernels.append(kernel_s()), rounds=rounds, warmup_rounds=int(rounds > 1))
    seconds = benchmark.stats.stats.data
    benchmark.extra_info["waits"] = [wait(what, seconds, kernels[-rounds:])]


@pytest.mark.parametrize("what", COMMANDS)
def test_command(benchmark, tmp_path, what):
    arguments, rounds = COMMANDS[what]
    out = () if "--help" in arguments else ("--out", str(tmp_path / "out"))
    timed(benchmark, what, (*arguments, *out), rounds)


def test_first_start(benchmark, tmp_path):
    arguments = ("demo", "--quiet", "--out", str(tmp_path / "out"))
    timed(benchmark, "rock2d demo, first start", arguments, 1, empty_cache(tmp_path))


def test_diagnosis(benchmark, tmp_path):
    tilted = catalogue()["camera_tilt"].apply(world(series_order(FILMED)), [0.03, 0.0, 0.0])
    write_experiment(tmp_path / "film", film(tilted, FILMED, seed=7))
    arguments = ("diagnose", str(tmp_path / "film"), "--out", str(tmp_path / "out"), "--quiet")
    timed(benchmark, f"rock2d diagnose, {2 * FILMED} generated releases", arguments, 3)


@pytest.mark.parametrize("folder", PRACTICE, ids=lambda folder: folder.parent.name)
def test_practice_film(benchmark, tmp_path, folder):
    arguments = ("diagnose", str(folder), "--out", str(tmp_path / "out"), "--quiet")
    timed(benchmark, f"rock2d diagnose, practice film {folder.parent.name}", arguments, 1)
