"""The commands `rock2d track`, `film`, `import` and `export`."""

from __future__ import annotations

import json
import tempfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from rock2d.errors import InputError, counted
from rock2d.files.experiment import Experiment, write_experiment_files
from rock2d.files.folders import atomic_folder, check_file, check_folder, write_whole
from rock2d.kinematics.flight_gravity import Measured
from rock2d.progress import Bars
from rock2d_tracking.camera import PixelMap
from rock2d_tracking.explanation import TrackingAttempt
from rock2d_tracking.film_reading import FilmFile, Frames
from rock2d_tracking.film_scale import FilmScale, proposal
from rock2d_tracking.following import Followed, Prepared, followed, motion_in, prepared
from rock2d_tracking.looks import ChannelMix
from rock2d_tracking.motion import Motion
from rock2d_tracking.setup_file import Setup
from rock2d_tracking.sights import FollowedRelease
from rock2d_tracking.steadying import camera_ways

if TYPE_CHECKING:
    from rock2d.kinematics.film_findings import FilmFindings
    from rock2d.kinematics.film_segments import FilmSegments
    from rock2d_tracking.importing import ImportOptions, TrackedFiles
    from rock2d_tracking.tracked_film import TrackedFilm

Array = np.ndarray
Report = Callable[[str], None]

GREY = ChannelMix()
GRAVITY_ROUNDS = 2  # in which the scale that gravity gives changes what counts as a flight
SIZE_WORTH_A_REMARK = 0.01  # share by which a block is seen larger or smaller than stated
VIEW_MARGIN = 0.08  # share of the picture that stays free on each side of the motion
FILM_REST_FRAMES = 60  # empty frames before each release of a synthetic film
FILM_PLAYED_FPS = 25
# why a film is read, with the time that this takes, relative to each other
PASSES = {
    "looking at the background": 0.5,
    "finding what moves": 1.0,
    "learning looks": 0.4,
    "following": 0.7,
}


class TrackedSetup(NamedTuple):
    """What is known of a film before its blocks are followed, and the set-up after that.

    Attributes
    ----------
    setup : set-up with which they are followed
    setup_of : the set-up of what was followed, with scale and frame rate
    guessed : whether it is guessed from the film
    """

    setup: Setup
    prepared: Prepared
    setup_of: Callable[[list[FollowedRelease], FilmScale], Setup]
    guessed: bool = False

    @property
    def asked(self) -> FilmScale:
        """Scale and frame rate without what gravity gives."""
        setup = self.setup
        given = setup.from_gravity.which if setup.from_gravity is not None else ""
        scale, fps, gravity = setup.scale
        return FilmScale(None if given == "scale" else scale, None if given == "fps" else fps, gravity)


class FilmFormat(NamedTuple):
    """Format of a synthetic film: size of its pictures (width, height) and number of releases, None for all."""

    size_px: tuple[int, int]
    releases: int | None


@dataclass(frozen=True)
class TrackSettings:
    """How to track.

    Attributes
    ----------
    last : number of frames after which to stop, None for all
    explain : whether to write what was seen of the film also where it can be tracked
    progress : whether to show a progress bar
    report : what is called with every line for the user
    """

    last: int | None = None
    explain: bool = False
    progress: bool = False
    report: Report = print


class ShownFrames(Frames):
    """Frames with a bar for each time that they are read; `passes`: what for."""

    def __init__(self, film: FilmFile, last: int | None, bars: Bars, passes: Sequence[str]) -> None:
        super().__init__(film, last)
        self._bars, self._passes = bars, iter(passes)
        self._length = min(film.expected_frames, last or film.expected_frames)

    def __iter__(self) -> Iterator[Array]:
        with self._bars.stage(next(self._passes, "reading again"), self._length, "frames") as bar:
            yield from bar.counted(super().__iter__())


