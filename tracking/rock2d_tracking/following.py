"""Blocks followed through a film, frame by frame: where each is, how it is turned, and how far that can be trusted."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from itertools import islice

import numpy as np

from rock2d.scene.cross_section import CrossSection
from rock2d_tracking.background import Background
from rock2d_tracking.camera import PixelMap
from rock2d_tracking.marks import Marks
from rock2d_tracking.outline import BLUR, FLOOR_BLUR, GREY, THETA, Outline, X, Y, fit_pose, outline_of
from rock2d_tracking.setup_file import Setup

Array = np.ndarray

FIRST = 100  # frames from which the background is learned, unless the set-up names some
ROUNDS = 25
SEEN_NEW = 0.75  # share of the outline that must be seen for a block to be taken up
WORST = 0.2  # misfit of the edge, over the contrast, above which it is not this block
FAINT, FAINT_GREY = 4.0, 8.0  # noise, and grey levels, below which the contrast is none
PALER = 0.3  # of the usual contrast: what is paler is no block, but dust or a trace of one
UNSURE_PX = 0.5  # standard error above which a frame is lost
STANDS_OUT = 6.0  # noise by which a pixel must differ from the background
LEAST_GREY = 8.0  # grey levels that a pixel must differ by in any film
COARSE_PX = 6.0  # of the block's radius: how coarse a picture is searched
CANDIDATES = 4  # places of a picture at which a block is tried
SIZES = (0.3, 2.5)  # of the block's area that a candidate may have
PATIENCE = 0.25  # seconds at most that a block may be lost within a release
AGREE = 3  # frames in a row that take up a block
STILL_PX = 0.5  # way per frame below which a lost block stays where it was


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
class Path:
    """One release as it was followed."""

    block: str
    sights: list[Sight] = field(default_factory=list)

    @property
    def seen(self) -> list[Sight]:
        """The frames that were not lost."""
        return [s for s in self.sights if not s.reason]

    def last_seen(self, count: int) -> list[Sight]:
        """The last of them, in order; without a look at the whole release, for it is asked in every frame."""
        return list(islice((s for s in reversed(self.sights) if not s.reason), count))[::-1]


def follow(
    frames: Iterable[Array],
    setup: Setup,
    size_px: tuple[int, int],
    on_progress: Callable[[int, Array, Path | None], None] = lambda number, frame, path: None,
) -> list[Path]:
    """Every release of a film, in the order filmed.

    `on_progress` hears of every frame: its number, picture (height, width) and the release that is being followed,
    if any.
    """
    stream = iter(frames)
    named = setup.keys.detection.background_frames
    buffer = list(islice(stream, max(FIRST, named[1] + 1 if named else 0)))
    still = buffer[named[0] : named[1] + 1] if named else buffer
    if not buffer:
        return []
    follower = _Follower(setup, size_px, Background(still or buffer))
    number = 0
    for part in (buffer, stream):
        for frame in part:
            follower.look(number, frame)
            on_progress(number, frame, follower.path)
            number += 1
    follower.end()
    return follower.paths


class _Follower:
    """What is known while a film is read."""

    def __init__(self, setup: Setup, size_px: tuple[int, int], background: Background) -> None:
        self.setup, self.background = setup, background
        self.map: PixelMap = setup.pixel_map(size_px)
        self.soil = _above(setup.cross_section, self.map, size_px)
        self.outlines = {
            name: outline_of(block, setup.metres_per_pixel, self.map.up)
            for name, block in setup.blocks.items()
        }
        self.patience = max(3, round(PATIENCE * setup.keys.camera.fps))
        self.paths: list[Path] = []
        self.path: Path | None = None
        self.blur = 1.0
        self._new: list[tuple[Sight, Array]] = []  # sights of a block that may be coming, with their frames
        self._marks = Marks()
        self._lost = 0
        self._grey = self._contrast = 0.0
        self._usual = 0.0  # contrast of the blocks so far

    # --- frame by frame ---

    def look(self, number: int, frame: Array) -> None:
        """One more frame."""
        if self.path is not None:
            sight = self._again(number, frame)
            self.path.sights.append(sight)
            self._lost = 0 if not sight.reason else self._lost + 1
            if self._lost >= AGREE and self._search(number, frame):
                return  # another release has begun
            if self._lost > self.patience or (self._lost and self._has_left()):
                self.end()
        else:
            self._search(number, frame)
        self._learn(frame)

    def end(self) -> None:
        """The release that is being followed is over."""
        if self.path is not None:
            while self.path.sights and self.path.sights[-1].reason:
                self.path.sights.pop()
            self.paths.append(self.path)
        self.path, self._lost, self._new = None, 0, []

    def _next_block(self) -> str:
        return self.setup.block_of(len(self.paths) + (self.path is not None))

    def _learn(self, frame: Array) -> None:
        if self.path is None:
            self.background.learn(frame, None if not self._new else self._window(self._new[-1][0].pose, 1.5))
            return
        for sight in self.path.last_seen(1):
            self.background.learn(frame, self._window(sight.pose, 1.5))

    # --- a block that is known ---

    def _again(self, number: int, frame: Array) -> Sight:
        assert self.path is not None
        expected = self._expected(number)
        outline = self.outlines[self.path.block]
        best = self._fit(number, frame, outline, expected, self._grey)
        if best.reason:
            blob = self._blob(frame, expected, outline)
            if blob is not None:
                other = self._fit(number, frame, outline, np.array([*blob, expected[2]]), self._grey)
                best = other if not other.reason else best
        if not best.reason and self._jumped(best.pose, expected, outline):
            best = _lost(number, "too far from where it should be")
        if not best.reason and outline.symmetry_rad == 0.0 and self.setup.keys.detection.marks:
            best = self._turned(frame, best, expected[2], outline)
        return best

    def _expected(self, number: int) -> Array:
        """Pose in this frame, as the last frames went on."""
        assert self.path is not None
        seen = self.path.last_seen(4)
        last = seen[-1]
        if len(seen) < 2:
            return last.pose.copy()
        first = seen[0]
        pace = (last.pose - first.pose) / (last.frame - first.frame)
        ahead = number - last.frame
        expected = last.pose + pace * ahead
        if ahead > 1 and np.hypot(*pace[:2]) > STILL_PX:
            g = self.setup.keys.gravity_m_s2 / self.setup.metres_per_pixel / self.setup.keys.camera.fps**2
            expected[1] -= self.map.up * 0.5 * g * ahead**2
        return np.asarray(expected)

    def _jumped(self, pose: Array, expected: Array, outline: Outline) -> bool:
        seen = self.path.last_seen(2) if self.path is not None else []
        pace = np.hypot(*(seen[-1].pose - seen[-2].pose)[:2]) if len(seen) > 1 else outline.reach_px
        way = float(np.hypot(*(pose - expected)[:2]))
        return way > 0.5 * outline.reach_px + (1 + self._lost) * (1.5 * pace + 1.0)

    def _turned(self, frame: Array, sight: Sight, near: float, outline: Outline) -> Sight:
        contrast = max(self._contrast, 1.0)
        found = self._marks.angle(
            frame, self.soil, (sight.pose[0], sight.pose[1]), outline.reach_px, near, contrast
        )
        if found is None:
            return _lost(sight.frame, "marks not recognised")
        sight.pose[2] = found[0]
        sight.error[2] = 1.0 / outline.reach_px * sight.error[0]
        return sight

    def _has_left(self) -> bool:
        """Whether the block was last seen on its way out of the picture."""
        assert self.path is not None
        seen = self.path.last_seen(1)
        if not seen:
            return True
        u, v = seen[-1].pose[:2]
        reach = self.outlines[self.path.block].reach_px
        height, width = self.background.grey.shape
        return bool(min(u, v, width - 1 - u, height - 1 - v) < 1.2 * reach)

    # --- a block that is not known yet ---

    def _search(self, number: int, frame: Array) -> bool:
        """Look for a block anywhere; whether a release has begun."""
        name = self._next_block()
        outline = self.outlines[name]
        best: Sight | None = None
        for centre in self._candidates(frame, outline):
            for turn in _starts(outline):
                sight = self._fit(number, frame, outline, np.array([*centre, turn]), None, SEEN_NEW)
                if not sight.reason and (best is None or sight.confidence > best.confidence):
                    best = sight
            if best is not None and self.path is None:
                break
        if best is None or (self.path is not None and not self._far_away(best, outline)):
            self._new = []
            return False
        self._new = [n for n in self._new if n[0].frame >= number - AGREE] + [(best, frame)]
        if len(self._new) < AGREE:
            return False
        taken = self._new
        self.end()
        self.path = Path(name)
        self._marks = Marks()
        for sight, own in taken:
            before = self.path.sights[-1].pose[2] if self.path.sights else sight.pose[2]
            if outline.symmetry_rad > 0.0:
                sight.pose[2] = _nearest(sight.pose[2], before, outline.symmetry_rad)
            elif self.setup.keys.detection.marks:
                self._turned(own, sight, before, outline)
            self.path.sights.append(sight)
        self._new = []
        return True

    def _far_away(self, sight: Sight, outline: Outline) -> bool:
        expected = self._expected(sight.frame)
        return float(np.hypot(*(sight.pose - expected)[:2])) > 4.0 * outline.reach_px

    def _candidates(self, frame: Array, outline: Outline) -> list[tuple[float, float]]:
        """Centres (u, v) of what stands out and has about the block's area, the best first."""
        import cv2

        # pixels of a sixth of the block, but no finer than the film's
        coarse = max(1, int(outline.reach_px / COARSE_PX))
        threshold = max(STANDS_OUT * self.background.noise / coarse, LEAST_GREY)
        mask = self.background.differs(frame, threshold, coarse)
        mask = cv2.morphologyEx(mask, cv2.MORPH_OPEN, np.ones((3, 3), np.uint8))
        count, _, stats, centres = cv2.connectedComponentsWithStats(mask)
        area = stats[1:, cv2.CC_STAT_AREA] * coarse**2 / _area(outline)
        good = [i for i in range(count - 1) if SIZES[0] < area[i] < SIZES[1]]
        good.sort(key=lambda i: abs(math.log(area[i])))
        middles = (centres[1:][good[:CANDIDATES]] + 0.5) * coarse - 0.5
        return [(float(u), float(v)) for u, v in middles]

    # --- one fit ---

    def _blob(self, frame: Array, expected: Array, outline: Outline) -> tuple[float, float] | None:
        """Centre of what stands out near the expected place."""
        u0, u1, v0, v1 = self._window(expected, 2.5)
        if u1 - u0 < 4 or v1 - v0 < 4:
            return None
        part = np.abs(frame[v0:v1, u0:u1].astype(np.float32) - self.background.grey[v0:v1, u0:u1])
        mask = (part > max(STANDS_OUT * self.background.noise, LEAST_GREY)) & (self.soil[v0:v1, u0:u1] > 0)
        if mask.sum() < SIZES[0] * _area(outline):
            return None
        v, u = np.nonzero(mask)
        return float(np.median(u)) + u0, float(np.median(v)) + v0

    def _window(self, pose: Array, reaches: float) -> tuple[int, int, int, int]:
        """First and last u, first and last v around a pose, within the picture."""
        outline = self.outlines[self.path.block if self.path is not None else self._next_block()]
        half = reaches * outline.reach_px + 6.0
        height, width = self.background.grey.shape
        u, v = np.clip(pose[:2], -1e6, 1e6)
        return (
            int(np.clip(u - half, 0, width)), int(np.clip(u + half + 1, 0, width)),
            int(np.clip(v - half, 0, height)), int(np.clip(v + half + 1, 0, height)),
        )  # fmt: skip

    def _fit(
        self, number: int, frame: Array, outline: Outline, start: Array, grey: float | None,
        least: float | None = None,
    ) -> Sight:  # fmt: skip
        u0, u1, v0, v1 = self._window(start, 1.2)
        if min(u1 - u0, v1 - v0) < outline.reach_px:
            return _lost(number, "out of the picture")
        image = frame[v0:v1, u0:u1].astype(np.float32)
        behind = self.background.grey[v0:v1, u0:u1]
        if grey is None:
            a, b, half = int(start[1] - v0), int(start[0] - u0), int(0.4 * outline.reach_px) + 1
            # of a part large enough that marks do not make it
            grey = float(np.median(image[max(a - half, 0) : a + half + 1, max(b - half, 0) : b + half + 1]))
        p = np.array([start[0] - u0, start[1] - v0, start[2], grey, max(self.blur, FLOOR_BLUR)])
        p, error, seen, misfit = fit_pose(
            image, behind, self.soil[v0:v1, u0:u1], outline.edges, outline.semi_axes_px, p,
            self.background.noise, ROUNDS,
        )  # fmt: skip
        a, b = int(np.clip(p[Y], 0, v1 - v0 - 1)), int(np.clip(p[X], 0, u1 - u0 - 1))
        contrast = abs(float(p[GREY]) - float(behind[a, b]))
        pose = np.array([p[X] + u0, p[Y] + v0, p[THETA]])
        reason = ""
        if not np.isfinite(p).all() or not np.isfinite(error).all():
            reason = "no fit"
        elif contrast < max(FAINT * self.background.noise, FAINT_GREY, PALER * self._usual):
            reason = "no contrast"
        elif seen < (least or self.setup.keys.detection.least_seen):
            reason = "hidden"
        elif misfit > WORST:
            reason = "another outline"
        elif max(error[0], error[1]) > UNSURE_PX:
            reason = "unsure"
        if reason:
            return _lost(number, reason)
        self._grey, self._contrast = float(p[GREY]), contrast
        self._usual = contrast if self._usual == 0.0 else 0.99 * self._usual + 0.01 * contrast
        self.blur = 0.9 * self.blur + 0.1 * min(float(p[BLUR]), 4.0)
        return Sight(number, pose, error, float(seen * max(0.0, 1.0 - misfit)))


