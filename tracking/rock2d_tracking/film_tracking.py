"""Tracking a whole film, for the command `rock2d track` and the function `rock2d.track`."""

import json
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from rock2d.arrays import Array
from rock2d.errors import InputError, counted
from rock2d.files.experiment import write_experiment_files
from rock2d.files.folders import atomic_folder, write_whole
from rock2d.kinematics.film_findings import write_film_findings
from rock2d.kinematics.flight_gravity import Measured
from rock2d.progress import Bars
from rock2d.records.columns import POSE_NAMES
from rock2d_tracking.camera import STRONGEST_BARREL
from rock2d_tracking.explanation import TrackingAttempt, keys_to_try, proposed, why_not_tracked, write_explanation
from rock2d_tracking.film_reading import Clock, FilmFile, Frames, Stamps
from rock2d_tracking.film_scale import FilmScale, proposal
from rock2d_tracking.film_tables import MID_AIR
from rock2d_tracking.first_setup import FirstSetup, ground_of
from rock2d_tracking.following import Follower, motion_for_setup
from rock2d_tracking.lens import lens_distortion
from rock2d_tracking.live_frames import LiveFrames, live_frames
from rock2d_tracking.looks import ChannelMix, Looks
from rock2d_tracking.motion import Motion, motion_of
from rock2d_tracking.overlay import Overlay
from rock2d_tracking.setup_file import LARGEST_DISTORTION, Setup
from rock2d_tracking.sights import FollowedRelease
from rock2d_tracking.stabilisation import camera_shifts
from rock2d_tracking.tracked_film import TrackedFilm, check_sanity, moving_releases, rescaled, tracked_film

PAGE, OVERLAY = "tracking.html", "overlay.webm"
GREY = ChannelMix()
TRACKED = "tracked film"  # kind of a folder of results
GRAVITY_ROUNDS = 2  # the scale from gravity changes which frames are flights, and these the scale
SIZE_WORTH_A_REMARK = 0.01  # relative difference between visible and stated size
# purpose of each reading of a film -> relative duration, for the progress bars
PASSES = {
    "looking at the background": 0.5,
    "finding what moves": 1.0,
    "learning looks": 0.4,
    "following": 0.7,
    "pictures for the page": 0.1,
}


@dataclass(frozen=True)
class FilmTrack:
    """The result of tracking a film.

    Attributes
    ----------
    film : set-up that was used or guessed, frames, experiment, flights, impacts, findings and remarks
    looks : how each block was recognised
    overlay : WebM of the film with the tracked outlines
    still : (height, width) uint8, the first frame
    live : the frames for the page"""

    film: TrackedFilm
    looks: Mapping[str, Looks]
    overlay: bytes
    still: Array
    live: LiveFrames

    def counts(self) -> str:
        """Releases, frames, flights and impacts in words."""
        film, frames = self.film, self.film.frames
        return (
            f"{counted(frames['release'].nunique(), 'release')}, {(frames['reason'] == '').sum()} of "
            f"{counted(len(frames), 'frame')} trusted, {counted(len(film.flights), 'flight')}, "
            f"{counted((film.impacts['flag'] != MID_AIR).sum(), 'impact')}"
        )

    def write(self, folder: Path, also: Callable[[Path], None] = lambda folder: None) -> None:
        """Write the experiment folder with tables, page and overlay, completely or not at all; `also` writes further
        files into the folder that is passed to it."""
        film = self.film
        with atomic_folder(folder, TRACKED) as partial:
            write_experiment_files(partial, film.experiment)
            write_film_findings(partial, film.findings)
            self._write_metadata(partial / "track.json")
            frames = film.frames.drop(columns=list(POSE_NAMES))
            tables = {"frames": frames, "flights": film.flights, "measured_impacts": film.impacts}
            for name, table in tables.items():
                table.to_csv(partial / f"{name}.csv", index=False, lineterminator="\n", float_format="%.9g")
            self.write_page(partial)
            film.setup.write(partial)
            also(partial)

    def write_page(self, folder: Path) -> None:
        """Write the page of diagnostics and its overlay."""
        from rock2d_tracking.page import write_page

        (folder / OVERLAY).write_bytes(self.overlay)
        write_page(folder / PAGE, self.film, self.still, self.live)

    def _write_metadata(self, path: Path) -> None:
        """Write how each block was recognised, and the possible common offset of its positions."""
        blocks = {
            name: {
                "fit": self.looks[name].kind,
                "radius_px": self.looks[name].outline.radius_px,
                "position_error_px": offset_px,
                "position_error_m": offset_px * self.film.setup.metres_per_pixel,
            }
            for name, offset_px in self.film.offset_px.items()
        }
        write_whole(path, json.dumps({"blocks": blocks}, indent=1, allow_nan=False) + "\n")


