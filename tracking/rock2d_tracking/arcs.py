"""Arcs: candidates of successive frames that lie on one parabola."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from rock2d.kinematics.flight_gravity import Measured
from rock2d.statistics import weighted_median
from rock2d_tracking.candidates import Candidate
from rock2d_tracking.clock import EVEN, Clock

Array = np.ndarray

# largest difference between the changes of two candidates that are the same block, over the larger
CHANGE_RATIO = 0.6
AREA_RATIO = 1.9  # largest between two candidates that are the same block
FEWEST_ARC_FRAMES = 5
RECENT_FRAMES = 24  # frames of an arc from which its next place is predicted
LONGEST_ARC_GAP = 3  # frames in a row in which a block in flight may be missed
GRAVITY_RATIO = (0.6, 1.6)  # range of an arc's acceleration over gravity: scale and frame rate may be wrong
# least length of a run that may be extended, and largest ratio of areas of the candidates that are added
FEWEST_TO_GROW, GROWN_AREA_RATIO = 8, 2.5
# accelerations in px per frame squared that are tried, in addition to 0
TRIED_FALLS_PX = tuple(0.5 * 2.0**k for k in range(8))
SAME_ACCELERATION = 0.25  # relative difference of accelerations that may be one
GRAVITY_SIGMAS = 4.0  # by which an arc's curvature must differ from 0 to count as a fall
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
    other : whether its curvature is significant and not that of gravity
    bend : its acceleration along v in px per usual time squared, with its standard error
    gravity_ratio : its acceleration over the gravity expected from scale and frame rate
    contrast : median change in grey levels, of the colour that changes most
    shadow_share : share of its frames that look like a shadow
    """

    frames: Array
    places: Array
    areas: Array
    curve: Array
    middle: float
    clock: Clock
    falls: bool
    other: bool
    bend: Measured
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


def find_arcs(candidates: list[list[Candidate]], fall_px: float, clock: Clock = EVEN) -> list[Arc]:
    """Parabolas through the longest runs of candidates; `fall_px`: acceleration of gravity in px per frame squared."""
    table = [np.array([(c.u_px, c.v_px, c.area_px2, *c.change, c.shadow) for c in own if c.whole]).reshape(-1, 7)
             for own in candidates]  # fmt: skip
    used = [np.zeros(len(own), bool) for own in table]
    arcs = []
    for frame in range(len(table) - 2):
        for i in range(len(table[frame])):
            if used[frame][i]:
                continue
            best = _best_run(table, used, frame, i, fall_px, clock)
            if best is None:
                continue
            run = _with_extended_ends(table, best, clock) if len(best) >= FEWEST_TO_GROW else best
            arc = _arc(table, run, fall_px, clock)
            if arc is not None:
                arcs.append(arc)
                for f, k in best:
                    used[f][k] = True
    return arcs


def common_fall(candidates: list[list[Candidate]], down: int = 1, clock: Clock = EVEN) -> Measured | None:
    """Acceleration along v in px per frame squared that most candidates on arcs share, with its standard error; None if
    no arc is curved. `down`: its sign.

    Several accelerations are tried, because strongly curved arcs are found only with about the right one.
    """
    best: list[Arc] = []
    for fall in (0.0, *TRIED_FALLS_PX):
        bent = [a for a in find_arcs(candidates, down * fall, clock) if _bends_downward(a, down)]
        if not bent:
            continue
        bends = np.array([a.bend.value for a in bent])
        frames = np.array([len(a.frames) for a in bent])
        near = np.abs(bends / weighted_median(bends, frames) - 1.0) < SAME_ACCELERATION
        own = [a for a, agrees in zip(bent, near, strict=True) if agrees]
        if sum(len(a.frames) for a in own) > sum(len(a.frames) for a in best):
            best = own
    if not best:
        return None
    middle = float(np.median([a.bend.value for a in best]))
    falls = [a for a in find_arcs(candidates, middle, clock) if a.falls]
    return mean_bend(falls or best)


def _bends_downward(arc: Arc, down: int) -> bool:
    return down * arc.bend.value > GRAVITY_SIGMAS * arc.bend.error


