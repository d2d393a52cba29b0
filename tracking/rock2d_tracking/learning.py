"""What the blocks of a film look like, learned from frames in which their arcs say where they are."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from itertools import islice

import numpy as np

from rock2d_tracking.edges import edge_points
from rock2d_tracking.fitting import Fitter, start_angles
from rock2d_tracking.looks import LEAST_MATCH, Looks, learned_picture, matched
from rock2d_tracking.motion import Motion
from rock2d_tracking.sights import Sight

Array = np.ndarray
Shots = list[tuple[int, Array, Array]]  # number, picture, and place (2,) in px of frames with a block

FEWEST_SHOTS, MOST_SHOTS = 4, 24  # frames from which the looks of a block are learned
LEAST_OUTLINES, LEAST_EDGES = 0.6, 0.5  # share of them in which a kind of fit must work
LARGEST_BIAS_PX = 0.15  # between the places by outline and by edge
FEWEST_PAIRS_ON_ARC, SCATTER_GAIN = 6, 0.9  # of places by edge about an arc, over that of places by outline
SEEN_TO_START = 0.75  # share of the outline that must be seen where nothing else says that it is a block
SEEN_FOR_SIZE = 0.6  # share of the outline that must be seen to measure its size
LEAST_SIZE_CHANGE = 0.012  # of the outline; below it the size that is stated is the better one
LARGEST_SIZE_CHANGE = 0.5
LARGEST_SIZE_SPREAD = 0.08  # from frame to frame; a larger one is no outline
SIZE_ROUNDS, SIZE_CONVERGED = 5, 0.002
SMALLEST_PICTURE_ERROR_PX = 0.1  # standard error of a place that correlation found, at least


def shots_of(film: Iterable[Array], motion: Motion) -> Shots:
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


def learned_looks(fitter: Fitter, looks: Looks, shots: Shots, motion: Motion) -> Looks:
    """The looks of a block in its shots: size, and the kind of fit that works; `looks`: those that are stated."""
    sized, by_outline = _sized(fitter, looks, shots), _sights(fitter, looks, shots)
    if abs(sized.size - 1.0) < LEAST_SIZE_CHANGE and _share_seen(by_outline) >= LEAST_OUTLINES:
        looks = replace(looks, size=sized.size, size_error=sized.size_error)
    elif sized is not looks:
        looks, by_outline = sized, _sights(fitter, sized, shots)
    by_edge = _sights(fitter, replace(looks, kind="edge"), shots)
    if _share_seen(by_outline) >= LEAST_OUTLINES:
        better, apart = _better(by_edge, by_outline, motion)
        return replace(looks, kind="edge") if better else replace(looks, bias_px=apart)
    if _share_seen(by_edge) >= LEAST_EDGES:
        return replace(looks, kind="edge")
    still = fitter.background.grey
    pairs = [(image, place) for _, image, place in shots]
    picture = learned_picture(pairs, still, looks.outline.reach_px)
    if picture is None:
        return replace(looks, kind="edge")
    places = [matched(i.astype(np.float32), still, picture, p, looks.outline.reach_px) for i, p in pairs]
    off = [m[0] - p for m, (_, p) in zip(places, pairs, strict=True) if m is not None and m[1] > LEAST_MATCH]
    scatter = float(1.4826 * np.median(np.abs(off))) if len(off) >= FEWEST_SHOTS else 1.0
    return replace(looks, kind="picture", picture=picture, scatter_px=max(scatter, SMALLEST_PICTURE_ERROR_PX))


def _sights(fitter: Fitter, looks: Looks, shots: Shots) -> list[Sight]:
    return [fitter.fit_anywhere_turned(number, image, looks, place) for number, image, place in shots]


def _share_seen(sights: list[Sight]) -> float:
    return float(np.mean([not s.reason for s in sights]))


def _better(by_edge: list[Sight], by_outline: list[Sight], motion: Motion) -> tuple[bool, float | None]:
    """Whether the edge finds a block better than its outline with one grey; usual distance of both in px, None if
    the edge is hardly seen.

    If the block is of one grey, both agree; if not, the edge is right, because it assumes less. Where they agree,
    the one whose places scatter less about the arcs is better."""
    pairs = [
        (a.frame, *a.pose[:2], *b.pose[:2])
        for a, b in zip(by_outline, by_edge, strict=True)
        if not a.reason and not b.reason and b.confidence >= SEEN_TO_START
    ]
    if len(pairs) < FEWEST_SHOTS:
        return False, None
    table = np.array(pairs)
    apart = float(np.median(np.hypot(*(table[:, 1:3] - table[:, 3:]).T)))
    if len(pairs) < LEAST_OUTLINES * len(by_edge):
        return False, apart
    if apart > LARGEST_BIAS_PX:
        return True, apart
    squares, count = np.zeros(4), 0
    for arc in (a for c in motion.chains for a in c.arcs):
        own = table[(table[:, 0] >= arc.first) & (table[:, 0] <= arc.last)]
        if len(own) < FEWEST_PAIRS_ON_ARC:
            continue
        basis = np.linalg.qr(np.vander(own[:, 0] - own[:, 0].mean(), 3))[0]
        squares += ((own[:, 1:] - basis @ (basis.T @ own[:, 1:])) ** 2).sum(axis=0)
        count += len(own)
    return bool(count and squares[2:].sum() < SCATTER_GAIN**2 * squares[:2].sum()), apart


def _sized(fitter: Fitter, looks: Looks, shots: Shots) -> Looks:
    """The looks in the size that the edge shows; as they are if the edge is not seen well enough."""
    size, outline = 1.0, looks.outline
    turns = [start_angles(outline) for _ in shots]
    for _ in range(SIZE_ROUNDS):
        trial = replace(looks, outline=outline.scaled(size), edge=edge_points(outline.scaled(size)))
        sizes = []
        for k, (_, image, place) in enumerate(shots):
            fits = [
                fitter.edge_fit(image, trial, np.array([*place, turn]), free_size=True) for turn in turns[k]
            ]
            best = max((f for f in fits if f is not None), key=lambda f: f.seen, default=None)
            if best is not None and best.seen > SEEN_FOR_SIZE:
                sizes.append(best.size)
                turns[k] = best.pose[2:] if np.isfinite(best.pose[2]) else turns[k]
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
