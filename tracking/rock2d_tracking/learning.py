"""Learning the looks of the blocks of a film, from frames in which arcs give their places."""

from collections.abc import Iterable
from dataclasses import replace
from itertools import islice

import numpy as np

from rock2d.arrays import Array
from rock2d.statistics import MAD_TO_SD
from rock2d_tracking.edges import JACKKNIFE_PARTS, EdgeFit, jackknife_variance
from rock2d_tracking.fitting import SURE_FIT, TRUSTED_OVER_SEEN, Fitter, start_angles
from rock2d_tracking.looks import BlockFrame, Looks, learned_picture
from rock2d_tracking.motion import Motion
from rock2d_tracking.sights import Sight

FEWEST_BLOCK_FRAMES, MOST_BLOCK_FRAMES = 4, 24  # frames from which the looks of a block are learned
LEAST_OUTLINES, LEAST_EDGES = 0.6, 0.5  # share of them in which a kind of fit must work
LARGEST_BIAS_PX = 0.15  # between the places by outline and by edge
FEWEST_PAIRS_ON_ARC, SCATTER_GAIN = 6, 0.9  # pairs on an arc; ratio of scatter by edge to that by outline
SEEN_TO_START = 0.75  # least visible share of the outline without other evidence of a block
SEEN_FOR_SIZE = 0.6  # share of the outline that must be seen to measure its size
LEAST_SIZE_CHANGE = 0.012  # relative change of the outline's size below which the stated size is better
LARGEST_SIZE_CHANGE = 0.25
LARGEST_SIZE_SPREAD = 0.08  # from frame to frame; with a larger one the fit is not the outline
FAST_RADII = 0.4  # displacement per frame above which a block may smear, in radii
SHUTTERS = (0.0, 0.25, 0.5, 0.75, 1.0)  # open shares of the frame interval that are tried
SAME_SHARE = 0.02  # visible shares of the outline that differ less are equal
SIZE_ROUNDS, SIZE_CONVERGED = 5, 0.002
WIDE_PICTURE = 1.5  # width of a learned picture that shows the block's edge, in units of the usual width
UNKNOWN_CENTRE = 0.2  # 1 sigma of the centre of a picture without an edge, over the reach of the block
CENTRE_STEP_PX = 0.25  # spacing of the places that are tried


