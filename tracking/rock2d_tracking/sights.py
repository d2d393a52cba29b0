"""Sights: position, angle and confidence of a block in each frame of a release."""

from dataclasses import dataclass, field
from itertools import islice, pairwise

import numpy as np

from rock2d.arrays import Array
from rock2d.kinematics.flights import FEWEST_FLIGHT_FRAMES
from rock2d.statistics import MAD_TO_SD

# frames on each side of one whose scatter about their parabola is compared with its error
ERROR_NEIGHBOURS = 3
FEWEST_COMPARED = 5  # frames of such a parabola
LEAST_NEIGHBOUR_STEP_PX, LARGEST_STRIDE = 0.7, 4  # way from one of these frames to the next
FEWEST_ERROR_FRAMES = 8
# true errors over their scatter from frame to frame, measured on synthetic films: they change slowly
SLOW_ERROR_FACTOR = 1.75
ERROR_FACTORS = (0.3, 30.0)  # of the errors that fits state, to the scatter that frames show
KINK_FRAMES = 3  # before and after a frame between which velocities are compared
# a kink is larger than the quieter changes of velocity, and than this per frame
KINK_RATIO, LEAST_KINK_PX = 10.0, 0.3
SHORTEST_MOTION_PX = 3.0  # objects that move less are stones in the soil, persons or shadows, not releases
# why a frame is lost: the words of `frames.csv`, and what they mean
REASONS = {
    "no fit": "No pose of the outline agrees with the frame.",
    "no contrast": "The block has the grey of its background.",
    "hidden": "Too little of the outline is visible (`detection: least_seen`).",
    "half hidden": "So little of the outline is visible that soil can look like its edge (less than 1.25 × "
    "`least_seen`); the block is followed, but the frame is not used.",
    "another outline": "The visible object has another size or shape.",
    "another picture": "The correlation with the learned picture is too low.",
    "too far from the expected place": "Something beside the path of the block was fitted.",
    "unsure": "The standard error of the position is larger than 0.5 px in the fit of the frame (0.1 radii for a large "
    "shaded ball), or than 1 px and 0.05 radii by the scatter about the flight.",
    "on the background": "The outline holds much less than usual of what differs from the background.",
    "like a shadow": "What moves darkens the background evenly, and its outline is not sharp.",
    "out of the picture": "The block has left the picture.",
    "jumps": "The pose is far from the path through its neighbours, or its flight does not begin where the one before "
    "ends.",
    "marks not recognised": "The turn of a marked circle does not follow from the frame before.",
}


@dataclass
class Sight:
    """One frame of a release.

    Attributes
    ----------
    pose : (3,) u, v in px and angle in rad, from u toward v; NaN where the frame is lost
    error : (3,) standard errors
    confidence : share of the outline that agrees with the fit, less for a poor fit; 0 if lost
    reason : why the frame is lost, "" if it is not
    covered : share of the outline's inside that differs from the background; NaN if not measured
    number_in_file : its number in the file, while `frame` is its number as filmed
    when : its instant in units of the usual frame interval; the frame number until it is set"""

    frame: int
    pose: Array
    error: Array
    confidence: float
    reason: str = ""
    covered: float = np.nan
    number_in_file: int = -1
    when: float = field(init=False)

    def __post_init__(self) -> None:
        self.when = float(self.frame)

    def reject(self, reason: str) -> None:
        """Distrust the frame, which keeps its pose."""
        self.reason, self.confidence = reason, 0.0


@dataclass
class FollowedRelease:
    """One followed release.

    Attributes
    ----------
    block : its name
    sights : its frames in order
    bias_px : standard error of a coordinate that all frames share; not part of the errors of frames
    radius_px : half the size of the block in the picture
    shutter : share of the frame interval in which the shutter is open"""

    block: str
    sights: list[Sight] = field(default_factory=list)
    bias_px: float = 0.0
    radius_px: float = 0.0
    shutter: float = 0.0

    @property
    def seen(self) -> list[Sight]:
        """The frames that were not lost."""
        return [s for s in self.sights if not s.reason]

    def last_seen(self, count: int) -> list[Sight]:
        """The last `count` frames that were not lost, in order."""
        # called in every frame, so it must not read the whole release
        return list(islice((s for s in reversed(self.sights) if not s.reason), count))[::-1]


def lost_sight(frame: int, reason: str) -> Sight:
    """A frame in which the block was not found."""
    return Sight(frame, np.full(3, np.nan), np.full(3, np.nan), 0.0, reason)


