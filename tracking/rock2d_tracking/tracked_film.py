"""The experiment of a tracked film: metres, seconds, and only trusted frames."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd

from rock2d.errors import counted
from rock2d.files.experiment import Experiment
from rock2d.kinematics.film_findings import FilmFindings, film_findings
from rock2d.kinematics.film_segments import FilmSegments
from rock2d.kinematics.flights import FEWEST_FLIGHT_FRAMES, Film, find_flights, load_film
from rock2d.kinematics.setup_world import setup_world
from rock2d_tracking.camera import PixelMap
from rock2d_tracking.gross_errors import reject_gross_errors
from rock2d_tracking.setup_file import Setup
from rock2d_tracking.sights import FollowedRelease, Sight, flights_of, set_errors

Array = np.ndarray

# largest standard error of a coordinate of a trusted frame: in px, or in radii of the block if that is more
LARGEST_STATED_ERROR_PX, LARGEST_ERROR_RADII = 1.0, 0.05
COMPARED_STEPS = 3  # steps on each side with which a step is compared
SMALLEST_NOISE_PX = 0.01  # noise of the positions in a film without noise
SMALLEST_STEP_SIGMA_PX = 0.02  # noise of the steps in a film without noise
LONG_STEP_SIGMAS = 7.0  # a step over a dropped frame is longer than the others by at least this much
# standard error of the position of a smeared block, over the length of the smear: root mean square in synthetic films
# (shiny balls 0.09, uniform ones 0.015)
SMEAR_OFFSET = 0.045
SHORTEST_MOTION_PX = 3.0  # objects that move less are stones in the soil, persons or shadows, not releases


@dataclass
class TrackedFilm:
    """The experiment that was tracked in a film.

    Attributes
    ----------
    experiment : with the noise found in its flights
    frames : a row for each frame of a release: release, block, frame, t_s, u_px, v_px, angle_px_rad, their standard
        errors, confidence, reason ("" or why the frame is lost)
    remarks : for the user
    offset_px : block -> standard error of a coordinate that all its frames share
    """

    experiment: Experiment
    frames: pd.DataFrame
    remarks: list[str]
    offset_px: dict[str, float]

    def placed_frames(self) -> pd.DataFrame:
        """`frames` with x_m, y_m and theta_rad, NaN where a frame is lost."""
        frames, seen = self.frames.copy(), self.experiment.trajectories
        assert seen is not None
        trusted = frames["reason"] == ""
        for name in ("x_m", "y_m", "theta_rad"):
            frames.loc[trusted, name] = seen[name].to_numpy()
        return frames


def tracked_film(
    kept: Sequence[FollowedRelease], followed: int, setup: Setup, size_px: tuple[int, int]
) -> TrackedFilm:
    """The experiment of a film.

    kept : its `moving_releases`, at least one
    followed : number of objects that were followed
    """
    camera = setup.pixel_map(size_px)
    remarks: list[str] = []
    if len(kept) < followed:
        remarks.append(
            f"{followed - len(kept)} of {counted(followed, 'object')} that were followed never moved and "
            "are left out"
        )
    stated = len(setup.keys.releases)
    if stated > 1 and stated != len(kept):
        remarks.append(
            f"{counted(len(kept), 'release')} seen, but the key releases of the set-up file lists {stated}"
        )
    missing = 0
    for release in kept:
        missing += _renumber_dropped(
            release.sights, setup.blocks[release.block].radius_m / setup.metres_per_pixel
        )
    if missing:
        remarks.append(
            f"{counted(missing, 'frame')} missing in the film: blocks moved two or three times as far there"
        )
    fps = setup.fps
    rows = [_rows(k, release, fps) for k, release in enumerate(kept)]
    frames = pd.DataFrame([row for own in rows for row in own])
    if not setup.keys.detection.marks and any(setup.blocks[p.block].shape == "circle" for p in kept):
        remarks.append("circles carry no marks: their angle is left empty and their spin is unknown")
    offset_px: dict[str, float] = {}
    for release in kept:
        offset_px[release.block] = max(release.bias_px, offset_px.get(release.block, 0.0))
    steps = np.concatenate([np.diff([s.when for s in release.sights]) for release in kept])
    usual_fps = fps / float(np.median(steps))  # another one than stated only where the frame rate varies
    smear_offset_s = SMEAR_OFFSET * max(release.shutter for release in kept) / fps
    experiment = _experiment(frames, setup, camera, usual_fps, smear_offset_s)
    return TrackedFilm(experiment, frames, remarks, offset_px)


def rescaled(film: TrackedFilm, before: Setup, setup: Setup, size_px: tuple[int, int]) -> TrackedFilm:
    """The film with scale and frame rate of `setup` instead of those of `before`."""
    slower = before.fps / setup.fps
    frames = film.frames.assign(t_s=(film.frames["t_s"] * slower).round(9))
    own = film.experiment
    experiment = _experiment(
        frames, setup, setup.pixel_map(size_px), own.fps / slower, own.smear_offset_s * slower
    )
    return replace(film, experiment=experiment, frames=frames)


def _moves(release: FollowedRelease, fall_px: float) -> bool:
    """Whether enough frames were seen, and the block moves within a flight; a change between flights does not count,
    because it may be a change to another object."""
    seen = release.seen
    if len(seen) < FEWEST_FLIGHT_FRAMES:
        return False
    poses = np.array([s.pose[:2] for s in seen])
    ways = [np.ptp(poses[own], axis=0).max() for own in flights_of(seen, fall_px)]
    return bool(max(ways) > SHORTEST_MOTION_PX)


def moving_releases(releases: Sequence[FollowedRelease], fall_px: float) -> list[FollowedRelease]:
    """The releases that moved, without frames that jump out of their motion, with the errors that flights show.

    `fall_px`: acceleration of gravity along v in px per frame squared.
    """
    kept = [release for release in releases if _moves(release, fall_px)]
    for release in kept:
        reject_gross_errors(release, fall_px)
        set_errors(release, fall_px)
        limit = max(LARGEST_STATED_ERROR_PX, LARGEST_ERROR_RADII * release.radius_px)
        for sight in release.seen:
            if max(sight.error[:2]) > limit:
                sight.reason, sight.confidence = "unsure", 0.0
    return [release for release in kept if _moves(release, fall_px)]


def _renumber_dropped(sights: list[Sight], reach_px: float) -> int:
    """Renumber the frames if the camera or the file dropped some; returns the number of dropped frames.

    Steps over dropped frames, rotation included, are two or three times as long as the steps before and after. If a
    block hardly moves, dropped frames cannot be seen and do not matter."""
    seen = [s for s in sights if not s.reason]
    at = np.array([s.when for s in seen])
    step = np.diff([s.pose * [1.0, 1.0, reach_px] for s in seen], axis=0)
    single = np.diff(at) == 1
    found = np.zeros(len(step), np.int64)
    sides = np.array([*range(-COMPARED_STEPS, 0), *range(1, COMPARED_STEPS + 1)])
    line = np.linalg.pinv(np.vander(sides, 2))
    for k in range(COMPARED_STEPS, len(step) - COMPARED_STEPS):
        if not single[k] or not single[k + sides].all() or found[k - COMPARED_STEPS : k].any():
            continue
        slope, usual = line @ step[k + sides]
        uneven = step[k + sides] - usual - sides[:, None] * slope
        # at an impact the steps before and after differ: sigma is large and no step is long
        sigma = max(float(np.sqrt((uneven**2).sum() / (len(sides) - 2) / 3)), SMALLEST_STEP_SIGMA_PX)
        times = round(float(step[k] @ usual) / max(float(usual @ usual), 1e-12))
        longer, off = (float(np.abs(step[k] - n * usual).max()) for n in (1, times))
        if times > 1 and longer > LONG_STEP_SIGMAS * sigma and off < 0.5 * LONG_STEP_SIGMAS * sigma:
            found[k] = times - 1
    later = dict(zip((s.when for s in seen[1:]), np.cumsum(found), strict=True))
    shift = 0
    for sight in sights:
        shift = int(later.get(sight.when, shift))
        sight.frame += shift
        sight.when += shift
    return int(found.sum())


def _rows(number: int, release: FollowedRelease, fps: float) -> list[dict[str, object]]:
    first = release.sights[0].when
    return [
        {
            "release": number, "block": release.block, "frame": s.frame, "t_s": round((s.when - first) / fps, 9),
            "u_px": s.pose[0], "v_px": s.pose[1], "angle_px_rad": s.pose[2],
            "u_error_px": s.error[0], "v_error_px": s.error[1], "angle_error_rad": s.error[2],
            "confidence": s.confidence, "reason": s.reason,
        }
        for s in release.sights
    ]  # fmt: skip


def _experiment(
    frames: pd.DataFrame, setup: Setup, camera: PixelMap, fps: float, smear_offset_s: float
) -> Experiment:
    seen = frames[frames["reason"] == ""]
    world = camera.to_world(seen[["u_px", "v_px"]].to_numpy(float))
    theta = camera.angle_to_world(seen["angle_px_rad"].to_numpy(float))
    if not setup.keys.detection.marks:
        theta[seen["block"].map(lambda name: setup.blocks[name].shape == "circle").to_numpy(bool)] = np.nan
    table = pd.DataFrame({
        "release": seen["release"].to_numpy(), "block": seen["block"].to_numpy(), "t_s": seen["t_s"].to_numpy(),
        "x_m": world[:, 0], "y_m": world[:, 1], "theta_rad": theta,
    })  # fmt: skip
    errors = seen[["u_error_px", "v_error_px", "angle_error_rad"]].to_numpy(float)
    position = float(np.nanmedian(errors[:, :2])) * setup.metres_per_pixel
    angle = float(np.nanmedian(errors[:, 2])) if np.isfinite(errors[:, 2]).any() else 0.0
    stated = Experiment(
        setup.keys.name, setup.keys.gravity_m_s2, fps, position, angle, setup.cross_section, dict(setup.blocks),
        trajectories=table, from_gravity=setup.from_gravity, smear_offset_s=smear_offset_s,
    )  # fmt: skip
    return with_measured_noise(film_of(stated, setup), stated)


def film_of(experiment: Experiment, setup: Setup) -> Film:
    """The frames of an experiment with its stated noise, because a short film has few impact-free windows that show the
    noise. The noise is at least `SMALLEST_NOISE_PX`: even without noise the error depends on the place of the block
    within its pixels."""
    film = load_film(experiment)
    reach = min(b.radius_m for b in experiment.blocks.values())
    least = SMALLEST_NOISE_PX * setup.metres_per_pixel * np.array([1.0, 1.0, 1.0 / reach])
    film.noise = film.long_noise = np.maximum(np.minimum(film.noise, film.stated_noise), least)
    return film


def findings_of(experiment: Experiment, setup: Setup) -> tuple[FilmSegments, FilmFindings]:
    """The flights and impacts of the film of an experiment, and the findings on the film."""
    world = setup_world(experiment)
    data = FilmSegments.of(film_of(experiment, setup), world)
    return data, film_findings(data, world, experiment.fps, experiment.from_gravity)


def with_measured_noise(film: Film, experiment: Experiment) -> Experiment:
    """The experiment with the noise measured in its flights; unchanged without flights."""
    if not len(find_flights(setup_world(experiment), film)):
        return experiment
    x, y, theta = film.noise
    position = float(np.sqrt(0.5 * (x * x + y * y)))
    return replace(experiment, position_noise_m=position, angle_noise_rad=float(theta))
