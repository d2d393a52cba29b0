"""Run all releases of a scenario with an engine, in several processes if that is faster.

Every release has its own random numbers, so results do not depend on the number of processes."""

import os
import signal
import threading
from collections.abc import Callable, Generator, Iterator
from contextlib import closing, contextmanager

from rock2d.files.scenario import Scenario
from rock2d.processes import as_finished
from rock2d.progress import Bars
from rock2d.records.track import Track
from rock2d.runs.acting_effects import true_film
from rock2d.runs.conditions import Conditions, starts
from rock2d.runs.engines import ENGINES, Condition, engine_named
from rock2d.runs.incident_states import IncidentState
from rock2d.runs.recording import Recording
from rock2d.runs.results import WRITING, RunResult

FRAME_MARGIN_S = 1e-9  # a restarted release lasts so much longer than its film, to include the last frame


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
    the engine, or if there is no such engine."""
    chosen = engine_named(engine or scenario.engine)
    seed = scenario.seed if seed is None else seed
    conditions = Conditions(scenario, chosen.name, seed)
    conditions.check_starts(releases or scenario.releases)
    started = starts(conditions, releases)
    states = [start for start, _ in started]
    blocks = {condition.block.name: condition.block for condition in conditions.common}
    jobs = [(*pair, limit_s) for pair, limit_s in zip(started, _time_limits(scenario, states), strict=True)]
    title = run_title(scenario, chosen.name)
    bars, processes = Bars.of(progress), workers or os.cpu_count() or 1
    shared = chosen.name, scenario.gravity_m_s2
    with closing(_tracks(shared, jobs, processes)) as simulated, bars.stage(title, len(jobs), "releases") as bar:
        found = dict(bar.counted(simulated))
    tracks = [found[k] for k in range(len(states))]
    return RunResult(
        chosen.name, conditions.cross_section, blocks, tracks, _recording(scenario, seed), title,
        own_blocks={start.release: own.block for start, own in started if own.block is not blocks[start.block]},
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
    outputs, times = scenario.outputs, {}
    if scenario.experiment is not None and (rows := true_film(scenario).trajectories) is not None:
        times = {int(str(k)): v.to_numpy(float) for k, v in rows.groupby("release")["t_s"]}
    return Recording(outputs.fps, outputs.position_noise_m, outputs.angle_noise_rad, times, seed)


def _time_limits(scenario: Scenario, states: list[IncidentState]) -> list[float]:
    """Time limits in s: a restarted release runs as long as its film, others as long as the scenario says."""
    if scenario.experiment is None or (rows := true_film(scenario).trajectories) is None:
        return [scenario.longest_release_s()] * len(states)
    last = rows.groupby("release")["t_s"].max()
    longest = scenario.longest_release_s()
    return [min(longest, float(last[s.release]) - s.t_s + FRAME_MARGIN_S) for s in states]


def _tracks(
    shared: tuple[str, float], releases: list[tuple[IncidentState, Condition, float]], workers: int
) -> Generator[tuple[int, Track]]:
    """Index and track of each release; `shared` is the engine and gravity in m/s². The first release runs in this
    process, so that workers find compiled code in the cache."""
    one_process = min(workers, len(releases) - 1) <= 1 or not ENGINES[shared[0]].many_processes
    here = len(releases) if one_process else 1
    with _interrupts_between_releases() as check:
        for k, (start, condition, limit_s) in enumerate(releases[:here]):
            check()
            yield k, _track(*shared, start, condition, limit_s)
        check()
    with closing(as_finished(_track, releases[here:], workers, shared)) as others:
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


def _track(engine: str, gravity_m_s2: float, start: IncidentState, condition: Condition, limit_s: float) -> Track:
    track = ENGINES[engine].track(condition, start, gravity_m_s2, limit_s)
    track.shift_time(start.t_s)
    return track
