"""Run all releases of a scenario with an engine, in several processes if that is faster.

Every release has its own random numbers, so results do not depend on the number of processes.
"""

from __future__ import annotations

import os
import signal
import threading
from collections.abc import Callable, Generator, Iterator, Mapping
from contextlib import closing, contextmanager
from typing import NamedTuple

import numpy as np

from rock2d.files.scenario import Scenario
from rock2d.processes import as_finished
from rock2d.progress import Bars
from rock2d.records.track import Track
from rock2d.runs.conditions import Condition, Conditions, starts
from rock2d.runs.engines import ENGINES, ReleaseInputs, engine_named
from rock2d.runs.incident_states import IncidentState
from rock2d.runs.recording import Recording
from rock2d.runs.results import WRITING, RunResult

FRAME_MARGIN_S = 1e-9  # a restarted release lasts so much longer than its film, to include the last frame


class _Job(NamedTuple):
    """Inputs of a worker process. `common`: block name -> condition of all releases of the block, if they do not
    vary."""

    engine: str
    gravity_m_s2: float
    common: Mapping[str, Condition]


def run(
    scenario: Scenario,
    *,
    engine: str | None = None,
    seed: int | None = None,
    releases: int | None = None,
    workers: int | None = None,
    progress: bool | Bars = False,
) -> RunResult:
    """Run every release of a scenario. `engine`, `seed` and `releases` (of each block) replace those of the scenario.

    progress : show a progress bar; or the bars of a command of which this is a stage

    Results do not depend on `workers`, the number of processes. Raises InputError if the scenario has no parameters for
    the engine, or if there is no such engine.
    """
    chosen = engine_named(engine or scenario.engine)
    seed = scenario.seed if seed is None else seed
    conditions = Conditions(scenario, chosen.name, seed)
    conditions.check_starts(releases or scenario.releases)
    started = starts(conditions, releases)
    states = [start for start, _ in started]
    common = {condition.block.name: condition for condition in conditions.common}
    blocks = {name: condition.block for name, condition in common.items()}
    job = _Job(chosen.name, scenario.gravity_m_s2, {} if conditions.vary else common)
    own = [condition for _, condition in started] if conditions.vary else [None] * len(started)
    jobs = list(zip(states, _time_limits(scenario, states), own, strict=True))
    title = run_title(scenario, chosen.name)
    bars, processes = Bars.of(progress), workers or os.cpu_count() or 1
    with closing(_tracks(job, jobs, processes)) as simulated, bars.stage(title, len(jobs), "releases") as bar:
        found = dict(bar.counted(simulated))
    tracks = [found[k] for k in range(len(states))]
    return RunResult(
        chosen.name, conditions.cross_section, blocks, tracks, _recording(scenario, seed), title,
        own_blocks={start.release: own.block for start, own in started if own.block is not common[start.block].block},
        scenario=scenario, seed=seed, incident_states=states,
        drawn={start.release: own.drawn for start, own in started if own.drawn},
    )  # fmt: skip


def run_title(scenario: Scenario, engine: str) -> str:
    """The title of a run in its figures and in its progress bar."""
    return f"{scenario.name} ({engine})"


def run_bars(scenario: Scenario, engine: str, shown: bool, workers: int | None = None) -> Bars:
    """The progress bars of a run whose results are written."""
    chosen = ENGINES[engine]
    processes = (workers or os.cpu_count() or 1) if chosen.many_processes else 1
    return Bars(shown, {run_title(scenario, engine): 1.0, WRITING: chosen.writing_work * processes})


def _recording(scenario: Scenario, seed: int) -> Recording:
    """Recording at the instants of the film if releases are restarted, else at the frame rate of the outputs."""
    outputs, film = scenario.outputs, scenario.experiment
    times = {}
    if film is not None and film.trajectories is not None:
        times = {int(str(k)): v.to_numpy(float) for k, v in film.trajectories.groupby("release")["t_s"]}
    return Recording(outputs.fps, outputs.position_noise_m, outputs.angle_noise_rad, times, seed)


def _time_limits(scenario: Scenario, states: list[IncidentState]) -> list[float]:
    """Time limits in s: a restarted release runs as long as its film, others as long as the scenario says."""
    if scenario.experiment is None or scenario.experiment.trajectories is None:
        return [scenario.longest_release_s()] * len(states)
    last = scenario.experiment.trajectories.groupby("release")["t_s"].max()
    longest = scenario.longest_release_s()
    return [min(longest, float(last[s.release]) - s.t_s + FRAME_MARGIN_S) for s in states]


def _tracks(
    job: _Job, releases: list[tuple[IncidentState, float, Condition | None]], workers: int
) -> Generator[tuple[int, Track]]:
    """Index and track of each release. The first one runs in this process, so that workers find compiled code in the
    cache."""
    here = (
        len(releases) if min(workers, len(releases) - 1) <= 1 or not ENGINES[job.engine].many_processes else 1
    )
    with _interrupts_between_releases() as check:
        for k, release in enumerate(releases[:here]):
            check()
            yield k, _track(job, *release)
        check()
    with closing(as_finished(_track, releases[here:], workers, (job,))) as others:
        for k, track in others:
            yield here + k, track


@contextmanager
def _interrupts_between_releases() -> Iterator[Callable[[], None]]:
    """Delay Ctrl-C until the next check, because pymunk would ignore an exception inside its callbacks."""
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


def _track(job: _Job, start: IncidentState, limit_s: float, own: Condition | None) -> Track:
    condition = own or job.common[start.block]
    track = ENGINES[job.engine].track(
        ReleaseInputs(
            condition, np.asarray(start.state), start.release, job.gravity_m_s2, limit_s, start.seed
        )
    )
    track.shift_time(start.t_s)
    return track
