"""Do stated intervals hold the truth? Random sites whose truth is known from many releases.

Each site has numbers that are not known. Its truth is one draw of them, simulated with many releases. Two kinds of
intervals are asked to hold it: those of `run`, from few releases of the true site (sampling), and those of its key
`uncertainty`, from possible sites (not known). Of 95 % intervals, 92 to 98 % should.

    python -m tests.hunt.coverage --sites 200 --seed 1 --workers 2"""

import argparse
import tempfile
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from rock2d.design.assessment import assess
from rock2d.design.possible_sites import SiteResults, simulate_sites
from rock2d.design.uncertainty import SHARES
from rock2d.files.scenario_reading import load_scenario
from rock2d.files.scenario_variants import variant
from rock2d.progress import Bars
from rock2d.runs.run import run
from tests.hunt.loop_inputs import write_yaml

TRUE_RELEASES, RELEASES = 4000, 300
ENGINES = ("batch", "point_mass")
FEWEST_TRUE = 400  # crossings that a true percentile needs
RAREST = 0.005  # a frequency nearer to 0 or 1 is held by any interval that begins there
BLOCKS = (
    {"shape": "circle", "diameter_m": 1.0, "mass_kg": 1400, "inertia": "solid_sphere"},
    {"shape": "square", "side_m": 1.0, "mass_kg": 2700, "inertia": "uniform"},
    {"shape": "rectangle", "length_m": 1.5, "height_m": 0.9, "mass_kg": 3200, "inertia": "uniform"},
)


class Held(NamedTuple):
    """An interval, and the truth that it should hold."""

    site: int
    kind: str
    quantity: str
    low: float
    high: float
    truth: float


def random_site(rng: np.random.Generator) -> dict[str, Any]:
    """A slope of 25 to 60 m with an embankment, and what is not known about it."""
    height, run_m = rng.uniform(25, 60), rng.uniform(25, 45)
    foot = run_m + rng.uniform(15, 40)
    middle = height * rng.uniform(0.25, 0.45)
    soils = rng.choice(["bedrock", "covered_bedrock", "coarse_talus", "medium_scree"], 2).tolist()
    return {
        "name": "site", "gravity_m_s2": 9.81, "engine": str(rng.choice(ENGINES)), "releases": RELEASES, "seed": 1,
        "cross_section": {
            "points_m": [[0.0, height], [run_m, middle], [foot, 0.0], [foot + 60.0, -2.0]],
            "zones": ["slope", "foot", "run_out"],
        },
        "embankment": {"x_m": foot + 4.0, "height_m": rng.uniform(1.5, 4.0), "crest_m": 2.0,
                       "uphill_deg": rng.uniform(50, 80), "downhill_deg": 34.0},
        "blocks": {"block": BLOCKS[rng.integers(len(BLOCKS))]},
        "model": {"soils": {"slope": soils[0], "default": soils[1]}},
        "incident": {"default": {"distribution": {
            "x_m": {"uniform": {"low": 1.0, "high": 4.0}}, "y_m": {"uniform": {"low": height + 2, "high": height + 4}},
            "vx_m_s": {"uniform": {"low": 1.0, "high": 3.0}}, "vy_m_s": 0.0,
            "theta_rad": {"uniform": {"low": -3.1, "high": 3.1}},
        }}},
        "roughness": {"slope": {"sd_deg": rng.uniform(2, 8), "length_m": 0.5}},
        "uncertainty": {"sites": 16, "releases": 100, "site": {
            "roughness.slope.sd_deg": {"times": {"uniform": {"low": 0.5, "high": 1.5}}},
            "embankment.x_m": {"normal": {"mean": foot + 4.0, "sd": 0.3}},
            "incident.default.distribution.vx_m_s.uniform.high": {"uniform": {"low": 3.0, "high": 5.0}},
        }},
    }  # fmt: skip


