"""Reading a video file from its first to its last frame in bounded memory, and its time stamps.

A film is read several times, but decoded once: frames beyond `KEPT_BYTES` are stored in a temporary file, if there is
room on the disk. FFmpeg decodes in its own threads. Only the brightness of a film without colour is read."""

from __future__ import annotations

import shutil
import tempfile
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import IO, TYPE_CHECKING, NamedTuple

import numpy as np

from rock2d.arrays import Array
from rock2d.errors import InputError, counted
from rock2d_tracking.stabilisation import stabilised

if TYPE_CHECKING:
    import av

KEPT_BYTES = 2_000_000_000  # of decoded frames in memory
# largest share of the free disk for the temporary file; otherwise each reading decodes the film
MOST_OF_DISK = 0.5
FULL_RANGE = 2  # FFmpeg's value for brightness from 0 to 255; otherwise it is 16 to 235
STUDIO_TO_FULL = np.clip(np.rint((np.arange(256) - 16) * 255 / 219), 0, 255).astype(np.uint8)
# tolerance of the time between frames: share of the usual one, and ticks of the clock
STAMP_SHARE, STAMP_TICKS = 0.1, 1.01
# for a varying frame rate: shortest time between frames over the usual one (a shorter one means that the playback speed
# changes); and range of the stated over the played frame rate, at these quantiles of the steps, that means real time
SHORTEST_STEP, AS_FILMED, USUAL_STEPS = 0.4, (0.8, 1.25), (0.1, 0.9)
COLOURLESS = 1  # largest distance of a colour from grey in a film without colour
BRIGHTNESS_FIRST = ("yuv", "gray")  # formats of 8 bits whose first plane is the brightness
BEFORE_EDIT = "hidden by an edit list"
ROUNDED_PX = 1.0  # change of the height by which programs round the size of a picture; pixels then count as square
UNREADABLE_SHARE = 0.01  # share of the stated frames that may be missing: the counts of containers are rough


class FilmFile:
    """A film on disk.

    Attributes
    ----------
    size_px : (width, height)
    expected_frames : number of frames that are played as the container states, 0 if it states none
    played_fps, tick_s : frame rate at which it is played, and resolution of its time stamps
    colourless : whether all colours of its first frame are grey"""

    def __init__(self, path: str | Path) -> None:
        """Open it once. Raises InputError if it does not exist, is not a video, needs a missing codec, or has pixels
        that are not square."""
        self.path = Path(path)
        if not self.path.is_file():
            raise InputError("no such video file", self.path)
        if self.path.stat().st_size == 0:
            raise InputError("this video file is empty", self.path)
        with self._open() as container:
            stream = container.streams.video[0]
            first = next(_decoded(container), None)
            rate = float(stream.average_rate or 0.0)
            lasts_s = float(stream.duration * stream.time_base) if stream.duration and stream.time_base else 0.0
            if not lasts_s and container.duration:
                lasts_s = container.duration / 1e6
            played = round(lasts_s * rate)
            self.expected_frames = stream.frames or played
            if "mp4" in container.format.name and played:
                # an edit list shortens what is played, not the number that is stated
                self.expected_frames = min(self.expected_frames, played)
            wide = float(stream.sample_aspect_ratio or 1.0)  # width of a pixel over its height
            self.played_fps, self.tick_s = rate, float(stream.time_base or 0.0)
        if first is None:
            raise InputError("this video holds no frame that can be read", self.path)
        if abs(wide - 1.0) * first.height > ROUNDED_PX:
            raise InputError(
                f"the pixels of this video are {wide:.4g} times as wide as high; convert it to square ones, for "
                'example with: ffmpeg -i FILM -vf "scale=trunc(iw*sar/2)*2:ih,setsar=1" SQUARE.mp4',
                self.path,
            )
        size = (first.width, first.height)
        self.size_px = size[::-1] if first.rotation % 180 else size
        self.colourless = _colourless(first)

    def _open(self) -> av.container.InputContainer:
        import av

        said = "cannot be read: it is no video, is damaged, or needs a codec that FFmpeg lacks"
        try:
            container = av.open(str(self.path))
        except (av.FFmpegError, OSError, ValueError):
            raise InputError(said, self.path) from None
        if not container.streams.video or container.streams.video[0].codec_context is None:
            container.close()
            raise InputError(said, self.path)
        container.streams.video[0].thread_type = "AUTO"
        return container

    def frames(self, last: int | None = None) -> Frames:
        """The frames in order as (height, width) or (height, width, 3) uint8, before frame `last`."""
        return Frames(self, last)


