"""Campaigns: ensembles too large for full tracks in memory, computed in chunks. An interrupted campaign can be
continued.

A chunk is a fixed number of releases of one block. The folder holds campaign.json (what determines the result),
chunks/<output>/<number>.parquet, and tables that are computed from these at the end. The bytes of the tables do not
depend on the number of processes or on interruptions."""

from __future__ import annotations

import hashlib
import json
import shutil
import threading
from collections.abc import Callable, Sequence
from concurrent.futures import CancelledError, ThreadPoolExecutor, as_completed
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rock2d.cluster import SCALE_EXTRA, THIS_PROCESS, Workers, as_finished_on_cluster, require_dask, versions
from rock2d.errors import InputError, require
from rock2d.files.text_files import read_json
from rock2d.runs.campaigns import DEFAULT_OUTPUTS, OUTPUTS
from rock2d.runs.engines import ENGINES, Engine, compiled_engine, engine_named
from rock2d.runs.indicators.passing import PASSING_COLUMNS

if TYPE_CHECKING:
    import pandas as pd

    from rock2d.files.scenario import Scenario
    from rock2d.runs.campaigns.job import Chunk, Job
    from rock2d.scene.cross_section import CrossSection

MOST_RELEASES_IN_MEMORY = 10_000  # a run of more releases than this is a campaign
OWN_CONDITIONS_CHUNK = 10_000  # most releases of a chunk if each has its own conditions, which takes longer
BYTES_OF_A_SAMPLE = 32
READ_OUTPUTS = {"crossings", "ends"}  # outputs from which tables are computed
TABLES_SHARE = 0.02  # time for the tables over the time for the releases
MANIFEST = "campaign.json"
OVERWRITE_OR_OUT = "--overwrite replaces it, --out chooses another folder"
# keys of a scenario that change no chunk file and no table, or that stand elsewhere in the manifest
KEYS_WITHOUT_INFLUENCE = {"about", "assumed", "engine", "seed", "releases", "outputs", "uncertainty", "design_values"}


def is_campaign(scenario: Scenario, releases: int | None = None) -> bool:
    """Whether a run of `releases` of each block (default: those of the scenario) is too large for memory."""
    each = releases or scenario.releases
    if scenario.experiment is None:
        return each * len(scenario.make_blocks()) > MOST_RELEASES_IN_MEMORY
    films = scenario.experiment.trajectories
    assert films is not None
    return int(films.groupby("block")["release"].nunique().clip(upper=each).sum()) > MOST_RELEASES_IN_MEMORY


@dataclass(frozen=True)
class CampaignOptions:
    """Options of a campaign.

    Attributes
    ----------
    engine, seed, releases : replace those of the scenario; releases are those of each block
    keep : names of `OUTPUTS`, default ends and crossings. If only crossings are kept, a release stops as soon as its
        energy is too small to reach another measure line
    chunk_releases : releases of a chunk; None: default of the engine"""

    engine: str | None = None
    seed: int | None = None
    releases: int | None = None
    keep: Sequence[str] = ()
    chunk_releases: int | None = None


def run_campaign(
    scenario: Scenario,
    folder: Path,
    options: CampaignOptions = CampaignOptions(),
    workers: Workers = THIS_PROCESS,
    *,
    overwrite: bool = False,
    progress: bool = True,
    report: Callable[[str], Any] = print,
) -> dict[str, pd.DataFrame]:
    """Run a campaign into `folder`, or continue it; returns its tables by name.

    `overwrite`: remove a different campaign, or an earlier run, in `folder`; `report` gets messages for the user, one
    line per call.

    Raises InputError if this cannot be a campaign (engine pymunk, measured incident states, no pyarrow), if `folder`
    holds anything else or, without `overwrite`, another result, or if it cannot be written. Messages of OSError,
    for example of a full disk, and of KeyboardInterrupt say how many chunks are done."""
    from rock2d.files.csv_tables import write_tables
    from rock2d.progress import Bars
    from rock2d.runs.campaigns.campaign_tables import all_counts, campaign_tables
    from rock2d.runs.campaigns.chunks import is_done

    job, manifest = _job_and_manifest(scenario, folder, options)
    if workers.scheduler is not None:
        require_dask()
    chunks = _chunks(len(job.blocks), options.releases or scenario.releases, _chunk_releases(scenario, options))
    _prepare_folder(folder, manifest, job, overwrite)
    _remove_partial_files(job)
    todo = [chunk for chunk in chunks if not is_done(job, chunk)]
    total = sum(chunk.count for chunk in chunks)
    _announce(job, total, len(chunks), len(todo), report)
    title = f"{scenario.name} ({job.engine})"
    try:
        first = total - sum(chunk.count for chunk in todo)
        bars = Bars(progress, {title: total - first, "tables": TABLES_SHARE * total})
        with bars.stage(title, total, "releases", first) as bar:
            _compute(job, todo, workers, bar.update)
        counts = all_counts(job, chunks)
        with bars.stage("tables", len(chunks) * len(READ_OUTPUTS & set(job.keep)), "files") as bar:
            tables = campaign_tables(job, chunks, counts, bar.update)
        write_tables(folder, tables)
        if unclosed := sum(int(of_block.unclosed) for of_block in counts):
            report(f"energy audit: DOES NOT CLOSE for {unclosed} of {total} releases")
    except KeyboardInterrupt:
        raise KeyboardInterrupt(_progress_text(job, chunks)) from None
    except OSError as error:
        message = f"{error.strerror or error}; {_progress_text(job, chunks)}"
        raise OSError(error.errno, message, str(error.filename or folder)) from None
    finally:
        _remove_partial_files(job)
    return tables