def flights_of(sights: list[Sight], g_px_frame2: float) -> list[Array]:
    """The flights: (n,) indices into `sights` of frames without a sudden change of velocity. Frames next to an impact
    are left out."""
    t = np.array([s.when for s in sights])
    count, k = len(t), KINK_FRAMES
    places = np.array([s.pose[:2] for s in sights]).reshape(-1, 2)
    places[:, 1] -= 0.5 * g_px_frame2 * (t - t[:1]) ** 2
    parted = np.flatnonzero(np.diff(t) > KINK_FRAMES) + 0.5
    if count > 2 * k:
        pace = (places[k:] - places[:-k]) / (t[k:] - t[:-k])[:, None]
        change = np.zeros(count)
        change[k : count - k] = np.hypot(*(pace[k:] - pace[:-k]).T)
        limit = max(KINK_RATIO * float(np.quantile(change[k : count - k], 0.25)), LEAST_KINK_PX)
        kinks: list[int] = []
        for i in np.argsort(-change).tolist():
            if change[i] > limit and all(abs(i - other) > k for other in kinks):
                kinks.append(i)
        parted = np.sort(np.append(parted, kinks))
    ends = np.concatenate([[-1.0], parted, [count]])
    parts = [np.arange(int(np.floor(a)) + 1, int(np.ceil(b))) for a, b in pairwise(ends)]
    return [part for part in parts if len(part)]


def shows_release(release: FollowedRelease, g_px_frame2: float) -> bool:
    """Whether enough frames were seen, and the block moved within a flight: other objects are none of the stated
    releases. A change between flights may be one to another object, and does not count."""
    seen = release.seen
    poses = np.array([s.pose[:2] for s in seen])
    return len(seen) >= FEWEST_FLIGHT_FRAMES and any(
        np.ptp(poses[own], axis=0).max() > SHORTEST_MOTION_PX for own in flights_of(seen, g_px_frame2)
    )


def set_errors(release: FollowedRelease, g_px_frame2: float) -> None:
    """Set the standard errors of a release to the scatter of its frames about the parabolas through their neighbours
    in the same flight.

    The error of a fit includes pixel noise, but not compression, blur and light. It also includes a shift that all
    frames share; this belongs to `bias_px`."""
    seen = release.seen
    if len(seen) < FEWEST_ERROR_FRAMES:
        return
    error = np.array([s.error for s in seen])
    # a fit that looks better than usual is so by chance
    turned = np.isfinite(error[:, 2]).any()
    usual = np.nanmedian(error, axis=0) if turned else np.median(error, axis=0)
    ratios = _scatter_ratios(seen, np.maximum(error, usual), flights_of(seen, g_px_frame2))
    if len(ratios) < 2:
        return
    place = MAD_TO_SD * float(np.median(ratios[:, :2]))
    turn = MAD_TO_SD * float(np.nanmedian(ratios[:, 2])) if np.isfinite(ratios[:, 2]).any() else 1.0
    factor = SLOW_ERROR_FACTOR * np.clip([place, place, turn], *ERROR_FACTORS)
    for sight in seen:
        sight.error = np.maximum(sight.error, usual) * factor
    alike = SLOW_ERROR_FACTOR * float(np.median(usual[:2])) * np.sqrt(max(1.0 - place**2, 0.0))
    release.bias_px = float(np.hypot(release.bias_px, alike))


def _scatter_ratios(seen: list[Sight], error: Array, flights: list[Array]) -> Array:
    """(n, 3) distances of frames from the parabolas through their neighbours, over the errors stated."""
    t, pose = np.array([s.when for s in seen]), np.array([s.pose for s in seen])
    # errors are correlated in frames that show the block at nearly the same place within its pixels
    pace = np.median(np.hypot(*np.diff(pose[:, :2], axis=0).T))
    stride = int(np.clip(np.ceil(LEAST_NEIGHBOUR_STEP_PX / max(pace, 1e-9)), 1, LARGEST_STRIDE))
    ratios = []
    for flight in flights:
        for i, at in enumerate(flight):
            around = i + stride * np.arange(-ERROR_NEIGHBOURS, ERROR_NEIGHBOURS + 1)
            near = flight[around[(around >= 0) & (around < len(flight))]]
            if len(near) < FEWEST_COMPARED:
                continue
            basis = np.linalg.qr(np.vander(t[near] - t[at], 3))[0]
            own = int(np.flatnonzero(near == at)[0])
            left = pose[at] - basis[own] @ (basis.T @ pose[near])
            ratios.append(np.abs(left) / (error[at] * np.sqrt(1.0 - float((basis[own] ** 2).sum()))))
    return np.array(ratios).reshape(-1, 3)
