"""One chunk of a campaign: a fixed number of releases of one block, simulated and written as columnar files.

A chunk has one parquet file for each kept output, folder/<output>/<number>.parquet. It is written under another name
and renamed when complete. Any process can compute any chunk, because the random numbers of a release depend only on its
number."""

from __future__ import annotations

import os
import secrets
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from rock2d.arrays import Array
from rock2d.records.columns import IMPACT_COLUMNS, IMPACT_NAMES, POSE_NAMES, STOP_EXIT, STOPS
from rock2d.runs.campaigns.counts import Counts
from rock2d.runs.campaigns.group_outcomes import Outcome, group_outcome
from rock2d.runs.campaigns.job import Chunk, Job
from rock2d.runs.conditions import Group
from rock2d.runs.engines import ENGINES
from rock2d.runs.incident_states import DRAW_GROUP
from rock2d.runs.indicators.crossings import CROSSING_COLUMNS, CROSSING_VALUES, crossing_rows
from rock2d.runs.indicators.passing import left_source
from rock2d.runs.indicators.releases import STOP_COLUMNS
from rock2d.runs.recording import FRAME_TOLERANCE
from rock2d.scene.nearest_facet import nearest_facets

if TYPE_CHECKING:
    import pyarrow as pa
    import pyarrow.parquet as pq

SAMPLE_COLUMNS = ("block", "release", "t_s", *POSE_NAMES)
TEXT_COLUMNS = ("block", "line", "zone", "stop")
FINGERPRINT = b"rock2d_fingerprint"  # key of the campaign's fingerprint in a file's metadata
ROW_GROUP = 1 << 17  # approximate number of rows that are written at once
COUNTS = b"rock2d_chunk"  # key of the Counts of a chunk, in the file of the first output
# output -> (columns that are not compressed, because their last digits are noise; compression of the others)
INCOMPRESSIBLE_COLUMNS = {
    "ends": ({"t_s", "x_m", "runout_m"}, "lz4"),
    "crossings": ({*CROSSING_VALUES} - {"x_m", "y_m"}, "lz4"),
}


def chunk_path(folder: Path, output: str, number: int) -> Path:
    """The file of one output of a chunk."""
    return folder / output / f"{number:07d}.parquet"


def is_done(job: Job, chunk: Chunk) -> bool:
    """Whether all files of a chunk exist, are complete and belong to this campaign."""
    return all(_metadata(job, output, chunk).get(FINGERPRINT) == job.fingerprint.encode() for output in job.keep)


def add_counts(counts: Counts, job: Job, chunk: Chunk) -> None:
    """Add the counts of a finished chunk to `counts`."""
    counts.add_text(_metadata(job, job.keep[0], chunk)[COUNTS])


