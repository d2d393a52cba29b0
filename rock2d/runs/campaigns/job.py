"""The job of a campaign, that is everything that determines its result, and its chunks."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from rock2d.arrays import Array
from rock2d.runs.conditions import Conditions
from rock2d.runs.engines import compiled_engine
from rock2d.runs.indicators.crossings import foot_and_up
from rock2d.runs.recording import FRAME_TOLERANCE

if TYPE_CHECKING:
    from rock2d.files.scenario import Scenario


@dataclass(frozen=True)
class Job(Conditions):
    """The conditions of each release, and everything else that is needed to compute a chunk of a campaign.

    Attributes
    ----------
    folder : folder with one folder for each of `keep`
    fingerprint : hash of everything that determines the result; each file contains it
    keep : names of `campaigns.OUTPUTS`"""

    folder: Path = Path()
    fingerprint: str = ""
    keep: tuple[str, ...] = ("crossings",)

    @cached_property
    def lines(self) -> tuple[Array, Array]:
        """(lines, 2) feet of the measure lines, and (lines, 2) their directions; see `foot_and_up`."""
        found = [foot_and_up(line, self.cross_section) for line in self.cross_section.measure_lines.values()]
        feet, ups = np.array(found).reshape(-1, 2, 2).transpose(1, 0, 2)
        return feet, ups

    @cached_property
    def time_limit_s(self) -> float:
        """A release ends after this time."""
        return self.scenario.longest_release_s()

    def times_s(self) -> Array:
        """Instants at which samples are taken."""
        fps = self.scenario.outputs.fps
        return np.arange(int(self.time_limit_s * fps + FRAME_TOLERANCE) + 1) / fps


@dataclass(frozen=True)
class Chunk:
    """Releases first .. first + count - 1 of the block with index `block`; the number of release i is `offset` + i."""

    number: int
    block: int
    first: int
    count: int
    offset: int


def crossings_job(scenario: Scenario, engine: str, seed: int) -> Job:
    """The job of a scenario that keeps only crossings, in memory, with the compiled engine of the same law."""
    return Job(scenario, compiled_engine(engine).name, seed)
