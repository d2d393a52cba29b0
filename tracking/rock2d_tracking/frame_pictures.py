"""Small pictures of the frames of a film, cropped around the block, for a page."""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np

Array = np.ndarray

HALF_RADII, LEAST_HALF_PX = 3.0, 20  # half the side of a picture, in radii of the block, and its minimum
LARGEST_SIDE_PX = 160  # larger pictures are reduced
QUALITY = 75  # of WebP, 0 to 100
MOST_TRIED = 2500  # most pictures that are made to find how many fit
IMPORTANT_RATIO = 8  # important frames are shown this many times as often as others
STILL_WIDTH_PX = 720


class FramePictures(NamedTuple):
    """Pictures of some frames.

    Attributes
    ----------
    stride : every `stride`-th frame is shown, of those that are not important
    rows : (n,) of the table of frames
    boxes_px : (n, 4) left, top, width and height of each in the film
    images : WebP
    """

    stride: int
    rows: Array
    boxes_px: Array
    images: list[bytes]


def frame_pictures(
    film: Iterable[Array],
    numbers: Array,
    places_px: Array,
    radii_px: Array,
    important: Array,
    most_bytes: int,
) -> FramePictures:
    """Pictures of as many frames as fit into `most_bytes`.

    numbers : (n,) of each row in the film
    places_px : (n, 2) centres of the pictures
    radii_px : (n,) of the blocks
    important : (n,) which rows are preferred
    """
    stride = 1
    while shown_rows(important, stride).sum() > MOST_TRIED:
        stride *= 2
    wanted = np.flatnonzero(shown_rows(important, stride))
    made = _cut_out(film, wanted, numbers, places_px, radii_px)
    sizes = np.zeros(len(important))
    sizes[list(made)] = [len(image) for _, image in made.values()]
    while stride < len(important) and sizes[shown_rows(important, stride)].sum() > most_bytes:
        stride *= 2
    kept = [row for row in np.flatnonzero(shown_rows(important, stride)).tolist() if row in made]
    boxes = np.array([made[row][0] for row in kept]).reshape(-1, 4)
    return FramePictures(stride, np.array(kept, int), boxes, [made[row][1] for row in kept])


def shown_rows(important: Array, stride: int) -> Array:
    """(n,) which rows have a picture."""
    number = np.arange(len(important))
    return (number % stride == 0) | (important & (number % max(1, stride // IMPORTANT_RATIO) == 0))


def _cut_out(
    film: Iterable[Array], wanted: Array, numbers: Array, places_px: Array, radii_px: Array
) -> dict[int, tuple[Array, bytes]]:
    """Row -> its box and picture."""
    rows_of: dict[int, list[int]] = {}
    for row in wanted.tolist():
        rows_of.setdefault(int(numbers[row]), []).append(row)
    last, made = max(rows_of, default=-1), {}
    for number, frame in enumerate(film):
        for row in rows_of.get(number, ()):
            half = max(round(HALF_RADII * radii_px[row]), LEAST_HALF_PX)
            middle = np.round(places_px[row]).astype(int)
            low = np.clip(middle - half, 0, np.array(frame.shape[1::-1]) - 1)
            high = np.clip(middle + half + 1, low + 1, frame.shape[1::-1])
            part = frame[low[1] : high[1], low[0] : high[0]]
            made[row] = (np.concatenate([low, high - low]), webp(part, LARGEST_SIDE_PX))
        if number == last:
            break
    return made


def webp(picture: Array, largest_px: int) -> bytes:
    """A picture as WebP, reduced so that no side is longer than `largest_px`."""
    import cv2

    scale = min(1.0, largest_px / max(picture.shape[:2]))
    size = (max(1, round(picture.shape[1] * scale)), max(1, round(picture.shape[0] * scale)))
    if scale < 1.0:
        picture = cv2.resize(picture, size, interpolation=cv2.INTER_AREA)
    return bytes(cv2.imencode(".webp", np.ascontiguousarray(picture), [cv2.IMWRITE_WEBP_QUALITY, QUALITY])[1])
