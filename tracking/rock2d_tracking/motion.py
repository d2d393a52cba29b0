"""What moves in a film, found before anything is known of how it looks: candidates of each frame, and the arcs on which
candidates fall.

A block in flight moves on a parabola whose curvature is gravity. Hands, sticks, people and flickering light do not; a
shadow does, but it darkens what lies below it and keeps to the ground.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field, replace

import numpy as np

from rock2d_tracking.candidates import Candidate, candidates_of

Array = np.ndarray

COARSE_WIDTH_PX = 640  # width of the picture in which motion is looked for, at most
COARSE_RADIUS_PX = 5.0  # radius that a block of known size keeps in it, at least
CHUNK_BYTES = 400_000_000  # of coarse pictures that share a background
FULL_SAMPLES = 25  # pictures of full size that are kept for the background of the fits
SHADOW_WEIGHT = 0.2  # of the frames of a chain that look like a shadow
CASTER_PX, CASTER_SHARE = 3.0, 0.08  # change of the distance from a block to its shadow, and share of its way
CHANGE_RATIO = (
    0.6  # largest difference between the changes of two candidates that are the same block, over the larger
)
AREA_RATIO = 1.9  # largest between two candidates that are the same block
FEWEST_ARC_FRAMES = 5
RECENT_FRAMES = 24  # of an arc, from which its next place is predicted
LONGEST_ARC_GAP = 3  # frames in a row in which a block in flight may be missed
GRAVITY_RATIO = (0.6, 1.6)  # range of an arc's acceleration over gravity: scale and frame rate may be wrong
OTHER_GRAVITIES = (4.0, 0.25, 16.0, 0.0625, 2.0, 0.5, -1.0)  # tried to explain why nothing falls as it should
GRAVITY_SIGMAS = 4.0  # by which an arc's curvature must differ from 0 to count as a fall
ARC_TOLERANCE_RADII = 0.35  # distance of a candidate from its arc
STEP_TOLERANCE = 0.04  # ... and share of the step to it
MOVED_RADII = 1.5  # way of an arc, at least
LONGEST_LINK_S, LONGEST_LINK_FRAMES = 0.25, 4  # between two arcs of one release
FEWEST_CHAIN_FRAMES = 6


@dataclass
class Arc:
    """Candidates on one parabola.

    Attributes
    ----------
    frames, places : (n,) frame numbers and (n, 2) centroids in px
    curve : (3, 2) polynomial of u and v over (frame - `middle`), highest power first
    falls : whether its curvature is significant and about that of gravity
    other : whether its curvature is significant and not that of gravity
    gravity_ratio : its acceleration over the gravity that scale and frame rate promise
    contrast : usual change in grey levels, of the colour that changes most
    shadow_share : share of its frames that look like a shadow
    """

    frames: Array
    places: Array
    areas: Array
    curve: Array
    middle: float
    falls: bool
    other: bool
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

    def at(self, frame: float | Array) -> Array:
        """(..., 2) places in px."""
        t = np.asarray(frame, float)[..., None] - self.middle
        return np.asarray((self.curve[0] * t + self.curve[1]) * t + self.curve[2])


@dataclass
class Chain:
    """Arcs of one release, one after the other, with impacts between them."""

    arcs: list[Arc]

    @property
    def first(self) -> int:
        """Its first frame."""
        return self.arcs[0].first

    @property
    def last(self) -> int:
        """Its last frame."""
        return self.arcs[-1].last

    @property
    def area_px2(self) -> float:
        """Usual area of its candidates."""
        return float(np.median(np.concatenate([a.areas for a in self.arcs])))

    @property
    def frames_seen(self) -> int:
        """Number of its candidates."""
        return sum(len(a.frames) for a in self.arcs)

    def bounces(self) -> list[Array]:
        """Places (2,) in px at which one arc passes into the next."""
        return [b.at(meeting(b, a)) for b, a in zip(self.arcs, self.arcs[1:], strict=False)]

    def at(self, frame: int) -> Array | None:
        """(2,) place in px, bridged between two arcs by whichever is nearer in time; None before and after them."""
        if not self.first <= frame <= self.last:
            return None
        for before, after in zip(self.arcs, [*self.arcs[1:], None], strict=True):
            if frame <= before.last:
                return before.at(frame)
            if after is not None and frame < after.first:
                meet = meeting(before, after)
                return before.at(frame) if frame < meet else after.at(frame)
        return None


@dataclass
class Motion:
    """What moves in a film.

    Attributes
    ----------
    candidates : of each frame
    chains : releases as their arcs show them, in the order filmed
    samples : pictures of full size, evenly over the film
    arcs : all arcs, of the blocks and of other things
    """

    candidates: list[list[Candidate]] = field(default_factory=list)
    chains: list[Chain] = field(default_factory=list)
    samples: list[Array] = field(default_factory=list)
    arcs: list[Arc] = field(default_factory=list)

    def chain_at(self, frame: int) -> Chain | None:
        """The chain that spans a frame."""
        return next((c for c in self.chains if c.first <= frame <= c.last), None)

    def near(self, frame: int, place: Array, reach_px: float) -> Candidate | None:
        """The candidate of a frame nearest to a place, if one is within reach."""
        own = [c for c in self.candidates[frame] if not c.shadow] if frame < len(self.candidates) else []
        best = min(own, key=lambda c: np.hypot(c.u_px - place[0], c.v_px - place[1]), default=None)
        if best is None or np.hypot(best.u_px - place[0], best.v_px - place[1]) > reach_px:
            return None
        return best


def motion_of(
    frames: Iterable[Array], promised: int, radii_px: list[float], fall_px: float, fps: float
) -> Motion:
    """Read a film once and find what moves in it.

    frames : (height, width) or (height, width, 3) uint8
    promised : about how many there are, 0 if nobody knows
    radii_px : radii of the blocks, [] if they are not known
    fall_px : acceleration of gravity along v in px per frame squared; 0 if it is not known
    """
    import cv2

    found, chunk = Motion(), []
    stride, number = max(1, promised // FULL_SAMPLES), 0
    coarse = 1
    for number, frame in enumerate(frames):
        if number == 0:
            coarse = _coarseness(frame.shape[1], radii_px)
        if number % stride == 0:
            found.samples.append(frame)
            if len(found.samples) > 2 * FULL_SAMPLES:  # the film is longer than promised
                found.samples, stride = found.samples[::2], 2 * stride
        size = (frame.shape[1] // coarse, frame.shape[0] // coarse)
        chunk.append(cv2.resize(frame, size, interpolation=cv2.INTER_AREA) if coarse > 1 else frame)
        if chunk[-1].nbytes * len(chunk) > CHUNK_BYTES:
            found.candidates += candidates_of(chunk, len(found.candidates), coarse)
            chunk = []
    if chunk:
        found.candidates += candidates_of(chunk, len(found.candidates), coarse)
    found.arcs = find_arcs(found.candidates, fall_px)
    found.chains = find_chains(found.arcs, fps, radii_px)
    if not found.chains:
        found.arcs += arcs_of_other_gravity(found.candidates, fall_px)
    return found


def _coarseness(width: int, radii_px: list[float]) -> int:
    coarse = -(-width // COARSE_WIDTH_PX)
    if radii_px:
        coarse = int(min(radii_px) / COARSE_RADIUS_PX)
    return max(1, coarse)


# --- arcs ---


def find_arcs(candidates: list[list[Candidate]], fall_px: float) -> list[Arc]:
    """Parabolas through candidates, the longest runs of frames that keep to one; `fall_px` as in `motion_of`."""
    table = [np.array([(c.u_px, c.v_px, c.area_px2, *c.change, c.shadow) for c in own if c.whole]).reshape(-1, 7)
             for own in candidates]  # fmt: skip
    used = [np.zeros(len(own), bool) for own in table]
    arcs = []
    for frame in range(len(table) - 2):
        for i in range(len(table[frame])):
            if used[frame][i]:
                continue
            best = _best_run(table, used, frame, i, fall_px)
            if best is None:
                continue
            arc = _arc(table, best, fall_px)
            if arc is not None:
                arcs.append(arc)
                for f, k in best:
                    used[f][k] = True
    return arcs


def arcs_of_other_gravity(candidates: list[list[Candidate]], fall_px: float) -> list[Arc]:
    """The arcs that scale, frame rate or the direction `up` would have to be wrong for; the best such guess."""
    best: list[Arc] = []
    for factor in OTHER_GRAVITIES:
        arcs = [a for a in find_arcs(candidates, factor * fall_px) if a.falls]
        if sum(len(a.frames) for a in arcs) > sum(len(a.frames) for a in best):
            best = [replace(a, falls=False, other=True, gravity_ratio=factor * a.gravity_ratio) for a in arcs]
    return best


def _best_run(
    table: list[Array], used: list[Array], frame: int, i: int, fall_px: float
) -> list[tuple[int, int]] | None:
    """The longest run of candidates that starts with candidate `i` of a frame."""
    start, best = table[frame][i], None
    for ahead in (1, 2):
        if frame + ahead >= len(table) or (ahead == 2 and best is not None):
            break
        nxt = table[frame + ahead]
        if not len(nxt):
            continue
        fits = np.flatnonzero(_alike(nxt, start) & ~used[frame + ahead])
        for k in fits.tolist():
            run = _extended(table, used, [(frame, i), (frame + ahead, k)], fall_px)
            if len(run) >= FEWEST_ARC_FRAMES and (best is None or len(run) > len(best)):
                best = run
    return best


def _extended(
    table: list[Array], used: list[Array], run: list[tuple[int, int]], fall_px: float
) -> list[tuple[int, int]]:
    """A run of two candidates, frame by frame as far as its parabola carries."""
    frame = run[-1][0] + 1
    usual = table[run[0][0]][run[0][1]].copy()
    radius = np.sqrt(usual[2] / np.pi)
    missed = 0
    while frame < len(table) and missed <= LONGEST_ARC_GAP:
        at = _predicted(table, run, frame, fall_px)
        own = table[frame]
        pick = -1
        if len(own):
            away = np.hypot(own[:, 0] - at[0], own[:, 1] - at[1])
            away[~_alike(own, usual) | used[frame]] = np.inf
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


def _alike(rows: Array, one: Array) -> Array:
    """Which candidates have about the area and the colours of one."""
    ratio = rows[:, 2] / one[2]
    apart = np.abs(rows[:, 3:6] - one[3:6]).max(axis=1)
    most = np.maximum(np.abs(rows[:, 3:6]).max(axis=1), np.abs(one[3:6]).max())
    return np.asarray((ratio < AREA_RATIO) & (ratio > 1 / AREA_RATIO) & (apart < CHANGE_RATIO * most))


def _predicted(table: list[Array], run: list[tuple[int, int]], frame: int, fall_px: float) -> Array:
    recent = run[-RECENT_FRAMES:]
    t = np.array([f for f, _ in recent], float) - frame
    at = np.array([table[f][k][:2] for f, k in recent])
    if len(recent) >= 6:
        return np.linalg.lstsq(np.vander(t, 3), at, rcond=None)[0][-1]
    line = np.linalg.lstsq(np.vander(t, 2), at - np.outer(t**2, [0.0, 0.5 * fall_px]), rcond=None)[0]
    return np.asarray(line[-1])


def _arc(table: list[Array], run: list[tuple[int, int]], fall_px: float) -> Arc | None:
    """The arc of a run; None if it hardly moves."""
    frames = np.array([f for f, _ in run])
    rows = np.array([table[f][k] for f, k in run])
    middle = float(frames.mean())
    basis = np.vander(frames - middle, 3)
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
        falls,
        other,
        float(ratio),
        contrast,
        float(rows[:, 6].mean()),
    )


# --- chains ---


def meeting(before: Arc, after: Arc) -> float:
    """The instant between two arcs, in frames, at which they are nearest to each other."""
    when = np.linspace(before.last, after.first, 4 * (after.first - before.last) + 1)
    apart = before.at(when) - after.at(when)
    return float(when[int(np.argmin((apart**2).sum(axis=1)))])


def find_chains(arcs: list[Arc], fps: float, radii_px: list[float]) -> list[Chain]:
    """Releases: arcs that follow one another where the one before ends, and of which at least one falls."""
    longest = max(LONGEST_LINK_FRAMES, round(LONGEST_LINK_S * fps))
    chains: list[Chain] = []
    for arc in sorted((a for a in arcs if not a.other), key=lambda a: (a.first, a.last)):
        for chain in reversed(chains):
            before = chain.arcs[-1]
            if 0 < arc.first - before.last <= longest and _joined(before, arc):
                chain.arcs.append(arc)
                break
        else:
            chains.append(Chain([arc]))
    kept = [c for c in chains if any(a.falls for a in c.arcs) and c.frames_seen >= FEWEST_CHAIN_FRAMES]
    if radii_px:
        low, high = np.pi * min(radii_px) ** 2 * 0.3, np.pi * max(radii_px) ** 2 * 2.5
        kept = [c for c in kept if low < c.area_px2 < high]
    kept = [_caster(c, arcs) or c for c in kept]
    # of two things at one time, the block is the one that falls longer, stands out more, and has its size
    kept.sort(key=lambda c: -_weight(c, radii_px))
    chosen: list[Chain] = []
    for chain in kept:
        if all(chain.last < c.first or chain.first > c.last for c in chosen):
            chosen.append(chain)
    return sorted(chosen, key=lambda c: c.first)


def _caster(chain: Chain, arcs: list[Arc]) -> Chain | None:
    """What casts a chain that looks like a shadow: arcs that keep their distance from it and are no shadow."""
    if np.average([a.shadow_share for a in chain.arcs], weights=[len(a.frames) for a in chain.arcs]) < 0.5:
        return None
    found: list[Arc] = []
    for arc in sorted(arcs, key=lambda a: -len(a.frames)):
        both = [f for f in arc.frames.tolist() if chain.first <= f <= chain.last]
        if arc.shadow_share > 0.5 or len(both) < max(FEWEST_ARC_FRAMES, 0.5 * len(arc.frames)):
            continue
        shadow = np.array([chain.at(f) for f in both])
        way = float(np.hypot(*np.ptp(shadow, axis=0)))
        apart = np.std(arc.at(np.array(both)) - shadow, axis=0).max()
        if apart < max(CASTER_PX, CASTER_SHARE * way) and all(
            arc.last < a.first or arc.first > a.last for a in found
        ):
            found.append(arc)
    frames = sum(len(a.frames) for a in found)
    return Chain(sorted(found, key=lambda a: a.first)) if frames > 0.4 * chain.frames_seen else None


def _weight(chain: Chain, radii_px: list[float]) -> float:
    frames = sum(
        len(a.frames) * (SHADOW_WEIGHT if a.shadow_share > 0.5 else 1.0) * a.contrast for a in chain.arcs
    )
    misfit = min((abs(np.log(chain.area_px2 / (np.pi * r**2))) for r in radii_px), default=0.0)
    return float(frames * np.exp(-misfit))


def _joined(before: Arc, after: Arc) -> bool:
    ratio = after.area_px2 / before.area_px2
    if not 1 / AREA_RATIO < ratio < AREA_RATIO:
        return False
    meet = meeting(before, after)
    apart = float(np.hypot(*(before.at(meet) - after.at(meet))))
    pace = max(float(np.hypot(*(a.at(meet) - a.at(meet - 1)))) for a in (before, after))
    return apart < before.radius_px + 0.5 * pace + 2.0
