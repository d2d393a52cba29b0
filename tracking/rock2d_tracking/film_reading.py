"""A video file, read from its first frame to its last, never by seeking: grey images in bounded memory."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from rock2d.errors import InputError

Array = np.ndarray

UNREADABLE_SHARE = 0.01  # share of the stated frames that may be missing: the counts of containers are rough


class FilmFile:
    """A film on disk.

    Attributes
    ----------
    size_px : (width, height)
    promised : number of frames that the container states, 0 if it states none
    """

    def __init__(self, path: str | Path) -> None:
        """Open it; raises `InputError` if it does not exist, is no video, or needs a codec that is missing."""
        import cv2

        self.path = Path(path)
        if not self.path.is_file():
            raise InputError("no such video file", self.path)
        if self.path.stat().st_size == 0:
            raise InputError("this video file is empty", self.path)
        self._capture = cv2.VideoCapture(str(self.path))
        if not self._capture.isOpened():
            raise InputError(
                "cannot be read: it is no video, is damaged, or needs a codec that this OpenCV lacks "
                "(convert it to Motion-JPEG AVI or H.264 MP4)",
                self.path,
            )
        self.size_px = (
            int(self._capture.get(cv2.CAP_PROP_FRAME_WIDTH)),
            int(self._capture.get(cv2.CAP_PROP_FRAME_HEIGHT)),
        )
        self.promised = max(int(self._capture.get(cv2.CAP_PROP_FRAME_COUNT)), 0)

    def frames(self, last: int | None = None) -> Iterator[Array]:
        """Frames in turn as (height, width) uint8, up to and without `last`.

        Raises `InputError` if there is none, or if the file ends before it should and `last` does not say so.
        """
        import cv2

        count = 0
        try:
            while last is None or count < last:
                done, image = self._capture.read()
                if not done:
                    break
                count += 1
                yield cv2.cvtColor(image, cv2.COLOR_BGR2GRAY) if image.ndim == 3 else image
        finally:
            self._capture.release()
        if count == 0:
            raise InputError("this video holds no frame that can be read", self.path)
        if last is None and count < (1.0 - UNREADABLE_SHARE) * self.promised - 1:
            raise InputError(
                f"the video ends early: {count} of the {self.promised} frames that it states can be read; "
                f"write --frames {count} to track these",
                self.path,
            )