def _metadata(job: Job, output: str, chunk: Chunk) -> dict[bytes, bytes]:
    """Metadata of the file of one output of a chunk; {} if it is missing or incomplete."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    try:
        return pq.read_metadata(chunk_path(job.folder, output, chunk.number)).metadata or {}
    except (OSError, pa.ArrowInvalid):
        return {}


def run_chunk(job: Job, chunk: Chunk, on_progress: Callable[[int], Any] = lambda count: None) -> int:
    """Simulate a chunk and write its files; returns its number of releases.

    At most about `ROW_GROUP` rows of each output are in memory. `on_progress` gets the number of releases of each group
    that is done. Raises OSError if a file cannot be written. An interruption leaves no incomplete file."""
    paths = {output: chunk_path(job.folder, output, chunk.number) for output in job.keep}
    token = secrets.token_hex(4)  # a worker that a scheduler has given up may still write the same chunk
    partial = {output: path.with_name(f".{path.name}.{token}") for output, path in paths.items()}
    writers = {output: _Writer(path, output) for output, path in partial.items()}
    end, counts = chunk.first + chunk.count, Counts.none(job)
    try:
        at_once = _releases_at_once(job)
        for first in range(chunk.first, end, at_once):
            stop = min(first + at_once, end)
            for output, columns in _simulate(job, chunk, first, stop, counts).items():
                writers[output].add(columns)
            on_progress(stop - first)
        for output, writer in writers.items():
            more = {COUNTS: counts.text()} if output == job.keep[0] else {}
            writer.finish({FINGERPRINT: job.fingerprint, **more})
            os.replace(partial[output], paths[output])
    finally:
        for writer in writers.values():
            writer.close()
        for path in partial.values():
            path.unlink(missing_ok=True)
    return chunk.count


class _Writer:
    """Writes a parquet file in few row groups, because a row group costs as much as a thousand rows."""

    def __init__(self, path: Path, output: str) -> None:
        self._path, self._output = path, output
        self._waiting: list[pa.Table] = []
        self._rows = 0
        self._file: pq.ParquetWriter | None = None

    def add(self, columns: dict[str, pa.Array]) -> None:
        """Add rows, with the same columns in each call."""
        import pyarrow as pa

        fields = [pa.field(name, column.type, nullable=name == "zone") for name, column in columns.items()]
        self._waiting.append(pa.Table.from_arrays(list(columns.values()), schema=pa.schema(fields)))
        self._rows += len(self._waiting[-1])
        if self._rows >= ROW_GROUP:
            self._write()

    def finish(self, metadata: dict[bytes, str]) -> None:
        """Write the remaining rows, and close the file."""
        if self._waiting:
            self._write()
        assert self._file is not None, "a chunk has at least one group of releases"
        self._file.add_key_value_metadata(metadata)
        self.close()

    def close(self) -> None:
        """Close the file without writing the remaining rows."""
        if self._file is not None:
            self._file.close()

    def _write(self) -> None:
        import pyarrow as pa
        import pyarrow.parquet as pq

        table = pa.concat_tables(self._waiting)
        if self._file is None:
            incompressible, compression = INCOMPRESSIBLE_COLUMNS.get(self._output, ((), "zstd"))
            self._file = pq.ParquetWriter(
                self._path,
                table.schema,
                compression={name: "none" if name in incompressible else compression for name in table.column_names},
                use_dictionary=[name for name in TEXT_COLUMNS if name in table.column_names],
                column_encoding={"release": "DELTA_BINARY_PACKED"},  # releases ascend
                write_statistics=False,
                store_schema=False,  # so that readers see text, not codes
            )
        self._file.write_table(table)
        self._waiting, self._rows = [], 0


def _releases_at_once(job: Job) -> int:
    """Number of releases that are simulated in one call: large, to reduce the cost of calls, but small if impacts or
    samples take memory."""
    bulky = {"impacts", "samples"} & set(job.keep)
    return DRAW_GROUP * (1 if bulky else ENGINES[job.engine].groups_at_once)


def warm_up(job: Job) -> None:
    """Compile the code that chunks need, or load it from the cache."""
    _simulate(job, Chunk(0, 0, 0, 1, 0), 0, 1, Counts.none(job))


def _simulate(job: Job, chunk: Chunk, first: int, stop: int, counts: Counts) -> dict[str, dict[str, pa.Array]]:
    """Output -> columns, of releases first .. stop - 1 of the block of the chunk. Adds these releases to `counts`."""
    import pyarrow as pa

    group = job.group(chunk.block, first, stop)
    found = group_outcome(job, group)
    numbers = chunk.offset + np.arange(first, stop)

    def columns(names: Sequence[str], release: Array, **of: Any) -> dict[str, pa.Array]:
        of |= {"release": numbers[release], "block": _text(block, np.zeros(len(release), int))}
        return {name: pa.array(of[name]) for name in names}

    block, out = [job.blocks[chunk.block].name], {}
    if "ends" in job.keep:
        out["ends"] = columns(STOP_COLUMNS, np.arange(len(group.states)), **_ends(job, group, found, counts))
    if "crossings" in job.keep:
        release, crossings = _crossings(job, group, found, counts)
        out["crossings"] = columns(CROSSING_COLUMNS, release, **crossings)
    if found.impacts is not None:
        release, zone, values = found.impacts
        named = dict(zip(IMPACT_NAMES[1:], values.T, strict=True))
        zones = _text(job.cross_section.zone_names, zone)
        out["impacts"] = columns(IMPACT_COLUMNS, release, zone=zones, **named)
    if found.samples is not None:
        times, ended = job.times_s(), found.ends[:, :1]
        release, at = np.nonzero(
            np.isfinite(found.samples[:, :, 0]) & (times <= ended + FRAME_TOLERANCE / job.scenario.outputs.fps)
        )
        named = dict(zip(POSE_NAMES, found.samples[release, at].T, strict=True))
        out["samples"] = columns(SAMPLE_COLUMNS, release, t_s=times[at], **named)
    counts.unclosed[...] += found.unclosed
    for total, further in zip(counts.passing, found.passing(job.cross_section), strict=True):
        total += further
    return out


def _ends(job: Job, group: Group, found: Outcome, counts: Counts) -> dict[str, Any]:
    ground, (t, x, y) = job.cross_section, found.ends[:, :3].T
    zone = ground.zone_ids[nearest_facets(found.ends[:, 1:3], ground.points_m)]
    zone[found.stop == STOP_EXIT] = -1
    runout = x - group.states[:, 0]
    counts.add_ends(found.stop, zone, runout)
    sizes = np.array([condition.block.size_m for condition in group.conditions])
    left = left_source(group.states[:, 0], x, found.stop == STOP_EXIT, sizes)
    counts.left_source[...] += np.count_nonzero(left)
    stop, zones = _text(STOPS, found.stop), _text(ground.zone_names, zone)
    return {"stop": stop, "zone": zones, "runout_m": runout, "t_s": t, "x_m": x, "y_m": y}


def _crossings(job: Job, group: Group, found: Outcome, counts: Counts) -> tuple[Array, dict[str, Any]]:
    """Index of the release of each crossing, and the columns of crossings."""
    lines = list(job.cross_section.measure_lines)
    release, line, values = crossing_rows(found.crossings, *job.lines, group.masses())
    counts.add_crossings(line, values)
    return release, {"line": _text(lines, line), **dict(zip(CROSSING_VALUES, values, strict=True))}


def _text(names: Sequence[str], index: Array) -> pa.DictionaryArray:
    """Column of names[index], null for -1."""
    import pyarrow as pa

    missing = index < 0
    codes = pa.array(index.astype(np.int32), mask=missing if missing.any() else None)
    return pa.DictionaryArray.from_arrays(codes, pa.array(names, pa.string()))