class NotTrackedError(InputError):
    """A film in which nothing can be tracked; `write` writes an explanation."""

    def __init__(self, error: InputError, seen: TrackingAttempt, setup: Setup, overlay: bytes | None = None) -> None:
        keys = ", ".join(text.split(":")[0] for text in keys_to_try(seen))
        self._said, self._seen, self._setup, self._overlay = str(error), seen, setup, overlay
        super().__init__(f"{error.message}; keys to try next: {keys}", error.file)

    def write(self, folder: Path) -> None:
        """Write the explanation into a folder, completely or not at all."""
        with atomic_folder(folder, TRACKED) as inside:
            write_explanation(inside, self._seen, self._said)
            self._setup.write(inside)
            if self._overlay is not None:
                (inside / OVERLAY).write_bytes(self._overlay)


class ShownFrames(Frames):
    """Frames with a progress bar for each reading; `passes`: the titles of the readings."""

    def __init__(self, film: FilmFile, last: int | None, bars: Bars, passes: Sequence[str]) -> None:
        super().__init__(film, last)
        self._bars, self._passes = bars, iter(passes)
        self._length = min(film.expected_frames, last or film.expected_frames)

    def __iter__(self) -> Iterator[Array]:
        with self._bars.stage(next(self._passes, "reading again"), self._length, "frames") as bar:
            yield from bar.counted(super().__iter__())


class Start(NamedTuple):
    """The state before the blocks of a film are followed.

    Attributes
    ----------
    follower : follows them with a set-up
    setup_of : gives the set-up from the followed releases, scale and frame rate
    guessed : whether the set-up is guessed from the film"""

    follower: Follower
    setup_of: Callable[[list[FollowedRelease], FilmScale], Setup]
    guessed: bool = False


def track_film(
    video: Path, known: Setup | FilmScale, last: int | None = None, *, progress: bool = False
) -> tuple[FilmTrack, TrackingAttempt]:
    """Track a film; also returns the attempt that `explanation.write_explanation` explains.

    known : the set-up; or scale and frame rate, from which a set-up is guessed. If one of these is None, it is computed
        from gravity
    last : number of frames after which to stop, None for all

    Raises NotTrackedError if nothing can be tracked, InputError if the file is not a film."""
    film = FilmFile(video)
    known = known.for_images(film.size_px) if isinstance(known, Setup) else known
    frames = ShownFrames(film, last, Bars(progress, PASSES), list(PASSES))
    frames.shifts_px = camera_shifts(frames, film.expected_frames)
    asked = known.scale if isinstance(known, Setup) else known
    stamps = frames.stamps(asked.fps)
    if isinstance(known, Setup):
        start = _start_with_setup(film, frames, known, stamps.clock)
    else:
        start = _start_with_scale(film, frames, known, stamps.clock)
    return _track(film, frames, start, asked, stamps)


