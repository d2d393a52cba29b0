"""Arcs: candidates of successive frames that lie on one parabola."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from rock2d.arrays import Array
from rock2d.kinematics.flight_gravity import Measured
from rock2d.kinematics.partition import partition
from rock2d.kinematics.window_gravity import GRAVITY_RATIO
from rock2d.statistics import noise_of_path, weighted_median
from rock2d_tracking.candidates import CANDIDATE
from rock2d_tracking.film_reading import CONSTANT_RATE, Clock

# largest difference between the changes of two candidates that are the same block, over the larger
CHANGE_RATIO = 0.6
AREA_RATIO = 1.9  # largest between two candidates that are the same block
FEWEST_ARC_FRAMES = 5
RECENT_FRAMES = 24  # frames of an arc from which its next place is predicted
LONGEST_ARC_GAP = 3  # frames in a row in which a block in flight may be missed
# least length of a run that may be extended, and largest ratio of areas of the candidates that are added
FEWEST_TO_GROW, GROWN_AREA_RATIO = 8, 2.5
# accelerations that are tried, in addition to 0
TRIED_ACCELERATIONS = tuple(0.5 * 2.0**k for k in range(8))
SAME_ACCELERATION = 0.25  # relative difference of accelerations that may be one
GRAVITY_SIGMAS = 4.0  # by which an arc's curvature must differ from 0 to count as a fall
SMALLEST_PLACE_ERROR_RADII = 0.04  # of the centroid of a candidate
ARC_TOLERANCE_RADII = 0.35  # distance of a candidate from its arc
STEP_TOLERANCE = 0.04  # ... and share of the step to it
MOVED_RADII = 1.5  # least length of an arc


@dataclass
class Arc:
    """Candidates on one parabola.

    Attributes
    ----------
    frames, places : (n,) frame numbers and (n, 2) centroids in px
    curve : (3, 2) polynomial of u and v over (instant of the frame - `middle`), highest power first
    clock : the instants of frames
    falls : whether its curvature is significant and about that of gravity
    falls_otherwise : whether its curvature is significant and not that of gravity
    acceleration : its acceleration along v in px per usual time squared, with its standard error
    gravity_ratio : its acceleration over the gravity expected from scale and frame rate
    contrast : median change in grey levels, of the colour that changes most
    shadow_share : share of its frames that look like a shadow"""

    frames: Array
    places: Array
    areas: Array
    curve: Array
    middle: float
    clock: Clock
    falls: bool
    falls_otherwise: bool
    acceleration: Measured
    gravity_ratio: float
    contrast: float
    shadow_share: float

    @property
    def first(self) -> int:
        """Its first frame."""
        return int(self.frames[0])

    @property
    def last(self) -> int:
        """Its last frame."""
        return int(self.frames[-1])

    @property
    def area_px2(self) -> float:
        """Usual area of its candidates."""
        return float(np.median(self.areas))

    @property
    def radius_px(self) -> float:
        """Radius of the circle of its area."""
        return float(np.sqrt(self.area_px2 / np.pi))

    def after(self, frame: int) -> Arc:
        """The arc without its frames up to and including `frame`."""
        kept = self.frames > frame
        return replace(self, frames=self.frames[kept], places=self.places[kept], areas=self.areas[kept])

    def at(self, frame: float | Array) -> Array:
        """(..., 2) places in px."""
        return self._at(self.clock(frame))

    def pace(self, frame: float) -> Array:
        """(2,) displacement in px per usual frame interval at a frame."""
        when = self.clock(frame)
        return self._at(when + 0.5) - self._at(when - 0.5)

    def _at(self, instant: Array) -> Array:
        t = instant[..., None] - self.middle
        return np.asarray((self.curve[0] * t + self.curve[1]) * t + self.curve[2])


def find_arcs(candidates: list[Array], g_px_frame2: float, clock: Clock = CONSTANT_RATE) -> list[Arc]:
    """Parabolas through the longest runs of candidates.

    candidates : (n,) CANDIDATE of each frame
    g_px_frame2 : gravity along v"""
    search = _Search(candidates, g_px_frame2, clock)
    arcs = []
    for i in np.flatnonzero(search.rows["frame"] < len(candidates) - 2).tolist():
        if search.used[i]:
            continue
        best = search.longest_run(i)
        found = search.arcs(best) if best else []
        if found:
            arcs += found
            search.used[best] = True
    return arcs


def common_acceleration(candidates: list[Array], down: int = 1, clock: Clock = CONSTANT_RATE) -> Measured | None:
    """Acceleration along v in px per frame squared that most candidates on arcs share, with its standard error; None if
    no arc is curved. `down`: its sign.

    Several accelerations are tried, because strongly curved arcs are found only with about the right one."""
    best: list[Arc] = []
    for fall in (0.0, *TRIED_ACCELERATIONS):
        arcs = find_arcs(candidates, down * fall, clock)
        bent = [a for a in arcs if down * a.acceleration.value > GRAVITY_SIGMAS * a.acceleration.error]
        if not bent:
            continue
        accelerations = np.array([a.acceleration.value for a in bent])
        frames = np.array([len(a.frames) for a in bent])
        near = np.abs(accelerations / weighted_median(accelerations, frames) - 1.0) < SAME_ACCELERATION
        own = [a for a, agrees in zip(bent, near, strict=True) if agrees]
        if sum(len(a.frames) for a in own) > sum(len(a.frames) for a in best):
            best = own
    if not best:
        return None
    middle = float(np.median([a.acceleration.value for a in best]))
    falls = [a for a in find_arcs(candidates, middle, clock) if a.falls]
    return mean_acceleration(falls or best)


def mean_acceleration(arcs: Sequence[Arc]) -> Measured:
    """Weighted mean of the accelerations of arcs; if they disagree, its error includes their scatter."""
    accelerations = np.array([a.acceleration.value for a in arcs])
    weights = np.array([a.acceleration.error for a in arcs]) ** -2.0
    mean = float(np.average(accelerations, weights=weights))
    squares = float((weights * (accelerations - mean) ** 2).sum()) / max(len(arcs) - 1, 1)
    return Measured(mean, float((max(squares, 1.0) / weights.sum()) ** 0.5))


def arcs_of_other_gravity(candidates: list[Array], g_px_frame2: float, clock: Clock = CONSTANT_RATE) -> list[Arc]:
    """The arcs whose acceleration is that of gravity only if scale, frame rate or the direction `up` is wrong."""
    down = 1 if g_px_frame2 > 0 else -1
    fall = common_acceleration(candidates, down, clock) or common_acceleration(candidates, -down, clock)
    if fall is None:
        return []
    return [
        replace(a, falls=False, falls_otherwise=True, gravity_ratio=a.acceleration.value / g_px_frame2)
        for a in find_arcs(candidates, fall.value, clock) if a.falls
    ]  # fmt: skip


class _Search:
    """Runs of candidates on parabolas. A run is a list of rows, one of a frame, in the order of time.

    Attributes
    ----------
    rows : (n,) CANDIDATE, the whole ones of all frames, in the order of frames
    used : (n,) which of them are part of an arc"""

    def __init__(self, candidates: list[Array], g_px_frame2: float, clock: Clock) -> None:
        self.rows = np.concatenate([np.empty(0, CANDIDATE), *(own[own["whole"]] for own in candidates)])
        self.used = np.zeros(len(self.rows), bool)
        self._places, self._areas, self._changes = (
            np.ascontiguousarray(self.rows[name]) for name in ("place_px", "area_px2", "change")
        )
        self._begins = np.searchsorted(self.rows["frame"], np.arange(len(candidates) + 1))
        self._g_px_frame2, self._clock, self._when = g_px_frame2, clock, clock(self.rows["frame"])

    def _of_frame(self, frame: int) -> slice:
        return slice(self._begins[frame], self._begins[frame + 1])

    def longest_run(self, i: int) -> list[int]:
        """The longest run that starts with row `i`, [] if none is long enough."""
        best: list[int] = []
        for frame in range(self.rows["frame"][i] + 1, self.rows["frame"][i] + 3):
            if best or frame >= len(self._begins) - 1:
                break
            for k in np.flatnonzero(self._similar(frame, self._areas[i], self._changes[i])).tolist():
                run = self._followed([i, int(self._begins[frame]) + k])
                if len(run) >= FEWEST_ARC_FRAMES and len(run) > len(best):
                    best = run
        return best

    def _similar(self, frame: int, area_px2: float, change: Array) -> Array:
        """Which candidates of a frame have about the same area and colours, and are not part of an arc."""
        own = self._of_frame(frame)
        ratio, changes = self._areas[own] / area_px2, self._changes[own]
        apart = np.abs(changes - change).max(axis=1)
        most = np.maximum(np.abs(changes).max(axis=1), np.abs(change).max())
        alike = (ratio < AREA_RATIO) & (ratio > 1 / AREA_RATIO) & (apart < CHANGE_RATIO * most)
        return np.asarray(alike & ~self.used[own])

    def _followed(self, run: list[int]) -> list[int]:
        """A run of two candidates, extended frame by frame as long as candidates lie on its parabola."""
        area, change = self._areas[run[0]], self._changes[run[0]]
        first_step = np.hypot(*(self._places[run[1]] - self._places[run[0]]))
        radius = np.sqrt(area / np.pi)
        missed = 0
        for frame in range(self.rows["frame"][run[-1]] + 1, len(self._begins) - 1):
            if missed > LONGEST_ARC_GAP or (missed and len(run) < 4):
                break
            missed += 1
            places = self._places[self._of_frame(frame)]
            if not len(places):
                continue
            at = self._predicted(run, frame)
            away = np.hypot(places[:, 0] - at[0], places[:, 1] - at[1])
            away[~self._similar(frame, area, change)] = np.inf
            slack = max(1.5, ARC_TOLERANCE_RADII * radius) * (2.0 if len(run) < 4 else 1.0)
            if len(run) == 2:  # two centroids say little about the pace
                slack += 0.15 * first_step
                slack += GRAVITY_RATIO[1] * abs(self._g_px_frame2)
            # lens, perspective and air bend a long step
            slack += STEP_TOLERANCE * np.hypot(*(at - self._places[run[-1]]))
            nearest = int(np.argmin(away))
            if away[nearest] < slack:
                k = int(self._begins[frame]) + nearest
                run.append(k)
                area, change = 0.8 * area + 0.2 * self._areas[k], 0.8 * change + 0.2 * self._changes[k]
                missed = 0
        return run

    def _predicted(self, run: list[int], frame: int) -> Array:
        recent = run[-RECENT_FRAMES:]
        t = self._when[recent] - self._clock(frame)
        at = self._places[recent]
        if len(recent) >= 6:
            return np.linalg.lstsq(np.vander(t, 3), at, rcond=None)[0][-1]
        fallen = np.outer(t**2, [0.0, 0.5 * self._g_px_frame2])
        return np.asarray(np.linalg.lstsq(np.vander(t, 2), at - fallen, rcond=None)[0][-1])

    def _with_extended_ends(self, run: list[int]) -> list[int]:
        """A run extended at both ends by candidates that lie on its parabola, whatever their colour: the contrast of a
        block depends on the background."""
        area = float(np.median(self._areas[run]))
        slack = max(1.5, ARC_TOLERANCE_RADII * np.sqrt(area / np.pi))
        for step in (-1, 1):
            run = run[::step]
            frame, missed = self.rows["frame"][run[-1]] + step, 0
            while 0 <= frame < len(self._begins) - 1 and missed <= LONGEST_ARC_GAP:
                recent, own = run[-RECENT_FRAMES:], self._of_frame(frame)
                t = self._when[recent] - self._clock(frame)
                at = np.linalg.lstsq(np.vander(t, 3), self._places[recent], rcond=None)[0][-1]
                away = np.hypot(*(self._places[own] - at).T)
                ratio = self._areas[own] / area
                away[(ratio > GROWN_AREA_RATIO) | (ratio < 1 / GROWN_AREA_RATIO)] = np.inf
                missed += 1
                if len(away) and away.min() < slack + STEP_TOLERANCE * float(np.hypot(*(at - self._places[run[-1]]))):
                    run, missed = [*run, int(own.start) + int(np.argmin(away))], 0
                frame += step
            run = run[::step]
        return run

    def arcs(self, run: list[int]) -> list[Arc]:
        """The arcs of a run and of what lies before and after it on its parabola, without those that hardly move."""
        if len(run) >= FEWEST_TO_GROW:
            run = self._with_extended_ends(run)
        return [arc for part in self._parts(run) if (arc := self._arc(part)) is not None]

    def _parts(self, run: list[int]) -> list[list[int]]:
        """A run, cut where it does not continue its parabola. A block that moves little from frame to frame is followed
        through its impacts."""
        if len(run) <= RECENT_FRAMES or not self._g_px_frame2:
            return [run]
        places, t = self._places[run], self._when[run] - self._when[run[0]]
        noise = max(
            noise_of_path(places), SMALLEST_PLACE_ERROR_RADII * float(np.sqrt(np.median(self._areas[run]) / np.pi))
        )
        data = np.column_stack([places - places[0], np.zeros(len(run))]) / noise
        g = self._g_px_frame2 / noise
        _, part = partition(t, data, np.array([0.0, 0.5 * g, 0.0]), np.full(3, 0.5 * abs(g)), FEWEST_ARC_FRAMES)
        cuts = np.flatnonzero(np.diff(part)) + 1
        return [own.tolist() for own in np.split(np.array(run), cuts) if len(own) >= FEWEST_ARC_FRAMES]

    def _arc(self, run: list[int]) -> Arc | None:
        """The arc of a run; None if it hardly moves."""
        rows, when = self.rows[run], self._when[run]
        places, areas, g_px_frame2 = rows["place_px"], rows["area_px2"], self._g_px_frame2
        middle = float(when.mean())
        basis = np.vander(when - middle, 3)
        curve, *_ = np.linalg.lstsq(basis, places, rcond=None)
        left = places - basis @ curve
        sigma = np.sqrt((left**2).sum(axis=0) / max(len(run) - 3, 1)) + 0.05
        error = sigma * np.sqrt(np.linalg.inv(basis.T @ basis)[0, 0])
        radius = float(np.sqrt(np.median(areas) / np.pi))
        if float(np.hypot(*np.ptp(places, axis=0))) < max(3.0, MOVED_RADII * radius):
            return None
        acceleration = Measured(float(2 * curve[0, 1]), float(2 * error[1]))
        ratio = acceleration.value / g_px_frame2 if g_px_frame2 else 1.0
        curved = abs(acceleration.value) > GRAVITY_SIGMAS * acceleration.error
        about_gravity = GRAVITY_RATIO[0] < ratio < GRAVITY_RATIO[1]
        falls = curved and about_gravity and acceleration.value * (g_px_frame2 or 1.0) > 0
        otherwise = curved and not falls and abs(acceleration.value - g_px_frame2) > GRAVITY_SIGMAS * acceleration.error
        return Arc(
            rows["frame"], places, areas, curve, middle, self._clock, falls, otherwise, acceleration, ratio,
            contrast=float(np.abs(np.median(rows["change"], axis=0)).max()),
            shadow_share=float(rows["shadow"].mean()),
        )  # fmt: skip
