"""Blocks followed through a film, frame by frame: where each is, how it is turned, and how far that can be trusted."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from itertools import islice

import numpy as np

from rock2d.scene.cross_section import CrossSection
from rock2d_tracking.background import Background
from rock2d_tracking.camera import PixelMap
from rock2d_tracking.marks import Marks
from rock2d_tracking.outline import (
    FIT_ANGLE,
    FIT_BLUR,
    FIT_GREY,
    FIT_U,
    FIT_V,
    SMALLEST_BLUR_PX,
    Outline,
    Patch,
    fit_pose,
    outline_of,
)  # fmt: skip
from rock2d_tracking.setup_file import Setup
from rock2d_tracking.sights import FollowedRelease, Sight, lost_sight

Array = np.ndarray

BACKGROUND_FRAMES = 100  # at the start of a film, unless the set-up file names others
FIT_ROUNDS = 25
SEEN_TO_START = 0.75  # share of the outline that must be seen at the start of a release
LARGEST_MISFIT = 0.2  # of the edge, over the contrast; a larger misfit is not this block
FAINTEST_CONTRAST_SIGMAS, FAINTEST_CONTRAST_GREY = (
    4.0,
    8.0,
)  # in noise and in grey levels
FAINTEST_CONTRAST_SHARE = 0.3  # of the usual contrast; what is fainter is dust or an afterimage
LARGEST_ERROR_PX = 0.5  # standard error; a frame with a larger one is lost
FOREGROUND_SIGMAS = 6.0  # least difference of a pixel from the background, in noise
FOREGROUND_GREY = 8.0  # and in grey levels
SEARCH_RADIUS_PX = 6.0  # radius of the block in the coarse picture that is searched
SEARCH_CANDIDATES = 4  # places of a picture at which a block is fitted
CANDIDATE_AREAS = (0.3, 2.5)  # smallest and largest, over the area of the block
LONGEST_LOSS_S = 0.25  # for which a block may be lost within a release
FRAMES_TO_START = 3  # in a row with a block: a release has begun
STILL_STEP_PX = 0.5  # per frame; a lost block that moved less is expected where it was


def follow(
    frames: Iterable[Array],
    setup: Setup,
    size_px: tuple[int, int],
    on_progress: Callable[[int, Array, FollowedRelease | None], None] = lambda number, frame, release: None,
) -> list[FollowedRelease]:
    """Every release of a film, in the order filmed.

    `on_progress` is called for every frame with its number, its picture (height, width) and the release that is being
    followed, if any.
    """
    stream = iter(frames)
    named = setup.keys.detection.background_frames
    buffer = list(islice(stream, max(BACKGROUND_FRAMES, named[1] + 1 if named else 0)))
    still = buffer[named[0] : named[1] + 1] if named else buffer
    if not buffer:
        return []
    follower = _Follower(setup, size_px, Background(still or buffer))
    number = 0
    for part in (buffer, stream):
        for frame in part:
            follower.read_frame(number, frame)
            on_progress(number, frame, follower.release)
            number += 1
    follower.end_release()
    return follower.releases


class _Follower:
    """The state of the search while a film is read."""

    def __init__(self, setup: Setup, size_px: tuple[int, int], background: Background) -> None:
        self.setup, self.background = setup, background
        self.map: PixelMap = setup.pixel_map(size_px)
        self.visible = _above_ground(setup.cross_section, self.map, size_px)
        self.outlines = {
            name: outline_of(block, setup.metres_per_pixel, self.map.up)
            for name, block in setup.blocks.items()
        }
        self.longest_loss = max(3, round(LONGEST_LOSS_S * setup.keys.camera.fps))
        self.releases: list[FollowedRelease] = []
        self.release: FollowedRelease | None = None
        self.blur = 1.0
        self._sighted: list[tuple[Sight, Array]] = []  # sights of what may be a block, with their frames
        self._marks = Marks()
        self._lost = 0
        self._grey = self._contrast = 0.0
        self._usual_contrast = 0.0  # contrast of the blocks so far

    # --- frame by frame ---

    def read_frame(self, number: int, frame: Array) -> None:
        """One more frame."""
        if self.release is not None:
            sight = self._follow_on(number, frame)
            self.release.sights.append(sight)
            self._lost = 0 if not sight.reason else self._lost + 1
            if self._lost >= FRAMES_TO_START and self._search(number, frame):
                return  # another release has begun
            if self._lost > self.longest_loss or (self._lost and self._has_left()):
                self.end_release()
        else:
            self._search(number, frame)
        self._learn(frame)

    def end_release(self) -> None:
        """The release that is being followed is over."""
        if self.release is not None:
            while self.release.sights and self.release.sights[-1].reason:
                self.release.sights.pop()
            self.releases.append(self.release)
        self.release, self._lost, self._sighted = None, 0, []

    def _next_block(self) -> str:
        return self.setup.block_of(len(self.releases) + (self.release is not None))

    def _learn(self, frame: Array) -> None:
        if self.release is None:
            self.background.learn(
                frame, None if not self._sighted else self._window(self._sighted[-1][0].pose, 1.5)
            )
            return
        for sight in self.release.last_seen(1):
            self.background.learn(frame, self._window(sight.pose, 1.5))

    # --- a block that is known ---

    def _follow_on(self, number: int, frame: Array) -> Sight:
        assert self.release is not None
        expected = self._expected(number)
        outline = self.outlines[self.release.block]
        best = self._fit(number, frame, outline, expected, self._grey)
        if best.reason:
            blob = self._blob(frame, expected, outline)
            if blob is not None:
                other = self._fit(number, frame, outline, np.array([*blob, expected[2]]), self._grey)
                best = other if not other.reason else best
        if not best.reason and self._jumped(best.pose, expected, outline):
            best = lost_sight(number, "too far from the expected place")
        if not best.reason and outline.symmetry_rad == 0.0 and self.setup.keys.detection.marks:
            best = self._with_angle_of_marks(frame, best, expected[2], outline)
        return best

    def _expected(self, number: int) -> Array:
        """Pose in this frame if the motion of the last frames continues."""
        assert self.release is not None
        seen = self.release.last_seen(4)
        last = seen[-1]
        if len(seen) < 2:
            return last.pose.copy()
        first = seen[0]
        pace = (last.pose - first.pose) / (last.frame - first.frame)
        ahead = number - last.frame
        expected = last.pose + pace * ahead
        if ahead > 1 and np.hypot(*pace[:2]) > STILL_STEP_PX:
            g = self.setup.keys.gravity_m_s2 / self.setup.metres_per_pixel / self.setup.keys.camera.fps**2
            expected[1] -= self.map.up * 0.5 * g * ahead**2
        return np.asarray(expected)

    def _jumped(self, pose: Array, expected: Array, outline: Outline) -> bool:
        seen = self.release.last_seen(2) if self.release is not None else []
        pace = np.hypot(*(seen[-1].pose - seen[-2].pose)[:2]) if len(seen) > 1 else outline.reach_px
        way = float(np.hypot(*(pose - expected)[:2]))
        return way > 0.5 * outline.reach_px + (1 + self._lost) * (1.5 * pace + 1.0)

    def _with_angle_of_marks(self, frame: Array, sight: Sight, near: float, outline: Outline) -> Sight:
        contrast = max(self._contrast, 1.0)
        found = self._marks.angle(
            frame, self.visible, (sight.pose[0], sight.pose[1]), outline.reach_px, near, contrast
        )
        if found is None:
            return lost_sight(sight.frame, "marks not recognised")
        sight.pose[2] = found[0]
        sight.error[2] = 1.0 / outline.reach_px * sight.error[0]
        return sight

    def _has_left(self) -> bool:
        """Whether the block was leaving the picture when it was last seen."""
        assert self.release is not None
        seen = self.release.last_seen(1)
        if not seen:
            return True
        u, v = seen[-1].pose[:2]
        reach = self.outlines[self.release.block].reach_px
        height, width = self.background.grey.shape
        return bool(min(u, v, width - 1 - u, height - 1 - v) < 1.2 * reach)

    # --- a block that is not known yet ---

    def _search(self, number: int, frame: Array) -> bool:
        """Look for a block in the whole picture; returns whether a release has begun."""
        name = self._next_block()
        outline = self.outlines[name]
        best: Sight | None = None
        for centre in self._candidates(frame, outline):
            for turn in _start_angles(outline):
                sight = self._fit(number, frame, outline, np.array([*centre, turn]), None, SEEN_TO_START)
                if not sight.reason and (best is None or sight.confidence > best.confidence):
                    best = sight
            if best is not None and self.release is None:
                break
        if best is None or (self.release is not None and not self._far_away(best, outline)):
            self._sighted = []
            return False
        self._sighted = [n for n in self._sighted if n[0].frame >= number - FRAMES_TO_START] + [(best, frame)]
        if len(self._sighted) < FRAMES_TO_START:
            return False
        taken = self._sighted
        self.end_release()
        self.release = FollowedRelease(name)
        self._marks = Marks()
        for sight, own in taken:
            before = self.release.sights[-1].pose[2] if self.release.sights else sight.pose[2]
            if outline.symmetry_rad > 0.0:
                sight.pose[2] = _nearest_angle(sight.pose[2], before, outline.symmetry_rad)
            elif self.setup.keys.detection.marks:
                self._with_angle_of_marks(own, sight, before, outline)
            self.release.sights.append(sight)
        self._sighted = []
        return True

    def _far_away(self, sight: Sight, outline: Outline) -> bool:
        expected = self._expected(sight.frame)
        return float(np.hypot(*(sight.pose - expected)[:2])) > 4.0 * outline.reach_px

    def _candidates(self, frame: Array, outline: Outline) -> list[tuple[float, float]]:
        """Centres (u, v) of what differs from the background and has about the area of the block, the best first."""
        import cv2

        # pixels of a sixth of the block, but no finer than the film's
        coarse = max(1, int(outline.reach_px / SEARCH_RADIUS_PX))
        threshold = max(FOREGROUND_SIGMAS * self.background.noise / coarse, FOREGROUND_GREY)
        mask = self.background.differs(frame, threshold, coarse)
        mask = cv2.morphologyEx(mask, cv2.MORPH_OPEN, np.ones((3, 3), np.uint8))
        count, _, stats, centres = cv2.connectedComponentsWithStats(mask)
        area = stats[1:, cv2.CC_STAT_AREA] * coarse**2 / outline.area_px2
        good = [i for i in range(count - 1) if CANDIDATE_AREAS[0] < area[i] < CANDIDATE_AREAS[1]]
        good.sort(key=lambda i: abs(math.log(area[i])))
        middles = (centres[1:][good[:SEARCH_CANDIDATES]] + 0.5) * coarse - 0.5
        return [(float(u), float(v)) for u, v in middles]

    # --- one fit ---

    def _blob(self, frame: Array, expected: Array, outline: Outline) -> tuple[float, float] | None:
        """Centre of what differs from the background near the expected place."""
        u0, u1, v0, v1 = self._window(expected, 2.5)
        if u1 - u0 < 4 or v1 - v0 < 4:
            return None
        part = np.abs(frame[v0:v1, u0:u1].astype(np.float32) - self.background.grey[v0:v1, u0:u1])
        mask = (part > max(FOREGROUND_SIGMAS * self.background.noise, FOREGROUND_GREY)) & (
            self.visible[v0:v1, u0:u1] > 0
        )
        if mask.sum() < CANDIDATE_AREAS[0] * outline.area_px2:
            return None
        v, u = np.nonzero(mask)
        return float(np.median(u)) + u0, float(np.median(v)) + v0

    def _window(self, pose: Array, reaches: float) -> tuple[int, int, int, int]:
        """First and last u, first and last v around a pose, within the picture."""
        outline = self.outlines[self.release.block if self.release is not None else self._next_block()]
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
            return lost_sight(number, "out of the picture")
        image = frame[v0:v1, u0:u1].astype(np.float32)
        behind = self.background.grey[v0:v1, u0:u1]
        if grey is None:
            a, b, half = int(start[1] - v0), int(start[0] - u0), int(0.4 * outline.reach_px) + 1
            # median of a part that is larger than the marks
            grey = float(np.median(image[max(a - half, 0) : a + half + 1, max(b - half, 0) : b + half + 1]))
        p = np.array([start[0] - u0, start[1] - v0, start[2], grey, max(self.blur, SMALLEST_BLUR_PX)])
        patch = Patch(image, behind, self.visible[v0:v1, u0:u1], self.background.noise)
        p, error, seen, misfit = fit_pose(patch, outline.edges, outline.semi_axes_px, p, FIT_ROUNDS)
        a, b = int(np.clip(p[FIT_V], 0, v1 - v0 - 1)), int(np.clip(p[FIT_U], 0, u1 - u0 - 1))
        contrast = abs(float(p[FIT_GREY]) - float(behind[a, b]))
        pose = np.array([p[FIT_U] + u0, p[FIT_V] + v0, p[FIT_ANGLE]])
        reason = ""
        if not np.isfinite(p).all() or not np.isfinite(error).all():
            reason = "no fit"
        elif contrast < max(
            FAINTEST_CONTRAST_SIGMAS * self.background.noise,
            FAINTEST_CONTRAST_GREY,
            FAINTEST_CONTRAST_SHARE * self._usual_contrast,
        ):
            reason = "no contrast"
        elif seen < (least or self.setup.keys.detection.least_seen):
            reason = "hidden"
        elif misfit > LARGEST_MISFIT:
            reason = "another outline"
        elif max(error[0], error[1]) > LARGEST_ERROR_PX:
            reason = "unsure"
        if reason:
            return lost_sight(number, reason)
        self._grey, self._contrast = float(p[FIT_GREY]), contrast
        self._usual_contrast = (
            contrast if self._usual_contrast == 0.0 else 0.99 * self._usual_contrast + 0.01 * contrast
        )
        self.blur = 0.9 * self.blur + 0.1 * min(float(p[FIT_BLUR]), 4.0)
        return Sight(number, pose, error, float(seen * max(0.0, 1.0 - misfit)))


def _start_angles(outline: Outline) -> Array:
    """Start angles; from one of them a fit finds the orientation."""
    if outline.symmetry_rad == 0.0:
        return np.zeros(1)
    return np.arange(0.0, outline.symmetry_rad, np.deg2rad(22.5))


def _nearest_angle(angle: float, near: float, symmetry: float) -> float:
    """Of the angles at which the block looks the same, the nearest to `near`."""
    return near + (angle - near + 0.5 * symmetry) % symmetry - 0.5 * symmetry


def _above_ground(cross_section: CrossSection, camera: PixelMap, size_px: tuple[int, int]) -> Array:
    """(height, width) uint8, 1 where the picture shows what lies above the surveyed ground."""
    v, u = np.mgrid[0 : size_px[1], 0 : size_px[0]]
    world = camera.to_world(np.stack([u, v], axis=-1))
    ground = cross_section.height_m(world[..., 0].ravel()).reshape(u.shape)
    return np.asarray(~(world[..., 1] <= ground), np.uint8)  # beside the cross-section nothing hides
