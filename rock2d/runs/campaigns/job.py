"""What determines a campaign, and the chunks that it is divided into."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from rock2d.runs.recording import FRAME_TOLERANCE
from rock2d.scene.blocks import Block
from rock2d.scene.cross_section import CrossSection

if TYPE_CHECKING:
    from rock2d.files.scenario import Scenario
    from rock2d.files.scenario_keys import Incident
    from rock2d.runs.engines import Engine

Array = np.ndarray


@dataclass(frozen=True)
class Job:
    """What it takes to compute any chunk of a campaign.

    Attributes
    ----------
    folder : holds a folder for each of `keep`, names of `outputs.OUTPUTS`
    fingerprint : of everything that determines the result; each file carries it
    parameters : by block, zone name, or default -> parameters of the engine's law
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
    parameters: tuple[Mapping[str, Any], ...]
    gravity_m_s2: float
    time_limit_s: float
    fps: float
    versions: dict[str, str]

    def times_s(self) -> Array:
        """Instants at which samples are taken."""
        return np.arange(int(self.time_limit_s * self.fps + FRAME_TOLERANCE) + 1) / self.fps


@dataclass(frozen=True)
class Chunk:
    """Releases first .. first + count - 1 of the block with index `block`; `offset` + i is i's number."""

    number: int
    block: int
    first: int
    count: int
    offset: int


def job_of(
    scenario: Scenario, engine: Engine, seed: int, keep: tuple[str, ...], folder: Path, fingerprint: str
) -> Job:
    """The job of a scenario."""
    blocks = scenario.make_blocks()
    return Job(
        folder, fingerprint, keep, engine.name, seed, scenario.make_cross_section(), tuple(blocks.values()),
        tuple(scenario.incident_of(name) for name in blocks),
        tuple(engine.parameters(scenario, block) for block in blocks.values()),
        scenario.gravity_m_s2, scenario.longest_release_s(), scenario.outputs.fps, versions(),
    )  # fmt: skip


def versions() -> dict[str, str]:
    """Versions of what the numbers depend on: the code, the random streams, the compiler."""
    import numba

    from rock2d import __version__

    return {"rock2d": __version__, "numpy": np.__version__, "numba": numba.__version__}
