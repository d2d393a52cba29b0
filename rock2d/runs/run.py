"""A checked scenario through an engine: all releases, shared out among processes where that pays.

Every release has its own random numbers, so results are bit-identical whatever the number of workers.
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

FRAME_MARGIN_S = (
    1e-9  # a restarted release lasts a little longer than its film, so that the last frame is inside
)


class _Job(NamedTuple):
    """What a worker process needs to simulate releases; `common` are the conditions of all releases of a block, by its
    name, where they do not vary."""

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
    """Run every release of a scenario; `engine`, `seed` and `releases` (of each block) come instead of the scenario's.

    progress : whether to show a bar; or the bars of a command of which this is a stage

    Results do not depend on `workers`, the number of processes. Raises InputError if the scenario has no parameters for
    the engine, or there is no such engine.
    """
    chosen = engine_named(engine or scenario.engine)
    seed = scenario.seed if seed is None else seed
    conditions = Conditions(scenario, chosen.name, seed)
    conditions.check_starts(releases or scenario.releases)
    begun = starts(conditions, releases)
    states = [start for start, _ in begun]
    common = {own.block.name: own for own in conditions.common}
    blocks = {name: met.block for name, met in common.items()}
    job = _Job(chosen.name, scenario.gravity_m_s2, {} if conditions.vary else common)
    own = [condition for _, condition in begun] if conditions.vary else [None] * len(begun)
    jobs = list(zip(states, _time_limits(scenario, states), own, strict=True))
    title = run_title(scenario, chosen.name)
    bars, processes = Bars.of(progress), workers or os.cpu_count() or 1
    with closing(_tracks(job, jobs, processes)) as simulated, bars.stage(title, len(jobs), "releases") as bar:
        found = dict(bar.counted(simulated))
    tracks = [found[k] for k in range(len(states))]
    return RunResult(
        chosen.name, conditions.cross_section, blocks, tracks, _recording(scenario, seed), title,
        own_blocks={start.release: met.block for start, met in begun if met.block is not common[start.block].block},
        scenario=scenario, seed=seed, incident_states=states,
        drawn={start.release: met.drawn for start, met in begun if met.drawn},
    )  # fmt: skip


def run_title(scenario: Scenario, engine: str) -> str:
    """What a run is called on its figures and on its bar."""
    return f"{scenario.name} ({engine})"


def run_bars(scenario: Scenario, engine: str, shown: bool, workers: int | None = None) -> Bars:
    """The bars of a run whose results are written."""
    own = ENGINES[engine]
    processes = (workers or os.cpu_count() or 1) if own.many_processes else 1
    return Bars(shown, {run_title(scenario, engine): 1.0, WRITING: own.writing_work * processes})


def _recording(scenario: Scenario, seed: int) -> Recording:
    """At the film's instants if releases were restarted, else at the output frame rate; with the outputs' noise."""
    outputs, film = scenario.outputs, scenario.experiment
    times = {}
    if film is not None and film.trajectories is not None:
        times = {int(str(k)): v.to_numpy(float) for k, v in film.trajectories.groupby("release")["t_s"]}
    return Recording(outputs.fps, outputs.position_noise_m, outputs.angle_noise_rad, times, seed)


def _time_limits(scenario: Scenario, states: list[IncidentState]) -> list[float]:
    """A restarted release runs as long as its film; any other as long as the scenario says."""
    if scenario.experiment is None or scenario.experiment.trajectories is None:
        return [scenario.longest_release_s()] * len(states)
    last = scenario.experiment.trajectories.groupby("release")["t_s"].max()
    longest = scenario.longest_release_s()
    return [min(longest, float(last[s.release]) - s.t_s + FRAME_MARGIN_S) for s in states]


def _tracks(
    job: _Job, releases: list[tuple[IncidentState, float, Condition | None]], workers: int
) -> Generator[tuple[int, Track]]:
    """Index and track of each release; the first in this process, so that workers find compiled code in the cache."""
    alone = (
        len(releases) if min(workers, len(releases) - 1) <= 1 or not ENGINES[job.engine].many_processes else 1
    )
    with _interrupts_between_releases() as check:
        for k, release in enumerate(releases[:alone]):
            check()
            yield k, _track(job, *release)
        check()
    with closing(as_finished(_track, releases[alone:], workers, (job,))) as others:
        for k, track in others:
            yield alone + k, track


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


def _track(job: _Job, start: IncidentState, limit_s: float, own: Condition | None) -> Track:
    met = own or job.common[start.block]
    track = ENGINES[job.engine].track(
        ReleaseInputs(met, np.asarray(start.state), start.release, job.gravity_m_s2, limit_s, start.seed)
    )
    track.shift_time(start.t_s)
    return track
