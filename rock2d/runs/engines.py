"""The engines of a run by name, with one interface for all.

The engines themselves (`rock2d.engines`) are imported when a release runs, because their import is slow.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, NamedTuple

from rock2d.errors import InputError

if TYPE_CHECKING:
    import numpy as np

    from rock2d.files.scenario import Scenario
    from rock2d.records.track import Track
    from rock2d.runs.campaigns.ensembles import Outcome
    from rock2d.runs.campaigns.job import Job
    from rock2d.runs.conditions import Condition, Group
    from rock2d.scene.blocks import Block


class ReleaseInputs(NamedTuple):
    """Inputs of an engine for one release.

    Attributes
    ----------
    condition : block, cross-section and parameters of the law
    state : (6,) state of the centre of mass at t = 0, in SI
    release : number of the release
    seed : seed of the random stream of the release
    """

    condition: Condition
    state: np.ndarray
    release: int
    gravity_m_s2: float
    time_limit_s: float
    seed: int


@dataclass(frozen=True)
class Engine:
    """The interface of an engine to a run.

    Attributes
    ----------
    law : key of `model` in a scenario with its parameters: "deterministic" or "probabilistic"
    track : simulates one release
    ensemble : simulates a group of releases of a campaign; None if the engine is for single releases only
    many_processes : whether its releases take so long that a run starts further processes
    audits_energy : whether its tracks have an energy audit
    keeps_samples : whether a campaign can keep sampled trajectories
    groups_at_once : groups of releases (`DRAW_GROUP`) that a campaign simulates in one call, about one second of work
    chunk_releases : default number of releases of a chunk: large enough that writing takes little time, small enough
        that an interruption loses only some seconds of work
    one_thread_per_chunk : whether each thread of a campaign computes its own chunk, because writing dominates
    writing_work : time for tables and files of a run over the time for its simulation in one process
    """

    name: str
    law: str
    track: Callable[[ReleaseInputs], Track]
    ensemble: Callable[[Job, Group], Outcome] | None = None
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


def _pymunk_track(inputs: ReleaseInputs) -> Track:
    from rock2d.engines.pymunk_engine import run_pymunk

    condition = inputs.condition
    return run_pymunk(
        condition.block, condition.cross_section, condition.parameters, inputs.state,
        release=inputs.release, gravity_m_s2=inputs.gravity_m_s2, time_limit_s=inputs.time_limit_s,
    )  # fmt: skip


def _batch_track(inputs: ReleaseInputs) -> Track:
    from rock2d.engines.batch import run_batch_track
    from rock2d.laws.contact import contact_rows

    condition = inputs.condition
    table = contact_rows(condition.parameters, condition.cross_section.zone_names)
    return run_batch_track(
        condition.block, condition.cross_section, table, inputs.state,
        release=inputs.release, gravity_m_s2=inputs.gravity_m_s2, time_limit_s=inputs.time_limit_s,
    )  # fmt: skip


def _point_mass_track(inputs: ReleaseInputs) -> Track:
    from rock2d.engines.point_mass import run_point_mass

    condition = inputs.condition
    assert isinstance(condition.parameters, Mapping)  # only the contact law has rows
    return run_point_mass(
        condition.block, condition.cross_section, condition.parameters, inputs.state,
        release=inputs.release, gravity_m_s2=inputs.gravity_m_s2, time_limit_s=inputs.time_limit_s, seed=inputs.seed,
    )  # fmt: skip


def _batch_ensemble(job: Job, group: Group) -> Outcome:
    from rock2d.runs.campaigns.ensembles import batch_outcome

    return batch_outcome(job, group)


def _point_mass_ensemble(job: Job, group: Group) -> Outcome:
    from rock2d.runs.campaigns.ensembles import point_mass_outcome

    return point_mass_outcome(job, group)


_ALL = (
    Engine(
        "pymunk",
        "deterministic",
        _pymunk_track,
        many_processes=True,
        audits_energy=True,
        writing_work=0.3,
    ),
    Engine(
        "batch",
        "deterministic",
        _batch_track,
        _batch_ensemble,
        audits_energy=True,
        keeps_samples=True,
    ),
    Engine(
        "point_mass",
        "probabilistic",
        _point_mass_track,
        _point_mass_ensemble,
        groups_at_once=10,
        chunk_releases=100_000,
        one_thread_per_chunk=True,
    ),
)
ENGINES: Mapping[str, Engine] = MappingProxyType({engine.name: engine for engine in _ALL})
SAME_LAW = {"pymunk": "batch"}  # the compiled engine of the same law
