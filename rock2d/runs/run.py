"""`rock2d run`: a checked scenario through an engine to a results folder.

Every release has its own random numbers, so results are bit-identical whatever the number of workers.
"""

from __future__ import annotations

import json
import os
import signal
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from rock2d.files.scenario import Scenario
from rock2d.records.track import IMPACT_COLUMNS, STATE_NAMES, Track
from rock2d.runs.incident_states import Start, starts
from rock2d.scene.blocks import Block
from rock2d.scene.cross_section import CrossSection

if TYPE_CHECKING:
    import pandas as pd

ENGINES = ("pymunk", "batch", "point_mass")


@dataclass(frozen=True)
class _Job:
    """What a worker process needs to simulate releases."""

    engine: str
    cross_section: CrossSection
    blocks: dict[str, Block]
    parameters: dict[str, Any]  # block -> parameters by zone
    gravity_m_s2: float


@dataclass
class RunResult:
    """What a run produced; `tracks` in the order of releases."""

    scenario: Scenario
    engine: str
    seed: int
    cross_section: CrossSection
    blocks: dict[str, Block]
    starts: list[Start]
    tracks: list[Track]


def simulate(
    scenario: Scenario,
    *,
    engine: str | None = None,
    seed: int | None = None,
    releases: int | None = None,
    workers: int | None = None,
    progress: bool = True,
) -> RunResult:
    """Run every release of a scenario.

    `engine`, `seed` and `releases` (per block) override the scenario's; `workers` processes (default: all
    cores). Raises InputError if the scenario has no parameters for the engine.
    """
    from tqdm import tqdm

    engine = engine or scenario.engine
    seed = scenario.seed if seed is None else seed
    blocks, cross_section = scenario.make_blocks(), scenario.make_cross_section()
    if engine in ("pymunk", "batch"):
        common = scenario.contact_parameters()
        parameters: dict[str, Any] = dict.fromkeys(blocks, common)
    elif engine == "point_mass":
        parameters = {name: scenario.rebound_parameters(name) for name in blocks}
    else:
        raise ValueError(f"engine must be one of {ENGINES}, got {engine!r}")
    job = _Job(engine, cross_section, blocks, parameters, scenario.gravity_m_s2)
    begin = starts(scenario, seed, releases)
    limits = _time_limits(scenario, begin)
    tracks = list(
        tqdm(
            _tracks(job, begin, limits, workers or os.cpu_count() or 1),
            total=len(begin), desc=f"{scenario.name} ({engine})", unit="release", disable=not progress,
        )
    )  # fmt: skip
    return RunResult(scenario, engine, seed, cross_section, blocks, begin, tracks)


def _time_limits(scenario: Scenario, begin: list[Start]) -> list[float]:
    """A restarted release runs as long as its film; any other as long as the scenario says."""
    if scenario.experiment is None or scenario.experiment.trajectories is None:
        return [scenario.time_limit_s] * len(begin)
    last = scenario.experiment.trajectories.groupby("release")["t_s"].max()
    return [min(scenario.time_limit_s, float(last[s.release]) - s.t_s + 1e-9) for s in begin]


def _tracks(job: _Job, begin: list[Start], limits: list[float], workers: int) -> Iterator[Track]:
    """Tracks in order; the first in this process, so that workers find compiled code in the cache."""
    if begin:
        yield _track(job, begin[0], limits[0])
    rest, rest_limits = begin[1:], limits[1:]
    workers = min(workers, len(rest))
    if workers <= 1 or job.engine != "pymunk":
        with _interrupts_between_releases() as check:
            for start, limit in zip(rest, rest_limits, strict=True):
                check()
                yield _track(job, start, limit)
        return
    import multiprocessing

    context = multiprocessing.get_context("spawn")
    pool = ProcessPoolExecutor(workers, mp_context=context, initializer=_set_job, initargs=(job,))
    try:
        yield from pool.map(_worker_track, rest, rest_limits, chunksize=2)
    finally:
        pool.shutdown(wait=True, cancel_futures=True)


