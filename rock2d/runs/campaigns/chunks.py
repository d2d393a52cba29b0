"""One chunk of a campaign: a fixed number of releases of one block, simulated and written as columnar files.

A chunk leaves one parquet file for each kept output, folder/<output>/<number>.parquet, written under another
name and renamed when whole. Any process can compute any chunk: its releases are drawn by their own numbers.
"""

from __future__ import annotations

import os
import secrets
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from rock2d.records.track import IMPACT_COLUMNS
from rock2d.runs.incident_states import GROUP, drawn_seeds, drawn_states
from rock2d.runs.indicators import CROSSING_COLUMNS, STOP_COLUMNS, crossing_values
from rock2d.scene.blocks import Block
from rock2d.scene.cross_section import CrossSection
from rock2d.scene.nearest_facet import nearest_facets

if TYPE_CHECKING:
    import pyarrow as pa

    from rock2d.files.scenario_keys import Incident

Array = np.ndarray

OUTPUTS = ("ends", "crossings", "impacts", "samples")
SAMPLE_COLUMNS = ("block", "release", "t_s", "x_m", "y_m", "theta_rad")
TEXT_COLUMNS = ("block", "line", "zone", "stop")
FINGERPRINT = b"rock2d_campaign"  # key of the campaign's fingerprint in a file's metadata
IMPACT_ROOM = 64  # impacts of a release that are recorded at first; a release with more runs once more
IMPACT_ROWS = 64 * GROUP  # impacts that such a second run may have room for at once


@dataclass(frozen=True)
class Job:
    """What it takes to compute any chunk of a campaign.

    Attributes
    ----------
    folder : holds a folder for each of `keep`, names of OUTPUTS
    fingerprint : of everything that determines the result; each file carries it
    parameters : by block, as the engine takes them: a table (zones, 6) or zone name -> ReboundParameters
    fps : samples per second, if they are kept
    versions : as `versions` gives them where the campaign was started
    """

    folder: Path
    fingerprint: str
    keep: tuple[str, ...]
    engine: str
    seed: int
    cross_section: CrossSection
    blocks: tuple[Block, ...]
    incidents: tuple[Incident, ...]
    parameters: tuple[Any, ...]
    gravity_m_s2: float
    time_limit_s: float
    fps: float
    versions: dict[str, str]


@dataclass(frozen=True)
class Chunk:
    """Releases first .. first + count - 1 of the block with index `block`; `offset` + i is i's number."""

    number: int
    block: int
    first: int
    count: int
    offset: int


@dataclass
class _Outcome:
    """What an engine found out about n releases; shapes as in `engines.batch.BatchResult`.

    impacts : their releases (k,), zone indices (k,) and values (k, 16) from t_s on, as in IMPACT_COLUMNS
    """

    stop: list[str]
    ends: Array
    crossings: Array
    impacts: tuple[Array, Array, Array] | None = None
    samples: Array | None = None


def versions() -> dict[str, str]:
    """Versions of what the numbers depend on: the code, the random streams, the compiler."""
    import numba

    from rock2d import __version__

    return {"rock2d": __version__, "numpy": np.__version__, "numba": numba.__version__}


def chunk_path(folder: Path, output: str, number: int) -> Path:
    """The file of one output of a chunk."""
    return folder / output / f"{number:07d}.parquet"