class Clock:
    """Instants of frames in units of the usual frame interval; without `instants` the frame rate is constant."""

    def __init__(self, instants: Array | None = None) -> None:
        """`instants` (n,): of each frame, increasing."""
        self._instants = instants

    def __call__(self, frame: float | Array) -> Array:
        """Instants of frame numbers, interpolated between frames and extrapolated at the usual rate."""
        at = np.asarray(frame, float)
        if self._instants is None:
            return at
        last = len(self._instants) - 1
        beyond = np.minimum(at, 0.0) + np.maximum(at - last, 0.0)
        return np.asarray(np.interp(at, np.arange(last + 1), self._instants) + beyond)


CONSTANT_RATE = Clock()  # constant frame rate


class Stamps(NamedTuple):
    """Frame numbers and instants from the time stamps of a film.

    Attributes
    ----------
    numbers : (n,) number of each frame as filmed; the numbers of missing frames are left out
    clock : the instant of each frame
    remark : for the user, "" if the frame rate is constant"""

    numbers: Array
    clock: Clock
    remark: str


class Frames:
    """The frames of a film, which can be read several times; they must not be changed.

    Attributes
    ----------
    times_s : time stamp of each frame that was read, NaN where the file has none
    shifts_px : (n, 2) displacement of each picture, which is removed; None to leave frames as they are
    cut : whether the film goes on after the last of them"""

    def __init__(self, film: FilmFile, last: int | None) -> None:
        """`last`: number of frames after which to stop, None for all."""
        self._film, self._last = film, last
        self.cut = last is not None and last < film.expected_frames
        self._kept: _FrameStore | None = None
        self.shifts_px: Array | None = None
        self.times_s: list[float] = []

    def __iter__(self) -> Iterator[Array]:
        """Read from the first frame, shifted back by `shifts_px` if given.

        Raises InputError if there is no frame, or if the file ends early and `last` is not given."""
        if self.shifts_px is None:
            yield from self._as_filmed()
        else:
            for frame, shift_px in zip(self._as_filmed(), self.shifts_px, strict=False):
                yield stabilised(frame, shift_px)

    def _as_filmed(self) -> Iterator[Array]:
        if self._kept is not None:
            yield from self._kept
            return
        kept = _FrameStore(self._film.expected_frames if self._last is None else self._last)
        for frame in self._decoded():
            yield frame
            kept.add(frame)
        if kept.whole:
            self._kept = kept

    def _decoded(self) -> Iterator[Array]:
        count, self.times_s, cut = 0, [], Counter[str]()
        with self._film._open() as container:
            for frame in _decoded(container, cut):
                if self._last is not None and count >= self._last:
                    break
                count += 1
                self.times_s.append(np.nan if frame.time is None else frame.time)
                yield _picture(frame, self._film.colourless)
        if count == 0:
            raise InputError("this video holds no frame that can be read", self._film.path)
        read = count + cut[BEFORE_EDIT]
        if self._last is None and read < (1.0 - UNREADABLE_SHARE) * self._film.expected_frames - 1:
            raise InputError(
                f"the video ends early: {count} of the {self._film.expected_frames} frames that it states can be read; "
                f"write --frames {count} to track these",
                self._film.path,
            )

    def stamps(self, fps: float | None) -> Stamps:
        """Evaluate the time stamps of the frames that were read; `fps`: frame rate of the recording, None if unknown.

        At a constant rate, two frames are one or more usual intervals apart, more than one if frames are missing.
        Otherwise the frame rate varies: the stamps are the instants of the frames, scaled if the film was recorded at
        another rate than it is played. Implausible stamps are ignored."""
        counted_on = np.arange(len(self.times_s))
        # frames come in the order of display; some containers give only the times of decoding
        when_s = np.sort(self.times_s)
        steps = np.diff(when_s)
        if len(steps) < 2 or not np.isfinite(steps).all() or np.median(steps) <= 0.0:
            return Stamps(counted_on, CONSTANT_RATE, "")
        usual_s = float(np.median(steps))
        times = np.rint(steps / usual_s)
        off = np.abs(steps - times * usual_s)
        if times.min() < 1 or off.max() > max(STAMP_SHARE * usual_s, STAMP_TICKS * self._film.tick_s):
            return self._varying_rate(when_s, usual_s, fps)
        missing = int(times.sum()) - len(steps)
        said = f"{counted(missing, 'frame')} missing in the film by its time stamps" if missing else ""
        numbers = np.concatenate([[0], np.cumsum(times)]).astype(int)
        return Stamps(numbers, Clock(numbers.astype(float)) if missing else CONSTANT_RATE, said)

    def _varying_rate(self, when_s: Array, usual_s: float, fps: float | None) -> Stamps:
        """As `stamps`, for a varying frame rate."""
        steps, numbers = np.diff(when_s), np.arange(len(when_s))
        said = (
            f"the frame rate of this film varies: its time stamps are {1e3 * steps.min():.3g} to "
            f"{1e3 * steps.max():.3g} ms apart"
        )
        if steps.min() < SHORTEST_STEP * usual_s:
            pace = "no camera does that; was it cut, or is it played at several paces?"
            return Stamps(numbers, CONSTANT_RATE, f"{said}; {pace} One rate is assumed, so times and speeds are rough")
        fast_s, slow_s = np.quantile(steps, USUAL_STEPS)
        if fps is not None and AS_FILMED[0] < fps * slow_s and fps * fast_s < AS_FILMED[1]:
            clock, drawn_out = Clock((when_s - when_s[0]) * fps), ""
        else:
            rate = "that of the recording" if fps is None else f"{fps:g}"
            clock = Clock((when_s - when_s[0]) / usual_s)
            drawn_out = f", drawn out from {1 / usual_s:.4g} to {rate} frames/s"
        return Stamps(numbers, clock, f"{said}. These are the times of the frames{drawn_out}")