def track(video: Path, config: Path | FilmScale, out: Path, settings: TrackSettings) -> None:
    """Track a film into the experiment folder `out`; whole or not at all.

    `config`: the set-up file, or scale and frame rate, from which one is written into `out`. Of the two, gravity gives
    the one that is not known. Where nothing can be tracked, what was seen of the film goes to `OUT_explained`. Raises
    `InputError` for input that cannot be used.
    """
    film = FilmFile(video)
    frames = ShownFrames(film, settings.last, Bars(settings.progress, PASSES), list(PASSES))
    check_folder(out)
    frames.ways_px = camera_ways(frames, film.expected_frames)
    if isinstance(config, Path):
        setup = Setup(config)
        motion = motion_in(frames, setup, film.expected_frames, frames.stamps(setup.scale.fps).clock)
        if not motion.scale.fall_px:
            raise _explained(_no_fall(film), out, TrackingAttempt(frames, motion, None, None), [config])
        setup = setup.with_scale(motion.scale)
        known = prepared(frames, setup, film.size_px, motion)
        own = TrackedSetup(setup, known, lambda releases, scale: setup.with_scale(scale))
        _track(film, frames, own, out, settings)
        return
    with tempfile.TemporaryDirectory() as folder:
        _track_first(film, frames, config, Path(folder), out, settings)


def _track_first(
    film: FilmFile, frames: Frames, asked: FilmScale, folder: Path, out: Path, settings: TrackSettings
) -> None:
    """Track a film without a set-up file; one is written in `folder` on the way."""
    from rock2d_tracking.first_setup import FirstSetup, first_motion, ground_of

    motion = first_motion(film, frames, asked)
    if not motion.scale.fall_px:
        raise _no_fall(film)
    first = FirstSetup(folder / "setup.yaml", film, motion, asked, motion.scale)
    setup = first.written()
    if not motion.chains:
        error = _no_fall(film, motion)
        raise _explained(error, out, TrackingAttempt(frames, motion, None, None), [setup.path])
    known = prepared(frames, setup, film.size_px, motion)
    first = replace(first, size=known.looks["ball"].size)

    def with_ground(releases: list[FollowedRelease], scale: FilmScale) -> Setup:
        return replace(first, scale=scale, ground_px=ground_of(releases, scale.fall_px)).written()

    _track(film, frames, TrackedSetup(first.written(), known, with_ground, guessed=True), out, settings)
    settings.report(f"set-up file to refine: {out / 'setup.yaml'}")


def _no_fall(film: FilmFile, motion: Motion | None = None) -> InputError:
    """That nothing falls, and what would let it fall."""
    from rock2d_tracking.explanation import proposed

    if motion is None or motion.scale.fall_px == 0.0:
        return InputError("nothing was seen to fall in this film, so that gravity gives no scale", film.path)
    scale, fps, _ = motion.scale
    said = f"nothing was seen to fall in this film with {scale:g} m per pixel and {fps:g} frames/s"
    bent = [arc for arc in motion.arcs if arc.other and arc.gravity_ratio > 0]
    if bent:
        said += f". Something falls otherwise: {proposed(motion, bent).sentence(options=True)}"
    return InputError(said, film.path)


