"""A video file, read from its first frame to its last, never by seeking: images in bounded memory.

A film is read several times. If its frames fit in `KEPT_BYTES`, they are decoded once and kept.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from rock2d.errors import InputError

if TYPE_CHECKING:
    import cv2

Array = np.ndarray

KEPT_BYTES = 2_000_000_000  # of decoded frames that are kept; a longer film is decoded anew for each reading
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


class Frames:
    """The frames of a film, which can be read again and again; they must not be changed."""

    def __init__(self, film: FilmFile, last: int | None) -> None:
        """`last`: number of frames after which to stop, None for all."""
        self._film, self._last = film, last
        self._kept: list[Array] | None = None

    def __iter__(self) -> Iterator[Array]:
        """Read from the first frame on.

        Raises `InputError` if there is none, or if the file ends before it should and `last` does not say so.
        """
        if self._kept is not None:
            yield from self._kept
            return
        kept: list[Array] = []
        fits = True
        for frame in self._decoded():
            yield frame
            fits = fits and frame.nbytes * (len(kept) + 1) <= KEPT_BYTES
            if fits:
                kept.append(frame)
            else:
                kept.clear()
        if fits:
            self._kept = kept

    def _decoded(self) -> Iterator[Array]:
        import cv2

        capture, count, grey = self._film._opened(), 0, False
        try:
            while self._last is None or count < self._last:
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
            raise InputError("this video holds no frame that can be read", self._film.path)
        if self._last is None and count < (1.0 - UNREADABLE_SHARE) * self._film.promised - 1:
            raise InputError(
                f"the video ends early: {count} of the {self._film.promised} frames that it states can be read; "
                f"write --frames {count} to track these",
                self._film.path,
            )
