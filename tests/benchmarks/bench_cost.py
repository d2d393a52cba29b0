"""What a release costs by the number of releases and of facets: the measurements of the figure `cost.png`.

ROCK2D_BENCH_LARGE=1 goes on to 10^6 and 10^7 releases, which take an hour and more.
"""

from __future__ import annotations

import os

import numpy as np
from rock2d_figures.cost import cost_of_facets, cost_of_releases

from tests.benchmarks.bench_engines import ROUNDS, row

MOST = 10**7 if os.environ.get("ROCK2D_BENCH_LARGE") else 10**5
SECONDS = 60.0  # no round begins after these


def test_cost_by_releases(benchmark):
    found = benchmark.pedantic(cost_of_releases, (MOST, ROUNDS, SECONDS))
    benchmark.extra_info["rows"] = [
        row(f"{engine}: {number:,} releases, of one", 1e6 * np.array(times) / number, "us")
        for engine, own in found.items()
        for number, times in zip(own["releases"], own["times_s"], strict=True)
    ]


def test_cost_by_facets(benchmark):
    found = benchmark.pedantic(cost_of_facets, (ROUNDS, SECONDS))
    benchmark.extra_info["rows"] = [
        row(f"{engine}: a release on {facets:,} facets", 1e6 * np.array(times), "us")
        for engine, own in found.items()
        for facets, times in zip(own["facets"], own["times_s"], strict=True)
    ]
