"""The table of engines: each by its name, with the interface that a run uses.

The engines themselves (`rock2d.engines`) are imported when a release runs, because their import is slow."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, NamedTuple

from rock2d.errors import InputError

if TYPE_CHECKING:
    from rock2d.files.scenario import Scenario
    from rock2d.records.track import Track
    from rock2d.runs.incident_states import IncidentState
    from rock2d.scene.blocks import Block
    from rock2d.scene.cross_section import CrossSection


class Condition(NamedTuple):
    """Block, ground and parameters of a release.

    Attributes
    ----------
    parameters : rows (zones, columns) of the contact law, with columns of effects if any act; of the engine
        point_mass: zone name, or default -> parameters of the rebound law
    drawn : values drawn for this release: place in the scenario file, or quantity of the block -> value"""

    block: Block
    cross_section: CrossSection
    parameters: Any
    drawn: Mapping[str, float]


@dataclass(frozen=True)
class Engine:
    """The interface of an engine to a run.

    Attributes
    ----------
    law : key of `model` in a scenario with its parameters: "deterministic" or "probabilistic"
    track : (condition, start, gravity in m/s², time limit in s) -> the motion of one release
    many_processes : whether its releases take so long that a run starts further processes
    audits_energy : whether its tracks have an energy audit
    keeps_samples : whether a campaign can keep sampled trajectories
    groups_at_once : groups of releases (`DRAW_GROUP`) that a campaign simulates in one call, about one second of work
    chunk_releases : default number of releases of a chunk: large enough that writing takes little time, small enough
        that an interruption loses only some seconds of work
    one_thread_per_chunk : whether each thread of a campaign computes its own chunk, because writing dominates
    writing_work : time for tables and files of a run over the time for its simulation in one process"""

    name: str
    law: str
    track: Callable[[Condition, IncidentState, float, float], Track]
    many_processes: bool = False
    audits_energy: bool = False
    keeps_samples: bool = False
    groups_at_once: int = 1
    chunk_releases: int = 10_000
    one_thread_per_chunk: bool = False
    writing_work: float = 15.0

    def parameters(self, scenario: Scenario, block: Block) -> Mapping[str, Any]:
        """Zone name, or default -> parameters of its law."""
        deterministic = self.law == "deterministic"
        return (scenario.contact_parameters if deterministic else scenario.rebound_parameters)(block)


def engine_named(name: str) -> Engine:
    """The engine of that name; raises InputError, code unknown_name, if there is none."""
    if name not in ENGINES:
        raise InputError(
            f"unknown engine {name!r}, expected one of {', '.join(ENGINES)}", code="unknown_name", name=name
        )
    return ENGINES[name]


def compiled_engine(name: str) -> Engine:
    """The engine with the same law that simulates many releases at once."""
    return engine_named(SAME_LAW.get(name, name))


def _pymunk_track(condition: Condition, start: IncidentState, gravity_m_s2: float, limit_s: float) -> Track:
    from rock2d.engines.pymunk_engine import run_pymunk

    return run_pymunk(
        *condition[:3], start.state, release=start.release, gravity_m_s2=gravity_m_s2, time_limit_s=limit_s
    )


def _batch_track(condition: Condition, start: IncidentState, gravity_m_s2: float, limit_s: float) -> Track:
    from rock2d.engines.batch import run_batch_track

    return run_batch_track(
        *condition[:3], start.state, release=start.release, gravity_m_s2=gravity_m_s2, time_limit_s=limit_s
    )


def _point_mass_track(condition: Condition, start: IncidentState, gravity_m_s2: float, limit_s: float) -> Track:
    from rock2d.engines.point_mass import run_point_mass

    return run_point_mass(
        *condition[:3], start.state,
        release=start.release, gravity_m_s2=gravity_m_s2, time_limit_s=limit_s, seed=start.seed,
    )  # fmt: skip


_ENGINES = (
    Engine("pymunk", "deterministic", _pymunk_track, many_processes=True, audits_energy=True, writing_work=0.3),
    Engine("batch", "deterministic", _batch_track, audits_energy=True, keeps_samples=True),
    Engine(
        "point_mass",
        "probabilistic",
        _point_mass_track,
        groups_at_once=10,
        chunk_releases=100_000,
        one_thread_per_chunk=True,
    ),
)
ENGINES: Mapping[str, Engine] = MappingProxyType({engine.name: engine for engine in _ENGINES})
SAME_LAW = {"pymunk": "batch"}  # the compiled engine of the same law
