"""Tables of a campaign from its chunk files. Memory does not grow with the number of releases.

Passing frequencies and stops are counts. Percentiles are exact order statistics; the counts give their leading digits,
and a pass over the values the rest. The result does not depend on which worker computed a chunk, or when."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from rock2d.arrays import Array
from rock2d.records.columns import STOPS
from rock2d.runs.campaigns.chunks import add_counts, chunk_path
from rock2d.runs.campaigns.counts import Counts
from rock2d.runs.campaigns.job import Chunk, Job
from rock2d.runs.campaigns.order_statistics import OrderStatistics, find_order_statistics
from rock2d.runs.indicators.passing import (
    LINE_PERCENTILES,
    LINE_QUANTITIES,
    PASSING_COLUMNS,
    PERCENTILE_COLUMNS,
    passing_rows,
)
from rock2d.statistics import percentile_estimate, percentile_ranks

if TYPE_CHECKING:
    import pandas as pd
    import pyarrow as pa

STOP_COUNT_COLUMNS = ["block", "stop", "zone", "releases", "frequency"]
RUNOUT_COLUMNS = ["block", "quantity", "percentile", "releases", "value", "low95", "high95"]
RUNOUT_PERCENTILES = (50.0, 95.0, 99.0)


def all_counts(job: Job, chunks: Sequence[Chunk]) -> list[Counts]:
    """Sum of the counts of each block over its chunks, which must be done."""
    found = [Counts.none(job) for _ in job.blocks]
    for chunk in chunks:
        add_counts(found[chunk.block], job, chunk)
    return found


def campaign_tables(
    job: Job, chunks: Sequence[Chunk], counts: Sequence[Counts], on_progress: Callable[[int], Any] = lambda count: None
) -> dict[str, pd.DataFrame]:
    """Tables by name: passing and percentiles if crossings were kept, stops and runout if ends were.

    - passing, percentiles: same columns as the indicators of the same names
    - stops: numbers of releases by block, kind of stop and zone; zone is empty for releases that left the cross-section
    - runout: percentiles of the distance from start to end; releases that left the cross-section count with the place
      where they left

    `counts` are those of each block; `on_progress` gets the number of further files that were read. Raises OSError if a
    file is missing."""
    import pandas as pd

    blocks = [
        _Block(job, [chunk for chunk in chunks if chunk.block == b], of_block, on_progress)
        for b, of_block in enumerate(counts)
    ]

    def table(columns: Sequence[str], rows: Callable[[_Block], list[Any]]) -> pd.DataFrame:
        return pd.DataFrame([row for block in blocks for row in rows(block)], columns=list(columns))

    tables = {}
    if "crossings" in job.keep:
        tables["passing"] = table(PASSING_COLUMNS, _Block.passing)
        tables["percentiles"] = table(PERCENTILE_COLUMNS, _Block.percentiles)
    if "ends" in job.keep:
        tables["stops"] = table(STOP_COUNT_COLUMNS, _Block.stops)
        tables["runout"] = table(RUNOUT_COLUMNS, _Block.runouts)
    return tables


class _Block:
    """Releases of one block: their chunks and counts."""

    def __init__(self, job: Job, chunks: Sequence[Chunk], counts: Counts, on_progress: Callable[[int], Any]) -> None:
        self.job, self.chunks, self.counts, self.on_progress = job, chunks, counts, on_progress
        self.name = job.blocks[chunks[0].block].name
        self.releases = sum(chunk.count for chunk in chunks)
        self.lines = list(job.cross_section.measure_lines)

    def passing(self) -> list[Any]:
        """Rows of PASSING_COLUMNS."""
        left = int(self.counts.left_source) if "ends" in self.job.keep else float("nan")
        return passing_rows(self.name, self.lines, self.releases, left, self.counts.passing)

    def percentiles(self) -> list[Any]:
        """Rows of PERCENTILE_COLUMNS."""
        passed = dict(zip(self.lines, self.counts.passed.tolist(), strict=True))
        sought = {
            (line, quantity): OrderStatistics(_ranks(passed[line], LINE_PERCENTILES), self.counts.crossings[k, q])
            for k, line in enumerate(self.lines)
            for q, quantity in enumerate(LINE_QUANTITIES)
            if _ranks(passed[line], LINE_PERCENTILES)
        }
        find_order_statistics(sought, self._values_at_lines)
        ranked = {key: statistics.values() for key, statistics in sought.items()}
        return [
            (self.name, line, quantity, p, n, *percentile_estimate(ranked.get((line, quantity), {}), n, p))
            for line, n in passed.items()
            if n
            for quantity in LINE_QUANTITIES
            for p in LINE_PERCENTILES
        ]

    def stops(self) -> list[Any]:
        """Rows of STOP_COUNT_COLUMNS."""
        zones = [*self.job.cross_section.zone_names, None]
        return [
            (self.name, stop, zone, count, count / self.releases)
            for stop, counts in sorted(zip(STOPS, self.counts.stops.tolist(), strict=True))
            for zone, count in zip(zones, counts, strict=True)
            if count
        ]

    def runouts(self) -> list[Any]:
        """Rows of RUNOUT_COLUMNS."""
        statistics = OrderStatistics(_ranks(self.releases, RUNOUT_PERCENTILES), self.counts.runouts)
        find_order_statistics(
            {"runout_m": statistics},
            lambda: ({"runout_m": table["runout_m"].to_numpy()} for table in self._tables("ends", ["runout_m"])),
        )
        return [
            (self.name, "runout_m", p, self.releases, *percentile_estimate(statistics.values(), self.releases, p))
            for p in RUNOUT_PERCENTILES
        ]

    def _values_at_lines(self) -> Iterator[dict[tuple[str, str], Array]]:
        for table in self._tables("crossings", ["line", *LINE_QUANTITIES]):
            text = table["line"].combine_chunks()
            line = np.array([self.lines.index(name) for name in text.dictionary.to_pylist()])[text.indices]
            rows = {name: np.flatnonzero(line == k) for k, name in enumerate(self.lines)}
            values = {quantity: table[quantity].to_numpy() for quantity in LINE_QUANTITIES}
            yield {(name, q): values[q][at_line] for name, at_line in rows.items() for q in LINE_QUANTITIES}

    def _tables(self, output: str, columns: Sequence[str]) -> Iterator[pa.Table]:
        import pyarrow.parquet as pq

        for chunk in self.chunks:
            path = chunk_path(self.job.folder, output, chunk.number)
            with pq.ParquetFile(path, read_dictionary={"line"} & set(columns)) as file:
                yield file.read(columns=list(columns))
            self.on_progress(1)


def _ranks(n: int, percentiles: Sequence[float]) -> list[int]:
    return sorted({rank for percentile in percentiles for rank in percentile_ranks(n, percentile)})
