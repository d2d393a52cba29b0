"""A video file, written whole or not at all (VP9 in WebM, which browsers play; MPEG-4 if asked by suffix)."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Iterable
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
        try:
            if not writer.isOpened():
                raise InputError(f"{path}: this OpenCV cannot write {codec} video; try {other}")
            for done, frame in enumerate(frames, 1):
                writer.write(frame)
                if progress:
                    progress(done, count)
        finally:
            writer.release()
        if not part.exists() or part.stat().st_size == 0:
            raise InputError(f"{path}: nothing could be written")
    return path


def opened(path: Path, code: str, fps: float, size_px: tuple[int, int]) -> cv2.VideoWriter:
    """A writer, opened without stderr: OpenCV warns about the tag of VP9 in WebM, which is right, and prints a page
    about a missing codec, which `isOpened` reports as well."""
    sys.stderr.flush()
    kept, nowhere = os.dup(2), os.open(os.devnull, os.O_WRONLY)
    try:
        os.dup2(nowhere, 2)
        size = (int(size_px[0]), int(size_px[1]))
        return cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*code), float(fps), size)
    finally:
        os.dup2(kept, 2)
        os.close(kept)
        os.close(nowhere)
