"""Where a block was seen in each frame of a release."""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import islice

import numpy as np

Array = np.ndarray


@dataclass
class Sight:
    """One frame of a release.

    Attributes
    ----------
    pose : (3,) u, v in px and angle in rad, from u toward v; NaN where the frame is lost
    error : (3,) standard errors
    confidence : share of the outline that was seen as fitted, less for a poor fit; 0 if lost
    reason : why the frame is lost, "" if it is not
    """

    frame: int
    pose: Array
    error: Array
    confidence: float
    reason: str = ""


@dataclass
class FollowedRelease:
    """One release as it was followed: name of the block and its frames in order."""

    block: str
    sights: list[Sight] = field(default_factory=list)

    @property
    def seen(self) -> list[Sight]:
        """The frames that were not lost."""
        return [s for s in self.sights if not s.reason]

    def last_seen(self, count: int) -> list[Sight]:
        """The last `count` frames that were not lost, in order."""
        # called in every frame, so it does not read the whole release
        return list(islice((s for s in reversed(self.sights) if not s.reason), count))[::-1]


def lost_sight(frame: int, reason: str) -> Sight:
    """A frame in which the block was not found."""
    return Sight(frame, np.full(3, np.nan), np.full(3, np.nan), 0.0, reason)