def _track(film: FilmFile, frames: Frames, known: TrackedSetup, out: Path, settings: TrackSettings) -> None:
    from rock2d.kinematics.film_findings import write_film_findings
    from rock2d_tracking.explanation import why_not_tracked, write_explanation
    from rock2d_tracking.overlay import Overlay
    from rock2d_tracking.page import write_page
    from rock2d_tracking.tracked_film import film_of, moving_releases
    from rock2d_tracking.velocities import MID_AIR, flights_and_impacts

    setup = known.setup
    stamps = frames.stamps(setup.scale.fps if setup.from_gravity is None else None)
    with atomic_folder(out) as folder:
        still: list[Array] = []
        with closing(Overlay(folder / "overlay.webm", setup, film.size_px, film.expected_frames)) as overlay:

            def on_progress(number: int, frame: Array, release: FollowedRelease | None) -> None:
                if not still:
                    still.append(GREY(frame))
                overlay.draw(number, frame, release)

            found_in_film = followed(frames, known.prepared, on_progress)
        seen = TrackingAttempt(frames, found_in_film.motion, found_in_film, setup)
        for sight in (s for release in found_in_film.releases for s in release.sights):
            sight.when = float(stamps.clock(sight.frame))
            sight.frame = int(stamps.numbers[sight.frame])
        try:
            kept = moving_releases(found_in_film.releases, setup.fall_px)
            if not kept:
                raise InputError(why_not_tracked(found_in_film), film.path)
            found, said, setup = _experiment_of(film, kept, len(found_in_film.releases), known)
            found.remarks.extend([stamps.remark] if stamps.remark else [])
            if frames.ways_px is not None:
                found.remarks.append(
                    f"the camera moved by {np.sqrt(frames.ways_px.var(axis=0).sum()):.2g} px (root mean square): its "
                    "motion, read from the background, was taken out; places are those in the first frame"
                )
            found.remarks.extend(_remarks_on_looks(found_in_film, sized=not known.guessed))
            found.remarks.extend(_check_sanity(found.experiment, setup, guessed=known.guessed))
            if said.off and said.ratio is not None:
                ratio = Measured(said.ratio.value, said.unexplained_error)
                found.remarks.append(proposal(setup.scale, ratio).sentence(options=known.guessed))
            if setup.from_gravity is not None and setup.from_gravity.which == "scale":
                found.remarks.append(
                    f"a pixel is {setup.metres_per_pixel:.6g} m, ± {100 * setup.from_gravity.relative_error:.2g} %"
                )
        except InputError as error:
            raise _explained(error, out, seen, [folder / "overlay.webm", setup.path]) from None
        flights, impacts, data = flights_and_impacts(film_of(found.experiment, setup), found.experiment)
        found.remarks.extend(_remarks_on_lens(data, setup, film.size_px))
        write_experiment_files(folder, found.experiment)
        write_film_findings(folder, said)
        _write_metadata(folder / "track.json", found, found_in_film, setup)
        for name, table in (("frames", found.frames), ("flights", flights), ("measured_impacts", impacts)):
            table.to_csv(folder / f"{name}.csv", index=False, lineterminator="\n", float_format="%.9g")
        write_page(folder / "tracking.html", found, flights, impacts, data, still[0])
        trusted = (found.frames["reason"] == "").sum()
        counts = (
            f"{counted(found.frames['release'].nunique(), 'release')}, {trusted} of "
            f"{counted(len(found.frames), 'frame')} trusted, {counted(len(flights), 'flight')}, "
            f"{counted((impacts['flag'] != MID_AIR).sum(), 'impact')}"
        )
        if settings.explain:
            write_explanation(folder, seen, counts)
        if setup.path.parent != out:
            (folder / "setup.yaml").write_bytes(setup.path.read_bytes())
    report = settings.report
    report(counts)
    _report_findings(said, report)
    for remark in found.remarks:
        report(f"note: {remark}")
    report(f"written: {out}")


def _experiment_of(
    film: FilmFile, kept: list[FollowedRelease], followed: int, known: TrackedSetup
) -> tuple[TrackedFilm, FilmFindings, Setup]:
    """The experiment that a film shows, what it says of itself, and the set-up. Scale or frame rate are those with
    which flights show gravity, if they are not stated.

    Raises `InputError` if flights are to give them and none shows gravity clearly.
    """
    from rock2d_tracking.tracked_film import rescaled, tracked_film

    setup = known.setup_of(kept, known.prepared.motion.scale)
    found = tracked_film(kept, followed, setup, film.size_px)
    said = _findings(found.experiment, setup)
    given = setup.from_gravity
    if given is None:
        return found, said, setup
    for _ in range(GRAVITY_ROUNDS):
        if said.ratio is None:
            raise InputError("no flight shows gravity clearly: state both scale and frame rate", film.path)
        fall_px, before = setup.scale.fall_px * said.ratio.value, setup
        error = said.unexplained_error / said.ratio.value * (0.5 if given.which == "fps" else 1.0)
        scale = known.asked.given(fall_px)
        setup = known.setup_of(kept, scale).with_scale(scale, error)
        found = rescaled(found, before, setup, film.size_px)
        said = _findings(found.experiment, setup)
    return found, said, setup


def _findings(experiment: Experiment, setup: Setup) -> FilmFindings:
    from rock2d.kinematics.film_findings import film_findings
    from rock2d.kinematics.film_segments import FilmSegments
    from rock2d.kinematics.setup_world import setup_world
    from rock2d_tracking.tracked_film import film_of

    world = setup_world(experiment)
    data = FilmSegments.of(film_of(experiment, setup), world)
    return film_findings(data, world, experiment.fps, experiment.from_gravity)