@contextmanager
def _interrupts_between_releases() -> Iterator[Callable[[], None]]:
    """Keep Ctrl-C until the next check: raised inside a C callback of pymunk it would be lost."""
    pressed: list[int] = []
    if threading.current_thread() is not threading.main_thread():
        yield lambda: None
        return

    def check() -> None:
        if pressed:
            raise KeyboardInterrupt

    before = signal.signal(signal.SIGINT, lambda number, frame: pressed.append(number))
    try:
        yield check
    finally:
        signal.signal(signal.SIGINT, before)


_worker_job: _Job | None = None


def _set_job(job: _Job) -> None:
    global _worker_job
    _worker_job = job
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent answers Ctrl-C, once


def _worker_track(start: Start, limit_s: float) -> Track:
    assert _worker_job is not None
    return _track(_worker_job, start, limit_s)


def _track(job: _Job, start: Start, limit_s: float) -> Track:
    block, parameters = job.blocks[start.block], job.parameters[start.block]
    if job.engine == "pymunk":
        from rock2d.engines.pymunk_engine import run_pymunk

        track = run_pymunk(
            block, job.cross_section, parameters, start.state,
            release=start.release, gravity_m_s2=job.gravity_m_s2, time_limit_s=limit_s,
        )  # fmt: skip
    elif job.engine == "batch":
        from rock2d.engines.batch import run_batch_track
        from rock2d.laws.contact import parameter_table

        track = run_batch_track(
            block, job.cross_section, parameter_table(parameters, job.cross_section.zone_names), start.state,
            release=start.release, gravity_m_s2=job.gravity_m_s2, time_limit_s=limit_s,
        )  # fmt: skip
    else:
        from rock2d.engines.point_mass import run_point_mass

        track = run_point_mass(
            block, job.cross_section, parameters, start.state,
            release=start.release, gravity_m_s2=job.gravity_m_s2, time_limit_s=limit_s, seed=start.seed,
        )  # fmt: skip
    track.shift_time(start.t_s)
    return track


# what a run leaves behind ---------------------------------------------------------------------------------


def impacts_table(tracks: list[Track]) -> pd.DataFrame:
    """Every impact of every track, exact: rows of IMPACT_COLUMNS."""
    import pandas as pd

    rows = [{"release": t.release, "block": t.block, **impact} for t in tracks for impact in t.impacts]
    return pd.DataFrame(rows, columns=list(IMPACT_COLUMNS))


def trajectories_table(result: RunResult) -> pd.DataFrame:
    """Tracks sampled as a camera would: at the film's instants if releases were restarted, else at the output
    frame rate; with the outputs' noise (1 sigma, own stream per release)."""
    import pandas as pd

    outputs, film = result.scenario.outputs, result.scenario.experiment
    frames = []
    times = {}
    if film is not None and film.trajectories is not None:
        times = {int(str(k)): v.to_numpy(float) for k, v in film.trajectories.groupby("release")["t_s"]}
    for track in result.tracks:
        start = float(track.knots[0, 0])
        t = times.get(track.release)
        if t is None:
            t = start + np.arange(int((track.end_s - start) * outputs.fps + 1e-9) + 1) / outputs.fps
        pose = track.states(t)[:, :3]
        stream = np.random.SeedSequence(result.seed, spawn_key=(2, track.release))
        sigma = [outputs.position_noise_m, outputs.position_noise_m, outputs.angle_noise_rad]
        pose = pose + np.random.default_rng(stream).normal(size=pose.shape) * sigma
        frames.append(
            pd.DataFrame(
                {
                    "release": track.release,
                    "block": track.block,
                    "t_s": t,
                    "x_m": pose[:, 0],
                    "y_m": pose[:, 1],
                    "theta_rad": pose[:, 2],
                }
            )
        )
    return pd.concat(frames, ignore_index=True)


