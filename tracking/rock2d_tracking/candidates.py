"""Candidates: regions of a frame that differ from the background, blocks or other things."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

Array = np.ndarray

CHUNK_SAMPLES = 41  # the background is the median of this many pictures
CHANGED_SIGMAS, LEAST_CHANGE_GREY = 6.0, 3.0  # by which a pixel that moves differs, in noise and grey levels
LEAST_AREA_PX = 6  # area of a candidate in the coarse picture
LARGEST_AREA_SHARE = 0.2  # area of a candidate, as a share of the picture
MOST_CANDIDATES = 30  # per frame
CORE_SHARE = 0.45  # share of a strong change: the weaker rim of a candidate is blur and shadow
# quantiles of a candidate's changes that count as strong: the first cuts shadows off, the second keeps round highlights
STRONG_QUANTILES = (0.9, 0.6)
SAME_PX, SAME_AREA = 1.5, 1.25  # distance in coarse pixels and ratio of areas below which two cores are one
SHADOW_RATIOS = (0.4, 0.985)  # ratio of the light in a shadow to that of the ground without it ...
SHADOW_COLOURS, SHADOW_SPREAD = 0.06, 0.15  # ... alike in all colours, and from pixel to pixel


class Candidate(NamedTuple):
    """A region of one frame that differs from the background.

    Attributes
    ----------
    u_px, v_px : its centroid in the film's pixels
    area_px2 : its area in the film's pixels
    whole : whether it does not touch the edges of the picture
    change : (3,) mean change of its colours, in grey levels; all equal in a grey film
    shadow : whether it only darkens the background
    """

    frame: int
    u_px: float
    v_px: float
    area_px2: float
    whole: bool
    change: tuple[float, float, float]
    shadow: bool


def shrunk(picture: Array, coarse: int) -> Array:
    """A picture with pixels `coarse` times as wide; incomplete pixels at the right and lower edge are cut off."""
    import cv2

    if coarse == 1:
        return picture
    width, height = picture.shape[1] // coarse, picture.shape[0] // coarse
    whole = picture[: height * coarse, : width * coarse]
    return np.asarray(cv2.resize(whole, (width, height), interpolation=cv2.INTER_AREA))


def candidates_of(pictures: list[Array], first: int, coarse: int) -> list[list[Candidate]]:
    """Candidates of each picture, which are `coarse` times smaller than the film's; `first`: number of the first."""
    import cv2

    chosen = np.unique(
        np.linspace(0, len(pictures) - 1, min(len(pictures), CHUNK_SAMPLES)).round().astype(int)
    )
    stack = np.stack([pictures[i] for i in chosen])
    still = np.median(stack, axis=0).astype(np.uint8)
    limit = _limit(stack, still)
    found = []
    for i, picture in enumerate(pictures):
        off = cv2.absdiff(picture, still)
        mask: Array = (cv2.subtract(off, limit) > 0).astype(np.uint8)
        if mask.ndim == 3:
            mask = mask.max(axis=2)
        # single pixels are noise; holes come from parts with the grey of the background
        mask = np.asarray(cv2.morphologyEx(mask, cv2.MORPH_CLOSE, np.ones((3, 3), np.uint8)))
        mask = np.asarray(cv2.morphologyEx(mask, cv2.MORPH_OPEN, np.ones((2, 2), np.uint8)))
        found.append(_components(mask, picture, still, first + i, coarse))
    return found


def _limit(stack: Array, still: Array) -> Array:
    """The least change of each pixel that counts as motion, from its own noise, so that flicker does not count."""
    steps = np.abs(np.diff(stack.astype(np.int16), axis=0)) if len(stack) > 1 else np.zeros_like(stack[:1])
    own = np.median(steps, axis=0) / (0.6745 * np.sqrt(2.0))
    level = np.mean(own)
    return np.clip(CHANGED_SIGMAS * np.maximum(own, level), LEAST_CHANGE_GREY, 250).astype(np.uint8)


def _components(mask: Array, picture: Array, still: Array, frame: int, coarse: int) -> list[Candidate]:
    """The cores of changed regions. A block and its shadow, or a hand, may touch, but their cores do not."""
    import cv2

    count, labels = cv2.connectedComponents(mask)
    if count == 1:
        return []
    apart = np.asarray(cv2.absdiff(picture, still))
    off: Array = apart.max(axis=2) if apart.ndim == 3 else apart
    inside = np.flatnonzero(labels)
    own, change = labels.ravel()[inside], off.ravel()[inside]
    order = np.lexsort((change, own))
    ends = np.searchsorted(own[order], np.arange(1, count + 1))
    found: list[Candidate] = []
    for quantile in STRONG_QUANTILES:
        strong = np.zeros(count)
        strong[1:] = change[order][(ends[:-1] + quantile * (np.diff(ends) - 1)).astype(int)]
        core = (off > CORE_SHARE * strong[labels]) & (mask > 0)
        for c in _cores(core.astype(np.uint8), picture, still, frame, coarse):
            same = (o for o in found if max(abs(o.u_px - c.u_px), abs(o.v_px - c.v_px)) < SAME_PX * coarse)
            if not any(1 / SAME_AREA < o.area_px2 / c.area_px2 < SAME_AREA for o in same):
                found.append(c)
    # those with the largest area and change; the others are flicker
    found.sort(key=lambda c: -c.area_px2 * max(map(abs, c.change)))
    return found[:MOST_CANDIDATES]


def _cores(core: Array, picture: Array, still: Array, frame: int, coarse: int) -> list[Candidate]:
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
        now, before = (a[box][within].reshape(area, -1).astype(float) for a in (picture, still))
        change = np.broadcast_to((now - before).mean(axis=0), 3)
        whole = left > 0 and top > 0 and left + wide < width and top + high < height
        u, v = (centres[k] + 0.5) * coarse - 0.5
        found.append(Candidate(
            frame, float(u), float(v), float(area * coarse**2), whole,
            (float(change[0]), float(change[1]), float(change[2])), _is_shadow(now, before),
        ))  # fmt: skip
    return found


def _is_shadow(now: Array, before: Array) -> bool:
    """Whether pixels `now` (n, colours) are those of the background `before`, darker by about the same factor in every
    colour."""
    ratio = (now + 2.0) / (before + 2.0)
    middle = np.median(ratio, axis=0)
    return bool(
        SHADOW_RATIOS[0] < middle.min() and middle.max() < SHADOW_RATIOS[1]
        and np.ptp(middle) < SHADOW_COLOURS and ratio.mean(axis=1).std() < SHADOW_SPREAD
    )  # fmt: skip