def _start_with_setup(film: FilmFile, frames: Frames, setup: Setup, clock: Clock) -> Start:
    motion = motion_for_setup(frames, setup, film.expected_frames, clock)
    if not motion.scale.g_px_frame2:
        raise NotTrackedError(_nothing_falls(film, motion), TrackingAttempt(frames, motion), setup)
    whole = setup.with_scale(motion.scale)
    follower = Follower(frames, whole, film.size_px, motion, cut=frames.cut)
    return Start(follower, lambda releases, scale: whole.with_scale(scale))


def _start_with_scale(film: FilmFile, frames: Frames, asked: FilmScale, clock: Clock) -> Start:
    """The start of a film without a set-up file."""
    motion = motion_of(frames, film.expected_frames, [], asked, clock)
    if not motion.scale.g_px_frame2:
        raise _nothing_falls(film, motion)
    first = FirstSetup(film, motion, asked, motion.scale)
    if not motion.chains:
        seen = TrackingAttempt(frames, motion)
        raise NotTrackedError(_nothing_falls(film, motion), seen, first.setup())
    follower = Follower(frames, first.setup(), film.size_px, motion)
    sized = replace(first, size=follower.looks["ball"].size)
    follower.setup = sized.setup()

    def with_ground(releases: list[FollowedRelease], scale: FilmScale) -> Setup:
        return replace(sized, scale=scale, ground_px=ground_of(releases, scale.g_px_frame2)).setup()

    return Start(follower, with_ground, guessed=True)


def _nothing_falls(film: FilmFile, motion: Motion) -> InputError:
    """The error that nothing falls, with a proposal for the scale or frame rate."""
    if not motion.scale.g_px_frame2:
        return InputError("nothing was seen to fall in this film, so that gravity gives no scale", film.path)
    scale, fps, _ = motion.scale
    said = f"nothing was seen to fall in this film with {scale:g} m per pixel and {fps:g} frames/s"
    bent = [arc for arc in motion.arcs if arc.falls_otherwise and arc.gravity_ratio > 0]
    if bent:
        said += f". Something falls otherwise: {proposed(motion, bent).sentence(options=True)}"
    return InputError(said, film.path)


def _track(
    film: FilmFile, frames: Frames, start: Start, asked: FilmScale, stamps: Stamps
) -> tuple[FilmTrack, TrackingAttempt]:
    follower, guessed = start.follower, start.guessed
    still, overlay = _follow_releases(film, frames, follower)
    seen = TrackingAttempt(frames, follower.motion, follower)
    for sight in (s for release in follower.releases for s in release.sights):
        sight.when = float(stamps.clock(sight.frame))
        sight.number_in_file, sight.frame = sight.frame, int(stamps.numbers[sight.frame])
    try:
        kept = moving_releases(follower.releases, follower.g_px_frame2)
        if not kept:
            raise InputError(why_not_tracked(follower), film.path)
        found = _tracked_film(film, kept, start, asked)
        found.remarks.extend([stamps.remark] if stamps.remark else [])
        if frames.shifts_px is not None:
            found.remarks.append(
                f"the camera moved by {np.sqrt(frames.shifts_px.var(axis=0).sum()):.2g} px (root mean square): its "
                "motion, read from the background, was taken out; places are those in the first frame"
            )
        found.remarks.extend(_remarks_on_looks(follower.looks, sized=not guessed))
        found.remarks.extend(check_sanity(found.experiment, found.setup, guessed=guessed))
    except InputError as error:
        raise NotTrackedError(error, seen, follower.setup, overlay) from None
    found.remarks.extend(_remarks_on_scale(found, options=guessed))
    found.remarks.extend(_remarks_on_lens(found, film.size_px))
    numbers = np.array([sight.number_in_file for release in kept for sight in release.sights])
    live = live_frames(frames, found, numbers, follower.looks, still)
    return FilmTrack(found, follower.looks, overlay, still, live), seen


