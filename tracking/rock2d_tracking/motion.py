"""What moves in a film, found before anything is known of how it looks: candidates of each frame, and the arcs on which
candidates fall.

A block in flight moves on a parabola whose curvature is gravity. Hands, sticks, people and flickering light do not; a
shadow does, but it darkens what lies below it and keeps to the ground.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field

import numpy as np

from rock2d_tracking.arcs import (
    AREA_RATIO,
    CHANGE_RATIO,
    FEWEST_ARC_FRAMES,
    Arc,
    arcs_of_other_gravity,
    find_arcs,
)
from rock2d_tracking.candidates import Candidate, candidates_of, shrunk

Array = np.ndarray

COARSE_WIDTH_PX = 640  # width of the picture in which motion is looked for, at most
COARSE_RADIUS_PX = 5.0  # radius that a block of known size keeps in it, at least
CHUNK_BYTES = 400_000_000  # coarse pictures that share a background
FULL_SAMPLES = 25  # pictures of full size that are kept for the background of the fits
SHADOW_WEIGHT = 0.2  # weight of frames in which a chain looks like a shadow
SHADOW_CHANGE_PX, SHADOW_CHANGE_SHARE = (
    3.0,
    0.08,
)  # change of the distance from a block to its shadow, and share of its way
LONGEST_LINK_S, LONGEST_LINK_FRAMES = 0.25, 4  # between two arcs of one release
FEWEST_CHAIN_FRAMES = 6


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
    candidates : candidates of each frame
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
    frames: Iterable[Array], expected_frames: int, radii_px: list[float], fall_px: float, fps: float
) -> Motion:
    """Read a film once and find what moves in it.

    frames : (height, width) or (height, width, 3) uint8
    expected_frames : about how many there are, 0 if nobody knows
    radii_px : radii of the blocks, [] if they are not known
    fall_px : acceleration of gravity along v in px per frame squared; 0 if it is not known
    """
    found, chunk = Motion(), []
    stride, number = max(1, expected_frames // FULL_SAMPLES), 0
    coarse = 1
    for number, frame in enumerate(frames):
        if number == 0:
            coarse = _coarseness(frame.shape[1], radii_px)
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
    kept = [_shadow_caster(c, arcs) or c for c in kept]
    # where two chains overlap in time, the block is the one that falls longer, stands out more, and has a block's size
    kept.sort(key=lambda c: -_weight(c, radii_px))
    chosen: list[Chain] = []
    for chain in kept:
        if all(chain.last < c.first or chain.first > c.last for c in chosen):
            chosen.append(chain)
    return sorted(chosen, key=lambda c: c.first)


def _shadow_caster(chain: Chain, arcs: list[Arc]) -> Chain | None:
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
        if apart < max(SHADOW_CHANGE_PX, SHADOW_CHANGE_SHARE * way) and all(
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
    ratio, contrasts = after.area_px2 / before.area_px2, (before.contrast, after.contrast)
    if not 1 / AREA_RATIO < ratio < AREA_RATIO or min(contrasts) < (1.0 - CHANGE_RATIO) * max(contrasts):
        return False
    meet = meeting(before, after)
    apart = float(np.hypot(*(before.at(meet) - after.at(meet))))
    pace = max(float(np.hypot(*(a.at(meet) - a.at(meet - 1)))) for a in (before, after))
    return apart < before.radius_px + 0.5 * pace + 2.0