def write_results(
    result: RunResult, out: Path, *, video: bool = False, progress: bool = True
) -> dict[str, Any]:
    """Write the results folder, whole or not at all; returns the tables by name.

    Files: the experiment folder (formats of an experiment), impacts, crossings, passing, percentiles, stops,
    starts and energy as CSV, run.json, trajectories.png; where a film was restarted also residuals and
    residual_summary, overlay.png, residuals.png and side_by_side.webm; with `video` trajectories.webm.
    """
    import pandas as pd

    from rock2d import __version__
    from rock2d.files.experiment import Experiment, write_experiment_files
    from rock2d.files.folders import atomic_folder
    from rock2d.graphics.figure_style import save_figure
    from rock2d.graphics.trajectories import trajectories_figure
    from rock2d.runs import indicators

    scenario, outputs = result.scenario, result.scenario.outputs
    crossings = indicators.crossings_table(result.tracks, result.cross_section, result.blocks)
    tables = {
        "impacts": impacts_table(result.tracks),
        "crossings": crossings,
        "passing": indicators.passing_table(result.tracks, result.cross_section),
        "percentiles": indicators.percentile_table(crossings),
        "stops": indicators.stops_table(result.tracks, result.cross_section),
        "starts": pd.DataFrame(
            [
                {"release": s.release, "block": s.block, "t_s": s.t_s,
                 **dict(zip(STATE_NAMES, s.state, strict=True)), "frames_fitted": s.frames}
                for s in result.starts
            ]
        ),
    }  # fmt: skip
    if result.engine == "pymunk":
        tables["energy"] = pd.DataFrame(
            [{"release": t.release, "block": t.block, **{f"{k}_J": v for k, v in t.energy_J.items()}}
             for t in result.tracks]
        )  # fmt: skip
    simulated = Experiment(
        f"{scenario.name}_{result.engine}", scenario.gravity_m_s2, outputs.fps, outputs.position_noise_m,
        outputs.angle_noise_rad, result.cross_section, result.blocks, trajectories_table(result),
    )  # fmt: skip
    title = f"{scenario.name} ({result.engine})"
    with atomic_folder(out) as folder:
        write_experiment_files(folder, simulated)
        if scenario.experiment is not None:
            from rock2d.runs.comparison import write_comparison

            tables |= write_comparison(result, simulated, folder, progress=progress)
        for name, table in tables.items():
            table.to_csv(folder / f"{name}.csv", index=False, lineterminator="\n")
        about = {
            "scenario": scenario.name, "about": scenario.about, "assumed": scenario.assumed,
            "engine": result.engine, "seed": result.seed, "releases": len(result.tracks),
            "rock2d": __version__,
        }  # fmt: skip
        (folder / "run.json").write_text(json.dumps(about, indent=2) + "\n", encoding="utf-8")
        figure = trajectories_figure(result.cross_section, result.blocks, result.tracks, title)
        save_figure(figure, folder / "trajectories.png")
        if video:
            write_video(result, folder / "trajectories.webm", title, progress=progress)
    return tables


def write_video(result: RunResult, path: Path, title: str, *, progress: bool = True, **options: Any) -> None:
    """Film of the first releases of each block, one scene a release number."""
    from rock2d.graphics.clips import clip_from_track
    from rock2d.graphics.progress import frame_bar
    from rock2d.graphics.video import render_video
    from rock2d.graphics.video_options import VideoOptions

    outputs = result.scenario.outputs
    of_block = [[t for t in result.tracks if t.block == name] for name in result.blocks]
    scenes = [
        [clip_from_track(tracks[i]) for tracks in of_block if i < len(tracks)]
        for i in range(outputs.video_releases)
    ]
    with frame_bar("video", progress) as show:
        own = VideoOptions(**{"slow_motion": outputs.slow_motion, "titles": (title,), **options})
        scenes = [scene for scene in scenes if scene]
        render_video(path, result.cross_section, result.blocks, scenes, own, show)