class _FrameStore:
    """Decoded frames: the first ones in memory, those beyond KEPT_BYTES in an unnamed temporary file."""

    def __init__(self, expected: int) -> None:
        """`expected`: number of frames."""
        self._expected = expected
        self._first: list[Array] = []
        self._file: IO[bytes] | None = None
        self._filed = 0
        self.whole = True  # whether all frames are kept

    def add(self, frame: Array) -> None:
        """Keep a frame, if there is room for all of them."""
        if not self.whole:
            return
        if self._file is None and frame.nbytes * (len(self._first) + 1) <= KEPT_BYTES:
            self._first.append(frame)
            return
        if self._file is None and self._has_room(frame.nbytes):
            self._file = tempfile.TemporaryFile()  # noqa: SIM115  lives as long as this object
        self.whole = self._write_to_file(frame)
        if not self.whole:
            self._first, self._file = [], None

    def _write_to_file(self, frame: Array) -> bool:
        """Write the frame to the file; False if there is no room or the size differs from that of the others."""
        if self._file is None or frame.shape != self._first[0].shape:
            return False
        try:
            self._file.write(frame.data)
        except OSError:
            return False
        self._filed += 1
        return True

    def _has_room(self, frame_bytes: int) -> bool:
        free = shutil.disk_usage(tempfile.gettempdir()).free
        return bool(self._first) and frame_bytes * self._expected <= MOST_OF_DISK * free

    def __iter__(self) -> Iterator[Array]:
        yield from self._first
        if self._file is not None:
            self._file.flush()
            shape = (self._filed, *self._first[0].shape)
            yield from np.asarray(np.memmap(self._file, np.uint8, "r", shape=shape))


def _decoded(container: av.container.InputContainer, cut: Counter[str] | None = None) -> Iterator[av.VideoFrame]:
    """Frames in the order of display, without damaged packets. `cut` counts the frames that an edit list hides."""
    import av

    try:
        for packet in container.demux(video=0):
            if cut is not None:
                cut[BEFORE_EDIT] += packet.is_discard
            try:
                frames = packet.decode()
            except av.FFmpegError:
                continue
            for frame in frames:
                assert isinstance(frame, av.VideoFrame)
                yield frame
    except av.FFmpegError:
        return  # the file ends within a packet: the caller knows how many frames there should be


def _brightness_first(frame: av.VideoFrame) -> bool:
    parts = frame.format.components
    return frame.format.name.startswith(BRIGHTNESS_FIRST) and all(part.bits == 8 for part in parts)


def _plane(frame: av.VideoFrame, k: int) -> Array:
    """(height, line) uint8, with the line length in memory."""
    plane = frame.planes[k]
    return np.frombuffer(memoryview(plane), np.uint8).reshape(-1, plane.line_size)[: plane.height]


def _colourless(frame: av.VideoFrame) -> bool:
    if _brightness_first(frame):
        colours = [_plane(frame, k)[:, : frame.planes[k].width] for k in range(1, len(frame.planes))]
        return all(int(np.abs(c.astype(np.int16) - 128).max()) <= COLOURLESS for c in colours)
    return not np.ptp(frame.to_ndarray(format="bgr24"), axis=2).any()


def _picture(frame: av.VideoFrame, colourless: bool) -> Array:
    """(height, width) or (height, width, 3) uint8, rotated for display."""
    import cv2

    if colourless and _brightness_first(frame):
        plane = _plane(frame, 0)[:, : frame.width]
        full = frame.format.name.startswith(("yuvj", "gray")) or frame.color_range == FULL_RANGE
        image: Array = plane.copy() if full else np.asarray(cv2.LUT(plane, STUDIO_TO_FULL))
    else:
        image = frame.to_ndarray(format="bgr24")
        image = np.ascontiguousarray(image[..., 0]) if colourless else image
    turns = round(frame.rotation / 90) % 4
    return np.ascontiguousarray(np.rot90(image, turns)) if turns else np.asarray(image)
