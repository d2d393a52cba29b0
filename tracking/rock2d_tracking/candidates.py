"""Candidates: regions of a frame that differ from the background, blocks or other things."""

import numpy as np

from rock2d.arrays import Array

# A candidate: its frame; centroid (u, v) and area in the film's pixels; mean change of its colours in grey levels, all
# equal in a grey film; whether it does not touch the edges of the picture, and whether it only darkens the background.
CANDIDATE = np.dtype([
    ("frame", np.int64), ("place_px", float, 2), ("area_px2", float), ("change", float, 3), ("whole", bool),
    ("shadow", bool),
])  # fmt: skip
CHUNK_SAMPLES = 41  # the background is the median of this many pictures
MOVING_SIGMAS, LEAST_CHANGE_GREY = 6.0, 3.0  # by which a pixel that moves differs, in noise and grey levels
LEAST_AREA_PX = 6  # area of a candidate in the coarse picture
LARGEST_AREA_SHARE = 0.2  # area of a candidate, as a share of the picture
MOST_CANDIDATES = 30  # per frame
CORE_SHARE = 0.45  # share of a strong change: the weaker rim of a candidate is blur and shadow
# quantiles of a candidate's changes that count as strong: the first cuts shadows off, the second keeps round highlights
STRONG_QUANTILES = (0.9, 0.6)
SAME_PX, SAME_AREA = 1.5, 1.25  # distance in coarse pixels and ratio of areas below which two cores are one
SHADOW_RATIOS = (0.4, 0.985)  # ratio of the light in a shadow to that of the ground without it ...
SHADOW_COLOURS, SHADOW_SPREAD = 0.06, 0.15  # ... alike in all colours, and from pixel to pixel


def shrunk(picture: Array, coarse: int) -> Array:
    """A picture with pixels `coarse` times as wide; incomplete pixels at the right and lower edge are cut off."""
    import cv2

    if coarse == 1:
        return picture
    width, height = picture.shape[1] // coarse, picture.shape[0] // coarse
    whole = picture[: height * coarse, : width * coarse]
    return np.asarray(cv2.resize(whole, (width, height), interpolation=cv2.INTER_AREA))


def candidates_of(pictures: list[Array], first: int, coarse: int) -> list[Array]:
    """(n,) CANDIDATE of each picture, which is `coarse` times smaller than a frame; `first`: number of the first."""
    import cv2

    chosen = np.unique(np.linspace(0, len(pictures) - 1, min(len(pictures), CHUNK_SAMPLES)).round().astype(int))
    stack = np.stack([pictures[i] for i in chosen])
    still = np.median(stack, axis=0).astype(np.uint8)
    limit = _limit(stack)
    found = []
    for i, picture in enumerate(pictures):
        off = np.asarray(cv2.absdiff(picture, still))
        mask: Array = (cv2.subtract(off, limit) > 0).astype(np.uint8)
        if mask.ndim == 3:
            mask, off = mask.max(axis=2), off.max(axis=2)
        # single pixels are noise; holes come from parts with the grey of the background
        mask = np.asarray(cv2.morphologyEx(mask, cv2.MORPH_CLOSE, np.ones((3, 3), np.uint8)))
        mask = np.asarray(cv2.morphologyEx(mask, cv2.MORPH_OPEN, np.ones((2, 2), np.uint8)))
        found.append(_components(mask, off, (picture, still), first + i, coarse))
    return found


def _limit(stack: Array) -> Array:
    """The least change of each pixel that counts as motion, from its own noise, so that flicker does not count."""
    steps = np.abs(np.diff(stack.astype(np.int16), axis=0)) if len(stack) > 1 else np.zeros_like(stack[:1])
    own = np.median(steps, axis=0) / (0.6745 * np.sqrt(2.0))
    level = np.mean(own)
    return np.clip(MOVING_SIGMAS * np.maximum(own, level), LEAST_CHANGE_GREY, 250).astype(np.uint8)


def _components(mask: Array, off: Array, pair: tuple[Array, Array], frame: int, coarse: int) -> Array:
    """(n,) CANDIDATE: cores of changed regions. A block and its shadow, or a hand, may touch; their cores do not.

    off : change of each pixel; pair : picture and background"""
    import cv2

    count, labels = cv2.connectedComponents(mask)
    found = np.empty(0, CANDIDATE)
    if count == 1:
        return found
    inside = np.flatnonzero(labels)
    own, change = labels.ravel()[inside], off.ravel()[inside]
    order = np.lexsort((change, own))
    ends = np.searchsorted(own[order], np.arange(1, count + 1))
    for quantile in STRONG_QUANTILES:
        strong = np.zeros(count)
        strong[1:] = change[order][(ends[:-1] + quantile * (np.diff(ends) - 1)).astype(int)]
        core = (off > CORE_SHARE * strong[labels]) & (mask > 0)
        for own in _cores(core.astype(np.uint8), pair, frame, coarse):
            same = np.abs(found["place_px"] - own["place_px"]).max(axis=1) < SAME_PX * coarse
            ratio = found["area_px2"] / own["area_px2"]
            if not (same & (ratio > 1 / SAME_AREA) & (ratio < SAME_AREA)).any():
                found = np.append(found, own)
    # those with the largest area and change; the others are flicker
    order = np.argsort(-found["area_px2"] * np.abs(found["change"]).max(axis=1), kind="stable")
    return found[order[:MOST_CANDIDATES]]


def _cores(core: Array, pair: tuple[Array, Array], frame: int, coarse: int) -> Array:
    import cv2

    _, labels, stats, centres = cv2.connectedComponentsWithStats(core, connectivity=4)
    height, width = core.shape
    order = 1 + np.argsort(-stats[1:, cv2.CC_STAT_AREA], kind="stable")[: 2 * MOST_CANDIDATES]
    found = []
    for k in order.tolist():
        left, top, wide, high, area = stats[k].tolist()
        if area < LEAST_AREA_PX or area > LARGEST_AREA_SHARE * core.size:
            continue
        box = np.s_[top : top + high, left : left + wide]
        within = labels[box] == k
        now, before = (a[box][within].reshape(area, -1).astype(float) for a in pair)
        change = np.broadcast_to((now - before).mean(axis=0), 3)
        whole = left > 0 and top > 0 and left + wide < width and top + high < height
        place = (centres[k] + 0.5) * coarse - 0.5
        found.append((frame, place, area * coarse**2, change, whole, _is_shadow(now, before)))
    return np.array(found, CANDIDATE)


def _is_shadow(now: Array, before: Array) -> bool:
    """Whether pixels `now` (n, colours) are those of the background `before`, darker by about the same factor in every
    colour."""
    ratio = (now + 2.0) / (before + 2.0)
    middle = np.median(ratio, axis=0)
    return bool(
        SHADOW_RATIOS[0] < middle.min() and middle.max() < SHADOW_RATIOS[1]
        and np.ptp(middle) < SHADOW_COLOURS and ratio.mean(axis=1).std() < SHADOW_SPREAD
    )  # fmt: skip
