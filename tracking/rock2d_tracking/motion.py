"""Motion in a film, found without knowledge of its appearance: the candidates of each frame, and the arcs on which they
fall.

A block in flight moves on a parabola whose curvature is that of gravity. Hands, sticks, people and flickering light do
not; a shadow does, but it darkens the background and stays on the ground."""

from collections.abc import Iterable
from dataclasses import dataclass, field

import numpy as np

from rock2d.arrays import Array
from rock2d.errors import InputError
from rock2d_tracking.arcs import (
    AREA_RATIO,
    CHANGE_RATIO,
    FEWEST_ARC_FRAMES,
    Arc,
    arcs_of_other_gravity,
    common_acceleration,
    find_arcs,
)
from rock2d_tracking.candidates import candidates_of, shrunk
from rock2d_tracking.film_reading import CONSTANT_RATE, Clock
from rock2d_tracking.film_scale import UNKNOWN_SCALE, FilmScale

COARSE_WIDTH_PX = 640  # width of the picture in which motion is looked for, at most
COARSE_RADIUS_PX = 5.0  # radius that a block of known size keeps in it, at least
CHUNK_BYTES = 400_000_000  # coarse pictures that share a background
FULL_SAMPLES = 25  # pictures of full size that are kept for the background of the fits
SHADOW_SHARE = 0.5  # least share of shadow-like frames for which an arc or a chain is taken as a shadow
SHADOW_WEIGHT = 0.2  # weight of frames in which a chain looks like a shadow
# largest change of the distance from a block to its shadow, px and over the length of the path
SHADOW_CHANGE_PX, SHADOW_CHANGE_SHARE = 3.0, 0.08
LONGEST_OVERLAP = 4  # frames that two arcs of one release may share next to an impact
LONGEST_LINK_S, LONGEST_LINK_FRAMES = 0.25, 4  # between two arcs of one release
FEWEST_CHAIN_FRAMES = 6
UNLIKE_SHARE = 0.5  # of the reach; added to the distance of a candidate with the least likely area
CANDIDATE_AREAS = (0.3, 2.5)  # smallest and largest of a candidate that may be a block, over its area
# contrast and area of a chain over those of the one that stands out most, where the size of the block is not known
LEAST_CONTRAST_SHARE, ONE_BLOCK_AREAS = 0.25, 3.0


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
    def radius_px(self) -> float:
        """Radius of the circle of this area."""
        return float(np.sqrt(self.area_px2 / np.pi))

    @property
    def shadow_share(self) -> float:
        """Share of its frames that look like a shadow."""
        return float(np.average([a.shadow_share for a in self.arcs], weights=[len(a.frames) for a in self.arcs]))

    @property
    def frames_seen(self) -> int:
        """Number of its candidates."""
        return sum(len(a.frames) for a in self.arcs)

    def pace(self, frame: int) -> Array:
        """(2,) displacement in px per usual frame interval at a frame."""
        arc = min(self.arcs, key=lambda a: max(a.first - frame, frame - a.last, 0))
        return arc.pace(frame)

    def at(self, frame: int) -> Array | None:
        """(2,) place in px; between two arcs, on the extrapolation of the nearer one; None before and after them."""
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
    """The motion in a film.

    Attributes
    ----------
    candidates : (n,) CANDIDATE of each frame
    chains : the arcs of each release, in the order filmed
    samples : pictures of full size, evenly distributed over the film
    arcs : all arcs, of blocks and of other things
    clock : the instants of frames
    scale : scale and frame rate; one of them possibly computed from the arcs"""

    candidates: list[Array] = field(default_factory=list)
    chains: list[Chain] = field(default_factory=list)
    samples: list[Array] = field(default_factory=list)
    arcs: list[Arc] = field(default_factory=list)
    clock: Clock = CONSTANT_RATE
    scale: FilmScale = UNKNOWN_SCALE

    def chain_at(self, frame: int) -> Chain | None:
        """The chain that spans a frame."""
        return next((c for c in self.chains if c.first <= frame <= c.last), None)

    def near(self, frame: int, place: Array, reach_px: float, area_px2: float | None = None) -> Array | None:
        """(2,) centroid in px of the whole candidate of a frame nearest to a place, if one is within reach; if the area
        is known, similar areas are preferred."""
        if frame >= len(self.candidates):
            return None
        own = self.candidates[frame]
        away = np.hypot(*(own["place_px"] - place).T)
        possible = own["whole"] & ~own["shadow"] & (away <= reach_px)
        if area_px2 is not None:
            ratio = own["area_px2"] / area_px2
            possible &= (ratio > CANDIDATE_AREAS[0]) & (ratio < CANDIDATE_AREAS[1])
            away += UNLIKE_SHARE * reach_px * (np.abs(np.log(ratio)) / np.log(CANDIDATE_AREAS[1]))
        if not possible.any():
            return None
        return np.asarray(own["place_px"][np.argmin(np.where(possible, away, np.inf))])