def mean_bend(arcs: Sequence[Arc]) -> Measured:
    """Weighted mean of the accelerations of arcs; if they disagree, its error includes their scatter."""
    bends, weights = (
        np.array([a.bend.value for a in arcs]),
        np.array([a.bend.error for a in arcs]) ** -2.0,
    )
    mean = float(np.average(bends, weights=weights))
    squares = float((weights * (bends - mean) ** 2).sum()) / max(len(arcs) - 1, 1)
    return Measured(mean, float((max(squares, 1.0) / weights.sum()) ** 0.5))


def arcs_of_other_gravity(
    candidates: list[list[Candidate]], fall_px: float, clock: Clock = EVEN
) -> list[Arc]:
    """The arcs whose acceleration is that of gravity only if scale, frame rate or the direction `up` is wrong."""
    down = 1 if fall_px > 0 else -1
    fall = common_fall(candidates, down, clock) or common_fall(candidates, -down, clock)
    if fall is None:
        return []
    return [
        replace(a, falls=False, other=True, gravity_ratio=a.bend.value / fall_px)
        for a in find_arcs(candidates, fall.value, clock) if a.falls
    ]  # fmt: skip


def _best_run(
    table: list[Array], used: list[Array], frame: int, i: int, fall_px: float, clock: Clock
) -> list[tuple[int, int]] | None:
    """The longest run of candidates that starts with candidate `i` of a frame."""
    start, best = table[frame][i], None
    for ahead in (1, 2):
        if frame + ahead >= len(table) or (ahead == 2 and best is not None):
            break
        nxt = table[frame + ahead]
        if not len(nxt):
            continue
        fits = np.flatnonzero(_similar(nxt, start) & ~used[frame + ahead])
        for k in fits.tolist():
            run = _followed_parabola(table, used, [(frame, i), (frame + ahead, k)], fall_px, clock)
            if len(run) >= FEWEST_ARC_FRAMES and (best is None or len(run) > len(best)):
                best = run
    return best


def _followed_parabola(
    table: list[Array], used: list[Array], run: list[tuple[int, int]], fall_px: float, clock: Clock
) -> list[tuple[int, int]]:
    """A run of two candidates, extended frame by frame as long as candidates lie on its parabola."""
    frame = run[-1][0] + 1
    usual = table[run[0][0]][run[0][1]].copy()
    radius = np.sqrt(usual[2] / np.pi)
    missed = 0
    while frame < len(table) and missed <= LONGEST_ARC_GAP:
        at = _predicted(table, run, frame, fall_px, clock)
        own = table[frame]
        pick = -1
        if len(own):
            away = np.hypot(own[:, 0] - at[0], own[:, 1] - at[1])
            away[~_similar(own, usual) | used[frame]] = np.inf
            k = int(np.argmin(away))
            last = table[run[-1][0]][run[-1][1]]
            slack = max(1.5, ARC_TOLERANCE_RADII * radius) * (2.0 if len(run) < 4 else 1.0)
            if len(run) == 2:  # two centroids say little about the pace
                slack += 0.15 * float(
                    np.hypot(*(table[run[1][0]][run[1][1]] - table[run[0][0]][run[0][1]])[:2])
                )
                slack += GRAVITY_RATIO[1] * abs(fall_px)
            # lens, perspective and air bend a long step
            slack += STEP_TOLERANCE * float(np.hypot(*(at - last[:2])))
            if away[k] < slack:
                pick = k
        if pick >= 0:
            run.append((frame, pick))
            usual[2:] = 0.8 * usual[2:] + 0.2 * own[pick, 2:]
            missed = 0
        else:
            missed += 1
            if len(run) < 4:
                break
        frame += 1
    return run


