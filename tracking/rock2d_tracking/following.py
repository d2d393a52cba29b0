"""Blocks followed through a film, frame by frame: where each is, how it is turned, and how far that can be trusted."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field, replace
from itertools import islice

import numpy as np

from rock2d.scene.cross_section import CrossSection
from rock2d_tracking.background import Background
from rock2d_tracking.camera import PixelMap
from rock2d_tracking.edges import EdgeFit, edge_points, fit_edges
from rock2d_tracking.looks import (
    LEAST_MATCH,
    SLOW_ERROR_FACTOR,
    Looks,
    View,
    best_view,
    learned_picture,
    matched,
    plain_looks,
)
from rock2d_tracking.marks import Marks
from rock2d_tracking.motion import Chain, Motion, motion_of
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

FEWEST_SHOTS, MOST_SHOTS = 4, 24  # frames from which the looks of a block are learned
LEAST_OUTLINES, LEAST_EDGES = 0.6, 0.5  # share of them in which a kind of fit must work
OUTLINE_BIAS_SHARE = 0.5  # of the distance between both, as standard error of a coordinate by outline
LARGEST_BIAS_PX = 0.15  # between the places by outline and by edge
FEWEST_PAIRS_ON_ARC, SCATTER_GAIN = 6, 0.9  # of places by edge about an arc, over that of places by outline
SEEN_FOR_SIZE = 0.6  # share of the outline that must be seen to measure its size
LEAST_SIZE_CHANGE = 0.012  # of the outline; below it the size that is stated is the better one
LARGEST_SIZE_CHANGE = 0.5
LARGEST_SIZE_SPREAD = 0.08  # from frame to frame; a larger one is no outline
SIZE_ROUNDS, SIZE_CONVERGED = 5, 0.002
SMALLEST_PICTURE_ERROR_PX = 0.1  # standard error of a place that correlation found, at least
FIT_ROUNDS = 25
SEEN_TO_START = 0.75  # share of the outline that must be seen at the start of a release
LARGEST_MISFIT = 0.2  # of the edge, over the contrast; a larger misfit is not this block
FAINTEST_CONTRAST_SIGMAS, FAINTEST_CONTRAST_GREY = (
    4.0,
    3.0,
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
FAR_FROM_ARC_REACHES = 1.0  # distance from its arc at which something else was fitted
FAST_FALL_PX = 0.5  # per frame squared, from which a block falls visibly within a few frames
STILL_STEP_PX = 0.5  # per frame; a lost block that moved less is expected where it was


def follow(
    film: Iterable[Array],
    setup: Setup,
    size_px: tuple[int, int],
    on_progress: Callable[[int, Array, FollowedRelease | None], None] = lambda number, frame, release: None,
    promised: int = 0,
) -> Followed:
    """Every release of a film, in the order filmed.

    film : (height, width) or (height, width, 3) uint8; it is read two or three times, from the start
    promised : about how many frames there are, 0 if nobody knows
    on_progress : called for every frame with its number, its picture and the release that is being followed, if any
    """
    motion = motion_in(film, setup, size_px, promised)
    if not motion.candidates:
        return Followed([], motion, {})
    follower, view = _prepared(film, setup, size_px, motion)
    for number, frame in enumerate(film):
        follower.read_frame(number, view(frame))
        on_progress(number, frame, follower.release)
    follower.end_release()
    return Followed(follower.releases, motion, follower.looks, follower.rejected)


def motion_in(film: Iterable[Array], setup: Setup, size_px: tuple[int, int], promised: int) -> Motion:
    """What moves in a film of which a set-up file is known."""
    camera, fps = setup.pixel_map(size_px), setup.keys.camera.fps
    outlines = [outline_of(b, setup.metres_per_pixel, camera.up) for b in setup.blocks.values()]
    radii = [float(np.sqrt(o.area_px2 / np.pi)) for o in outlines]
    return motion_of(film, promised, radii, setup.fall_px(size_px), fps)


def looks_in(
    film: Iterable[Array], setup: Setup, size_px: tuple[int, int], motion: Motion
) -> dict[str, Looks]:
    """How the blocks look where their arcs say that they are."""
    return _prepared(film, setup, size_px, motion)[0].looks


def _prepared(
    film: Iterable[Array], setup: Setup, size_px: tuple[int, int], motion: Motion
) -> tuple[_Follower, View]:
    """A follower that knows background and looks, and how it wants to see frames."""
    named = setup.keys.detection.background_frames
    samples = list(islice(film, named[0], named[1] + 1)) if named else motion.samples
    samples = samples or motion.samples
    shots = shots_of(film, motion)
    still = np.median(np.stack(samples), axis=0).astype(np.uint8)
    radius = float(np.median([np.sqrt(c.area_px2 / np.pi) for c in motion.chains])) if motion.chains else 1.0
    view = best_view([(picture, place) for _, picture, place in shots], still, radius)
    follower = _Follower(setup, size_px, Background([view(s) for s in samples]), motion)
    follower.learn_looks([(number, view(picture), place) for number, picture, place in shots])
    return follower, view


def shots_of(film: Iterable[Array], motion: Motion) -> list[tuple[int, Array, Array]]:
    """Frames in which a block is on its arc: number, picture, and place (2,) in px."""
    if not motion.chains:
        return []
    # some of each release
    wanted: set[int] = set()
    for chain in motion.chains:
        own = np.concatenate([a.frames for a in chain.arcs])
        count = min(len(own), max(FEWEST_SHOTS, MOST_SHOTS // len(motion.chains)))
        wanted |= set(own[np.linspace(0, len(own) - 1, count).round().astype(int)].tolist())
    found = []
    for number, frame in enumerate(islice(film, max(wanted) + 1)):
        spanning = motion.chain_at(number) if number in wanted else None
        place = spanning.at(number) if spanning is not None else None
        if place is not None:
            found.append((number, frame, place))
    return found


@dataclass
class Followed:
    """What was followed: the releases, what moves in the film, how each block looks, and how many frames of things
    that were not followed were lost, by reason."""

    releases: list[FollowedRelease]
    motion: Motion
    looks: dict[str, Looks]
    rejected: Counter[str] = field(default_factory=Counter)


class _Follower:
    """The state of the search while a film is read."""

    def __init__(
        self,
        setup: Setup,
        size_px: tuple[int, int],
        background: Background,
        motion: Motion,
    ) -> None:
        self.setup, self.background, self.motion = setup, background, motion
        self.map: PixelMap = setup.pixel_map(size_px)
        self.fall_px = setup.fall_px(size_px)
        self.visible = _above_ground(setup.cross_section, self.map, size_px)
        self.looks = {
            name: plain_looks(outline_of(block, setup.metres_per_pixel, self.map.up))
            for name, block in setup.blocks.items()
        }
        self.longest_loss = max(3, round(LONGEST_LOSS_S * setup.keys.camera.fps))
        self.releases: list[FollowedRelease] = []
        self.release: FollowedRelease | None = None
        self.chain: Chain | None = None
        self.blur = 1.0
        self.rejected: Counter[str] = Counter()
        self._sighted: list[tuple[Sight, Array]] = []  # sights of what may be a block, with their frames
        self._marks = Marks()
        self._lost = 0
        self._grey = self._contrast = 0.0
        self._usual_contrast = 0.0  # contrast of the blocks so far

    # --- what the blocks look like ---

    def learn_looks(self, shots: list[tuple[int, Array, Array]]) -> None:
        """Size and kind of fit of each block, from frames in which its arc says where it is."""
        for name in self.looks:
            own = [s for s in shots if self._block_of_chain(s[0]) == name]
            if len(own) >= FEWEST_SHOTS:
                self.looks[name] = self._learned(self.looks[name], own)
        self._usual_contrast = 0.0

    def _block_of_chain(self, number: int) -> str:
        order = next(k for k, c in enumerate(self.motion.chains) if c.first <= number <= c.last)
        return self.setup.block_of(order)

    def _learned(self, looks: Looks, shots: list[tuple[int, Array, Array]]) -> Looks:
        seen = self._sized(looks, shots)
        if abs(seen.size - 1.0) < LEAST_SIZE_CHANGE and self._works(looks, shots) >= LEAST_OUTLINES:
            seen = replace(looks, size=seen.size, size_error=seen.size_error)
        looks = seen
        by_edge = replace(looks, kind="edge")
        if self._works(looks, shots) >= LEAST_OUTLINES:
            better, apart = self._better(by_edge, looks, shots)
            return by_edge if better else replace(looks, bias_px=OUTLINE_BIAS_SHARE * apart)
        if self._works(by_edge, shots) >= LEAST_EDGES:
            return by_edge
        still = self.background.grey
        pairs = [(image, place) for _, image, place in shots]
        picture = learned_picture(pairs, still, looks.outline.reach_px)
        if picture is None:
            return replace(looks, kind="edge")
        places = [matched(i.astype(np.float32), still, picture, p, looks.outline.reach_px) for i, p in pairs]
        off = [
            m[0] - p for m, (_, p) in zip(places, pairs, strict=True) if m is not None and m[1] > LEAST_MATCH
        ]
        scatter = float(1.4826 * np.median(np.abs(off))) if len(off) >= FEWEST_SHOTS else 1.0
        return replace(
            looks, kind="picture", picture=picture, scatter_px=max(scatter, SMALLEST_PICTURE_ERROR_PX)
        )

    def _better(
        self, by_edge: Looks, looks: Looks, shots: list[tuple[int, Array, Array]]
    ) -> tuple[bool, float]:
        """Whether the edge finds a block better than its outline with one grey; usual distance of both in px.

        If the block is of one grey, both agree; if not, the edge is right, because it assumes less. Where they agree,
        the one whose places scatter less about the arcs is better."""
        pairs = []
        for number, image, place in shots:
            a = self._fit_start(number, image, looks, place)
            b = self._fit_start(number, image, by_edge, place, SEEN_TO_START)
            if not a.reason and not b.reason:
                pairs.append((number, *a.pose[:2], *b.pose[:2]))
        if len(pairs) < max(FEWEST_SHOTS, LEAST_OUTLINES * len(shots)):
            return False, 0.0
        table = np.array(pairs)
        apart = float(np.median(np.hypot(*(table[:, 1:3] - table[:, 3:]).T)))
        if apart > LARGEST_BIAS_PX:
            return True, apart
        squares, count = np.zeros(4), 0
        for arc in (a for c in self.motion.chains for a in c.arcs):
            own = table[(table[:, 0] >= arc.first) & (table[:, 0] <= arc.last)]
            if len(own) < FEWEST_PAIRS_ON_ARC:
                continue
            basis = np.linalg.qr(np.vander(own[:, 0] - own[:, 0].mean(), 3))[0]
            squares += ((own[:, 1:] - basis @ (basis.T @ own[:, 1:])) ** 2).sum(axis=0)
            count += len(own)
        return bool(count and squares[2:].sum() < SCATTER_GAIN**2 * squares[:2].sum()), apart

    def _works(self, looks: Looks, shots: list[tuple[int, Array, Array]]) -> float:
        """Share of the shots in which a fit finds the block."""
        return float(
            np.mean([not self._fit_start(n, image, looks, place).reason for n, image, place in shots])
        )

    def _sized(self, looks: Looks, shots: list[tuple[int, Array, Array]]) -> Looks:
        """The looks in the size that the edge shows; as they are if the edge is not seen well enough."""
        size, outline = 1.0, looks.outline
        for _ in range(SIZE_ROUNDS):
            trial = replace(looks, outline=outline.scaled(size), edge=edge_points(outline.scaled(size)))
            sizes = []
            for _, image, place in shots:
                fits = [self._edge_fit(image, trial, np.array([*place, turn]), free_size=True)
                        for turn in _start_angles(outline)]  # fmt: skip
                best = max((f for f in fits if f is not None), key=lambda f: f.seen, default=None)
                if best is not None and best.seen > SEEN_FOR_SIZE:
                    sizes.append(best.size)
            if len(sizes) < FEWEST_SHOTS:
                return looks
            change = float(np.median(sizes))
            spread = float(1.4826 * np.median(np.abs(np.array(sizes) - change)))
            size *= change
            if abs(size - 1.0) > LARGEST_SIZE_CHANGE or spread > LARGEST_SIZE_SPREAD:
                return looks
            if abs(change - 1.0) < SIZE_CONVERGED:
                break
        error = 1.25 * spread / np.sqrt(len(sizes))
        outline = outline.scaled(size)
        return replace(looks, outline=outline, edge=edge_points(outline), size=size, size_error=error)

    def _edge_fit(
        self, frame: Array, looks: Looks, start: Array, *, free_size: bool = False
    ) -> EdgeFit | None:
        u0, u1, v0, v1 = self._window(start, 1.9, looks.outline)
        if min(u1 - u0, v1 - v0) < looks.outline.reach_px:
            return None
        found = fit_edges(
            frame[v0:v1, u0:u1].astype(np.float32), self.background.grey[v0:v1, u0:u1], self.visible[v0:v1, u0:u1],
            self.background.noise, looks.edge, start - [u0, v0, 0.0],
            symmetric=looks.outline.symmetry_rad == 0.0, free_size=free_size,
        )  # fmt: skip
        return None if found is None else found._replace(pose=found.pose + np.array([u0, v0, 0.0]))

    def _fit_start(
        self, number: int, frame: Array, looks: Looks, place: Array, least: float | None = None
    ) -> Sight:
        """The best fit from any angle at a place."""
        best: Sight | None = None
        for turn in _start_angles(looks.outline):
            sight = self._fit(number, frame, looks, np.array([*place, turn]), None, least)
            if best is None or sight.confidence > best.confidence:
                best = sight
        assert best is not None
        return best

    # --- frame by frame ---

    def read_frame(self, number: int, frame: Array) -> None:
        """One more frame."""
        self._take_chain(number)
        if self.release is not None:
            sight = self._follow_on(number, frame)
            self.release.sights.append(sight)
            self._lost = 0 if not sight.reason else self._lost + 1
            on_arc = self.chain is not None and number <= self.chain.last
            if not on_arc and self._lost >= FRAMES_TO_START and self._search(number, frame):
                return  # another release has begun
            if not on_arc and (self._lost > self.longest_loss or (self._lost and self._has_left())):
                self.end_release()
        else:
            self._search(number, frame)
        self._learn(frame)

    def _take_chain(self, number: int) -> None:
        """Where arcs begin, a release begins, unless it is the one that is being followed."""
        chain = self.motion.chain_at(number)
        if chain is None or chain is self.chain:
            return
        place = chain.at(number)
        assert place is not None
        if self.release is not None and self.release.last_seen(1):
            reach = self.looks[self.release.block].outline.reach_px
            if np.hypot(*(self._expected(number)[:2] - place)) < 2.0 * reach:
                self.chain = chain
                return
        self.end_release()
        self.release, self._marks, self.chain = self._new_release(self._next_block()), Marks(), chain

    def _new_release(self, name: str) -> FollowedRelease:
        looks = self.looks[name]
        return FollowedRelease(name, [], 1.0 if looks.kind == "outline" else SLOW_ERROR_FACTOR, looks.bias_px)

    def end_release(self) -> None:
        """The release that is being followed is over."""
        if self.release is not None:
            seen = [i for i, s in enumerate(self.release.sights) if not s.reason]
            if seen:
                self.release.sights = self.release.sights[seen[0] : seen[-1] + 1]
                self.releases.append(self.release)
            else:
                self.rejected.update(s.reason for s in self.release.sights)
        self.release, self.chain, self._lost, self._sighted = None, None, 0, []

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
        looks = self.looks[self.release.block]
        outline = looks.outline
        seen = self.release.last_seen(4)
        on_arc = self._place_on_arc(number, outline)
        if not seen:
            if on_arc is None:
                return lost_sight(number, "no fit")
            best, expected = self._fit_start(number, frame, looks, on_arc), np.array([*on_arc, 0.0])
        else:
            expected = self._expected(number)
            starts = [] if on_arc is not None and (len(seen) < 2 or self._lost) else [expected]
            starts += [np.array([*on_arc, expected[2]])] if on_arc is not None else []
            best = lost_sight(number, "no fit")
            for start in starts:
                best = self._fit(number, frame, looks, start, self._grey)
                if not best.reason:
                    break
            if best.reason:
                blob = self._blob(number, frame, expected, outline)
                if blob is not None:
                    other = self._fit(number, frame, looks, np.array([*blob, expected[2]]), self._grey)
                    best = other if not other.reason else best
        if not best.reason:
            far = (
                np.hypot(*(best.pose[:2] - on_arc)) > FAR_FROM_ARC_REACHES * outline.reach_px
                if on_arc is not None
                else self._jumped(best.pose, expected, outline)
            )
            if far:
                best = lost_sight(number, "too far from the expected place")
        if not best.reason and outline.symmetry_rad == 0.0 and self.setup.keys.detection.marks:
            best = self._with_angle_of_marks(frame, best, expected[2], outline)
        return best

    def _place_on_arc(self, number: int, outline: Outline) -> Array | None:
        """Where the block's arc, or what moves there, says that it is."""
        place = self.chain.at(number) if self.chain is not None else None
        if place is None:
            return None
        moving = self.motion.near(number, place, 0.5 * outline.reach_px)
        return place if moving is None or not moving.whole else np.array([moving.u_px, moving.v_px])

    def _expected(self, number: int) -> Array:
        """Pose in this frame if the motion of the last frames continues."""
        assert self.release is not None
        seen = self.release.last_seen(4)
        last, first = seen[-1], seen[0]
        if len(seen) < 2:
            return last.pose.copy()
        pace = (last.pose - first.pose) / (last.frame - first.frame)
        ahead = number - last.frame
        expected = last.pose + pace * ahead
        g = self.fall_px
        if abs(g) > FAST_FALL_PX:
            # the pace is that of the middle of the frames it was read from
            expected[1] += 0.5 * g * ahead * (ahead + last.frame - first.frame)
        elif ahead > 1 and np.hypot(*pace[:2]) > STILL_STEP_PX:
            expected[1] += 0.5 * g * ahead**2
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
        reach = self.looks[self.release.block].outline.reach_px
        height, width = self.background.grey.shape
        return bool(min(u, v, width - 1 - u, height - 1 - v) < 1.2 * reach)

    # --- a block that is not known yet ---

    def _search(self, number: int, frame: Array) -> bool:
        """Look for a block in the whole picture; returns whether a release has begun."""
        name = self._next_block()
        looks = self.looks[name]
        outline = looks.outline
        if looks.kind != "outline":
            return False  # only arcs tell such a block from other things
        best: Sight | None = None
        for centre in self._candidates(frame, outline):
            sight = self._fit_start(number, frame, looks, np.array(centre), SEEN_TO_START)
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
        self.release = self._new_release(name)
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

    def _blob(
        self, number: int, frame: Array, expected: Array, outline: Outline
    ) -> tuple[float, float] | None:
        """Centre of what differs from the background near the expected place."""
        moving = self.motion.near(number, expected[:2], 2.0 * outline.reach_px)
        if moving is not None and moving.whole and moving.area_px2 < CANDIDATE_AREAS[1] * outline.area_px2:
            return moving.u_px, moving.v_px
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

    def _window(
        self, pose: Array, reaches: float, outline: Outline | None = None
    ) -> tuple[int, int, int, int]:
        """First and last u, first and last v around a pose, within the picture."""
        if outline is None:
            outline = self.looks[
                self.release.block if self.release is not None else self._next_block()
            ].outline
        half = reaches * outline.reach_px + 6.0
        height, width = self.background.grey.shape
        u, v = np.clip(pose[:2], -1e6, 1e6)
        return (
            int(np.clip(u - half, 0, width)), int(np.clip(u + half + 1, 0, width)),
            int(np.clip(v - half, 0, height)), int(np.clip(v + half + 1, 0, height)),
        )  # fmt: skip

    def _fit(
        self,
        number: int,
        frame: Array,
        looks: Looks,
        start: Array,
        grey: float | None,
        least: float | None = None,
    ) -> Sight:
        if looks.kind == "edge":
            return self._fit_edge(number, frame, looks, start, least)
        if looks.kind == "picture":
            return self._fit_picture(number, frame, looks, start)
        return self._fit_outline(number, frame, looks.outline, start, grey, least)

    def _fit_edge(self, number: int, frame: Array, looks: Looks, start: Array, least: float | None) -> Sight:
        found = self._edge_fit(frame, looks, start)
        if found is None:
            return lost_sight(number, "no contrast")
        if found.seen < (least or self.setup.keys.detection.least_seen):
            return lost_sight(number, "hidden")
        if max(found.error[:2]) > LARGEST_ERROR_PX:
            return lost_sight(number, "unsure")
        return Sight(number, found.pose, found.error, found.seen)

    def _fit_picture(self, number: int, frame: Array, looks: Looks, start: Array) -> Sight:
        assert looks.picture is not None
        u0, u1, v0, v1 = self._window(start, 3.0, looks.outline)
        image = frame[v0:v1, u0:u1].astype(np.float32)
        found = matched(
            image,
            self.background.grey[v0:v1, u0:u1],
            looks.picture,
            start[:2] - [u0, v0],
            looks.outline.reach_px,
        )
        if found is None or found[1] < LEAST_MATCH:
            return lost_sight(number, "another picture")
        pose = np.array([*(found[0] + [u0, v0]), start[2]])
        return Sight(number, pose, np.array([looks.scatter_px, looks.scatter_px, np.nan]), found[1])

    def _fit_outline(
        self,
        number: int,
        frame: Array,
        outline: Outline,
        start: Array,
        grey: float | None,
        least: float | None,
    ) -> Sight:
        u0, u1, v0, v1 = self._window(start, 1.2, outline)
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