def _tracked_film(film: FilmFile, kept: list[FollowedRelease], start: Start, asked: FilmScale) -> TrackedFilm:
    """The film of the releases that moved. A scale or frame rate that is not stated is computed from the acceleration
    of the flights.

    Raises InputError if it is not stated and no flight shows gravity clearly."""
    follower = start.follower
    setup = start.setup_of(kept, follower.motion.scale)
    found = tracked_film(kept, len(follower.releases), setup, film.size_px)
    given = setup.from_gravity
    for _ in range(GRAVITY_ROUNDS if given is not None else 0):
        said = found.findings
        if said.ratio is None:
            raise InputError("no flight shows gravity clearly: state both scale and frame rate", film.path)
        scale = asked.completed(found.setup.scale.g_px_frame2 * said.ratio.value)
        error = said.unexplained_error / said.ratio.value * (0.5 if asked.fps is None else 1.0)
        setup = start.setup_of(kept, scale).with_scale(scale, error)
        found = rescaled(found, setup, film.size_px)
    return found


def _follow_releases(film: FilmFile, frames: Frames, follower: Follower) -> tuple[Array, bytes]:
    """Follow the releases; returns the first frame in grey, and the overlay."""
    still: list[Array] = []
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / OVERLAY
        with closing(Overlay(path, follower.setup, film.size_px, film.expected_frames)) as overlay:

            def on_progress(number: int, frame: Array, release: FollowedRelease | None) -> None:
                if not still:
                    still.append(GREY(frame))
                overlay.draw(number, frame, release)

            follower.follow(frames, on_progress)
        return still[0], path.read_bytes()


def _remarks_on_scale(film: TrackedFilm, *, options: bool) -> list[str]:
    """Remarks on a wrong scale or frame rate with the right values, and on a scale computed from gravity."""
    said, setup = film.findings, film.setup
    if said.off and said.ratio is not None:
        ratio = Measured(said.ratio.value, said.unexplained_error)
        return [proposal(setup.scale, ratio).sentence(options=options)]
    given = setup.from_gravity
    if given is not None and given.which == "scale":
        return [f"a pixel is {setup.metres_per_pixel:.6g} m, ± {100 * given.relative_error:.2g} %"]
    return []


def _remarks_on_lens(film: TrackedFilm, size_px: tuple[int, int]) -> list[str]:
    """A remark if a lens seems to distort the flights and no distortion is stated."""
    if film.setup.keys.camera.distortion is not None:
        return []
    segments = film.segments
    k = lens_distortion(segments.film, segments.flights, film.setup.pixel_map(size_px), size_px)
    if k is None or not STRONGEST_BARREL <= k.value <= LARGEST_DISTORTION:
        return []
    return [
        f"flights are bent as a lens with distortion k = {k.value:.3f} ± {k.error:.3f} bends them; it was not "
        f"taken out. If the lens is a wide one, state `camera: distortion: {{k: {k.value:.3f}}}`; "
        "`metres_per_pixel` is then the scale in the middle of the picture. A rolling shutter, air or a camera at a "
        "slant may do the same"
    ]


def _remarks_on_looks(blocks: Mapping[str, Looks], *, sized: bool) -> list[str]:
    """Remarks on the size and recognition of blocks; `sized`: whether their sizes were stated."""
    remarks = []
    for name, looks in blocks.items():
        if sized and abs(looks.size - 1.0) > max(SIZE_WORTH_A_REMARK, 3 * looks.size_error):
            remarks.append(
                f"block {name} is seen {looks.size:.3f} (± {looks.size_error:.3f}) times as large as its size and the "
                "scale say; it was tracked in the size that is seen"
            )
        if looks.kind == "picture":
            remarks.append(
                f"the outline of block {name} cannot be fitted; it was tracked by its learned picture, "
                f"without its turn; its centroid in this picture is known to {looks.bias_px:.2f} px: all its positions "
                "may be off alike by so much, velocities and g are not"
            )
    return remarks
