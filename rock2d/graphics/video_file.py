"""A video file, written whole or not at all (VP9 in WebM, which browsers play; MPEG-4 if asked by suffix)."""

from __future__ import annotations

import errno
import os
import sys
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path

import cv2
import numpy as np

from rock2d.errors import InputError
from rock2d.files.folders import atomic_file

Array = np.ndarray
Progress = Callable[[int, int], None]

CODECS = {".webm": ("VP90", "VP9"), ".mp4": ("mp4v", "MPEG-4")}
QUICK_CODEC = ("VP80", "VP8")


def write_video(
    path: str | Path,
    frames: Iterable[Array],
    count: int,
    fps: float,
    size_px: tuple[int, int],
    progress: Progress | None = None,
    *,
    quick: bool = False,
) -> Path:
    """Write `count` BGR `frames` (height, width, 3) of `size_px` (width, height) and return the path.

    `quick`: a WebM as VP8, five times as fast to write as OpenCV's VP9, a little larger; browsers play both.

    Written beside `path` and renamed at the end. Raises InputError if the suffix is neither .webm nor .mp4,
    or the codec is missing from this OpenCV.
    """
    path = Path(path)
    suffix = path.suffix.lower()
    if suffix not in CODECS:
        raise InputError(f"{path}: expected a video as .webm or .mp4, found {path.suffix or 'no suffix'!r}")
    code, codec = QUICK_CODEC if quick and suffix == ".webm" else CODECS[suffix]
    other = next(s for s in CODECS if s != suffix)
    with atomic_file(path) as part:
        writer = opened(part, code, fps, size_px)
        done = 0
        try:
            if not writer.isOpened():
                raise InputError(f"{path}: this OpenCV cannot write {codec} video; try {other}")
            for done, frame in enumerate(frames, 1):
                writer.write(frame)
                if progress:
                    progress(done, count)
        finally:
            writer.release()
        if not done:
            raise InputError(f"{path}: nothing could be written")
        check_frames(part, done)
    return path


def check_frames(path: Path, count: int) -> None:
    """OSError unless a video holds `count` pictures: OpenCV goes on when the disk is full."""
    with without_stderr():
        video = cv2.VideoCapture(str(path), cv2.CAP_FFMPEG)
        video.set(cv2.CAP_PROP_FORMAT, -1)  # packets as they are: counted, not decoded
        found = 0
        while video.grab():
            found += 1
        video.release()
    if found < count:
        raise OSError(
            errno.ENOSPC, f"only {found} of {count} pictures could be written; is the disk full?", str(path)
        )


def opened(path: Path, code: str, fps: float, size_px: tuple[int, int]) -> cv2.VideoWriter:
    """A writer, opened without stderr: OpenCV warns about the tag of VP9 in WebM, which is right, and prints a page
    about a missing codec, which `isOpened` reports as well."""
    quiet_about_frames()
    with without_stderr():
        size = (int(size_px[0]), int(size_px[1]))
        return cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*code), float(fps), size)


def quiet_about_frames() -> None:
    """Let OpenCV print no line for each picture that it cannot write: `check_frames` says it once."""
    cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_ERROR)


@contextmanager
def without_stderr() -> Iterator[None]:
    """Let what libraries print to stderr in the block go nowhere."""
    sys.stderr.flush()
    kept, nowhere = os.dup(2), os.open(os.devnull, os.O_WRONLY)
    try:
        os.dup2(nowhere, 2)
        yield
    finally:
        os.dup2(kept, 2)
        os.close(kept)
        os.close(nowhere)
