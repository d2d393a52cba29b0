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
    """One release as it was followed.

    Attributes
    ----------
    block : its name
    sights : its frames in order
    error_factor : by which its errors are larger than their scatter from frame to frame, because they change slowly
    bias_px : usual distance of a coordinate between two ways to fit the block, added to the standard errors
    """

    block: str
    sights: list[Sight] = field(default_factory=list)
    error_factor: float = 1.0
    bias_px: float = 0.0

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


ERROR_NEIGHBOURS = (
    3  # frames on each side of one whose scatter about their parabola is compared with its error
)
LEAST_NEIGHBOUR_STEP_PX, LARGEST_STRIDE = 0.7, 4  # way from one of these frames to the next
FEWEST_ERROR_FRAMES = 8
LARGEST_ERROR_FACTOR = 30.0


def enlarge_errors(release: FollowedRelease) -> None:
    """Enlarge the standard errors of a release to the scatter of its frames about the parabolas through their
    neighbours: a fit knows the noise of pixels, not compression, blur and light."""
    seen = release.seen
    t = np.array([s.frame for s in seen], float)
    if len(seen) < FEWEST_ERROR_FRAMES:
        return
    pose, error = np.array([s.pose for s in seen]), np.array([s.error for s in seen])
    ratios = []
    # a fit errs alike in two frames that show the block at nearly the same place within its pixels
    pace = np.median(np.hypot(*np.diff(pose[:, :2], axis=0).T))
    stride = int(np.clip(np.ceil(LEAST_NEIGHBOUR_STEP_PX / max(pace, 1e-9)), 1, LARGEST_STRIDE))
    around = stride * np.arange(-ERROR_NEIGHBOURS, ERROR_NEIGHBOURS + 1)
    for i in range(-around[0], len(seen) - around[-1]):
        near = i + around
        if t[near[-1]] - t[near[0]] > 1.5 * (around[-1] - around[0]):
            continue
        basis = np.linalg.qr(np.vander(t[near] - t[i], 3))[0]
        left = pose[near] - basis @ (basis.T @ pose[near])
        own = 1.0 - float((basis[ERROR_NEIGHBOURS] ** 2).sum())
        ratios.append(left[ERROR_NEIGHBOURS] / (error[i] * np.sqrt(own)))
    if len(ratios) < 2:
        return
    table = np.abs(np.array(ratios))
    # impacts are outliers of the median
    place = 1.4826 * float(np.median(table[:, :2]))
    turn = 1.4826 * float(np.nanmedian(table[:, 2])) if np.isfinite(table[:, 2]).any() else 1.0
    factor = np.clip([place, place, turn], 1.0, LARGEST_ERROR_FACTOR)
    # a fit that looks better than usual is so by chance
    usual = np.nanmedian(error, axis=0) if np.isfinite(error[:, 2]).any() else np.median(error, axis=0)
    for sight in seen:
        sight.error = np.maximum(sight.error, usual) * factor * release.error_factor
        sight.error[:2] = np.hypot(sight.error[:2], release.bias_px)
