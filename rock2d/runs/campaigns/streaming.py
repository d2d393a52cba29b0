"""Indicators of a campaign, read from its chunk files one at a time: memory does not grow with the releases.

Passing frequencies and stops are counts. Percentiles are exact order statistics. A number is read as an
unsigned integer of 64 bits with the same order. Four passes over the files find its bits, 16 in each pass: a pass
counts the values that share the bits found before. The result does not depend on which worker computed a chunk, or
when.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from rock2d.runs.campaigns.chunks import chunk_path, counts_of
from rock2d.runs.campaigns.job import Chunk, Job
from rock2d.runs.indicators.passing import PASSING_COLUMNS, passing_row
from rock2d.runs.indicators.percentiles import PERCENTILE_COLUMNS, PERCENTILES, QUANTITIES
from rock2d.statistics import percentile_estimate, percentile_ranks

if TYPE_CHECKING:
    import pandas as pd
    import pyarrow as pa

Array = np.ndarray

STOP_COUNT_COLUMNS = ["block", "stop", "zone", "releases", "frequency"]
RUNOUT_COLUMNS = ["block", "quantity", "percentile", "releases", "value", "low95", "high95"]
RUNOUT_PERCENTILES = (50.0, 95.0, 99.0)
DIGIT_BITS = 16
PASSES = 64 // DIGIT_BITS


def campaign_tables(
    job: Job, chunks: Sequence[Chunk], on_progress: Callable[[int], Any] = lambda count: None
) -> dict[str, pd.DataFrame]:
    """Tables by name: passing and percentiles if crossings were kept, stops and runout if ends were.

    - passing, percentiles: as the indicators of the same names give them.
    - stops: how many releases of each block ended in which way in which zone; zone is empty for those that
      left the cross-section.
    - runout: percentiles, as above, of the distance from start to end; what left the cross-section counts
      with the place where it left.

    `on_progress` gets the number of further files that were read. Raises OSError if a file is not there.
    """
    import pandas as pd

    files = _Files(job, chunks, on_progress)
    tables: dict[str, pd.DataFrame] = {}
    if "crossings" in job.keep:
        passing, percentiles = [], []
        for b in range(len(job.blocks)):
            passed, rows = _of_crossings(files, b)
            passing += passed
            percentiles += rows
        tables["passing"] = pd.DataFrame(passing, columns=list(PASSING_COLUMNS))
        tables["percentiles"] = pd.DataFrame(percentiles, columns=list(PERCENTILE_COLUMNS))
    if "ends" in job.keep:
        stops, runout = [], []
        for b in range(len(job.blocks)):
            stops += _stop_counts(files, b)
            runout += _runouts(files, b)
        tables["stops"] = pd.DataFrame(stops, columns=STOP_COUNT_COLUMNS)
        tables["runout"] = pd.DataFrame(runout, columns=RUNOUT_COLUMNS)
    return tables


def files_read(job: Job, chunks: Sequence[Chunk]) -> int:
    """How many files `campaign_tables` reads, each pass counted."""
    return (1 + PASSES) * len(chunks) * len({"crossings", "ends"} & set(job.keep))


class _Files:
    """Chunk files of a campaign, block by block."""

    def __init__(self, job: Job, chunks: Sequence[Chunk], on_progress: Callable[[int], Any]) -> None:
        self.job, self.chunks, self.on_progress = job, chunks, on_progress

    def releases(self, block: int) -> int:
        return sum(chunk.count for chunk in self.chunks if chunk.block == block)

    def unresolved(self, block: int) -> dict[str, int]:
        """Of each measure line, the releases that were cut short or buried before they crossed it."""
        lines = self.job.cross_section.measure_lines
        own = [counts_of(self.job, chunk).unresolved for chunk in self.chunks if chunk.block == block]
        return dict(zip(lines, map(sum, zip(*own, strict=True)), strict=True))

    def tables(self, output: str, block: int, columns: Sequence[str]) -> Iterator[pa.Table]:
        import pyarrow.parquet as pq

        for chunk in self.chunks:
            if chunk.block == block:
                with pq.ParquetFile(chunk_path(self.job.folder, output, chunk.number)) as file:
                    yield file.read(columns=list(columns))
                self.on_progress(1)


def _of_crossings(files: _Files, block: int) -> tuple[list[Any], list[Any]]:
    """Rows of PASSING_COLUMNS and of PERCENTILE_COLUMNS of one block."""
    import pyarrow.compute as pc

    name, releases = files.job.blocks[block].name, files.releases(block)
    passed: Counter[str] = Counter()
    for table in files.tables("crossings", block, ["line"]):
        for item in pc.value_counts(table["line"]).to_pylist():
            passed[item["values"]] += item["counts"]
    unresolved = files.unresolved(block)
    lines = list(unresolved)
    passing = [passing_row(name, line, releases, passed[line], unresolved[line]) for line in lines]
    sought = {
        (line, quantity): OrderStatistics(_ranks(passed[line], PERCENTILES))
        for line in lines
        for quantity in QUANTITIES
        if passed[line]
    }
    for _ in range(PASSES):
        for table in files.tables("crossings", block, ["line", *QUANTITIES]):
            values = {quantity: table[quantity].to_numpy() for quantity in QUANTITIES}
            here = {line: pc.equal(table["line"], line).to_numpy() for line in lines}
            for (line, quantity), statistics in sought.items():
                statistics.count(values[quantity][here[line]])
        for statistics in sought.values():
            statistics.settle()
    rows = []
    for (line, quantity), statistics in sought.items():
        for percentile in PERCENTILES:
            estimate = percentile_estimate(statistics.values(), passed[line], percentile)
            rows.append((name, line, quantity, percentile, passed[line], *estimate))
    return passing, rows


def _stop_counts(files: _Files, block: int) -> list[Any]:
    counts: Counter[tuple[str, str | None]] = Counter()
    for table in files.tables("ends", block, ["stop", "zone"]):
        groups = table.group_by(["stop", "zone"]).aggregate([([], "count_all")])
        for row in groups.to_pylist():
            counts[row["stop"], row["zone"]] += row["count_all"]
    name, releases = files.job.blocks[block].name, files.releases(block)
    zones = [*files.job.cross_section.zone_names, None]
    order = sorted(counts, key=lambda key: (key[0], zones.index(key[1])))
    return [(name, *key, counts[key], counts[key] / releases) for key in order]


def _runouts(files: _Files, block: int) -> list[Any]:
    name, releases = files.job.blocks[block].name, files.releases(block)
    statistics = OrderStatistics(_ranks(releases, RUNOUT_PERCENTILES))
    for _ in range(PASSES):
        for table in files.tables("ends", block, ["runout_m"]):
            statistics.count(table["runout_m"].to_numpy())
        statistics.settle()
    return [
        (name, "runout_m", p, releases, *percentile_estimate(statistics.values(), releases, p))
        for p in RUNOUT_PERCENTILES
    ]


def _ranks(n: int, percentiles: Sequence[float]) -> list[int]:
    return sorted({rank for percentile in percentiles for rank in percentile_ranks(n, percentile)})


class OrderStatistics:
    """Exact values of given ranks (from 0, in ascending order) among numbers that come in parts.

    All parts go through `count`, then `settle` is called, PASSES times over; then `values` gives rank ->
    value. The parts' order does not matter. Numbers must be finite.
    """

    def __init__(self, ranks: Sequence[int]) -> None:
        self._ranks = list(ranks)
        self._within = list(ranks)  # rank among the numbers that share the settled bits
        self._settled = [0] * len(ranks)  # leading bits of the value sought
        self._shift = 64 - DIGIT_BITS
        self._counts = {0: np.zeros(1 << DIGIT_BITS, np.int64)}  # settled bits -> numbers by their next digit

    def count(self, numbers: Array) -> None:
        bits = (numbers + 0.0).view(np.uint64)  # + 0.0: minus zero is zero
        sign = np.uint64(1 << 63)
        keys = np.where(bits & sign, ~bits, bits | sign)
        digits = keys >> np.uint64(self._shift)
        leading = digits >> np.uint64(DIGIT_BITS)
        for settled, counts in self._counts.items():
            own = digits[leading == np.uint64(settled)] & np.uint64((1 << DIGIT_BITS) - 1)
            np.add.at(counts, own.astype(np.int64), 1)

    def settle(self) -> None:
        for i, settled in enumerate(self._settled):
            below = np.cumsum(self._counts[settled])
            digit = int(np.searchsorted(below, self._within[i], side="right"))
            self._within[i] -= int(below[digit - 1]) if digit else 0
            self._settled[i] = settled << DIGIT_BITS | digit
        self._shift -= DIGIT_BITS
        if self._shift >= 0:
            self._counts = {settled: np.zeros(1 << DIGIT_BITS, np.int64) for settled in set(self._settled)}

    def values(self) -> dict[int, float]:
        keys = np.array(self._settled, np.uint64)
        sign = np.uint64(1 << 63)
        bits = np.where(keys & sign, keys ^ sign, ~keys)
        return dict(zip(self._ranks, bits.view(np.float64).tolist(), strict=True))
