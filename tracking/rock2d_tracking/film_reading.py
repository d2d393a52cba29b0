"""A video file, read from its first frame to its last, never by seeking: images in bounded memory."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from rock2d.errors import InputError

if TYPE_CHECKING:
    import cv2

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
        """Look at it; raises `InputError` if it does not exist, is no video, or needs a codec that is missing."""
        import cv2

        self.path = Path(path)
        if not self.path.is_file():
            raise InputError("no such video file", self.path)
        if self.path.stat().st_size == 0:
            raise InputError("this video file is empty", self.path)
        capture = self._opened()
        self.size_px = (
            int(capture.get(cv2.CAP_PROP_FRAME_WIDTH)),
            int(capture.get(cv2.CAP_PROP_FRAME_HEIGHT)),
        )
        self.promised = max(int(capture.get(cv2.CAP_PROP_FRAME_COUNT)), 0)
        self.played_fps = float(capture.get(cv2.CAP_PROP_FPS))
        capture.release()

    def _opened(self) -> cv2.VideoCapture:
        import cv2

        capture = cv2.VideoCapture(str(self.path))
        if not capture.isOpened():
            raise InputError(
                "cannot be read: it is no video, is damaged, or needs a codec that this OpenCV lacks "
                "(convert it to Motion-JPEG AVI or H.264 MP4)",
                self.path,
            )
        return capture

    def frames(self, last: int | None = None) -> Frames:
        """Frames in turn as (height, width) or (height, width, 3) uint8, up to and without `last`."""
        return Frames(self, last)


@dataclass(frozen=True)
class Frames:
    """The frames of a film, which can be read again and again."""

    film: FilmFile
    last: int | None

    def __iter__(self) -> Iterator[Array]:
        """Read from the first frame on.

        Raises `InputError` if there is none, or if the file ends before it should and `last` does not say so.
        """
        import cv2

        capture, count, grey = self.film._opened(), 0, False
        try:
            while self.last is None or count < self.last:
                done, image = capture.read()
                if not done:
                    break
                if count == 0:  # codecs give grey films in three equal colours
                    grey = image.ndim == 3 and not np.ptp(image, axis=2).any()
                count += 1
                yield cv2.cvtColor(image, cv2.COLOR_BGR2GRAY) if grey else image
        finally:
            capture.release()
        if count == 0:
            raise InputError("this video holds no frame that can be read", self.film.path)
        if self.last is None and count < (1.0 - UNREADABLE_SHARE) * self.film.promised - 1:
            raise InputError(
                f"the video ends early: {count} of the {self.film.promised} frames that it states can be read; "
                f"write --frames {count} to track these",
                self.film.path,
            )