def _lost(number: int, reason: str) -> Sight:
    return Sight(number, np.full(3, np.nan), np.full(3, np.nan), 0.0, reason)


def _area(outline: Outline) -> float:
    """Area in px²."""
    if len(outline.edges) == 0:
        return float(np.pi * outline.semi_axes_px.prod())
    normals, h = outline.edges[:, :2], outline.edges[:, 2]
    turn = np.arctan2(normals[:, 1], normals[:, 0])
    ahead, behind = np.roll(turn, -1) - turn, turn - np.roll(turn, 1)
    ahead, behind = ahead % (2 * np.pi), behind % (2 * np.pi)
    sides = (np.roll(h, -1) - h * np.cos(ahead)) / np.sin(ahead) + (
        np.roll(h, 1) - h * np.cos(behind)
    ) / np.sin(behind)
    return float(0.5 * (sides * h).sum())


def _starts(outline: Outline) -> Array:
    """Angles from which a fit finds any orientation."""
    if outline.symmetry_rad == 0.0:
        return np.zeros(1)
    return np.arange(0.0, outline.symmetry_rad, np.deg2rad(22.5))


def _nearest(angle: float, near: float, symmetry: float) -> float:
    """The angle, of those that look the same, nearest to another."""
    return near + (angle - near + 0.5 * symmetry) % symmetry - 0.5 * symmetry


def _above(cross_section: CrossSection, camera: PixelMap, size_px: tuple[int, int]) -> Array:
    """(height, width) uint8, 1 where the picture shows what lies above the surveyed ground."""
    v, u = np.mgrid[0 : size_px[1], 0 : size_px[0]]
    world = camera.to_world(np.stack([u, v], axis=-1))
    ground = cross_section.height_m(world[..., 0].ravel()).reshape(u.shape)
    return np.asarray(~(world[..., 1] <= ground), np.uint8)  # beside the cross-section nothing hides
