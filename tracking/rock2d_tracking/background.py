"""The background: the picture without a block, from the first frames and updated outside the block."""

from collections.abc import Sequence

import numpy as np

from rock2d.arrays import Array
from rock2d_tracking.candidates import shrunk

LEARNING_RATE = 0.02  # weight of a frame in the background
LEARNING_INTERVAL = 4  # one frame of this many is used, with a larger weight
# difference of a pixel that has changed, in noise and in grey levels
CHANGED_SIGMAS, CHANGED_GREY = 5.0, 6.0
CHANGED_LEARNING_SHARE = 0.05  # share of the learning rate for changed pixels
BACKGROUND_SAMPLES = 25  # frames whose median it starts from


class Background:
    """The still picture and the noise of its pixels.

    Attributes
    ----------
    grey : (height, width) float32
    noise : grey levels, 1 sigma of a pixel from frame to frame"""

    def __init__(self, frames: Sequence[Array]) -> None:
        """Median of the frames (height, width) uint8; moving objects do not appear in it."""
        chosen = np.linspace(0, len(frames) - 1, min(len(frames), BACKGROUND_SAMPLES)).round().astype(int)
        stack = np.stack([frames[i] for i in np.unique(chosen)])
        self.grey = np.median(stack, axis=0).astype(np.float32)
        if len(stack) > 2:
            steps = np.abs(np.diff(stack[:, ::4, ::4].astype(np.float32), axis=0))
            self.noise = max(float(np.mean(steps)) * np.sqrt(np.pi) / 2.0, 0.5)
        else:
            self.noise = 2.0
        self._count = 0
        self._bytes: Array | None = None
        self._coarse: dict[int, Array] = {}

    def differs(self, frame: Array, threshold: float, coarse: int) -> Array:
        """Mask of the pixels that differ from the background by more than `threshold` grey levels; its pixels are
        `coarse` times as wide as those of the frame."""
        import cv2

        if coarse not in self._coarse:
            self._coarse[coarse] = shrunk(self._byte(), coarse)
        apart = cv2.absdiff(shrunk(frame, coarse), self._coarse[coarse])
        return cv2.threshold(apart, threshold, 255, cv2.THRESH_BINARY)[1]

    def learn(self, frame: Array, block: tuple[int, int, int, int] | None) -> None:
        """Update the background with every LEARNING_INTERVAL-th frame, but not within `block` (first and last u, first
        and last v). Pixels that differ have a small weight: they may show a block that is not recognised yet."""
        import cv2

        self._count += 1
        if self._count % LEARNING_INTERVAL:
            return
        alike = cv2.compare(
            cv2.absdiff(frame, self._byte()), max(CHANGED_SIGMAS * self.noise, CHANGED_GREY), cv2.CMP_LT
        )
        other = cv2.bitwise_not(alike)
        if block is not None:
            u0, u1, v0, v1 = block
            alike[v0:v1, u0:u1] = other[v0:v1, u0:u1] = 0
        cv2.accumulateWeighted(frame, self.grey, LEARNING_INTERVAL * LEARNING_RATE, alike)
        cv2.accumulateWeighted(frame, self.grey, CHANGED_LEARNING_SHARE * LEARNING_INTERVAL * LEARNING_RATE, other)
        self._bytes = None
        self._coarse.clear()

    def _byte(self) -> Array:
        import cv2

        if self._bytes is None:
            self._bytes = cv2.convertScaleAbs(self.grey)
        return self._bytes
