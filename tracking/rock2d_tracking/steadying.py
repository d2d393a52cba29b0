"""The motion of a hand-held camera, read from the background, so that it can be taken out of a film."""

from __future__ import annotations

from collections.abc import Iterable
from itertools import islice

import numpy as np

Array = np.ndarray

WIDTH_PX = 640  # of the picture in which the background is compared, at most
TRIED_FRAMES = 40  # frames, evenly over the film, that tell whether the camera moves
MEDIAN_FRAMES = 21  # whose median is the still picture
# root mean square; a smaller motion, or what a person before the wall looks like, is left alone
LEAST_SHAKE_PX = 1.3
# how many times smaller the compared pictures are, one after the other, and steps at each
LEVELS, ROUNDS = (4, 1), 8
CONVERGED_PX = 0.005
BLUR_PX = 1.5  # of the compared pictures, so that slopes hold over a step
# difference in grey, over the usual one, at which a pixel counts half: something moves there
ROBUST_SIGMAS = 2.0


def camera_ways(film: Iterable[Array], expected_frames: int) -> Array | None:
    """(n, 2) way of the picture in px in each frame against the first one; None if the camera stands still.

    film : (height, width) or (height, width, 3) uint8, read once or twice
    expected_frames : about how many there are
    """
    tried = _ways(islice(film, 0, None, max(1, expected_frames // TRIED_FRAMES)))
    if not len(tried) or np.sqrt(tried.var(axis=0).sum()) < LEAST_SHAKE_PX:
        return None
    ways = _ways(film)
    # what moves before the background in the first frame is not in the median
    still = _median(film, ways, max(1, len(ways) // MEDIAN_FRAMES))
    better = _ways(film, still)
    return better - better[:1]


def _median(film: Iterable[Array], ways: Array, stride: int) -> Array:
    """Median of every `stride`-th frame, moved back."""
    chosen = [
        steadied(frame, way)
        for k, (frame, way) in enumerate(zip(film, ways, strict=False)) if k % stride == 0
    ]  # fmt: skip
    return np.median(np.stack(chosen), axis=0).astype(np.uint8)


def steadied(frame: Array, way_px: Array) -> Array:
    """A frame moved back by a way (2,) in px; its borders are continued."""
    import cv2

    back = np.array([[1.0, 0.0, -way_px[0]], [0.0, 1.0, -way_px[1]]])
    size_px = (frame.shape[1], frame.shape[0])
    moved = cv2.warpAffine(frame, back, size_px, flags=cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE)
    return np.asarray(moved)


def _ways(film: Iterable[Array], still: Array | None = None) -> Array:
    """(n, 2) way of the picture in px in each of some frames against a still picture, or the first of them.

    At each level the way is the least-squares translation (Lucas and Kanade 1981), with weights that leave out what
    moves before the background.
    """
    ways: list[Array] = []
    first: list[Array] = []
    for frame in film:
        scale = max(1.0, frame.shape[1] / WIDTH_PX)
        pictures = [_small(frame, scale * level) for level in LEVELS]
        if not first:
            first = pictures if still is None else [_small(still, scale * level) for level in LEVELS]
        way = ways[-1] / scale if ways else np.zeros(2)
        for level, one, other in zip(LEVELS, first, pictures, strict=True):
            way = level * _translation(one, other, way / level)
        ways.append(way * scale)
    return np.array(ways).reshape(-1, 2)


def _translation(one: Array, other: Array, way: Array) -> Array:
    """(2,) way of a picture against another one, from a first guess."""
    du, dv = np.gradient(one, axis=1), np.gradient(one, axis=0)
    margin = np.s_[2:-2, 2:-2]
    slopes = np.stack([du[margin].ravel(), dv[margin].ravel()])
    for _ in range(ROUNDS):
        off = (steadied(other, way) - one)[margin].ravel()
        usual = max(1.4826 * float(np.median(np.abs(off))), 0.1)
        weight = 1.0 / (1.0 + (off / (ROBUST_SIGMAS * usual)) ** 2)
        weighted = slopes * weight
        step = np.linalg.lstsq(weighted @ slopes.T, -(weighted @ off), rcond=1e-9)[0]
        way = way + np.clip(step, -2.0, 2.0)
        if np.hypot(*step) < CONVERGED_PX:
            break
    return np.asarray(way)


def _small(frame: Array, scale: float) -> Array:
    """A grey, smooth picture with pixels `scale` times as wide, float32."""
    import cv2

    grey = frame if frame.ndim == 2 else cv2.cvtColor(frame, cv2.COLOR_BGR2GRAY)
    if scale > 1.0:
        size_px = (round(grey.shape[1] / scale), round(grey.shape[0] / scale))
        grey = np.asarray(cv2.resize(grey, size_px, interpolation=cv2.INTER_AREA))
    return np.asarray(cv2.GaussianBlur(grey.astype(np.float32), (0, 0), BLUR_PX))
