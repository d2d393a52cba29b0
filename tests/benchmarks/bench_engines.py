"""What the engines cost, on the paper's set-up and at field scale, and what half the contact step changes.

What is compared runs in one process in turns, round after round;
a ratio is that of one round, stated as the median over the rounds, from the least to the greatest. Nothing here
passes or fails by the clock."""

import itertools
from functools import cache
from time import perf_counter

import numba
import numpy as np
import pytest
from scipy import stats

from rock2d.engines.batch import BATCH_STEP_FRACTION, Ensemble, run_batch
from rock2d.engines.point_mass import run_point_mass_batch
from rock2d.engines.pymunk_engine import run_pymunk
from rock2d.files.scenario_reading import load_scenario
from rock2d.laws.contact import contact_table
from rock2d.records.columns import STOPS
from rock2d.runs.conditions import incident_states
from tests.benchmarks.calibration import kernel_s, wait
from tests.scenarios_of_tests import SHIPPED

SETUP = [("paper_setup", block) for block in ("sphere", "cube", "parallelepiped")]
SLOPE = [("slope_embankment", block) for block in ("ball_1m", "cube_1m", "slab_2m")]
ROUNDS = 5
STARTS = 4000  # drawn for each block
DETERMINISTIC = 4000  # releases a round of the batch engine
POINT_MASS = 40_000  # releases a round of the point-mass ensemble: the starts, ten times
PYMUNK = 4  # releases a round of the pymunk engine
HALVING = 2000  # releases of each step


@cache
def scenario_of(name):
    """A scenario and, by block, the states (STARTS, 6) of its starts."""
    scenario = load_scenario(SHIPPED / f"{name}.yaml")
    states = {block: [] for block in scenario.make_blocks()}
    for start in incident_states(scenario, scenario.seed, STARTS):
        states[start.block].append(start.state)
    return scenario, {block: np.array(rows) for block, rows in states.items()}


def ensemble_of(scenario, block_name):
    """The ensemble of one block, and what its runs share."""
    cross_section = scenario.make_cross_section()
    block = scenario.make_blocks()[block_name]
    table = contact_table(scenario.contact_parameters(block), cross_section.zone_names)
    shared = {"gravity_m_s2": scenario.gravity_m_s2, "time_limit_s": scenario.time_limit_s}
    return Ensemble([block], [cross_section], [table]), shared


def row(what, values, unit="", note=""):
    """A line of the table: median, least and greatest of the rounds."""
    values = np.asarray(values, float)
    return {
        "what": what, "value": float(np.median(values)), "low": float(values.min()), "high": float(values.max()),
        "unit": unit, "note": note,
    }  # fmt: skip


@pytest.mark.parametrize(("name", "block_name"), SETUP + SLOPE)
def test_releases(benchmark, name, block_name):
    scenario, states = scenario_of(name)
    ensemble, shared = ensemble_of(scenario, block_name)
    block, cross_section = ensemble.blocks[0], ensemble.cross_sections[0]
    law, rebound = scenario.contact_parameters(block), scenario.rebound_parameters(block)
    threads = numba.get_num_threads()
    few = states[block_name][:DETERMINISTIC]
    many, seeds = np.resize(states[block_name], (POINT_MASS, 6)), np.arange(POINT_MASS, dtype=np.uint64)

    def own(k):  # other releases every round
        return states[block_name][k * PYMUNK : (k + 1) * PYMUNK]

    def one_thread(k):
        numba.set_num_threads(1)
        run_batch(ensemble, own(k), **shared)
        numba.set_num_threads(threads)

    def pymunk(k):
        for state in own(k):
            run_pymunk(block, cross_section, law, state, **shared)

    parts = {
        "batch": (DETERMINISTIC, lambda k: run_batch(ensemble, few, **shared)),
        "captured": (DETERMINISTIC, lambda k: run_batch(ensemble, few, stop_when_captured=True, **shared)),
        "point_mass": (
            POINT_MASS,
            lambda k: run_point_mass_batch(block, cross_section, rebound, many, seeds, **shared),
        ),
        "kernel": (1, lambda k: kernel_s()),
    }
    if name == "paper_setup":
        parts |= {"one thread": (PYMUNK, one_thread), "pymunk": (PYMUNK, pymunk)}
    seconds = {part: [] for part in parts}

    def a_round(k):
        for part, (releases, run) in parts.items():
            begin = perf_counter()
            run(k)
            seconds[part].append((perf_counter() - begin) / releases)

    count = itertools.count()
    benchmark.pedantic(a_round, setup=lambda: ((next(count),), {}), rounds=ROUNDS, warmup_rounds=1)
    cost = {part: np.array(values[1:]) for part, values in seconds.items()}  # s a release
    late = np.mean(run_batch(ensemble, few, **shared).stop == STOPS.index("time"))
    every = f"{threads} threads"
    rows = [
        row(f"batch, {every}, to rest or exit", 1 / cost["batch"], "releases/s", f"{late:.1%} ran out of time"),
        row(f"batch, {every}, until captured", 1 / cost["captured"], "releases/s"),
        row(f"point mass, {every}, to rest or exit", 1 / cost["point_mass"], "releases/s"),
        row("a release to rest: batch / point mass", cost["batch"] / cost["point_mass"]),
        row("a release until captured: batch / point mass", cost["captured"] / cost["point_mass"]),
    ]
    if name == "paper_setup":
        rows += [
            row("pymunk, one core, to rest or exit", cost["pymunk"], "s/release"),
            row(f"a release: pymunk / batch, {every}", cost["pymunk"] / cost["batch"]),
            row("the same releases, one core: pymunk / batch", cost["pymunk"] / cost["one thread"]),
        ]
    benchmark.extra_info["rows"] = rows
    benchmark.extra_info["waits"] = [wait(f"a descent to rest, {name}, {block_name}", cost["batch"], cost["kernel"])]


@pytest.mark.parametrize(("name", "block_name"), SETUP)
def test_half_the_contact_step(benchmark, name, block_name):
    """Change of the passing frequency at each line, with the same starts: McNemar's exact test, and the 95 % interval
    of Agresti & Min (2005), which has half a release added to each cell of the table."""
    scenario, states = scenario_of(name)
    ensemble, shared = ensemble_of(scenario, block_name)
    start = states[block_name][:HALVING]

    def passed(fraction):
        run = run_batch(ensemble, start, stop_when_spent=True, step_fraction=fraction, **shared)
        return np.isfinite(run.crossings[:, :, 0])

    def both():
        return passed(BATCH_STEP_FRACTION), passed(0.5 * BATCH_STEP_FRACTION)

    before, after = benchmark.pedantic(both, rounds=1)
    rows = []
    for k, line in enumerate(ensemble.cross_sections[0].measure_lines):
        lost, gained = int((before & ~after)[:, k].sum()), int((after & ~before)[:, k].sum())
        n, changed = len(start), lost + gained
        centre = (gained - lost) / (n + 2)
        reach = 1.96 * np.sqrt((changed + 1) / (n + 2) - centre**2) / np.sqrt(n + 2)
        p = stats.binomtest(gained, changed).pvalue if changed else 1.0
        note = f"{before[:, k].mean():.4f} to {after[:, k].mean():.4f}; {gained} gained, {lost} lost, p = {p:.2f}"
        own = row(f"{line}: change of passing frequency", [(gained - lost) / n], "", note)
        rows.append(own | {"low": centre - reach, "high": centre + reach})
    benchmark.extra_info["rows"] = rows