def motion_of(
    frames: Iterable[Array],
    expected_frames: int,
    radii_px: list[float],
    scale: FilmScale,
    clock: Clock = CONSTANT_RATE,
    down: int = 1,
) -> Motion:
    """Read a film once and find the motion in it.

    frames : (height, width) or (height, width, 3) uint8
    expected_frames : approximate number of frames, 0 if unknown
    radii_px : radii of the blocks, [] if unknown
    scale : scale and frame rate; one that is None is computed from falling objects
    clock : the instants of frames
    down : the sign of gravity along v"""
    found, chunk = Motion(clock=clock), []
    stride, number = max(1, expected_frames // FULL_SAMPLES), 0
    coarse = 1
    for number, frame in enumerate(frames):
        if number == 0:
            height, width = frame.shape[:2]
            if 2.0 * max(radii_px, default=0.0) > max(height, width):
                message = f"a block is {2.0 * max(radii_px):.0f} px wide in a picture of {width} x {height} px"
                raise InputError(f"{message}: are the sizes of blocks in m, and is the scale right?")
            coarse = _coarseness(width, radii_px)
        if number % stride == 0:
            found.samples.append(frame)
            if len(found.samples) > 2 * FULL_SAMPLES:  # the film is longer than expected
                found.samples, stride = found.samples[::2], 2 * stride
        chunk.append(shrunk(frame, coarse))
        if chunk[-1].nbytes * len(chunk) > CHUNK_BYTES:
            found.candidates += candidates_of(chunk, len(found.candidates), coarse)
            chunk = []
    if chunk:
        found.candidates += candidates_of(chunk, len(found.candidates), coarse)
    if not scale.g_px_frame2 and (fall := common_acceleration(found.candidates, down, clock)) is not None:
        scale = scale.completed(abs(fall.value))
    found.scale, g_px_frame2 = scale, down * scale.g_px_frame2
    if not g_px_frame2:  # nothing falls
        return found
    found.arcs = find_arcs(found.candidates, g_px_frame2, clock)
    found.chains = find_chains(found.arcs, scale.fps or 0.0, radii_px)
    if not found.chains:
        found.arcs += arcs_of_other_gravity(found.candidates, g_px_frame2, clock)
    return found


def _coarseness(width: int, radii_px: list[float]) -> int:
    coarse = -(-width // COARSE_WIDTH_PX)
    if radii_px:
        coarse = int(min(radii_px) / COARSE_RADIUS_PX)
    return max(1, coarse)


def meeting(before: Arc, after: Arc) -> float:
    """The instant between two arcs (or up to one frame outside) at which they are nearest to each other. One frame
    outside, because a shadow on the continuation of an arc can be taken for the block."""
    first, last = sorted((before.last, after.first))
    when = np.linspace(first - 1, last + 1, 4 * (last - first) + 9)
    apart = before.at(when) - after.at(when)
    return float(when[int(np.argmin((apart**2).sum(axis=1)))])


def find_chains(arcs: list[Arc], fps: float, radii_px: list[float]) -> list[Chain]:
    """Releases: successive arcs that begin where the previous one ends; at least one of them falls."""
    longest = max(LONGEST_LINK_FRAMES, round(LONGEST_LINK_S * fps))
    chains: list[Chain] = []
    for arc in sorted((a for a in arcs if not a.falls_otherwise), key=lambda a: (a.first, a.last)):
        before = [
            c for c in chains
            if -LONGEST_OVERLAP < arc.first - c.last <= longest and arc.last > c.last + LONGEST_OVERLAP
            and _joined(c.arcs[-1], arc)
        ]  # fmt: skip
        if before:  # a part of the block, or its shadow, moves as it does, but is seen for a shorter time
            own = max(before, key=lambda c: c.frames_seen)
            own.arcs.append(arc.after(own.last))
        else:
            chains.append(Chain([arc]))
    kept = [c for c in chains if any(a.falls for a in c.arcs) and c.frames_seen >= FEWEST_CHAIN_FRAMES]
    if radii_px:
        low, high = (
            np.pi * r**2 * share for r, share in zip((min(radii_px), max(radii_px)), CANDIDATE_AREAS, strict=True)
        )
        kept = [c for c in kept if low < c.area_px2 < high]
    kept = [_shadow_caster(c, arcs) or c for c in kept]
    if kept and not radii_px:
        kept = _like_the_strongest(kept)
    # where two chains overlap in time, the block is the one that falls longer, stands out more, and has a block's size
    kept.sort(key=lambda c: -_weight(c, radii_px))
    chosen: list[Chain] = []
    for chain in kept:
        if all(chain.last < c.first or chain.first > c.last for c in chosen):
            chosen.append(chain)
    return sorted(chosen, key=lambda c: c.first)


def _like_the_strongest(chains: list[Chain]) -> list[Chain]:
    """The chains with a contrast and area similar to the strongest one; the others are flicker and compression."""
    first = max(chains, key=lambda c: _weight(c, []))
    contrast, area = max(a.contrast for a in first.arcs), first.area_px2
    return [
        c for c in chains
        if max(a.contrast for a in c.arcs) > LEAST_CONTRAST_SHARE * contrast
        and 1 / ONE_BLOCK_AREAS < c.area_px2 / area < ONE_BLOCK_AREAS
    ]  # fmt: skip


def _shadow_caster(chain: Chain, arcs: list[Arc]) -> Chain | None:
    """The object that casts a shadow-like chain: arcs at a constant distance from it that are not a shadow."""
    if chain.shadow_share < SHADOW_SHARE:
        return None
    found: list[Arc] = []
    for arc in sorted(arcs, key=lambda a: -len(a.frames)):
        both = [f for f in arc.frames.tolist() if chain.first <= f <= chain.last]
        if arc.shadow_share > SHADOW_SHARE or len(both) < max(FEWEST_ARC_FRAMES, 0.5 * len(arc.frames)):
            continue
        shadow = np.array([chain.at(f) for f in both])
        way = float(np.hypot(*np.ptp(shadow, axis=0)))
        apart = np.std(arc.at(np.array(both)) - shadow, axis=0).max()
        if apart < max(SHADOW_CHANGE_PX, SHADOW_CHANGE_SHARE * way) and all(
            arc.last < a.first or arc.first > a.last for a in found
        ):
            found.append(arc)
    frames = sum(len(a.frames) for a in found)
    return Chain(sorted(found, key=lambda a: a.first)) if frames > 0.4 * chain.frames_seen else None


def _weight(chain: Chain, radii_px: list[float]) -> float:
    frames = sum(
        len(a.frames) * (SHADOW_WEIGHT if a.shadow_share > SHADOW_SHARE else 1.0) * a.contrast for a in chain.arcs
    )
    if not radii_px:  # highlights are brighter than the block, but smaller
        return float(frames * np.sqrt(chain.area_px2))
    misfit = min(abs(np.log(chain.area_px2 / (np.pi * r**2))) for r in radii_px)
    return float(frames * np.exp(-misfit))


def _joined(before: Arc, after: Arc) -> bool:
    ratio, contrasts = after.area_px2 / before.area_px2, (before.contrast, after.contrast)
    if not 1 / AREA_RATIO < ratio < AREA_RATIO or min(contrasts) < (1.0 - CHANGE_RATIO) * max(contrasts):
        return False
    meet = meeting(before, after)
    apart = float(np.hypot(*(before.at(meet) - after.at(meet))))
    pace = max(float(np.hypot(*(a.at(meet) - a.at(meet - 1)))) for a in (before, after))
    return apart < before.radius_px + 0.5 * pace + 2.0