def studied(job: tuple[int, int]) -> list[Held]:
    """Every interval that is stated about the site of this seed and number."""
    seed, number = job
    rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(number,)))
    with tempfile.TemporaryDirectory() as folder:
        scenario = load_scenario(write_yaml(Path(folder) / "site.yaml", random_site(rng)))
        values = {place: float(quantile(np.array([rng.random()]))[0]) for place, quantile in scenario.unknown().items()}
        true_site = variant(scenario, values)
        seeds = [int(own) for own in rng.integers(1 << 30, size=3)]
        truth = simulate_sites([true_site], scenario.engine, [seeds[0]], TRUE_RELEASES)
        sampled = run(true_site, seed=seeds[1])
        tables = {name: sampled.to_pandas(name) for name in ("passing", "percentiles")}
        return [*_of_sampling(number, truth, tables), *_of_sites(number, truth, scenario, seeds[2])]


def _of_sampling(number: int, truth: SiteResults, tables: dict[str, pd.DataFrame]) -> Iterator[Held]:
    rows: list[Any] = list(tables["passing"].itertuples())
    for r in rows:
        shares = true_shares(truth, r.line)
        yield Held(number, "sampling", "frequency", r.low95, r.high95, shares["frequency"])
        arriving = r.per_arriving_low95, r.per_arriving_high95
        yield Held(number, "sampling", "per_arriving", *arriving, shares["per_arriving"])
    rows = list(tables["percentiles"].itertuples())
    for r in rows:
        true = true_percentile(truth, r.line, r.quantity, r.percentile)
        yield Held(number, "sampling", f"{r.quantity}, {r.percentile:g} %", r.low95, r.high95, true)


def _of_sites(number: int, truth: SiteResults, scenario: Any, seed: int) -> Iterator[Held]:
    rows: list[Any] = list(assess(scenario, scenario.engine, seed).uncertain.itertuples())
    for r in rows:
        if r.quantity in SHARES:
            true = true_shares(truth, r.line)[r.quantity]
        else:
            quantity, _, percentile = r.quantity.rpartition("_")
            true = true_percentile(truth, r.line, quantity, float(percentile))
        yield Held(number, "not known", r.quantity, r.low95, r.high95, true)


def true_shares(truth: SiteResults, line: str) -> dict[str, float]:
    """Passing frequency of the released and of the arriving blocks; NaN where any interval would hold it."""
    k = truth.lines.index(line)
    passed, arrived = truth.passed[0, 0, k], truth.arrived[0, 0, k]
    shares = {"frequency": passed.mean(), "per_arriving": passed[arrived].mean() if arrived.sum() > 500 else np.nan}
    return {key: float(p) if RAREST < p < 1.0 - RAREST else np.nan for key, p in shares.items()}


def true_percentile(truth: SiteResults, line: str, quantity: str, percentile: float) -> float:
    """Percentile of what passes; NaN where too few do."""
    values = truth.crossings[quantity][0, 0, truth.lines.index(line)]
    values = values[np.isfinite(values)]
    return float(np.percentile(values, percentile)) if len(values) >= FEWEST_TRUE else np.nan


def coverage_table(held: list[Held]) -> pd.DataFrame:
    """Share of the intervals that hold the truth, and of those that lie above and below it."""
    table = pd.DataFrame(held).dropna()
    table["held %"] = 100.0 * table["truth"].between(table["low"], table["high"])
    table["too high %"] = 100.0 * (table["truth"] < table["low"])
    table["too low %"] = 100.0 * (table["truth"] > table["high"])
    grouped = table.groupby(["kind", "quantity"])
    found = grouped[["held %", "too high %", "too low %"]].mean()
    return found.assign(intervals=grouped.size(), sites=grouped["site"].nunique())


def main(arguments: list[str] | None = None) -> None:
    """Study the sites and print the table."""
    parser = argparse.ArgumentParser(description="Coverage of the intervals of run and of possible sites.")
    parser.add_argument("--sites", type=int, default=200)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--save", type=Path, help="table (CSV) of every interval")
    given = parser.parse_args(arguments)
    held: list[Held] = []
    jobs = [(given.seed, number) for number in range(given.sites)]
    with ProcessPoolExecutor(given.workers) as pool, Bars(True).stage("sites", len(jobs), "sites") as bar:
        try:
            for found in pool.map(studied, jobs):
                held += found
                bar.update()
        except KeyboardInterrupt:
            pool.shutdown(cancel_futures=True)
            print("interrupted: what is done so far")
    if given.save:
        pd.DataFrame(held).to_csv(given.save, index=False)
    print(coverage_table(held).to_string(float_format="{:.1f}".format))


if __name__ == "__main__":
    main()
