"""A video file, written completely or not at all: VP9 in WebM, which browsers play, or H.264 in MP4.

One thread draws pictures while another encodes them."""

from __future__ import annotations

import errno
from collections import deque
from collections.abc import Callable, Iterable
from concurrent.futures import Future, ThreadPoolExecutor
from fractions import Fraction
from pathlib import Path
from types import TracebackType
from typing import NamedTuple

import av
import cv2

from rock2d.arrays import Array
from rock2d.errors import InputError
from rock2d.files.folders import atomic_file

Progress = Callable[[int, int], None]

ENCODER_THREADS = 2  # fixed, because the file must not depend on the machine
WAITING_PICTURES = 4  # most pictures that are drawn and not yet encoded
LARGEST_DENOMINATOR = 1001  # of the frame rate as a fraction; television has 30000/1001


class Encoder(NamedTuple):
    """An encoder of FFmpeg and its options."""

    name: str
    options: dict[str, str]


ENCODERS = {
    # crf: quality, lower is better; cpu-used: 0 slow to 8 fast
    ".webm": Encoder(
        "libvpx-vp9",
        {
            "deadline": "realtime",
            "cpu-used": "8",
            "row-mt": "1",
            "tile-columns": "2",
            "lag-in-frames": "0",
            "crf": "26",
        },
    ),
    ".mp4": Encoder("libx264", {"preset": "veryfast", "crf": "20"}),
}


class VideoWriter:
    """Writes a video picture by picture; a context manager that closes the file.

    The suffix of the path chooses the encoder. Raises InputError if it is neither .webm nor .mp4."""

    def __init__(self, path: str | Path, fps: float, size_px: tuple[int, int]) -> None:
        """Open a file with `fps` pictures per second of `size_px` (width, height), both even."""
        self._path, self._shape = Path(path), (int(size_px[1]), int(size_px[0]), 3)
        encoder = encoder_of(self._path)
        try:
            self._container = av.open(str(self._path), "w", options={"fflags": "+bitexact"})
        except av.FFmpegError as error:
            raise self._os_error(error) from None
        rate = Fraction(fps).limit_denominator(LARGEST_DENOMINATOR)
        stream = self._container.add_stream(encoder.name, rate=rate, options=encoder.options)
        assert isinstance(stream, av.VideoStream)
        self._stream = stream
        self._stream.height, self._stream.width = self._shape[:2]
        self._stream.pix_fmt = "yuv420p"
        context = self._stream.codec_context
        context.bit_rate = 0  # no limit: quality alone decides
        context.thread_count = ENCODER_THREADS
        context.colorspace, context.color_range = 6, 1  # BT.601, 16 to 235, as OpenCV converts
        self._thread = ThreadPoolExecutor(1)
        self._waiting: deque[Future[None]] = deque()
        self._number = 0

    def write(self, picture: Array) -> None:
        """Add a picture (height, width, 3), BGR uint8; the caller may change it afterwards. Raises OSError if earlier
        pictures could not be written, ValueError if the size differs."""
        if picture.shape != self._shape:
            raise ValueError(f"expected pictures of shape {self._shape}, got {picture.shape}")
        self._waiting.append(self._thread.submit(self._encode, cv2.cvtColor(picture, cv2.COLOR_BGR2YUV_I420)))
        if len(self._waiting) > WAITING_PICTURES:
            self._waiting.popleft().result()

    def close(self) -> None:
        """Finish the file. Raises OSError if it is not complete."""
        try:
            if self._waiting:
                self._waiting.append(self._thread.submit(self._encode_and_write, None))
            for future in self._waiting:
                future.result()
        finally:
            self._thread.shutdown()
            try:
                self._container.close()
            except av.FFmpegError as error:
                raise self._os_error(error) from None

    def __enter__(self) -> VideoWriter:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        try:
            self.close()
        except OSError:
            if error is None:  # otherwise the error inside the block is more informative
                raise

    def _encode(self, picture: Array) -> None:
        frame = av.VideoFrame.from_ndarray(picture, format="yuv420p")
        frame.pts = self._number
        self._number += 1
        self._encode_and_write(frame)

    def _encode_and_write(self, frame: av.VideoFrame | None) -> None:
        """Encode and write a picture, or with None the pictures that the encoder still holds."""
        try:
            self._container.mux(self._stream.encode(frame))
        except av.FFmpegError as error:
            raise self._os_error(error) from None

    def _os_error(self, error: Exception) -> OSError:
        number = getattr(error, "errno", None) or errno.EIO
        return OSError(number, getattr(error, "strerror", None) or str(error), str(self._path))


def encoder_of(path: Path) -> Encoder:
    """The encoder for the suffix of a path. Raises InputError if there is none."""
    if path.suffix.lower() not in ENCODERS:
        raise InputError(f"{path}: expected a video as .webm or .mp4, found {path.suffix or 'no suffix'!r}")
    return ENCODERS[path.suffix.lower()]


def write_video(
    path: str | Path,
    pictures: Iterable[Array],
    count: int,
    fps: float,
    size_px: tuple[int, int],
    progress: Progress | None = None,
) -> Path:
    """Write `count` BGR `pictures` (height, width, 3) of `size_px` (width, height) and return the path.

    The file is written completely or not at all. Raises InputError if the suffix is neither .webm nor .mp4 or there are
    no pictures, OSError if a picture could not be written."""
    path = Path(path)
    encoder_of(path)
    done = 0
    with atomic_file(path) as part:
        with VideoWriter(part, fps, size_px) as writer:
            for done, picture in enumerate(pictures, 1):
                writer.write(picture)
                if progress:
                    progress(done, count)
        if not done:
            raise InputError(f"{path}: nothing could be written")
    return path
