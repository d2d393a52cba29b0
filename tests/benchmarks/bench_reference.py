"""How far the batch engine is from the limit of its arithmetic: the same algorithm in plain C on the same releases.

See `bench_engines` for how numbers are taken; these are of one thread, in processor time."""

from time import process_time

import numba
import numpy as np
import pytest

from rock2d.engines.batch import run_batch
from tests.benchmarks.bench_engines import ROUNDS, SETUP, SLOPE, ensemble_of, row, scenario_of
from tests.benchmarks.calibration import wait
from tests.benchmarks.reference_kernel import compile_reference, compiler, run_reference

COMPARED = 300  # releases a round
AGREEING = {"first": 0.999, "passings": 0.98}  # least shares of releases: roundings differ, and grow with every impact
AGREES = 1e-9  # relative and absolute


@pytest.fixture
def one_thread():
    threads = numba.get_num_threads()
    numba.set_num_threads(1)
    yield
    numba.set_num_threads(threads)


def in_turns(benchmark, parts, rounds=ROUNDS):
    """Processor time in s of each part in each round, by name; what is compiled is compiled already."""
    seconds = {name: [] for name in parts}

    def a_round():
        for name, run in parts.items():
            begin = process_time()
            run()
            seconds[name].append(process_time() - begin)

    benchmark.pedantic(a_round, rounds=rounds)
    return {name: np.array(values) for name, values in seconds.items()}


def agreement(run, other):
    """Shares of releases that end at the same instant and state, and that pass the same lines."""
    ends = np.abs(run.ends - other.ends) <= AGREES * (1.0 + np.abs(run.ends))
    passed, passed_other = np.isfinite(run.crossings[:, :, 0]), np.isfinite(other.crossings[:, :, 0])
    return ends.all(axis=1).mean(), (passed == passed_other).all(axis=1).mean()


@pytest.mark.parametrize(("name", "block_name"), SETUP + SLOPE)
def test_ratio_to_c(benchmark, one_thread, tmp_path, name, block_name):
    if compiler() is None:
        pytest.skip("no C compiler `cc`: no ratio to the reference kernel")
    library = compile_reference(tmp_path)
    scenario, states = scenario_of(name)
    ensemble, shared = ensemble_of(scenario, block_name)
    few = states[block_name][:COMPARED]

    def batch(impacts=0):
        return run_batch(ensemble, few, impact_limit=impacts, **shared)

    def reference(impacts=0):
        return run_reference(library, ensemble, few, impact_limit=impacts, **shared)

    first, _ = agreement(batch(1), reference(1))
    ends, passings = agreement(batch(), reference())
    assert first >= AGREEING["first"], "not the engine's algorithm any more"
    assert passings >= AGREEING["passings"], "not the engine's algorithm any more"

    seconds = in_turns(benchmark, {"batch": batch, "reference": reference})
    same = f"equal to 1e-9: {first:.1%} after an impact, {ends:.1%} at the end; same passings: {passings:.1%}"
    benchmark.extra_info["rows"] = [
        row("a release to rest or exit: batch / C", seconds["batch"] / seconds["reference"], "", same),
        row("batch, one thread, to rest or exit", COMPARED / seconds["batch"], "releases/s"),
        row("C, one thread, to rest or exit", COMPARED / seconds["reference"], "releases/s"),
    ]
    own, other = (seconds[name] / COMPARED for name in ("batch", "reference"))
    benchmark.extra_info["waits"] = [wait(f"a descent to rest, one thread, {name}, {block_name}", own, other, "C")]
