"""What a release costs by the number of releases and of facets: the measurements of the figure `cost.png`.

ROCK2D_BENCH_LARGE=1 goes on to 10^6 and 10^7 releases, which take an hour and more."""

import os

import numpy as np
import pytest
from rock2d_figures.cost import cost_of_facets, cost_of_releases

from tests.benchmarks.bench_engines import ROUNDS, row

MOST = 10**7 if os.environ.get("ROCK2D_BENCH_LARGE") else 10**5
SECONDS = 60.0  # no round begins after these


@pytest.mark.parametrize(
    ("cost_of", "given", "many", "what"),
    [
        (cost_of_releases, (MOST, ROUNDS, SECONDS), "releases", "{:,} releases, of one"),
        (cost_of_facets, (ROUNDS, SECONDS), "facets", "a release on {:,} facets"),
    ],
    ids=["releases", "facets"],
)
def test_cost(benchmark, cost_of, given, many, what):
    found = benchmark.pedantic(cost_of, given)
    benchmark.extra_info["rows"] = [
        row(f"{engine}: {what.format(n)}", 1e6 * np.array(times) / (n if many == "releases" else 1), "us")
        for engine, own in found.items()
        for n, times in zip(own[many], own["times_s"], strict=True)
    ]
