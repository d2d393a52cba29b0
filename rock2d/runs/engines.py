"""The engines that a run can choose from, by name: what they need, what they offer, how they are called.

The engines themselves (`rock2d.engines`) are imported when a release runs, so that a list of their names costs nothing.
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
    """What an engine needs to simulate one release.

    Attributes
    ----------
    state : (6,) state of the centre of mass at t = 0, in SI
    seed : of the release's own random stream
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
    law : key of a scenario's `model` that holds its parameters: "deterministic" or "probabilistic"
    track : simulates one release
    ensemble : simulates a group of releases of a campaign; None if it is for single releases only
    many_processes : its releases are worth the start of further processes
    audits_energy : its tracks carry an energy audit that is written with a run
    keeps_samples : a campaign can keep sampled trajectories
    groups_at_once : groups of releases (`DRAW_GROUP`) that a campaign simulates in one call, for about a second's work
    chunk_releases : releases of a chunk of a campaign by default: enough that its files and tables take little beside
        it, but some seconds' work, which an interruption loses
    chunk_a_thread : the threads of a campaign compute a chunk each, since a release is little work beside its output
    writing_work : time that the tables and files of a run take, relative to that of its simulation in one process
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
    chunk_a_thread: bool = False
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


def _pymunk_track(given: ReleaseInputs) -> Track:
    from rock2d.engines.pymunk_engine import run_pymunk

    met = given.condition
    return run_pymunk(
        met.block, met.cross_section, met.parameters, given.state,
        release=given.release, gravity_m_s2=given.gravity_m_s2, time_limit_s=given.time_limit_s,
    )  # fmt: skip


def _batch_track(given: ReleaseInputs) -> Track:
    from rock2d.engines.batch import run_batch_track
    from rock2d.laws.contact import contact_rows

    met = given.condition
    table = contact_rows(met.parameters, met.cross_section.zone_names)
    return run_batch_track(
        met.block, met.cross_section, table, given.state,
        release=given.release, gravity_m_s2=given.gravity_m_s2, time_limit_s=given.time_limit_s,
    )  # fmt: skip


def _point_mass_track(given: ReleaseInputs) -> Track:
    from rock2d.engines.point_mass import run_point_mass

    met = given.condition
    assert isinstance(met.parameters, Mapping)  # only the contact law has rows
    return run_point_mass(
        met.block, met.cross_section, met.parameters, given.state,
        release=given.release, gravity_m_s2=given.gravity_m_s2, time_limit_s=given.time_limit_s, seed=given.seed,
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
        chunk_a_thread=True,
    ),
)
ENGINES: Mapping[str, Engine] = MappingProxyType({engine.name: engine for engine in _ALL})
SAME_LAW = {"pymunk": "batch"}  # the compiled engine of the same law
