"""Synthetic films with known truth: the trajectories of an experiment, as recorded by a high-speed camera.

The scene is drawn anti-aliased: the share of the block in a pixel is the covered share of its area."""

from __future__ import annotations

import csv
from collections.abc import Iterable, Iterator, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from rock2d.arrays import Array
from rock2d.errors import InputError
from rock2d.files.experiment import Experiment
from rock2d.files.folders import atomic_file
from rock2d.records.columns import POSE_NAMES
from rock2d_tracking.camera import PixelMap
from rock2d_tracking.synthetic.faults import CLEAN, BlockMotion, Faults, Puff, Sensor, exposure_poses, extended, puffs
from rock2d_tracking.synthetic.scene import PLAIN_LOOK, Look, Pose, Scene

if TYPE_CHECKING:
    from av.packet import Packet
    from av.video.stream import VideoStream

TRUTH_COLUMNS = ("frame", "release", "block", "t_s", "u_px", "v_px", "angle_px_rad", *POSE_NAMES)
MOST_TICKS = 1000  # largest denominator of a frame rate in a film


@dataclass(frozen=True)
class Shot:
    """One frame of a film and its truth.

    Attributes
    ----------
    image : (height, width) uint8
    frame : its number, counted from 0 as filmed; the numbers of missing frames are left out
    release, block, t_s : as in the experiment; before the block is released, t_s is less than its first
    pose_px : u, v in px and angle in rad, in the image; None where no block is in the picture
    pose_m : x, y in m and theta in rad; None likewise"""

    image: Array
    frame: int
    release: int
    block: str
    t_s: float
    pose_px: Pose | None
    pose_m: Pose | None


@dataclass(frozen=True)
class FilmOptions:
    """How an experiment is filmed.

    Attributes
    ----------
    seed : seed of soil, noise, dust and dropped frames; the same seed makes the same film
    faults, look : faults of the film; light and colours
    releases : numbers of the releases, in this order; all if None
    rest_frames : empty frames before each release"""

    seed: int
    faults: Faults = CLEAN
    look: Look = PLAIN_LOOK
    releases: Sequence[int] | None = None
    rest_frames: int = 5


def film_frames(
    experiment: Experiment, pixel_map: PixelMap, size_px: tuple[int, int], options: FilmOptions
) -> Iterator[Shot]:
    """Film an experiment with images of `size_px` (width, height), one release after the other.

    A row of a trajectory is a frame, at `experiment.fps`; rows that are missing or NaN give no frame.

    Raises InputError if the experiment has no trajectories or no such release, or two rows of a release are within one
    frame interval."""
    table = experiment.trajectories
    if table is None:
        raise InputError(f"experiment {experiment.name}: only trajectories can be filmed, it has impacts")
    known = table["release"].unique().tolist()
    unknown = [release for release in options.releases or [] if release not in known]
    if unknown:
        raise InputError(f"experiment {experiment.name}: there is no release {unknown[0]}")
    for release, rows in table.groupby("release"):
        if (np.diff(np.rint(rows["t_s"] * experiment.fps)) < 1).any():
            raise InputError(f"release {release}: two rows within a frame at {experiment.fps:g} frames/s")
    faults, seed = options.faults, options.seed
    scene = Scene(experiment, pixel_map, size_px, options.look, faults, np.random.default_rng([seed, 0]))
    sensor = Sensor(faults, size_px, np.random.default_rng([seed, 1]))
    return _filmed(experiment, scene, sensor, known if options.releases is None else options.releases, options)