def _write_metadata(path: Path, film: TrackedFilm, followed: Followed, setup: Setup) -> None:
    """Write how each block was found, and by how much all its positions may be off alike."""
    blocks = {}
    for name, offset_px in film.offset_px.items():
        looks = followed.looks[name]
        blocks[name] = {
            "fit": looks.kind,
            "radius_px": float(np.sqrt(looks.outline.area_px2 / np.pi)),
            "position_error_px": offset_px,
            "position_error_m": offset_px * setup.metres_per_pixel,
        }
    write_whole(path, json.dumps({"blocks": blocks}, indent=1, allow_nan=False) + "\n")


def _report_findings(said: FilmFindings, report: Report) -> None:
    for line in said.sentences():
        report(f"film: {line}")


def _remarks_on_looks(followed: Followed, *, sized: bool) -> list[str]:
    """What a user should know of how blocks look; `sized`: whether their sizes were stated."""
    remarks = []
    for name, looks in followed.looks.items():
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


def _remarks_on_lens(data: FilmSegments, setup: Setup, size_px: tuple[int, int]) -> list[str]:
    """That flights are bent as by a lens, if none is stated."""
    from rock2d_tracking.lens import lens_bend

    if setup.keys.camera.distortion is not None:
        return []
    bend = lens_bend(data.film, data.segmentation.flights, setup.pixel_map(size_px), size_px)
    if bend is None:
        return []
    return [
        f"flights are bent as a lens with distortion k = {bend.value:.3f} ± {bend.error:.3f} bends them; it was not "
        f"taken out. If the lens is a wide one, state `camera: distortion: {{k: {bend.value:.3f}}}`, and measure the "
        "scale near the middle of the picture. A rolling shutter, air or a camera at a slant may do the same"
    ]


def _explained(error: InputError, out: Path, seen: TrackingAttempt, files: Sequence[Path]) -> InputError:
    """The error, with a word on the folder that explains what was seen of the film; `files` are copied into it, the
    set-up file last."""
    from rock2d_tracking.explanation import keys_to_try, write_explanation

    folder = out.with_name(f"{out.name}_explained")
    with atomic_folder(folder) as inside:
        write_explanation(inside, seen, str(error))
        for path in files[:-1]:
            (inside / path.name).write_bytes(path.read_bytes())
        (inside / "setup.yaml").write_bytes(files[-1].read_bytes())
    keys = ", ".join(text.split(":")[0] for text in keys_to_try(seen))
    return InputError(f"{error.message}. What was seen: {folder}; keys to try next: {keys}", error.file)


def film(
    experiment_folder: Path,
    out: Path,
    film_format: FilmFormat,
    *,
    faults: str,
    seed: int,
    progress: bool,
    report: Report,
) -> None:
    """Film an experiment synthetically: `out` (AVI), its truth beside it (CSV), and a set-up file to track it with.

    `faults`: one of `FAULT_LEVELS`. Raises `InputError` for an experiment that cannot be filmed.
    """
    from rock2d.files.experiment import load_experiment, seen_frames
    from rock2d_tracking.setup_writing import write_setup
    from rock2d_tracking.synthetic.faults import FAULT_LEVELS
    from rock2d_tracking.synthetic.film import FilmOptions, film_frames, write_film

    experiment = load_experiment(experiment_folder)
    if experiment.trajectories is None:
        raise InputError("holds impacts only; an experiment with trajectories is needed", experiment_folder)
    table = seen_frames(experiment)
    experiment = replace(experiment, trajectories=table)
    for suffix in (".avi", ".csv", ".yaml"):
        check_file(out.with_suffix(suffix))
    numbers = table["release"].unique()[: film_format.releases].tolist()
    camera = _whole_view(experiment, film_format.size_px)
    options = FilmOptions(seed, FAULT_LEVELS[faults], releases=numbers, rest_frames=FILM_REST_FRAMES)
    shots = film_frames(experiment, camera, film_format.size_px, options)
    length = int(table["release"].isin(numbers).sum()) + FILM_REST_FRAMES * len(numbers)
    with Bars(progress).stage("filming", length, "frames") as bar:
        size_px, quality = film_format.size_px, options.faults.quality
        write_film(out, bar.counted(shots), size_px, FILM_PLAYED_FPS, quality, truth=True)
    setup = out.with_suffix(".yaml")
    first = table.groupby("release")["block"].first()
    write_setup(setup, experiment, camera, [str(first[n]) for n in numbers])
    report(f"written: {out}, {out.with_suffix('.csv')} (truth), {setup}")