def _with_extended_ends(
    table: list[Array], run: list[tuple[int, int]], clock: Clock
) -> list[tuple[int, int]]:
    """A run extended at both ends by candidates that lie on its parabola, whatever their colour: the contrast of a
    block depends on the background."""
    area = float(np.median([table[f][k, 2] for f, k in run]))
    slack = max(1.5, ARC_TOLERANCE_RADII * np.sqrt(area / np.pi))
    for step in (-1, 1):
        run = run[::step]
        frame, missed = run[-1][0] + step, 0
        while 0 <= frame < len(table) and missed <= LONGEST_ARC_GAP:
            t = clock(np.array([f for f, _ in run[-RECENT_FRAMES:]])) - clock(frame)
            places = np.array([table[f][k, :2] for f, k in run[-RECENT_FRAMES:]])
            at = np.linalg.lstsq(np.vander(t, 3), places, rcond=None)[0][-1]
            away = np.hypot(*(table[frame][:, :2] - at).T)
            ratio = table[frame][:, 2] / area
            away[(ratio > GROWN_AREA_RATIO) | (ratio < 1 / GROWN_AREA_RATIO)] = np.inf
            missed += 1
            if len(away) and away.min() < slack + STEP_TOLERANCE * float(np.hypot(*(at - places[-1]))):
                run, missed = [*run, (frame, int(np.argmin(away)))], 0
            frame += step
        run = run[::step]
    return run


def _similar(rows: Array, one: Array) -> Array:
    """Which candidates have about the same area and colours as one of them."""
    ratio = rows[:, 2] / one[2]
    apart = np.abs(rows[:, 3:6] - one[3:6]).max(axis=1)
    most = np.maximum(np.abs(rows[:, 3:6]).max(axis=1), np.abs(one[3:6]).max())
    return np.asarray((ratio < AREA_RATIO) & (ratio > 1 / AREA_RATIO) & (apart < CHANGE_RATIO * most))


def _predicted(
    table: list[Array], run: list[tuple[int, int]], frame: int, fall_px: float, clock: Clock
) -> Array:
    recent = run[-RECENT_FRAMES:]
    t = clock(np.array([f for f, _ in recent])) - clock(frame)
    at = np.array([table[f][k][:2] for f, k in recent])
    if len(recent) >= 6:
        return np.linalg.lstsq(np.vander(t, 3), at, rcond=None)[0][-1]
    line = np.linalg.lstsq(np.vander(t, 2), at - np.outer(t**2, [0.0, 0.5 * fall_px]), rcond=None)[0]
    return np.asarray(line[-1])


def _arc(table: list[Array], run: list[tuple[int, int]], fall_px: float, clock: Clock) -> Arc | None:
    """The arc of a run; None if it hardly moves."""
    frames = np.array([f for f, _ in run])
    rows = np.array([table[f][k] for f, k in run])
    when = clock(frames)
    middle = float(when.mean())
    basis = np.vander(when - middle, 3)
    curve, *_ = np.linalg.lstsq(basis, rows[:, :2], rcond=None)
    left = rows[:, :2] - basis @ curve
    sigma = np.sqrt((left**2).sum(axis=0) / max(len(frames) - 3, 1)) + 0.05
    error = sigma * np.sqrt(np.linalg.inv(basis.T @ basis)[0, 0])
    radius = float(np.sqrt(np.median(rows[:, 2]) / np.pi))
    way = float(np.hypot(*np.ptp(rows[:, :2], axis=0)))
    if way < max(3.0, MOVED_RADII * radius):
        return None
    bend, bend_error = 2 * curve[0, 1], 2 * error[1]
    ratio = bend / fall_px if fall_px else 1.0
    curved = abs(bend) > GRAVITY_SIGMAS * bend_error
    falls = bool(curved and GRAVITY_RATIO[0] < ratio < GRAVITY_RATIO[1] and bend * (fall_px or 1.0) > 0)
    other = bool(curved and not falls and abs(bend - fall_px) > GRAVITY_SIGMAS * bend_error)
    contrast = float(np.abs(np.median(rows[:, 3:6], axis=0)).max())
    return Arc(
        frames,
        rows[:, :2],
        rows[:, 2],
        curve,
        middle,
        clock,
        falls,
        other,
        Measured(float(bend), float(bend_error)),
        float(ratio),
        contrast,
        float(rows[:, 6].mean()),
    )
