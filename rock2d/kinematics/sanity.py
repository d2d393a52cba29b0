"""What must be true of a film before anything is concluded from it: units, time step, axes, ground, numbers.

Every check looks at the recorded frames alone, without a model of contact. A *fault* makes a diagnosis meaningless and
stops it; a *remark* is printed and goes into the report. What would spoil the cut of the film into flights (a mirrored
axis, a set-up that the blocks seem to fall into) is undone for the cut and for a first fit of the law: the diagnosis
has to find it.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass, field, replace

import numpy as np

from rock2d.diagnosis.impact_table_data import TableData
from rock2d.files.experiment import Experiment
from rock2d.kinematics.flights import Film
from rock2d.kinematics.registration import CLEAR, below_ground, seated
from rock2d.kinematics.setup_world import setup_world
from rock2d.scene.world import View, World

Array = np.ndarray

WINDOWS = (768, 384, 192, 96, 64, 48, 32, 20, 12)  # frames of a parabola that gravity is read from
FEWEST_RELEASES = 6
FEWEST_IMPACTS = 15
MIRRORS = {"": (1.0, 1.0, 1.0), "x": (-1.0, 1.0, 1.0), "y": (1.0, -1.0, 1.0)}
SUNK = 0.2  # share of the frames with the centre in the ground that cannot be


@dataclass
class Sanity:
    """What the checks found; `mirror` names the axis recorded with the wrong sign, "" if none; `seen` is the world that
    a film is cut in, None if it is the stated one; `suspects` are the effects that could have made the faults."""

    faults: list[str] = field(default_factory=list)
    remarks: list[str] = field(default_factory=list)
    mirror: str = ""
    seen: World | None = None
    suspects: list[str] = field(default_factory=list)


def _check_count(releases: int, found: Sanity) -> None:
    if releases < FEWEST_RELEASES:
        found.faults.append(
            f"{releases} releases are too few to tell causes apart: at least {FEWEST_RELEASES} are needed"
        )


def check_film(experiment: Experiment, film: Film) -> Sanity:
    """Checks of the recorded frames: numbers, time step, units, axes, ground."""
    found = Sanity()
    _check_time_step(experiment, film, found)
    _check_units(experiment, film, found)
    if not found.faults:
        _check_axes(experiment, film, found)
    _check_count(len(film.release_names), found)
    return found


def _check_time_step(experiment: Experiment, film: Film, found: Sanity) -> None:
    dt = np.diff(film.t_s)[np.diff(film.release) == 0]
    if not len(dt):
        found.faults.append("no release has two frames")
        return
    step = float(np.median(dt)) * experiment.fps
    if not 0.8 < step < 1.25:
        found.faults.append(
            f"the frames are {np.median(dt):.6g} s apart, but {experiment.fps:g} frames/s make "
            f"{1 / experiment.fps:.6g} s: one of the two is wrong "
            "(slow-motion files state the rate of playing, not of filming)"
        )
    lost = 1.0 - len(film.t_s) / max(1.0, sum(_expected_frames(experiment, film)))
    if lost > 0.02:
        found.remarks.append(f"{100 * lost:.0f} % of the frames were lost")


def _expected_frames(experiment: Experiment, film: Film) -> list[float]:
    starts = np.searchsorted(film.release, np.arange(len(film.release_names) + 1))
    return [(film.t_s[b - 1] - film.t_s[a]) * experiment.fps + 1 for a, b in itertools.pairwise(starts)]


def _check_units(experiment: Experiment, film: Film, found: Sanity) -> None:
    size = np.array([b.radius_m for b in experiment.blocks.values()])[film.release_block]
    setup = max(float(np.ptp(experiment.cross_section.points_m, axis=0).max()), 1e-9)
    extent = float(np.quantile(np.abs(film.pose[:, :2]), 0.95))
    reach = float(np.abs(experiment.cross_section.points_m).max())
    if extent > 20 * reach:
        found.faults.append(
            f"positions reach {extent:.3g} where the cross-section reaches {reach:.3g} m: "
            "are they in millimetres or pixels?"
        )
    elif float(np.ptp(film.pose[:, :2], axis=0).max()) < 2e-3 * setup:
        found.faults.append(
            f"all positions lie within {np.ptp(film.pose[:, :2], axis=0).max():.3g} m of each other on a set-up of "
            f"{setup:.3g} m: wrong unit, or a block that never moved"
        )
    fall = _fall(experiment, film)
    if fall is not None and not found.faults:
        ratio = abs(fall[1]) / max(experiment.gravity_m_s2, 1e-9)
        if not 0.6 < ratio < 1.6:
            found.faults.append(
                f"blocks in flight accelerate by {abs(fall[1]):.3g} m/s², gravity is {experiment.gravity_m_s2:g}: "
                f"lengths would be wrong by a factor {ratio:.3g}, or the frame rate by {ratio**-0.5:.3g}"
            )
            found.suspects += ["scale_error", "frame_rate_error"]
    turn = np.abs(np.diff(film.pose[:, 2]))[np.diff(film.release) == 0]
    travel = np.hypot(*np.diff(film.pose[:, :2], axis=0).T)[np.diff(film.release) == 0]
    moving = travel > 4 * film.noise[0]
    if moving.sum() > 50:
        rolling = float(np.median(turn[moving]) * np.median(size) / np.median(travel[moving]))
        if rolling > 6:
            found.faults.append(
                f"blocks turn {rolling:.0f} times as fast as rolling would: are the angles in degrees?"
            )


def _fall(experiment: Experiment, film: Film) -> Array | None:
    """(2,) acceleration in m/s² of the frames that lie on a curved parabola; None if too few do.

    Short windows may be the smooth turn of a bounce, long ones a slide: what counts is where windows of a length crowd,
    and of the lengths that which comes nearest to gravity. If none does, lengths or times are wrong.
    """
    found = []
    for window in WINDOWS:
        a, error = _curvatures(film, window)
        use = (np.abs(a[:, 1]) > 8 * error) & (experiment.gravity_m_s2 > 8 * error)
        if use.sum() >= 20:
            found.append(_mode(a[use]))
    gravity = max(experiment.gravity_m_s2, 1e-9)
    return min(found, key=lambda a: abs(np.log(abs(a[1]) / gravity)), default=None)


def _mode(a: Array) -> Array:
    """Where vectors (n, 2) crowd most along y: the median of the closest quarter of them, or of ten."""
    a = a[np.argsort(a[:, 1])]
    k = max(len(a) // 4, min(len(a), 10))
    first = int(np.argmin(a[k - 1 :, 1] - a[: len(a) - k + 1, 1]))
    return np.asarray(np.median(a[first : first + k], axis=0))


def _curvatures(film: Film, window: int) -> tuple[Array, Array]:
    """Accelerations (n, 2) of the windows of frames in which a block moves smoothly, standard errors (n,) of those
    along y."""
    start = np.arange(0, len(film.t_s) - window, max(window // 2, 1))
    start = start[film.release[start] == film.release[start + window - 1]]
    frames = start[:, None] + np.arange(window)
    t = film.t_s[frames]
    t = t - t.mean(axis=1, keepdims=True)
    pose = film.pose[frames]
    cubic = (t**3).mean(axis=1, keepdims=True) / (t**2).mean(axis=1, keepdims=True) * t
    square = t**2 - (t**2).mean(axis=1, keepdims=True) - cubic
    a = 2 * np.einsum("wf,wfc->wc", square, pose) / (square**2).sum(axis=1)[:, None]
    v = np.einsum("wf,wfc->wc", t, pose) / (t**2).sum(axis=1)[:, None]
    fitted = pose.mean(axis=1)[:, None] + v[:, None] * t[..., None] + 0.5 * a[:, None] * square[..., None]
    error = 2 * film.noise[1] / np.sqrt((square**2).sum(axis=1))
    rough = np.sqrt(((pose - fitted) ** 2).mean(axis=1)) / film.noise
    smooth = rough[:, :2].max(axis=1) < 1.4
    return a[smooth, :2], error[smooth]


def _check_axes(experiment: Experiment, film: Film, found: Sanity) -> None:
    fall = _fall(experiment, film)
    upwards = fall is not None and fall[1] > 0
    setup = setup_world(experiment)
    worlds = {axis: replace(setup, view=View(mirror=mirror)) for axis, mirror in MIRRORS.items()}
    below = {axis: below_ground(world, film) for axis, world in worlds.items()}
    if upwards and below["y"] < CLEAR:
        found.mirror = "y"
    elif below[""] > SUNK and below["x"] < CLEAR:
        found.mirror = "x"
    elif below[""] > SUNK and not upwards and (better := seated(setup, film, fall)) is not None:
        found.seen, words = better
        found.remarks.append(
            f"in {100 * below['']:.0f} % of the frames the block's centre lies inside the ground, which {words} would "
            "explain; the film is cut into flights as if it were so"
        )
    elif below[""] > SUNK:
        found.faults.append(
            f"in {100 * below['']:.0f} % of the frames the block's centre lies inside the ground: "
            "the cross-section and the film do not belong together (origin, scale or axes)"
        )
        found.suspects += ["scale_error", "camera_tilt", "geometry_error"]
    elif upwards:
        found.faults.append(
            "blocks in flight accelerate upwards: is y measured downwards, from the top of the image?"
        )
        found.suspects.append("mirrored_axis")
    elif below[""] > 0.002:
        found.remarks.append(
            f"in {100 * below['']:.1f} % of the frames the block's centre lies inside the ground"
        )
    if found.mirror:
        found.seen = worlds[found.mirror]


def check_table(experiment: Experiment, data: TableData) -> Sanity:
    """Checks of an impact table: numbers, units, direction of the impacts, energy."""
    found = Sanity()
    _check_count(len(data.order), found)
    if found.faults:
        return found
    reach = float(np.abs(experiment.cross_section.points_m).max())
    extent = float(np.quantile(np.abs(data.before[:, :2]), 0.95))
    if extent > 20 * reach:
        found.faults.append(
            f"positions reach {extent:.3g} where the cross-section reaches {reach:.3g} m: "
            "are they in millimetres or pixels?"
        )
    mass = np.array([b.mass_kg for b in experiment.blocks.values()])[data.impact_block]
    inertia = np.array([b.inertia_kg_m2 for b in experiment.blocks.values()])[data.impact_block]
    energy = [
        0.5 * mass * (v**2).sum(axis=1) + 0.5 * inertia * w**2
        for v, w in ((data.before[:, 3:5], data.before[:, 5]), (data.after[:, :2], data.after[:, 2]))
    ]
    gains = float((energy[1] > 1.05 * energy[0]).mean())
    if gains > 0.5:
        found.faults.append(
            f"{100 * gains:.0f} % of the impacts gain energy: "
            "are the columns before and after exchanged, or an axis mirrored?"
        )
    elif gains > 0.02:
        found.remarks.append(f"{100 * gains:.0f} % of the impacts gain more than 5 % of kinetic energy")
    return found