def _whole_view(experiment: Experiment, size_px: tuple[int, int]) -> PixelMap:
    """A camera that sees the whole motion."""
    table = experiment.trajectories
    assert table is not None
    reach = max(b.radius_m for b in experiment.blocks.values())
    low = np.array([table["x_m"].min(), table["y_m"].min()]) - 2 * reach
    high = np.array([table["x_m"].max(), table["y_m"].max()]) + 2 * reach
    scale = float(((high - low) / ((1 - 2 * VIEW_MARGIN) * np.array(size_px))).max())
    return PixelMap(
        scale, (VIEW_MARGIN * size_px[0], (1 - VIEW_MARGIN) * size_px[1]), (float(low[0]), float(low[1]))
    )


def import_files(
    files: TrackedFiles,
    config: Path,
    out: Path,
    options: ImportOptions,
    *,
    block: str | None = None,
    report: Report,
) -> None:
    """Turn what another program tracked into the experiment folder `out`; scale and frame rate are those of the set-up.

    `block`: name of the block; without it that of the first release. Raises `InputError` for input that cannot be used.
    """
    from rock2d.kinematics.film_findings import write_film_findings
    from rock2d_tracking.importing import CameraScale, import_tracks
    from rock2d_tracking.tracked_film import film_of, with_measured_noise

    setup = Setup(config)
    if setup.from_gravity is not None:
        raise InputError("import needs scale and frame rate: gravity gives them only of a film", config)
    check_folder(out)
    name = block or setup.block_of(0)
    if name not in setup.blocks:
        raise InputError(f"--block: expected one of {', '.join(setup.blocks)}, found {name!r}", config)
    camera = setup.keys.camera
    (u, v), (x_m, y_m) = camera.origin_px, camera.origin_m
    scale = CameraScale(setup.metres_per_pixel, setup.fps, (u, v), (x_m, y_m))
    table = import_tracks(files, scale, setup.blocks[name], options, report=report)
    stated = Experiment(
        setup.keys.name, setup.keys.gravity_m_s2, setup.fps, setup.metres_per_pixel, np.deg2rad(1.0),
        setup.cross_section, {name: setup.blocks[name]}, trajectories=table,
    )  # fmt: skip
    found = with_measured_noise(film_of(stated, setup), stated)
    _check_sanity(found, setup)
    said = _findings(found, setup)
    with atomic_folder(out) as folder:
        write_experiment_files(folder, found)
        write_film_findings(folder, said)
    report(f"{counted(table['release'].nunique(), 'release')}, {counted(len(table), 'frame')}")
    _report_findings(said, report)
    report(f"written: {out}")


def export_tracker(experiment_folder: Path, out: Path, *, report: Report) -> None:
    """Write the trajectories of an experiment for Tracker (Open Source Physics)."""
    from rock2d.files.experiment import load_experiment, seen_frames
    from rock2d_tracking.importers.tracker import write_tracker

    experiment = load_experiment(experiment_folder)
    if experiment.trajectories is None:
        raise InputError(
            "holds impacts only; Tracker needs an experiment with trajectories", experiment_folder
        )
    check_file(out)
    for path in write_tracker(out, seen_frames(experiment), experiment.fps):
        report(f"written: {path}")


def _check_sanity(experiment: Experiment, setup: Setup, *, guessed: bool = False) -> list[str]:
    """Remarks on an experiment; raises `InputError` where frame rate, scale or axes must be wrong. `guessed`: whether
    the ground is a guess, against which nothing can be held."""
    from rock2d.kinematics.sanity import ABOVE_GROUND, FEW_RELEASES, check_film
    from rock2d_tracking.tracked_film import film_of

    sanity = check_film(experiment, film_of(experiment, setup))
    harmless = {FEW_RELEASES, ABOVE_GROUND} if guessed else {FEW_RELEASES}
    wrong = [fault.message for fault in sanity.faults if fault.code not in harmless]
    if wrong:
        raise InputError("; ".join(wrong), setup.path)
    if sanity.mirror:
        raise InputError(
            f"seen with {sanity.mirror} mirrored, blocks would fall and stay above the ground: "
            "is the film upside down (camera: up), or was it filmed from behind?",
            setup.path,
        )
    if sanity.registered is not None:
        raise InputError(sanity.remarks[-1], setup.path)
    return sanity.remarks
