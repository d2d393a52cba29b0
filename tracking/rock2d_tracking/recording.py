"""From followed blocks to an experiment: metres, seconds, and only frames that can be trusted."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd

from rock2d.files.experiment import Experiment
from rock2d.kinematics.flights import FEWEST_FLIGHT_FRAMES, Film, load_film, segment_film
from rock2d.kinematics.setup_world import setup_world
from rock2d_tracking.camera import PixelMap
from rock2d_tracking.following import Path, Sight
from rock2d_tracking.setup_file import Setup

Array = np.ndarray

NEIGHBOURS = 4  # frames on either side that a frame is compared with
ODD = 6.0  # standard deviations by which a frame may differ from the parabola through its neighbours
ODD_PX, ODD_RAD = 0.75, 0.05  # and how far at least, before it is lost
ROUND = 3  # steps on either side that one is compared with
FINEST_PX = 0.01  # noise of a film without noise
FINE_PX = 0.02  # what steps differ by at least, 1 sigma
OUTSTANDING = 7.0  # sigma by which a step must be longer than its like to be that of two frames
MOVED_PX = 3.0  # way of a release below which it is none: a stone of the soil, a hand, a shadow


@dataclass
class Record:
    """What was tracked.

    Attributes
    ----------
    experiment : with the noise found in its flights
    frames : a row a frame of a release: release, block, frame, t_s, u_px, v_px, angle_px_rad, their standard errors,
        confidence, reason ("" or why the frame is lost)
    remarks : what the user should know
    """

    experiment: Experiment
    frames: pd.DataFrame
    remarks: list[str]


def record(paths: Sequence[Path], setup: Setup, size_px: tuple[int, int]) -> Record:
    """The experiment that a film shows; raises ValueError if it shows no release."""
    camera = setup.pixel_map(size_px)
    remarks: list[str] = []
    kept = [path for path in paths if _moved(path)]
    if len(kept) < len(paths):
        remarks.append(
            f"{len(paths) - len(kept)} of {len(paths)} things followed never moved and were left out"
        )
    if not kept:
        raise ValueError(
            "no block was seen to move in this film: are the scale and the blocks' sizes right, is the cross-section "
            "where it is in the picture, does `up` point to where it is up?"
        )
    stated = len(setup.keys.releases)
    if stated > 1 and stated != len(kept):
        remarks.append(f"{len(kept)} releases were seen, {stated} are listed in the set-up file")
    missing = 0
    for path in kept:
        _lose_the_odd(path.sights)
        missing += _count_the_missing(path.sights, setup.blocks[path.block].radius_m / setup.metres_per_pixel)
    if missing:
        remarks.append(
            f"{missing} frames are missing in the film: blocks moved twice as far where they should be"
        )
    fps = setup.keys.camera.fps
    rows = [_rows(k, path, fps) for k, path in enumerate(kept)]
    frames = pd.DataFrame([row for own in rows for row in own])
    if not setup.keys.detection.marks and any(setup.blocks[p.block].shape == "circle" for p in kept):
        remarks.append("circles carry no marks: their angle is written as 0, no spin can be read off")
    return Record(_experiment(frames, setup, camera, fps), frames, remarks)


def _moved(path: Path) -> bool:
    seen = path.seen
    if len(seen) < FEWEST_FLIGHT_FRAMES:
        return False
    poses = np.array([s.pose[:2] for s in seen])
    return bool(np.ptp(poses, axis=0).max() > MOVED_PX)


def _lose_the_odd(sights: list[Sight]) -> None:
    """Frames that jump out of the parabola through their neighbours are lost: no block moves so."""
    seen = [s for s in sights if not s.reason]
    if len(seen) < 2 * NEIGHBOURS + 1:
        return
    t = np.array([s.frame for s in seen], float)
    pose = np.array([s.pose for s in seen])
    odd = []
    for i in range(len(seen)):
        near = [k for k in range(max(0, i - NEIGHBOURS), min(len(seen), i + NEIGHBOURS + 1)) if k != i]
        before, after = [k for k in near if k < i], [k for k in near if k > i]
        # at an impact one side is enough
        misses = [_miss(t, pose, i, side) for side in (before, after, near) if len(side) >= 3]
        if misses and min(misses) > 1.0:
            odd.append(i)
    for i in odd:
        seen[i].reason, seen[i].confidence = "jumps", 0.0


def _count_the_missing(sights: list[Sight], reach_px: float) -> int:
    """Frames that the camera or the file dropped: steps two or three times as long, turn included, as those before and
    after promise. The frames that follow are numbered anew. Where a block hardly moves it does not matter, and shows
    nothing."""
    seen = [s for s in sights if not s.reason]
    at = np.array([s.frame for s in seen])
    step = np.diff([s.pose * [1.0, 1.0, reach_px] for s in seen], axis=0)
    single = np.diff(at) == 1
    found = np.zeros(len(step), np.int64)
    sides = np.array([*range(-ROUND, 0), *range(1, ROUND + 1)])
    line = np.linalg.pinv(np.vander(sides, 2))
    for k in range(ROUND, len(step) - ROUND):
        if not single[k] or not single[k + sides].all() or found[k - ROUND : k].any():
            continue
        slope, usual = line @ step[k + sides]
        uneven = step[k + sides] - usual - sides[:, None] * slope
        # at an impact the steps before and after do not go together: nothing stands out of that
        sigma = max(float(np.sqrt((uneven**2).sum() / (len(sides) - 2) / 3)), FINE_PX)
        times = round(float(step[k] @ usual) / max(float(usual @ usual), 1e-12))
        longer, off = (float(np.abs(step[k] - n * usual).max()) for n in (1, times))
        if times > 1 and longer > OUTSTANDING * sigma and off < 0.5 * OUTSTANDING * sigma:
            found[k] = times - 1
    later = dict(zip((s.frame for s in seen[1:]), np.cumsum(found), strict=True))
    shift = 0
    for sight in sights:
        shift = int(later.get(sight.frame, shift))
        sight.frame += shift
    return int(found.sum())


def _miss(t: Array, pose: Array, i: int, side: list[int]) -> float:
    """How far a frame lies off the line through some of its neighbours, over what is allowed."""
    degree = 2 if len(side) > 4 else 1
    basis = np.vander(t[side] - t[i], degree + 1)
    fitted, *_ = np.linalg.lstsq(basis, pose[side], rcond=None)
    left = pose[side] - basis @ fitted
    sigma = np.sqrt((left**2).sum(axis=0) / max(len(side) - degree - 1, 1))
    off = np.abs(pose[i] - fitted[-1])
    return float((off / np.maximum(ODD * sigma, [ODD_PX, ODD_PX, ODD_RAD])).max())


def _rows(release: int, path: Path, fps: float) -> list[dict[str, object]]:
    first = path.sights[0].frame
    return [
        {
            "release": release, "block": path.block, "frame": s.frame, "t_s": round((s.frame - first) / fps, 9),
            "u_px": s.pose[0], "v_px": s.pose[1], "angle_px_rad": s.pose[2],
            "u_error_px": s.error[0], "v_error_px": s.error[1], "angle_error_rad": s.error[2],
            "confidence": s.confidence, "reason": s.reason,
        }
        for s in path.sights
    ]  # fmt: skip


def _experiment(frames: pd.DataFrame, setup: Setup, camera: PixelMap, fps: float) -> Experiment:
    seen = frames[frames["reason"] == ""]
    world = camera.to_world(seen[["u_px", "v_px"]].to_numpy(float))
    theta = camera.angle_to_world(seen["angle_px_rad"].to_numpy(float))
    table = pd.DataFrame({
        "release": seen["release"].to_numpy(), "block": seen["block"].to_numpy(), "t_s": seen["t_s"].to_numpy(),
        "x_m": world[:, 0], "y_m": world[:, 1], "theta_rad": theta,
    })  # fmt: skip
    errors = seen[["u_error_px", "v_error_px", "angle_error_rad"]].to_numpy(float)
    position = float(np.nanmedian(errors[:, :2])) * setup.metres_per_pixel
    angle = float(np.nanmedian(errors[:, 2])) if np.isfinite(errors[:, 2]).any() else 0.0
    stated = Experiment(
        setup.keys.name, setup.keys.gravity_m_s2, fps, position, angle, setup.cross_section, dict(setup.blocks),
        trajectories=table,
    )  # fmt: skip
    return with_measured_noise(film_of(stated, setup), stated)


def film_of(experiment: Experiment, setup: Setup) -> Film:
    """The frames of an experiment, with as much noise as what even a film without any leaves: a few thousandths of a
    pixel that go with the place of the block within its pixels."""
    film = load_film(experiment)
    reach = min(b.radius_m for b in experiment.blocks.values())
    film.noise = np.maximum(
        film.noise, FINEST_PX * setup.metres_per_pixel * np.array([1.0, 1.0, 1.0 / reach])
    )
    return film


def with_measured_noise(film: Film, experiment: Experiment) -> Experiment:
    """The experiment with the noise that its own flights show, if it has any; else as it is."""
    cut = segment_film(setup_world(experiment), film)
    if not len(cut.flights):
        return experiment
    x, y, theta = cut.film.noise
    position = float(np.sqrt(0.5 * (x * x + y * y)))
    return replace(experiment, position_noise_m=position, angle_noise_rad=float(theta))