def _filmed(
    experiment: Experiment, scene: Scene, sensor: Sensor, releases: Sequence[int], options: FilmOptions
) -> Iterator[Shot]:
    table, fps, faults, pixel_map = experiment.trajectories, experiment.fps, scene.faults, scene.pixel_map
    seed, rest_frames = options.seed, options.rest_frames
    assert table is not None
    first = 0
    for release in releases:
        rows = table[table["release"] == release]
        block = experiment.blocks[rows["block"].iloc[0]]
        t, poses = rows["t_s"].to_numpy(float), rows[list(POSE_NAMES)].to_numpy(float)
        frame = first + rest_frames + np.rint((t - t[0]) * fps).astype(int)
        before_s = t[0] + np.arange(-rest_frames, 0) / fps
        measured = np.isfinite(poses).all(axis=1)
        kept = np.random.default_rng([seed, 2, release]).random(rest_frames + len(t)) >= faults.dropped
        for i in np.flatnonzero(kept[:rest_frames]).tolist():
            image = sensor.expose(scene.still.copy(), (first + i) / fps)
            yield Shot(image, first + i, release, block.name, float(before_s[i]), None, None)
        turning = poses[measured]
        turning[:, 2] = np.unwrap(turning[:, 2])
        motion = BlockMotion(block, extended(t[measured]), extended(turning), experiment.position_noise_m)
        clouds: list[Puff] = []
        if faults.dust:
            rng = np.random.default_rng([seed, 3, release])
            clouds = puffs(motion, experiment.cross_section, pixel_map, faults.dust, rng)
        for i in np.flatnonzero(kept[rest_frames:] & measured).tolist():
            exposed = exposure_poses(motion, t[i], faults.shutter / fps, pixel_map)
            light, there = scene.light(block, exposed)
            for puff in clouds:
                puff.draw(light, t[i])
            image = sensor.expose(light, frame[i] / fps)
            x, y, theta = poses[i].tolist()
            u, v = pixel_map.to_pixel(poses[i, :2]).tolist()
            seen, real = (u, v, float(pixel_map.angle_to_pixel(theta))), (x, y, theta)
            pose = (seen, real) if there else (None, None)
            yield Shot(image, int(frame[i]), release, block.name, float(t[i]), *pose)
        first = int(frame[-1]) + 1


def write_film(
    path: str | Path, shots: Iterable[Shot], size_px: tuple[int, int], fps_video: float, quality: int | None = None
) -> Path:
    """Write a film as AVI and return its path: Motion JPEG of `quality` 1 to 100, or lossless FFV1 if None.

    Its truth is a CSV of `TRUTH_COLUMNS` with the same name: one row for each picture in the order of the film, with
    empty cells if no block is in the picture.

    Both files are written completely or not at all. Raises InputError if the suffix is not .avi, the size is odd or not
    that of the shots, or there are no shots."""
    import av

    path, (width, height) = Path(path), size_px
    if path.suffix.lower() != ".avi":
        raise InputError(f"{path}: expected a film as .avi, found {path.suffix or 'no suffix'!r}")
    if width % 2 or height % 2:
        raise InputError(f"{path}: expected an even width and height, found {width} x {height}")
    with ExitStack() as stack:  # closes the files before they are renamed
        part = stack.enter_context(atomic_file(path))
        part_truth = stack.enter_context(atomic_file(path.with_suffix(".csv")))
        file = stack.enter_context(part_truth.open("w", encoding="utf-8", newline=""))
        table = csv.writer(file, lineterminator="\n")
        table.writerow(TRUTH_COLUMNS)
        film = stack.enter_context(av.open(str(part), "w", format="avi"))
        rate = Fraction(fps_video).limit_denominator(MOST_TICKS)
        stream = film.add_stream("ffv1" if quality is None else "mjpeg", rate)
        stream.width, stream.height = int(width), int(height)
        stream.pix_fmt = "gray" if quality is None else "yuvj420p"
        pictures = 0
        for shot in shots:
            if shot.image.shape != (height, width):
                found = " x ".join(map(str, shot.image.shape[::-1]))
                raise InputError(f"{path}: expected frames of {width} x {height} px, found {found}")
            film.mux(_packets(stream, shot.image, pictures, 1 / rate, quality))
            pictures += 1
            pose = [*(shot.pose_px or ("",) * 3), *(shot.pose_m or ("",) * 3)]
            table.writerow([shot.frame, shot.release, shot.block, shot.t_s, *pose])
        if not pictures:
            raise InputError(f"{path}: nothing could be written")
        film.mux(stream.encode(None))
    return path


def _packets(stream: VideoStream, image: Array, number: int, tick: Fraction, quality: int | None) -> list[Packet]:
    """The packets of a picture, (height, width) uint8, at the instant `number` of ticks in s."""
    import av
    import cv2

    if quality is None:
        frame = av.VideoFrame.from_ndarray(image, format="gray")
        frame.pts, frame.time_base = number, tick
        return stream.encode(frame)
    # OpenCV takes a JPEG quality; FFmpeg takes steps of its quantiser
    packet = av.Packet(cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, quality])[1].tobytes())
    packet.stream, packet.pts, packet.dts, packet.time_base = stream, number, number, tick
    return [packet]