def _remove_partial_files(job: Job) -> None:
    """Remove incomplete files of processes that were killed."""
    for partial in job.folder.glob("*/.*"):
        partial.unlink(missing_ok=True)


def _announce(job: Job, total: int, chunks: int, todo: int, report: Callable[[str], Any]) -> None:
    report(
        f"campaign: {total} releases in {chunks} chunks, kept: {', '.join(job.keep)}; "
        "no full tracks, so no trajectories, figures or video"
    )
    if "samples" in job.keep:
        most = total * job.time_limit_s * job.scenario.outputs.fps * BYTES_OF_A_SAMPLE / 1e9
        report(f"samples: up to {most:.3g} GB before compression, if every release lasts until the time limit")
    if todo < chunks:
        report(f"{chunks - todo} of {chunks} chunks are done already")


def _progress_text(job: Job, chunks: Sequence[Chunk]) -> str:
    from rock2d.runs.campaigns.chunks import is_done

    done = sum(is_done(job, chunk) for chunk in chunks)
    return f"{done} of {len(chunks)} chunks are done, the same command continues from there"


def _job_and_manifest(scenario: Scenario, folder: Path, options: CampaignOptions) -> tuple[Job, dict[str, Any]]:
    """The job of a campaign and its manifest; raises InputError if it cannot be a campaign."""
    from rock2d.runs.campaigns.job import Job

    engine = engine_named(options.engine or scenario.engine)
    keep = tuple(name for name in OUTPUTS if name in (options.keep or DEFAULT_OUTPUTS))
    _check_campaign(scenario, engine, keep, scenario.make_cross_section())
    seed = scenario.seed if options.seed is None else options.seed
    fps = scenario.outputs.fps
    determined_by = {
        "scenario": scenario.model_dump(mode="json", exclude=KEYS_WITHOUT_INFLUENCE),
        "engine": engine.name,
        "seed": seed,
        "releases": options.releases or scenario.releases,
        "chunk_releases": _chunk_releases(scenario, options),
        "keep": list(keep),
        "passing": list(PASSING_COLUMNS),
        **({"fps": fps} if "samples" in keep else {}),
        "versions": versions(),
        **({"diagnosis": scenario.diagnosed.fingerprint} if scenario.diagnosed else {}),
    }
    fingerprint = hashlib.sha256(json.dumps(determined_by, sort_keys=True).encode()).hexdigest()
    job = Job(scenario, engine.name, seed, folder.absolute() / "chunks", fingerprint, keep)
    job.check_starts(options.releases or scenario.releases)
    about = {"about": scenario.about, "assumed": scenario.assumed}
    return job, {**about, "fingerprint": fingerprint, "determined_by": determined_by}


def _check_campaign(scenario: Scenario, engine: Engine, keep: tuple[str, ...], cross_section: CrossSection) -> None:
    if (compiled := compiled_engine(engine.name)) is not engine:
        raise InputError(
            f"engine {engine.name} is for single releases; for a campaign use the compiled engine of the same law: "
            f"--engine {compiled.name}",
            code="wrong_kind",
            engine=engine.name,
        )
    if scenario.experiment is not None:
        raise InputError(
            "campaigns draw their releases; these start from the measured states of an experiment", code="wrong_kind"
        )
    if "samples" in keep and not engine.keeps_samples:
        raise InputError(
            f"engine {engine.name} keeps no samples: between its impacts, a block flies on a parabola",
            code="wrong_kind",
            engine=engine.name,
        )
    if keep == ("crossings",) and not cross_section.measure_lines:
        raise InputError("only crossings are kept, but the cross-section has no measure lines", code="wrong_kind")
    require("pyarrow", f"pyarrow is missing, which writes the parquet files of a campaign: {SCALE_EXTRA}")


