"""The effects of a wide-angle lens and a hand-held camera on a picture."""

from __future__ import annotations

import numpy as np

Array = np.ndarray

SWINGS = np.array([1.0, 1.7, 3.0, 6.0])  # periods of the motion of a hand, over the shortest
LENS_ROUNDS = 6  # iterations that invert a weak distortion


def hand_shake(seed: int, shake_px: float, shortest_frames: float, frames: Array) -> Array:
    """(n, 2) displacement of the picture in px at the frames (n,) from frame 0: slow oscillations, `shake_px` root mean
    square along each axis."""
    rng = np.random.default_rng(np.random.SeedSequence([seed, 2]))
    way = np.zeros((len(frames), 2))
    for period in SWINGS:
        begin = rng.uniform(0, 2 * np.pi, 2)
        swing = np.sin(2 * np.pi * frames[:, None] / (shortest_frames * period) + begin) - np.sin(begin)
        way += shake_px * swing * np.sqrt(2.0 / (SWINGS**2).sum()) * period
    return way


def through_lens(places: Array, lens: float, size_px: tuple[int, int]) -> Array:
    """(..., 2) places after distortion by a lens; `lens`: relative shift toward the centre of a point half a picture
    width away from it."""
    middle = 0.5 * (np.array(size_px) - 1.0)
    off = np.asarray(places) - middle
    return np.asarray(middle + off * (1.0 - lens * ((off / middle[0]) ** 2).sum(axis=-1, keepdims=True)))


def through_camera(light: Array, lens: float, way_px: Array) -> Array:
    """The light (height, width, 3) seen through a lens by a camera that moves the picture by `way_px` (2,)."""
    import cv2

    size_px = (light.shape[1], light.shape[0])
    if lens:
        v, u = np.mgrid[: size_px[1], : size_px[0]]
        seen = np.stack([u, v], axis=-1).astype(float)
        even = seen
        for _ in range(LENS_ROUNDS):
            even = even + seen - through_lens(even, lens, size_px)
        u32, v32 = (np.ascontiguousarray(even[..., k], np.float32) for k in range(2))
        light = cv2.remap(light, u32, v32, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    if way_px.any():
        moved = np.array([[1.0, 0.0, way_px[0]], [0.0, 1.0, way_px[1]]])
        light = cv2.warpAffine(light, moved, size_px, flags=cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    return light
