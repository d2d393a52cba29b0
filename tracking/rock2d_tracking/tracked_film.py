"""The experiment of a tracked film: metres, seconds, and only trusted frames."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import pandas as pd

from rock2d.arrays import Array
from rock2d.errors import InputError, comma_list, counted
from rock2d.files.experiment import TRAJECTORY_COLUMNS, Experiment
from rock2d.kinematics.film_findings import FilmFindings, film_findings
from rock2d.kinematics.film_segments import FilmSegments
from rock2d.kinematics.flights import FEWEST_FLIGHT_FRAMES, Film, find_flights, load_film
from rock2d.kinematics.sanity import ABOVE_GROUND, FEW_RELEASES, check_film
from rock2d.kinematics.setup_world import setup_world
from rock2d.records.columns import POSE_NAMES
from rock2d.statistics import noise_of_path
from rock2d_tracking.film_tables import flights_table, measured_impacts_table
from rock2d_tracking.gross_errors import reject_gross_errors
from rock2d_tracking.setup_file import Setup
from rock2d_tracking.sights import FollowedRelease, Sight, set_errors, shows_release

# largest standard error of a coordinate of a trusted frame: in px, or in radii of the block if that is more
LARGEST_STATED_ERROR_PX, LARGEST_STATED_ERROR_RADII = 1.0, 0.05
COMPARED_STEPS = 3  # steps on each side with which a step is compared
SMALLEST_NOISE_PX = 0.01  # noise of the positions in a film without noise
SMALLEST_STEP_SIGMA_PX = 0.02  # noise of the steps in a film without noise
WHOLE_FRAME = 0.3  # distance of a duration from a whole number of frames that makes it this number
LARGEST_DURATION_ERROR = 0.1  # in frames
PARALLEL = 0.01  # ratio of singular values below which two velocities have one direction
# standard error of the position of a smeared block, over the length of the smear: root mean square in synthetic films
# (shiny balls 0.09, uniform ones 0.015)
SMEAR_OFFSET = 0.045


@dataclass
class TrackedFilm:
    """The experiment that was tracked in a film.

    Attributes
    ----------
    setup : with which pixels and frames were converted
    frames : a row for each frame of a release: release, block, frame, t_s, u_px, v_px, angle_px_rad, their standard
        errors, confidence, reason ("" or why the frame is lost); x_m, y_m, theta_rad, NaN where it is lost
    experiment : its trusted frames, with the noise found in its flights
    segments, findings : its flights and impacts, and findings on the film, such as its accuracy
    remarks : for the user
    offset_px : block -> standard error of a coordinate that all its frames share"""

    setup: Setup
    frames: pd.DataFrame
    experiment: Experiment
    segments: FilmSegments
    findings: FilmFindings
    remarks: list[str]
    offset_px: dict[str, float]

    @cached_property
    def flights(self) -> pd.DataFrame:
        """See `film_tables.flights_table`."""
        return flights_table(self.experiment, self.segments, self.findings.gravity)

    @cached_property
    def impacts(self) -> pd.DataFrame:
        """See `film_tables.measured_impacts_table`."""
        return measured_impacts_table(self.experiment, self.segments)


def tracked_film(kept: Sequence[FollowedRelease], followed: int, setup: Setup, size_px: tuple[int, int]) -> TrackedFilm:
    """The experiment of a film.

    kept : its `moving_releases`, at least one
    followed : number of objects that were followed"""
    remarks: list[str] = []
    if len(kept) < followed:
        remarks.append(
            f"{followed - len(kept)} of {counted(followed, 'object')} that were followed never moved, or were trusted "
            f"in fewer than {FEWEST_FLIGHT_FRAMES} frames, and are left out"
        )
    remarks += remarks_on_names([release.block for release in kept], setup)
    missing = 0
    for release in kept:
        missing += renumber_dropped(release.sights, setup.blocks[release.block].radius_m / setup.metres_per_pixel)
    if missing:
        remarks.append(f"{counted(missing, 'frame')} missing in the film: blocks moved too far for the time there")
    fps = setup.fps
    frames = pd.concat([_frames(k, release, fps) for k, release in enumerate(kept)], ignore_index=True)
    if not setup.keys.detection.marks and any(setup.blocks[p.block].shape == "circle" for p in kept):
        remarks.append("circles carry no marks: their angle is left empty and their spin is unknown")
    offset_px: dict[str, float] = {}
    for release in kept:
        offset_px[release.block] = max(release.bias_px, offset_px.get(release.block, 0.0))
    steps = np.concatenate([np.diff([s.when for s in release.sights]) for release in kept])
    usual_fps = fps / float(np.median(steps))  # another one than stated only where the frame rate varies
    smear_offset_s = SMEAR_OFFSET * max(release.shutter for release in kept) / fps
    return _measured(frames, setup, size_px, usual_fps, smear_offset_s, remarks, offset_px)


def remarks_on_names(blocks: Sequence[str], setup: Setup) -> list[str]:
    """Remarks if the releases that were seen, of these blocks, may not be those that the set-up states."""
    stated, wrong = setup.keys.releases, "if that is wrong, correct releases and track again"
    if len(stated) > 1 and list(blocks) != stated:
        return [
            f"{counted(len(blocks), 'release')} seen and taken for {comma_list(blocks)}, but the key releases of the "
            f"set-up file lists {len(stated)}, {comma_list(stated)}: {wrong}"
        ]
    others = [name for name in setup.blocks if name not in stated]
    if len(stated) == 1 and others:
        subject = "every release" if len(blocks) > 1 else "the release"
        return [f"{subject} was taken for {stated[0]}, none for {comma_list(others)}: {wrong}"]
    return []


def rescaled(film: TrackedFilm, setup: Setup, size_px: tuple[int, int]) -> TrackedFilm:
    """The film with scale and frame rate of `setup`."""
    slower, own = film.setup.fps / setup.fps, film.experiment
    frames = film.frames.assign(t_s=(film.frames["t_s"] * slower).round(9))
    return _measured(
        frames, setup, size_px, own.fps / slower, own.smear_offset_s * slower, film.remarks, film.offset_px
    )


def moving_releases(releases: Sequence[FollowedRelease], g_px_frame2: float) -> list[FollowedRelease]:
    """The releases that moved, without frames that jump out of their motion, with the errors that flights show."""
    kept = [release for release in releases if shows_release(release, g_px_frame2)]
    for release in kept:
        reject_gross_errors(release, g_px_frame2)
        set_errors(release, g_px_frame2)
        limit = max(LARGEST_STATED_ERROR_PX, LARGEST_STATED_ERROR_RADII * release.radius_px)
        for sight in release.seen:
            if max(sight.error[:2]) > limit:
                sight.reject("unsure")
    return [release for release in kept if shows_release(release, g_px_frame2)]


def renumber_dropped(sights: list[Sight], radius_px: float) -> int:
    """Renumber the frames if the camera or the file dropped some; returns the number of dropped frames.

    A step between two frames is a mean of the velocities before and after it, however they change in between, times
    its duration: a vector whose product with both velocities is 1 has its duration as product with the step. Rotation
    counts as a third direction. The velocities are lines, or means, of `COMPARED_STEPS` steps; a step is longer than
    stated only if both say so. If a block hardly moves, dropped frames cannot be seen and do not matter."""
    seen = [s for s in sights if not s.reason]
    found = np.zeros(max(len(seen) - 1, 0), np.int64)
    if len(seen) > 2 * COMPARED_STEPS + 1:
        at = np.array([s.when for s in seen])
        places = np.nan_to_num([s.pose * [1.0, 1.0, radius_px] for s in seen])
        step, frames, middle = np.diff(places, axis=0), np.diff(at), 0.5 * (at[1:] + at[:-1])
        pace = step / frames[:, None]
        sigma = max(noise_of_path(pace), SMALLEST_STEP_SIGMA_PX)
        for k in range(COMPARED_STEPS, len(step) - COMPARED_STEPS):
            sides = slice(k - COMPARED_STEPS, k), slice(k + 1, k + 1 + COMPARED_STEPS)
            if middle[k + COMPARED_STEPS] - middle[k - COMPARED_STEPS] > 3.0 * COMPARED_STEPS + frames[k]:
                continue
            means = [pace[own].mean(axis=0) for own in sides]
            lines = [_pace_at(when, middle[own], pace[own]) for own, when in zip(sides, at[k : k + 2], strict=True)]
            missing = [_duration(step[k], np.array(paces), sigma) - frames[k] for paces in (means, lines)]
            times = round(float(np.mean(np.nan_to_num(missing))))
            if times > 0 and np.abs(np.array(missing) - times).max() < WHOLE_FRAME:
                found[k] = times
    later = dict(zip((s.when for s in seen[1:]), np.cumsum(found), strict=True))
    shift = 0
    for sight in sights:
        shift = int(later.get(sight.when, shift))
        sight.frame += shift
        sight.when += shift
    return int(found.sum())


def _pace_at(when: float, middle: Array, pace: Array) -> Array:
    """(3,) velocity at an instant, from the line through the velocities (n, 3) at `middle` (n,)."""
    own = middle - middle.mean()
    return np.asarray(pace.mean(axis=0) + (when - middle.mean()) * (own @ pace) / (own @ own))


def _duration(step: Array, paces: Array, sigma: float) -> float:
    """Duration in frames of a step (3,) between two velocities (2, 3); NaN if steps of noise `sigma` do not show it."""
    along = np.linalg.pinv(paces, rcond=PARALLEL) @ np.ones(2)
    return float(along @ step) if np.hypot.reduce(along) * sigma < LARGEST_DURATION_ERROR else np.nan


def _frames(number: int, release: FollowedRelease, fps: float) -> pd.DataFrame:
    """Rows of `TrackedFilm.frames` of a release, without places in metres."""
    sights = release.sights
    pose, error = np.array([s.pose for s in sights]).T, np.array([s.error for s in sights]).T
    return pd.DataFrame({
        "release": number, "block": release.block, "frame": [s.frame for s in sights],
        "t_s": [round((s.when - sights[0].when) / fps, 9) for s in sights],
        "u_px": pose[0], "v_px": pose[1], "angle_px_rad": pose[2],
        "u_error_px": error[0], "v_error_px": error[1], "angle_error_rad": error[2],
        "confidence": [s.confidence for s in sights], "reason": [s.reason for s in sights],
    })  # fmt: skip


def _measured(
    frames: pd.DataFrame,
    setup: Setup,
    size_px: tuple[int, int],
    fps: float,
    smear_offset_s: float,
    remarks: list[str],
    offset_px: dict[str, float],
) -> TrackedFilm:
    """The film with places in metres, and what its trusted frames show."""
    camera, trusted = setup.pixel_map(size_px), (frames["reason"] == "").to_numpy()
    place = camera.to_world(frames[["u_px", "v_px"]].to_numpy(float)[trusted])
    theta = camera.angle_to_world(frames["angle_px_rad"].to_numpy(float)[trusted])
    if not setup.keys.detection.marks:
        theta[[setup.blocks[name].shape == "circle" for name in frames["block"][trusted]]] = np.nan
    frames = frames.assign(x_m=np.nan, y_m=np.nan, theta_rad=np.nan)
    frames.loc[trusted, list(POSE_NAMES)] = np.column_stack([place, theta])
    errors = frames[["u_error_px", "v_error_px", "angle_error_rad"]].to_numpy(float)[trusted]
    position = float(np.nanmedian(errors[:, :2])) * setup.metres_per_pixel
    angle = float(np.nanmedian(errors[:, 2])) if np.isfinite(errors[:, 2]).any() else 0.0
    stated = Experiment(
        setup.keys.name, setup.keys.gravity_m_s2, fps, position, angle, setup.cross_section, dict(setup.blocks),
        trajectories=frames.loc[trusted, list(TRAJECTORY_COLUMNS)].reset_index(drop=True),
        from_gravity=setup.from_gravity, smear_offset_s=smear_offset_s,
    )  # fmt: skip
    experiment = with_measured_noise(stated, setup)
    return TrackedFilm(setup, frames, experiment, *findings_of(experiment, setup), remarks=remarks, offset_px=offset_px)


def with_measured_noise(experiment: Experiment, setup: Setup) -> Experiment:
    """The experiment with the noise measured in its flights; unchanged without flights."""
    film = film_of(experiment, setup)
    if not len(find_flights(setup_world(experiment), film)):
        return experiment
    x, y, theta = film.noise
    position = float(np.sqrt(0.5 * (x * x + y * y)))
    return replace(experiment, position_noise_m=position, angle_noise_rad=float(theta))


def findings_of(experiment: Experiment, setup: Setup) -> tuple[FilmSegments, FilmFindings]:
    """The flights and impacts of the film of an experiment, and the findings on the film."""
    world = setup_world(experiment)
    segments = FilmSegments.of(film_of(experiment, setup), world)
    return segments, film_findings(segments, world, experiment.fps, experiment.from_gravity)


def check_sanity(experiment: Experiment, setup: Setup, *, guessed: bool = False) -> list[str]:
    """Remarks on an experiment. Raises InputError if frame rate, scale or axes must be wrong. `guessed`: whether the
    ground is a guess; it is then not checked."""
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


def film_of(experiment: Experiment, setup: Setup) -> Film:
    """The frames of an experiment with its stated noise, because a short film has few impact-free windows that show the
    noise. The noise is at least `SMALLEST_NOISE_PX`: even without noise the error depends on the place of the block
    within its pixels."""
    film = load_film(experiment)
    reach = min(b.radius_m for b in experiment.blocks.values())
    least = SMALLEST_NOISE_PX * setup.metres_per_pixel * np.array([1.0, 1.0, 1.0 / reach])
    film.noise = film.long_noise = np.maximum(np.minimum(film.noise, film.stated_noise), least)
    return film
