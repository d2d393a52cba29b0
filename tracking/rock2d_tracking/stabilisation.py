"""The motion of a hand-held camera, measured on the background and removed from a film."""

from collections.abc import Iterable
from itertools import islice

import numpy as np

from rock2d.arrays import Array
from rock2d.statistics import MAD_TO_SD

COMPARED_WIDTH_PX = 640  # of the picture in which the background is compared, at most
TRIED_FRAMES = 40  # frames, evenly distributed over the film, that show whether the camera moves
MEDIAN_FRAMES = 21  # the still picture is the median of this many frames
# root mean square; a smaller motion is not removed (a person in front of the wall can cause it)
LEAST_SHAKE_PX = 1.3
# factors by which the compared pictures are reduced, in this order, and steps at each
LEVELS, TRANSLATION_ROUNDS = (4, 1), 8
CONVERGED_PX = 0.005
BLUR_PX = 1.5  # of the compared pictures, so that slopes hold over a step
# difference in grey, over the usual one, at which a pixel has half its weight
ROBUST_SIGMAS = 2.0


def camera_shifts(film: Iterable[Array], expected_frames: int) -> Array | None:
    """(n, 2) displacement of each picture from the first one in px; None if the camera does not move.

    film : (height, width) or (height, width, 3) uint8, read once or twice
    expected_frames : approximate number of frames"""
    tried = _shifts(islice(film, 0, None, max(1, expected_frames // TRIED_FRAMES)))
    if not len(tried) or np.sqrt(tried.var(axis=0).sum()) < LEAST_SHAKE_PX:
        return None
    shifts = _shifts(film)
    # moving objects in the first frame are not in the median
    still = _median(film, shifts, max(1, len(shifts) // MEDIAN_FRAMES))
    better = _shifts(film, still)
    return better - better[:1]


def _median(film: Iterable[Array], shifts: Array, stride: int) -> Array:
    """Median of every `stride`-th frame, moved back."""
    chosen = [stabilised(*pair) for pair in islice(zip(film, shifts, strict=False), 0, None, stride)]
    return np.median(np.stack(chosen), axis=0).astype(np.uint8)


def stabilised(frame: Array, shift_px: Array) -> Array:
    """A frame shifted back by a displacement (2,) in px; its border pixels are repeated."""
    import cv2

    back = np.array([[1.0, 0.0, -shift_px[0]], [0.0, 1.0, -shift_px[1]]])
    size_px = (frame.shape[1], frame.shape[0])
    moved = cv2.warpAffine(frame, back, size_px, flags=cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE)
    return np.asarray(moved)


def _shifts(film: Iterable[Array], still: Array | None = None) -> Array:
    """(n, 2) displacement in px of each frame from a still picture, or from the first frame.

    At each level it is the least-squares translation (Lucas and Kanade 1981); moving objects have little weight."""
    shifts: list[Array] = []
    first: list[Array] = []
    for frame in film:
        scale = max(1.0, frame.shape[1] / COMPARED_WIDTH_PX)
        pictures = [_small(frame, scale * level) for level in LEVELS]
        if not first:
            first = pictures if still is None else [_small(still, scale * level) for level in LEVELS]
        shift = shifts[-1] / scale if shifts else np.zeros(2)
        for level, one, other in zip(LEVELS, first, pictures, strict=True):
            shift = level * _translation(one, other, shift / level)
        shifts.append(shift * scale)
    return np.array(shifts).reshape(-1, 2)


def _translation(one: Array, other: Array, shift: Array) -> Array:
    """(2,) displacement between two pictures, from a first guess."""
    du, dv = np.gradient(one, axis=1), np.gradient(one, axis=0)
    margin = np.s_[2:-2, 2:-2]
    slopes = np.stack([du[margin].ravel(), dv[margin].ravel()])
    for _ in range(TRANSLATION_ROUNDS):
        off = (stabilised(other, shift) - one)[margin].ravel()
        usual = max(MAD_TO_SD * float(np.median(np.abs(off))), 0.1)
        weight = 1.0 / (1.0 + (off / (ROBUST_SIGMAS * usual)) ** 2)
        weighted = slopes * weight
        step = np.linalg.lstsq(weighted @ slopes.T, -(weighted @ off), rcond=1e-9)[0]
        shift = shift + np.clip(step, -2.0, 2.0)
        if np.hypot(*step) < CONVERGED_PX:
            break
    return np.asarray(shift)


def _small(frame: Array, scale: float) -> Array:
    """A grey, smoothed picture, reduced, float32."""
    import cv2

    grey = frame if frame.ndim == 2 else cv2.cvtColor(frame, cv2.COLOR_BGR2GRAY)
    if scale > 1.0:
        size_px = (round(grey.shape[1] / scale), round(grey.shape[0] / scale))
        grey = np.asarray(cv2.resize(grey, size_px, interpolation=cv2.INTER_AREA))
    return np.asarray(cv2.GaussianBlur(grey.astype(np.float32), (0, 0), BLUR_PX))
