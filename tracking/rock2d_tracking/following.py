"""Following blocks through a film, frame by frame: position, angle and confidence of each."""

import copy
import math
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from itertools import islice, pairwise

import numpy as np

from rock2d.arrays import Array
from rock2d.kinematics.flights import FEWEST_FLIGHT_FRAMES
from rock2d_tracking.background import Background
from rock2d_tracking.film_reading import CONSTANT_RATE, Clock
from rock2d_tracking.fitting import SURE_FIT, TRUSTED_OVER_SEEN, Fitter, above_ground
from rock2d_tracking.learning import FEWEST_BLOCK_FRAMES, SEEN_TO_START, frames_with_blocks, learned_looks
from rock2d_tracking.looks import BlockFrame, Looks, best_channel_mix
from rock2d_tracking.marks import Marks, nearest_angle
from rock2d_tracking.motion import CANDIDATE_AREAS, SHADOW_SHARE, Chain, Motion, motion_of
from rock2d_tracking.outline import Outline, outline_of
from rock2d_tracking.setup_file import Setup
from rock2d_tracking.sights import FollowedRelease, Sight, lost_sight, shows_release
from rock2d_tracking.tracked_film import moving_releases

FOREGROUND_SIGMAS = 6.0  # least difference of a pixel from the background, in noise
FOREGROUND_GREY = 8.0  # and in grey levels
SEARCH_RADIUS_PX = 6.0  # radius of the block in the coarse picture that is searched
SEARCH_CANDIDATES = 4  # places of a picture at which a block is fitted
LONGEST_LOSS_S = 0.25  # longest time without the block within a release
FRAMES_TO_START = 3  # in a row with a block: a release has begun
FAR_FROM_ARC_REACHES = 1.0  # largest distance of a fit from its arc; farther away it is another object
FAST_G_PX_FRAME2 = 0.5  # from which a block falls visibly within a few frames
USUAL_SIZE_ERROR = 0.05  # relative error of a stated size
STILL_STEP_PX = 0.5  # per frame; a lost block that moved less is expected where it was

OnProgress = Callable[[int, Array, FollowedRelease | None], None]


def motion_for_setup(film: Iterable[Array], setup: Setup, expected_frames: int, clock: Clock = CONSTANT_RATE) -> Motion:
    """The motion in a film with a set-up."""
    metres = setup.scale.metres_per_pixel
    outlines = [] if metres is None else [outline_of(b, metres, -setup.down) for b in setup.blocks.values()]
    return motion_of(film, expected_frames, [o.radius_px for o in outlines], setup.scale, clock, setup.down)