def is_done(job: Job, chunk: Chunk) -> bool:
    """Whether all files of a chunk are there, whole and of this campaign."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    for output in job.keep:
        try:
            metadata = pq.read_metadata(chunk_path(job.folder, output, chunk.number)).metadata
        except (OSError, pa.ArrowInvalid):  # not there, or cut short
            return False
        if (metadata or {}).get(FINGERPRINT) != job.fingerprint.encode():
            return False
    return True


def run_chunk(job: Job, chunk: Chunk, on_progress: Callable[[int], Any] = lambda count: None) -> int:
    """Simulate a chunk and write its files; returns its number of releases.

    One group of releases at a time is in memory; after each, `on_progress` hears how many there were. Raises OSError
    if a file cannot be written; whatever stops it, no file is then half there.
    """
    import pyarrow as pa
    import pyarrow.parquet as pq

    paths = {output: chunk_path(job.folder, output, chunk.number) for output in job.keep}
    token = secrets.token_hex(4)  # a process taken for dead may write the same chunk at the same time
    partial = {output: path.with_name(f".{path.name}.{token}") for output, path in paths.items()}
    writers: dict[str, pq.ParquetWriter] = {}
    end = chunk.first + chunk.count
    try:
        for first in range(chunk.first, end, GROUP):
            stop = min(first + GROUP, end)
            for output, columns in _simulate(job, chunk, first, stop).items():
                table = pa.table(columns)
                if output not in writers:
                    schema = table.schema.with_metadata({FINGERPRINT: job.fingerprint})
                    writers[output] = pq.ParquetWriter(
                        partial[output], schema, compression="zstd", use_dictionary=list(TEXT_COLUMNS)
                    )
                writers[output].write_table(table)
            on_progress(stop - first)
        for output, writer in writers.items():
            writer.close()
            os.replace(partial[output], paths[output])
    finally:
        for writer in writers.values():
            writer.close()
        for path in partial.values():
            path.unlink(missing_ok=True)
    return chunk.count


def warm_up(job: Job) -> None:
    """Compile what chunks need, or see that it is in the cache."""
    _simulate(job, Chunk(0, 0, 0, 1, 0), 0, 1)


def _simulate(job: Job, chunk: Chunk, first: int, stop: int) -> dict[str, dict[str, pa.Array]]:
    """Output -> columns of releases first .. stop - 1 of the chunk's block."""
    states = drawn_states(job.incidents[chunk.block], job.seed, chunk.block, first, stop)
    found = (_batch if job.engine == "batch" else _point_mass)(job, chunk.block, states, first)
    block, numbers = job.blocks[chunk.block], chunk.offset + np.arange(first, stop)

    def columns(names: Sequence[str], release: Array, **of: Any) -> dict[str, pa.Array]:
        of |= {"release": numbers[release], "block": _text([block.name], np.zeros(len(release), int))}
        return {name: of[name] for name in names}

    out = {}
    if "ends" in job.keep:
        out["ends"] = columns(STOP_COLUMNS, np.arange(len(states)), **_ends(job.cross_section, states, found))
    if "crossings" in job.keep:
        lines = job.cross_section.measure_lines
        release, line = np.nonzero(np.isfinite(found.crossings[:, :, 0]))
        values = np.empty((len(release), len(CROSSING_COLUMNS) - 3))
        for k, ends in enumerate(lines.values()):
            own = line == k
            values[own] = crossing_values(found.crossings[release[own], k], ends, job.cross_section, block)
        named = dict(zip(CROSSING_COLUMNS[3:], values.T, strict=True))
        out["crossings"] = columns(CROSSING_COLUMNS, release, line=_text(list(lines), line), **named)
    if found.impacts is not None:
        release, zone, values = found.impacts
        named = dict(zip(IMPACT_COLUMNS[3:], values.T, strict=True))
        zones = _text(job.cross_section.zone_names, zone)
        out["impacts"] = columns(IMPACT_COLUMNS, release, zone=zones, **named)
    if found.samples is not None:
        times, ended = _times_s(job), found.ends[:, :1]
        release, at = np.nonzero(np.isfinite(found.samples[:, :, 0]) & (times <= ended + 1e-9 / job.fps))
        named = dict(zip(SAMPLE_COLUMNS[3:], found.samples[release, at].T, strict=True))
        out["samples"] = columns(SAMPLE_COLUMNS, release, t_s=times[at], **named)
    return out


def _ends(cross_section: CrossSection, states: Array, found: _Outcome) -> dict[str, Any]:
    import pyarrow as pa

    stop = np.array(found.stop)
    zones = cross_section.zone_ids[nearest_facets(found.ends[:, 1:3], cross_section.points_m)]
    return {
        "stop": pa.array(stop),
        "zone": _text(cross_section.zone_names, np.where(stop == "exit", -1, zones)),
        "runout_m": found.ends[:, 1] - states[:, 0],
        **{name: found.ends[:, i] for i, name in enumerate(("t_s", "x_m", "y_m"))},
    }