def _prepare_folder(folder: Path, manifest: dict[str, Any], job: Job, overwrite: bool) -> None:
    """Create the folders of a campaign and write its manifest; refuse a folder that holds anything else. A different
    campaign or an earlier run is removed if `overwrite` is set."""
    from rock2d.files.folders import check_output_folder, mark_as_result, unwritable, write_whole
    from rock2d.runs.results import KIND

    path = folder / MANIFEST
    try:
        if path.is_file():
            mismatch = _mismatch(path, manifest)
            if mismatch and not overwrite:
                raise mismatch
            if mismatch:
                shutil.rmtree(folder)
        elif folder.exists() and (not folder.is_dir() or any(p.name[0] != "." for p in folder.iterdir())):
            check_output_folder(folder, overwrite, KIND)  # of a run of fewer releases
            shutil.rmtree(folder)
        write_whole(path, json.dumps(manifest, indent=2, ensure_ascii=False) + "\n")
        mark_as_result(folder, KIND)  # a run of fewer releases may replace it
        for output in job.keep:
            (job.folder / output).mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise unwritable(error, folder) from None


def _mismatch(path: Path, manifest: dict[str, Any]) -> InputError | None:
    """The error if the campaign with a manifest at `path` cannot be continued; None if it can."""
    try:
        found = read_json(path)
        fingerprint, other = found["fingerprint"], dict(found["determined_by"])
    except (ValueError, KeyError, TypeError):
        return InputError(f"is damaged; {OVERWRITE_OR_OUT}", path, code="not_a_result")
    if fingerprint == manifest["fingerprint"]:
        return None
    own = manifest["determined_by"]
    differ = [key for key in {**own, **other} if own.get(key) != other.get(key)]
    verb = "differs" if len(differ) == 1 else "differ"
    message = f"is a different campaign: {', '.join(differ)} {verb}; {OVERWRITE_OR_OUT}"
    return InputError(message, path, code="not_a_result", differ=differ)


def _chunk_releases(scenario: Scenario, options: CampaignOptions) -> int:
    if options.chunk_releases is not None:
        return options.chunk_releases
    most = engine_named(options.engine or scenario.engine).chunk_releases
    vary = scenario.scatter or scenario.roughness or scenario.populations
    return min(most, OWN_CONDITIONS_CHUNK) if vary else most


def _chunks(blocks: int, releases: int, chunk_releases: int) -> list[Chunk]:
    from rock2d.runs.campaigns.job import Chunk

    places = [(block, first) for block in range(blocks) for first in range(0, releases, chunk_releases)]
    return [
        Chunk(number, block, first, min(chunk_releases, releases - first), block * releases)
        for number, (block, first) in enumerate(places)
    ]


def _compute(job: Job, todo: Sequence[Chunk], workers: Workers, on_progress: Callable[[int], Any]) -> None:
    """Compute chunks on the workers of a scheduler, in several processes or in this one; `on_progress` gets the number
    of further releases that are done."""
    from rock2d.processes import as_finished, numba_threads
    from rock2d.runs.campaigns.chunks import run_chunk, warm_up

    jobs = [(chunk,) for chunk in todo]
    if workers.scheduler is not None:
        finished = as_finished_on_cluster(run_chunk, jobs, workers.scheduler, (job,), job.folder)
    elif min(workers.processes or 1, len(todo)) > 1:
        warm_up(job)  # compile here, so that workers find the code in the cache
        finished = as_finished(run_chunk, jobs, workers.processes or 1, (job,))
    else:
        with numba_threads(workers.processes) as threads:
            if ENGINES[job.engine].one_thread_per_chunk and min(threads, len(todo)) > 1:
                _compute_in_threads(job, todo, threads, on_progress)
                return
            for chunk in todo:
                run_chunk(job, chunk, on_progress)
        return
    with closing(finished) as done:
        for _, count in done:
            on_progress(count)


def _compute_in_threads(job: Job, todo: Sequence[Chunk], threads: int, on_progress: Callable[[int], Any]) -> None:
    """Compute chunks on threads of this process, one thread a chunk; the last chunks share the free threads."""
    import numba

    from rock2d.runs.campaigns.chunks import run_chunk, warm_up

    warm_up(job)  # compile before the threads start
    ended, lock = threading.Event(), threading.Lock()

    def count(releases: int) -> None:
        if ended.is_set():
            raise CancelledError
        with lock:
            on_progress(releases)

    def compute(k: int) -> None:
        remaining = min(threads, len(todo) - k)
        numba.set_num_threads(threads // remaining)  # holds for calls from this thread only
        run_chunk(job, todo[k], count)

    pool = ThreadPoolExecutor(min(threads, len(todo)))
    try:
        for done in as_completed([pool.submit(compute, k) for k in range(len(todo))]):
            done.result()
    finally:
        ended.set()  # after Ctrl-C, only the present groups are completed
        pool.shutdown(cancel_futures=True)