class Follower:
    """The search for the blocks of a film.

    Attributes
    ----------
    setup, motion : the set-up and the motion from which it starts
    looks : how each block is recognised
    releases : the followed releases, in the order filmed
    rejected : number of lost frames of objects that were not followed in any frame, by reason"""

    def __init__(
        self, film: Iterable[Array], setup: Setup, size_px: tuple[int, int], motion: Motion, *, cut: bool = False
    ) -> None:
        """Read the film to learn the background, and the looks of the blocks at the places given by their arcs.

        film : (height, width) or (height, width, 3) uint8
        cut : whether it is the beginning of a longer film, so that the last of the stated releases are not in it

        Raises InputError if the frames that the set-up names as background are not in it."""
        named = setup.keys.detection.background_frames
        samples = list(islice(film, named[0], named[1] + 1)) if named else motion.samples
        if not samples:
            raise setup.background_missing(len(motion.candidates))
        block_frames = frames_with_blocks(film, motion)
        still = np.median(np.stack(samples), axis=0).astype(np.uint8)
        radius = float(np.median([c.radius_px for c in motion.chains])) if motion.chains else 1.0
        self.mix = best_channel_mix(block_frames, still, radius)
        self.setup, self.motion = setup, motion
        self.background = Background([self.mix(s) for s in samples])
        camera = setup.pixel_map(size_px)
        self.g_px_frame2 = setup.g_px_frame2
        visible = above_ground(setup.cross_section, camera, size_px)
        self.fitter = Fitter(self.background, visible, setup.keys.detection.least_seen)
        self.looks = {
            name: Looks("outline", outline_of(block, setup.metres_per_pixel, camera.up))
            for name, block in setup.blocks.items()
        }
        self._chain_blocks = [] if cut else self._blocks_of_chains()
        self.longest_loss = max(3, round(LONGEST_LOSS_S * setup.fps))
        self.releases: list[FollowedRelease] = []
        self._named = 0  # of them, those that take a name from the stated releases
        self.release: FollowedRelease | None = None
        self.chain: Chain | None = None
        self.rejected: Counter[str] = Counter()
        self._sighted: list[tuple[Sight, Array]] = []  # sights of what may be a block, with their frames
        self._marks = Marks()
        self._lost = 0
        self._learn_looks([f._replace(picture=self.mix(f.picture)) for f in block_frames])

    def follow(self, film: Iterable[Array], on_progress: OnProgress = lambda number, frame, release: None) -> None:
        """Read the film from the start and find all its releases.

        on_progress : called for every frame with its number, its picture and the release being followed, if any"""
        for number, frame in enumerate(film):
            self._read_frame(number, self.mix(frame))
            on_progress(number, frame, self.release)
        self._end_release()

    def lost_frames(self) -> Counter[str]:
        """Number of lost frames by reason."""
        return Counter(s.reason for r in self.releases for s in r.sights if s.reason) + self.rejected

    # --- what the blocks look like ---

    def _learn_looks(self, block_frames: list[BlockFrame]) -> None:
        """Set size and kind of fit of each block, from frames in which its arc gives its place."""
        for name in self.looks:
            own = [f for f in block_frames if self._block_of_chain(f.number) == name]
            if len(own) >= FEWEST_BLOCK_FRAMES:
                self.looks[name] = learned_looks(self.fitter, self.looks[name], own, self.motion)
        self.fitter.forget_contrast()

    def _block_of_chain(self, number: int) -> str:
        """The block of the chain at a frame; one that is none of the `_named_chains` counts as the one after it."""
        order = sum(chain.last < number for chain in self._named_chains())
        blocks = self._chain_blocks
        return blocks[min(order, len(blocks) - 1)] if blocks else self.setup.block_of(order)

    def _named_chains(self) -> list[Chain]:
        """The chains; where there are more than stated releases, without those too short for a release."""
        chains = self.motion.chains
        if len(chains) <= len(self.setup.keys.releases):
            return chains
        return [c for c in chains if c.last - c.first + 1 >= FEWEST_FLIGHT_FRAMES]

    def _blocks_of_chains(self) -> list[str]:
        """The block of each chain, if the set-up states more releases than there are chains; otherwise empty: the
        releases are then taken in order."""
        stated, areas = self.setup.keys.releases, [chain.area_px2 for chain in self._named_chains()]
        if len(areas) >= len(stated):
            return []
        expected = [self.looks[name].outline.area_px2 for name in stated]
        return [stated[k] for k in releases_shown(areas, expected)]

    # --- frame by frame ---

    def _read_frame(self, number: int, frame: Array) -> None:
        """Process the next frame."""
        self._begin_release_of_chain(number)
        if self.release is not None:
            sight = self._fit_followed(number, frame)
            self.release.sights.append(sight)
            self._lost = 0 if not sight.reason else self._lost + 1
            on_arc = self.chain is not None and number <= self.chain.last
            if not on_arc and self._lost >= FRAMES_TO_START and self._search(number, frame):
                return  # another release has begun
            if not on_arc and (self._lost > self.longest_loss or (self._lost and self._has_left())):
                self._end_release()
        else:
            self._search(number, frame)
        self._learn(frame)

    def _begin_release_of_chain(self, number: int) -> None:
        """Begin a release where a chain begins, unless it belongs to the release being followed."""
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
        self._end_release()
        name = self._block_of_chain(number) if self._chain_blocks else self._next_block()
        self.release, self._marks, self.chain = self._new_release(name), Marks(), chain

    def _new_release(self, name: str) -> FollowedRelease:
        looks = self.looks[name]
        radius = looks.outline.radius_px
        # a block of which only the lit part is seen looks smaller and off centre
        beside = max(abs(looks.size - 1.0) - USUAL_SIZE_ERROR, 0.0) * radius
        bias_px = float(np.hypot(looks.bias_px, beside))
        return FollowedRelease(name, [], bias_px, radius, looks.shutter)

    def _end_release(self) -> None:
        """End the release that is being followed."""
        if self.release is not None:
            self._distrust_hidden(self.release)
            self._distrust_shadow(self.release)
            seen = [i for i, s in enumerate(self.release.sights) if not s.reason]
            if seen:
                self.release.sights = self.release.sights[seen[0] : seen[-1] + 1]
                self.releases.append(self.release)
                judged = copy.deepcopy(self.release)
                for sight in judged.sights:
                    sight.when = float(self.motion.clock(sight.frame))
                self._named += len(moving_releases([judged], self.g_px_frame2))
            else:
                self.rejected.update(s.reason for s in self.release.sights)
        self.release, self.chain, self._lost, self._sighted = None, None, 0, []

    def _distrust_hidden(self, release: FollowedRelease) -> None:
        """Reject frames in which too little of the outline was seen; they served only to follow the block. Soil that
        hides one side looks like an edge of the block."""
        if self.looks[release.block].kind == "outline":
            for sight in release.seen:
                if sight.confidence < TRUSTED_OVER_SEEN * self.setup.keys.detection.least_seen:
                    sight.reject("half hidden")

    def _distrust_shadow(self, release: FollowedRelease) -> None:
        """Reject a release that darkens the background like a shadow, unless its outline is sharp."""
        if not release.seen or self._shadow_share(release) < SHADOW_SHARE:
            return
        if np.median([s.confidence for s in release.seen]) < SURE_FIT:
            for sight in release.seen:
                sight.reject("like a shadow")

    def _shadow_share(self, release: FollowedRelease) -> float:
        """Share of the candidates of a release that look like a shadow. Without arcs, the candidates at its places
        count: the shadow of a block in a hand may be found as an outline, while the hand hides the block."""
        if self.chain is not None:
            return self.chain.shadow_share
        reach_px = 0.5 * self.looks[release.block].outline.reach_px
        near: list[bool] = []
        for sight in release.seen:
            own = self.motion.candidates[sight.frame]
            near += own["shadow"][np.hypot(*(own["place_px"] - sight.pose[:2]).T) < reach_px].tolist()
        return float(np.mean(near)) if near else 0.0

    def _next_block(self) -> str:
        own = self.release is not None and shows_release(self.release, self.g_px_frame2)
        return self.setup.block_of(self._named + own)

    def _learn(self, frame: Array) -> None:
        if self.release is None:
            self.background.learn(frame, None if not self._sighted else self._around(self._sighted[-1][0].pose, 1.5))
            return
        for sight in self.release.last_seen(1):
            self.background.learn(frame, self._around(sight.pose, 1.5))

    # --- a block that is known ---

    def _fit_followed(self, number: int, frame: Array) -> Sight:
        assert self.release is not None
        looks = self.looks[self.release.block]
        outline = looks.outline
        seen = self.release.last_seen(4)
        on_arc = self._place_on_arc(number, outline)
        self.fitter.pace_px = self._pace(number, seen)
        if not seen:
            if on_arc is None:
                return lost_sight(number, "no fit")
            expected = np.array([*on_arc, 0.0])
            best = self.fitter.fit_any_angle(number, frame, looks, on_arc)
            best = self._reject_unexpected(best, on_arc, expected, frame)
        else:
            expected = self._expected(number)
            best = lost_sight(number, "no fit")
            for start in self._starts(number, frame, expected, on_arc):
                found = self.fitter.fit(number, frame, looks, start, self.fitter.grey)
                found = self._reject_unexpected(found, on_arc, expected, frame)
                best = found if not found.reason or best.reason == "no fit" else best
                if not best.reason:
                    break
        if not best.reason and outline.symmetry_rad == 0.0 and self.setup.keys.detection.marks:
            best = self._with_angle_of_marks(frame, best, expected[2], outline)
        return best

    def _starts(self, number: int, frame: Array, expected: Array, on_arc: Array | None) -> Iterator[Array]:
        """Poses (3,) from which the block is fitted, the likeliest first."""
        assert self.release is not None
        outline = self.looks[self.release.block].outline
        if on_arc is None or (len(self.release.last_seen(2)) == 2 and not self._lost):
            yield expected
        if on_arc is not None:
            yield np.array([*on_arc, expected[2]])
        last = self.release.last_seen(1)[0].pose
        # an impact can reverse the motion
        around = 2.0 * outline.reach_px + (1 + self._lost) * self._fastest(outline)
        for near, reach_px in ((expected, 2.0 * outline.reach_px), (last, around)):
            blob = self._blob(number, frame, near, reach_px, outline)
            if blob is not None:
                yield np.array([*blob, expected[2]])

    def _reject_unexpected(self, sight: Sight, on_arc: Array | None, expected: Array, frame: Array) -> Sight:
        """The sight; lost if it is too far from the possible places of the block."""
        assert self.release is not None
        if sight.reason:
            return sight
        looks = self.looks[self.release.block]
        far = (
            np.hypot(*(sight.pose[:2] - on_arc)) > FAR_FROM_ARC_REACHES * looks.outline.reach_px
            if on_arc is not None
            else self._jumped(sight.pose, expected, looks.outline)
        )
        if far:
            return lost_sight(sight.frame, "too far from the expected place")
        sight.covered = self.fitter.covered(frame, looks, sight.pose)
        return sight

    def _pace(self, number: int, seen: list[Sight]) -> Array:
        """(2,) approximate displacement of the block per usual frame interval."""
        if self.chain is not None and self.chain.first <= number <= self.chain.last:
            return self.chain.pace(number)
        if len(seen) < 2:
            return np.zeros(2)
        return np.asarray((seen[-1].pose - seen[-2].pose)[:2] / self._time(seen[-2].frame, seen[-1].frame))

    def _time(self, first: int, last: int) -> float:
        """Time from one frame to another, in units of the usual one."""
        clock = self.motion.clock
        return float(clock(last) - clock(first))

    def _place_on_arc(self, number: int, outline: Outline) -> Array | None:
        """The place of the block on its arc, or of the candidate there."""
        place = self.chain.at(number) if self.chain is not None else None
        if place is None:
            return None
        moving = self.motion.near(number, place, 0.5 * outline.reach_px)
        return place if moving is None else moving

    def _expected(self, number: int) -> Array:
        """Pose in this frame if the motion of the last frames continues."""
        assert self.release is not None
        seen = self.release.last_seen(4)
        last, first = seen[-1], seen[0]
        if len(seen) < 2:
            return last.pose.copy()
        since, ahead = self._time(first.frame, last.frame), self._time(last.frame, number)
        pace = (last.pose - first.pose) / since
        expected = last.pose + pace * ahead
        g = self.g_px_frame2
        if abs(g) > FAST_G_PX_FRAME2:
            # the pace belongs to the middle of its frames
            expected[1] += 0.5 * g * ahead * (ahead + since)
        elif number > last.frame + 1 and np.hypot(*pace[:2]) > STILL_STEP_PX:
            expected[1] += 0.5 * g * ahead**2
        return np.asarray(expected)

    def _fastest(self, outline: Outline) -> float:
        """Largest displacement in px per frame of the last frames; an impact does not make it larger."""
        seen = self.release.last_seen(4) if self.release is not None else []
        steps = [np.hypot(*(b.pose - a.pose)[:2]) / self._time(a.frame, b.frame) for a, b in pairwise(seen)]
        return float(max(steps, default=outline.reach_px))

    def _jumped(self, pose: Array, expected: Array, outline: Outline) -> bool:
        pace = self._fastest(outline)
        way = float(np.hypot(*(pose - expected)[:2]))
        return way > 0.5 * outline.reach_px + (1 + self._lost) * (1.5 * pace + 1.0)

    def _with_angle_of_marks(self, frame: Array, sight: Sight, near: float, outline: Outline) -> Sight:
        contrast = max(self.fitter.contrast, 1.0)
        centre_px = (sight.pose[0], sight.pose[1])
        angle = self._marks.angle(frame, self.fitter.visible, centre_px, outline.reach_px, near, contrast)
        if angle is None:
            return lost_sight(sight.frame, "marks not recognised")
        sight.pose[2] = angle
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
            return False  # only arcs distinguish such a block from other things
        best: Sight | None = None
        for centre in self._candidates(frame, outline):
            sight = self.fitter.fit_any_angle(number, frame, looks, np.array(centre), SEEN_TO_START)
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
        self._end_release()
        self.release = self._new_release(name)
        self._marks = Marks()
        for sight, own in taken:
            before = self.release.sights[-1].pose[2] if self.release.sights else sight.pose[2]
            if outline.symmetry_rad > 0.0:
                sight.pose[2] = nearest_angle(sight.pose[2], before, outline.symmetry_rad)
            elif self.setup.keys.detection.marks:
                self._with_angle_of_marks(own, sight, before, outline)
            self.release.sights.append(sight)
        self._sighted = []
        return True

    def _far_away(self, sight: Sight, outline: Outline) -> bool:
        """Whether a sight is too far from the block being followed; False if the block was never seen."""
        assert self.release is not None
        if not self.release.last_seen(1):
            return True
        expected = self._expected(sight.frame)
        return float(np.hypot(*(sight.pose - expected)[:2])) > 4.0 * outline.reach_px

    def _candidates(self, frame: Array, outline: Outline) -> list[tuple[float, float]]:
        """Centres (u, v) of regions that differ from the background and have its approximate area, best first."""
        import cv2

        # pixels of a sixth of the block, but not finer than those of the film
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

    def _blob(self, number: int, frame: Array, near: Array, reach_px: float, outline: Outline) -> Array | None:
        """(2,) centre of the region that differs from the background near a place, at most `reach_px` away."""
        moving = self.motion.near(number, near[:2], reach_px, outline.area_px2)
        if moving is not None:
            return moving
        u0, u1, v0, v1 = self._around(near, 2.5)
        if u1 - u0 < 4 or v1 - v0 < 4:
            return None
        part = np.abs(frame[v0:v1, u0:u1].astype(np.float32) - self.background.grey[v0:v1, u0:u1])
        mask = (part > max(FOREGROUND_SIGMAS * self.background.noise, FOREGROUND_GREY)) & (
            self.fitter.visible[v0:v1, u0:u1] > 0
        )
        if mask.sum() < CANDIDATE_AREAS[0] * outline.area_px2:
            return None
        v, u = np.nonzero(mask)
        return np.array([np.median(u) + u0, np.median(v) + v0])

    def _around(self, pose: Array, reaches: float) -> tuple[int, int, int, int]:
        """First and last u, first and last v around the block that is followed or expected."""
        name = self.release.block if self.release is not None else self._next_block()
        return self.fitter.window(pose, reaches, self.looks[name].outline)


def releases_shown(areas_px2: Sequence[float], stated_px2: Sequence[float]) -> list[int]:
    """Index of the stated release of each visible object, in the order filmed, if not all releases are visible.

    areas_px2 : (n,) of the visible objects, fewer than stated releases
    stated_px2 : (m,) of the blocks of the stated releases

    Minimises the sum of |log(area / stated area)|; among equal assignments, it takes the earliest releases."""
    miss = np.abs(np.log(np.asarray(areas_px2)[:, None] / np.asarray(stated_px2)))
    seen, stated = miss.shape
    least = np.full((seen + 1, stated + 1), np.inf)  # of the first k seen among the first m stated
    least[0] = 0.0
    for k in range(1, seen + 1):
        for m in range(k, stated + 1):
            least[k, m] = min(least[k, m - 1], least[k - 1, m - 1] + miss[k - 1, m - 1])
    chosen, m = [], stated
    for k in range(seen, 0, -1):
        while m > k and least[k, m - 1] <= least[k, m]:
            m -= 1
        chosen.append(m - 1)
        m -= 1
    return chosen[::-1]