def _text(names: Sequence[str], index: Array) -> pa.Array:
    """Column of names[index], null for -1."""
    import pyarrow as pa

    codes = pa.array(index.astype(np.int32), mask=index < 0)
    return pa.DictionaryArray.from_arrays(codes, pa.array(names, pa.string())).dictionary_decode()


def _times_s(job: Job) -> Array:
    return np.arange(int(job.time_limit_s * job.fps + 1e-9) + 1) / job.fps


def _batch(job: Job, block: int, states: Array, first: int) -> _Outcome:
    from rock2d.engines.batch import STOPS, Ensemble, run_batch

    ensemble = Ensemble([job.blocks[block]], [job.cross_section], [job.parameters[block]])
    times = _times_s(job) if "samples" in job.keep else None

    def run(some: Array | slice, room: int) -> Any:
        return run_batch(
            ensemble, states[some], gravity_m_s2=job.gravity_m_s2, time_limit_s=job.time_limit_s,
            impact_room=room, times_s=times,
            stop_when_spent=job.keep == ("crossings",),  # any other output lasts until the block stops
        )  # fmt: skip

    def impacts(rows: Array) -> tuple[Array, Array]:
        return rows[:, 0].astype(int), rows[:, 1:]

    outcome, result = _outcome(job, STOPS, run, impacts)
    if times is not None:
        outcome.samples = result.samples
    return outcome


def _point_mass(job: Job, block: int, states: Array, first: int) -> _Outcome:
    from rock2d.engines.point_mass import STOPS
    from rock2d.engines.point_mass_batch import run_point_mass_batch

    seeds = drawn_seeds(job.seed, block, first, first + len(states))

    def run(some: Array | slice, room: int) -> Any:
        return run_point_mass_batch(
            job.blocks[block], job.cross_section, job.parameters[block], states[some], seeds[some],
            gravity_m_s2=job.gravity_m_s2, time_limit_s=job.time_limit_s, impact_room=room,
        )  # fmt: skip

    def impacts(rows: Array) -> tuple[Array, Array]:
        unknown = np.full((len(rows), 2), np.nan)  # penetration and force
        values = np.column_stack([rows[:, :7], rows[:, :4], rows[:, 7:10], unknown])
        return job.cross_section.zone_ids[rows[:, 10].astype(int)], values

    return _outcome(job, STOPS, run, impacts)[0]


def _outcome(
    job: Job,
    stops: Sequence[str],
    run: Callable[[Array | slice, int], Any],
    impacts: Callable[[Array], tuple[Array, Array]],
) -> tuple[_Outcome, Any]:
    """The outcome of an engine's `run` (releases, room for impacts), and what it gave; `impacts` takes its rows to zone
    indices and values."""
    keep = "impacts" in job.keep
    result = run(slice(None), IMPACT_ROOM if keep else 0)
    outcome = _Outcome([stops[i] for i in result.stop], result.ends, result.crossings)
    if keep:
        release, rows = _all_impacts(result.impacts, result.impact_count, run)
        outcome.impacts = release, *impacts(rows)
    return outcome, result


def _all_impacts(impacts: Array, count: Array, run: Callable[[Array, int], Any]) -> tuple[Array, Array]:
    """Every impact of n releases: their releases (k,) and rows (k, width), in order.

    `impacts` (n, room, width) holds the first ones of `count` (n,); `run` (releases, room) runs those that had
    more once more.
    """
    room = impacts.shape[1]
    taken = [(np.flatnonzero(count <= room), impacts[count <= room])]
    crowded = np.flatnonzero(count > room)
    if len(crowded):
        room = int(count[crowded].max())
        at_once = max(1, IMPACT_ROWS // room)
        for i in range(0, len(crowded), at_once):
            some = crowded[i : i + at_once]
            taken.append((some, run(some, room).impacts))
    releases, rows = [], []
    for some, held in taken:
        which, k = np.nonzero(np.arange(held.shape[1]) < count[some, None])
        releases.append(some[which])
        rows.append(held[which, k])
    release = np.concatenate(releases)
    order = np.argsort(release, kind="stable")
    return release[order], np.concatenate(rows)[order]
