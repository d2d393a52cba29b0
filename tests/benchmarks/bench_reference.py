"""How far the batch engine is from the limit of its arithmetic: the same algorithm in plain C on the same releases.

And what a release costs by the number of releases and of facets. ROCK2D_BENCH_LARGE=1 goes on to 10^6 and 10^7
releases: an hour and more. See `bench_engines` for how numbers are taken; these are of one thread, in processor time.
"""

from __future__ import annotations

import os
from time import process_time

import numba
import numpy as np
import pytest

from rock2d.engines.batch import Ensemble, run_batch
from rock2d.laws.contact import parameter_table
from tests.benchmarks.bench_engines import ROUNDS, SETUP, SLOPE, ensemble_of, row, scenario_of
from tests.benchmarks.reference_kernel import compile_reference, compiler, run_reference

COMPARED = 300  # releases a round
AGREEING = {
    "first": 0.999,
    "passings": 0.98,
}  # least shares of releases: roundings differ, and grow with every impact
LARGE = bool(os.environ.get("ROCK2D_BENCH_LARGE"))
RELEASES = [10**k for k in range(2, 8 if LARGE else 6)]
FACETS = [10**k for k in range(2, 5)]
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


def test_cost_by_releases(benchmark, one_thread):
    scenario, states = scenario_of("slope_embankment")
    ensemble, shared = ensemble_of(scenario, "cube_1m")

    def run(n):
        return lambda: run_batch(
            ensemble, np.resize(states["cube_1m"], (n, 6)), stop_when_captured=True, **shared
        )

    run(RELEASES[0])()  # may have to compile
    seconds = in_turns(benchmark, {n: run(n) for n in RELEASES}, rounds=1)
    benchmark.extra_info["rows"] = [
        row(f"{n:,} releases until captured, of one", 1e3 * values / n, "ms") for n, values in seconds.items()
    ]


def test_cost_by_facets(benchmark, one_thread):
    """The same slope with each facet divided into equal parts, the same releases until captured."""
    scenario, states = scenario_of("slope_embankment")
    ensemble, shared = ensemble_of(scenario, "cube_1m")
    block, whole = ensemble.blocks[0], ensemble.cross_sections[0]
    law = scenario.contact_parameters(block)
    own = len(whole.points_m) - 1

    def run(ground):
        divided = Ensemble([block], [ground], [parameter_table(law, ground.zone_names)])
        return lambda: run_batch(divided, states["cube_1m"][:COMPARED], stop_when_captured=True, **shared)

    grounds = [whole, *(whole.subdivided(round(n / own)) for n in FACETS)]
    parts = {len(g.points_m) - 1: run(g) for g in grounds}
    parts[own]()  # may have to compile
    seconds = in_turns(benchmark, parts)
    benchmark.extra_info["rows"] = [
        row(f"a release until captured: {n:,} facets / {own}", values / seconds[own])
        for n, values in seconds.items()
    ]