def frames_with_blocks(film: Iterable[Array], motion: Motion) -> list[BlockFrame]:
    """Some frames of each release in which the block is on its arc."""
    if not motion.chains:
        return []
    wanted: set[int] = set()
    for chain in motion.chains:
        own = np.concatenate([a.frames for a in chain.arcs])
        count = min(len(own), max(FEWEST_BLOCK_FRAMES, MOST_BLOCK_FRAMES // len(motion.chains)))
        wanted |= set(own[np.linspace(0, len(own) - 1, count).round().astype(int)].tolist())
    found = []
    for number, frame in enumerate(islice(film, max(wanted) + 1)):
        own_chain = motion.chain_at(number) if number in wanted else None
        place = own_chain.at(number) if own_chain is not None else None
        if own_chain is not None and place is not None:
            found.append(BlockFrame(number, frame, place, own_chain.pace(number)))
    return found


def learned_looks(fitter: Fitter, looks: Looks, block_frames: list[BlockFrame], motion: Motion) -> Looks:
    """The looks of a block with the size and the kind of fit from its frames; `looks`: those of the set-up."""
    looks = replace(looks, shutter=_shutter(fitter, looks, block_frames))
    sized, turns = _fit_size(fitter, looks, block_frames)

    def sights(own: Looks) -> list[Sight]:
        found = []
        for frame, starts in zip(block_frames, turns, strict=True):
            fitter.pace_px = frame.pace
            found.append(fitter.fit_any_angle(frame.number, frame.picture, own, frame.place, turns=starts))
        return found

    by_outline = sights(looks)
    trusted = TRUSTED_OVER_SEEN * fitter.least_seen
    if abs(sized.size - 1.0) < LEAST_SIZE_CHANGE and _share_seen(by_outline, trusted) >= LEAST_OUTLINES:
        looks = replace(looks, size=sized.size, size_error=sized.size_error)
    elif sized is not looks:
        looks, by_outline = sized, sights(sized)
    by_edge = sights(replace(looks, kind="edge"))
    smeared = looks.shutter > 0.0 and _share_seen(by_edge) > _share_seen(by_outline, trusted)
    if _share_seen(by_outline, trusted) >= LEAST_OUTLINES and not smeared:
        better, apart = _edge_is_better(by_edge, by_outline, motion)
        return replace(looks, kind="edge") if better else replace(looks, bias_px=apart or 0.0)
    if _share_seen(by_edge) >= LEAST_EDGES:
        return replace(looks, kind="edge")
    picture = learned_picture(block_frames, fitter.background.grey, looks.outline.reach_px)
    if picture is None:
        return replace(looks, kind="edge")
    centre, error = _centre_of_picture(fitter, looks, block_frames)
    return replace(looks, kind="picture", picture=picture, centre_px=centre, bias_px=error)


def _centre_of_picture(
    fitter: Fitter, looks: Looks, block_frames: list[BlockFrame]
) -> tuple[tuple[float, float], float]:
    """Vector from the middle of a learned picture to the centroid in px, and the standard error of a coordinate.

    Arcs pass through the centres of changed regions, which highlights and shadows shift. The centroid is where
    the picture changes most across the outline; an edge that is too faint in one frame is visible in the median of
    many. The error is that of a delete-a-group jackknife over parts of the outline."""
    import cv2

    reach = looks.outline.reach_px
    wide = learned_picture(block_frames, fitter.background.grey, WIDE_PICTURE * reach)
    if wide is None:
        return (0.0, 0.0), UNKNOWN_CENTRE * reach
    steps = np.arange(-2 * UNKNOWN_CENTRE * reach, 2 * UNKNOWN_CENTRE * reach, CENTRE_STEP_PX)
    du, dv = np.meshgrid(steps, steps)
    slopes = [cv2.Sobel(wide, cv2.CV_32F, *order) for order in ((1, 0), (0, 1))]
    part = np.arange(len(looks.edge.points)) * JACKKNIFE_PARTS // len(looks.edge.points)
    found: list[tuple[float, Array]] = []
    for turn in start_angles(looks.outline):
        c, s = np.cos(turn), np.sin(turn)
        turned, normals = (a @ np.array([[c, s], [-s, c]]) for a in (looks.edge.points, looks.edge.normals))
        u, v = (
            (wide.shape[0] // 2 + turned[:, k, None] + d.ravel()).astype(np.float32) for k, d in enumerate((du, dv))
        )
        across = sum(cv2.remap(own, u, v, cv2.INTER_LINEAR) * normals[:, k, None] for k, own in enumerate(slopes))
        change = np.array([np.abs(across[part == k]).sum(axis=0) for k in range(JACKKNIFE_PARTS)])
        # with all parts, and without each
        best = (change.sum(axis=0) - np.vstack([np.zeros_like(change[:1]), change])).argmax(axis=1)
        found.append((change.sum(axis=0).max(), np.column_stack([du.ravel()[best], dv.ravel()[best]])))
    _, places = max(found, key=lambda own: own[0])
    error_px = np.sqrt(jackknife_variance(places[1:]).max())
    return (float(places[0, 0]), float(places[0, 1])), float(np.hypot(error_px, CENTRE_STEP_PX))


def _shutter(fitter: Fitter, looks: Looks, block_frames: list[BlockFrame]) -> float:
    """The shortest open share of the frame interval with which smeared edges are seen as well as with any other."""
    fast = [f for f in block_frames if np.hypot(*f.pace) > FAST_RADII * looks.edge.inner_px]
    if len(fast) < FEWEST_BLOCK_FRAMES or looks.outline.symmetry_rad != 0.0:
        return 0.0
    seen = []
    for shutter in SHUTTERS:
        own = replace(looks, shutter=shutter)
        shares = []
        for frame in fast:
            fitter.pace_px = frame.pace
            found = fitter.edge_fit(frame.picture, own, np.array([*frame.place, 0.0]), free_size=True)
            shares.append(0.0 if found is None else found.seen)
        seen.append(float(np.mean(shares)))
    return next(s for s, share in zip(SHUTTERS, seen, strict=True) if share > max(seen) - SAME_SHARE)


def _share_seen(sights: list[Sight], least: float = 0.0) -> float:
    return float(np.mean([not s.reason and s.confidence >= least for s in sights]))


def _edge_is_better(by_edge: list[Sight], by_outline: list[Sight], motion: Motion) -> tuple[bool, float | None]:
    """Whether the edge fit is better than the outline fit with one grey value; median distance of both in px, None if
    the edge is hardly visible.

    For a uniform block both agree; otherwise the edge is right, because it assumes less. If they agree, the one with
    less scatter about the arcs is better."""
    pairs = [
        (a.frame, *a.pose[:2], *b.pose[:2])
        for a, b in zip(by_outline, by_edge, strict=True)
        if not a.reason and not b.reason and b.confidence >= SEEN_TO_START
    ]
    if len(pairs) < FEWEST_BLOCK_FRAMES:
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
        when = motion.clock(own[:, 0])
        basis = np.linalg.qr(np.vander(when - when.mean(), 3))[0]
        squares += ((own[:, 1:] - basis @ (basis.T @ own[:, 1:])) ** 2).sum(axis=0)
        count += len(own)
    return bool(count and squares[2:].sum() < SCATTER_GAIN**2 * squares[:2].sum()), apart


def _fit_size(fitter: Fitter, looks: Looks, block_frames: list[BlockFrame]) -> tuple[Looks, list[Array]]:
    """The looks with the size fitted to the edge (unchanged if the edge is not visible enough), and the start angles of
    each frame, one if its edge was found."""
    size, outline = 1.0, looks.outline
    turns = [start_angles(outline) for _ in block_frames]
    for _ in range(SIZE_ROUNDS):
        trial = replace(looks, outline=outline.scaled(size))
        sizes = []
        for k, frame in enumerate(block_frames):
            best: EdgeFit | None = None
            fitter.pace_px = frame.pace
            for turn in turns[k]:
                found = fitter.edge_fit(frame.picture, trial, np.array([*frame.place, turn]), free_size=True)
                if found is not None and (best is None or found.seen > best.seen):
                    best = found
                if best is not None and best.seen > SURE_FIT:
                    break
            if best is not None and best.seen > SEEN_FOR_SIZE:
                sizes.append(best.size)
                turns[k] = best.pose[2:] if np.isfinite(best.pose[2]) else turns[k]
        if len(sizes) < FEWEST_BLOCK_FRAMES:
            return looks, turns
        change = float(np.median(sizes))
        spread = float(MAD_TO_SD * np.median(np.abs(np.array(sizes) - change)))
        size *= change
        if abs(size - 1.0) > LARGEST_SIZE_CHANGE or spread > LARGEST_SIZE_SPREAD:
            return looks, turns
        if abs(change - 1.0) < SIZE_CONVERGED:
            break
    error = 1.25 * spread / np.sqrt(len(sizes))
    outline = outline.scaled(size)
    return replace(looks, outline=outline, size=size, size_error=error), turns
