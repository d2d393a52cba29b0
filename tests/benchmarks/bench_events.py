"""What a descent to rest consists of: contact episodes, events of the law, trial steps, and where the time goes.

All of it is measured on the reference kernel in C, which makes the steps of the engine; see `bench_reference`. Shares
of the time need the profiler `perf`, and a kernel whose parts are not inlined, which is slower by about 15 %."""

import ctypes
import shutil
import subprocess
import sys

import numpy as np
import pytest

from tests.benchmarks.bench_engines import SLOPE, ensemble_of, row, scenario_of
from tests.benchmarks.bench_reference import in_turns
from tests.benchmarks.reference_kernel import compile_reference, compiler, run_reference

DESCENTS = 500  # a round
COUNTS = (  # as in reference/notes.h
    "flights", "strides of flights", "hops of a ball that rolls or slides", "steps within the guard",
    "steps with a search of the ground", "trial steps", "trial steps that are cut at an event",
    "trial steps that are halved", "events: loading, unloading, off the bottom", "events: stick, slip",
    "events: rolling spring at its limit or not",
)  # fmt: skip
PARTS = {  # functions of the kernel, and what they do; all others are "the rest"
    "flights": ("time_to_contact", "time_to_ground", "node_time", "gap_to_ground", "gap_to_found", "cross"),
    "search of the ground": ("step", "find_features", "offer", "point_depth", "near_depth", "set_anchor", "commit"),
    "trial steps": ("runge_kutta", "__sincos_fma", "__sincos", "__cos_fma", "__sin_fma"),
    "next event": ("hermite_root", "first_event", "first_loaded_event", "law_event", "place", "hop_s"),
    "energy and memory of a step": ("correct_energy", "step_error", "note_outcome", "commit_loaded", "follow_run"),
    "series of steps": ("fast_contact_steps", "load_active"),
}  # fmt: skip
PROFILED = """
import ctypes, sys
from tests.benchmarks.bench_events import descents
library, name, block_name = sys.argv[1:]
run = descents(name, block_name)
for _ in range(20):
    run(ctypes.CDLL(library))
"""


def descents(name, block_name):
    """A function that runs DESCENTS of a block with a library of the kernel."""
    scenario, states = scenario_of(name)
    ensemble, shared = ensemble_of(scenario, block_name)
    start = states[block_name][:DESCENTS]

    def run(library):
        return run_reference(library, ensemble, start, **shared)

    return run


def counted(library, run):
    """The counts of one descent, with `run`, which takes the library."""
    noted = np.ctypeslib.as_array((ctypes.c_double * len(COUNTS)).in_dll(library, "noted"))
    noted[:] = 0.0
    run(library)
    return dict(zip(COUNTS, noted / DESCENTS, strict=True))


def shares(folder, name, block_name):
    """Part -> share of the samples of a profile; empty where `perf` is not there, or may not look."""
    library, data = compile_reference(folder, "-DPARTS"), str(folder / "perf.data")
    record = ["perf", "record", "-q", "-e", "cpu-clock", "-F", "1999", "-o", data, sys.executable, "-c",
              PROFILED]  # fmt: skip
    report = ["perf", "report", "-q", "--stdio", "--no-children", "-i", data, "--sort", "dso,symbol", "-t;"]
    command = [*record, library._name, name, block_name]
    if shutil.which("perf") is None or subprocess.run(command, capture_output=True).returncode != 0:
        return {}
    text = subprocess.run(report, check=True, capture_output=True, text=True).stdout
    found: dict[str, float] = dict.fromkeys((*PARTS, "the rest"), 0.0)
    part_of = {function: part for part, functions in PARTS.items() for function in functions}
    for line in filter(None, map(str.strip, text.splitlines())):
        percent, dso, symbol, *_ = (cell.strip() for cell in line.split(";"))
        if dso.startswith(("reference", "libm")):
            function = symbol.split()[-1].split(".")[0]
            found[part_of.get(function, "the rest")] += float(percent.rstrip("%"))
    total = sum(found.values())
    return {part: own / total for part, own in found.items()}


@pytest.mark.parametrize(("name", "block_name"), SLOPE)
def test_events(benchmark, tmp_path, name, block_name):
    if compiler() is None:
        pytest.skip("no C compiler `cc`: no counts of events")
    plain, counting = compile_reference(tmp_path), compile_reference(tmp_path, "-DCOUNTS")
    run = descents(name, block_name)
    counts = counted(counting, run)
    cost = 1e6 * in_turns(benchmark, {"plain": lambda: run(plain)})["plain"] / DESCENTS
    found = shares(tmp_path, name, block_name)
    benchmark.extra_info["rows"] = [
        row("a descent, one thread", cost, "us"),
        row("a descent / its trial steps", cost / counts["trial steps"], "us"),
        row("contact episodes", [run(plain).impact_count.mean()]),
        *(row(what, [count]) for what, count in counts.items()),
        *(row(f"share of the time: {what}", [share]) for what, share in found.items()),
    ]
