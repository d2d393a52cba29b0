"""Sanity checks that an experiment must pass before a diagnosis.

The checks use only the recorded data, without a model of contact. A *fault* makes a diagnosis meaningless and stops it.
A *remark* is printed and stands in the report. A mirrored axis, or a set-up in which the blocks would sink into the
ground, would spoil the segmentation. It is corrected only for the segmentation and for a first fit of the law; the
diagnosis has to find the cause."""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from rock2d.arrays import Array
from rock2d.errors import counted
from rock2d.files.experiment import Experiment
from rock2d.kinematics.flights import Film
from rock2d.kinematics.impacts import SPIN_AFTER, VELOCITY_AFTER, ImpactTable
from rock2d.kinematics.registration import (
    LARGEST_CLEARANCE_RADII,
    MOST_GROUND_FRAMES,
    POSSIBLE_BELOW_GROUND,
    lowest_clearances,
    registered_world,
    share_below_ground,
)
from rock2d.kinematics.setup_world import setup_world
from rock2d.kinematics.window_gravity import GRAVITY_RATIO, window_gravity
from rock2d.records.columns import LINEAR_VELOCITY, OMEGA, POSITION, THETA, X, Y
from rock2d.scene.world import View, World

FEWEST_RELEASES = 2  # so that one can be held out
FEWEST_IMPACTS = 15
FEWEST_REBOUNDS = 6  # fewest impacts followed by a flight, if blocks stick
MIRRORED_SIGNS = {"": (1.0, 1.0, 1.0), "x": (-1.0, 1.0, 1.0), "y": (1.0, -1.0, 1.0)}
IMPOSSIBLE_BELOW_GROUND = 0.2  # share of the frames with the centroid in the ground
REMARKABLE_GRAVITY = 0.06  # relative difference of recorded gravity
STILL_ANGLE_SDS = 1.5  # standard deviation of an angle that does not change, over that of the noise
MOST_BESIDE = 0.5  # largest share of the frames with the block outside the cross-section
LANDED_FRAMES = 5  # fewest frames after the lowest position of a block that has landed
MOST_ROLLING = 6.0  # largest median of the spin over that of a block that rolls
LARGEST_SPEED = 100.0  # largest median of the speeds, over that of a fall from the top of the cross-section
DEEP_RADII, FAR_RADII = 0.5, 2.0  # depth and height of blocks, in radii, that no soil explains


# codes of faults
FEW_RELEASES, FEW_IMPACTS, NO_FRAMES = "few_releases", "few_impacts", "no_frames"
FRAME_RATE, LENGTH_UNIT, ANGLE_UNIT = "frame_rate", "length_unit", "angle_unit"
NO_MOTION, WRONG_GRAVITY, UPWARD_GRAVITY = "no_motion", "wrong_gravity", "upward_gravity"
BELOW_GROUND, ABOVE_GROUND, BESIDE_GROUND = "below_ground", "above_ground", "beside_ground"
CONSTANT_ANGLE, ENERGY_GAIN = "constant_angle", "energy_gain"


@dataclass(frozen=True)
class Fault:
    """A reason why an experiment cannot be diagnosed: one of the codes of this module, and a message."""

    code: str
    message: str


@dataclass
class Sanity:
    """What the checks found.

    Attributes
    ----------
    faults, remarks : see the module
    mirror : axis that was recorded with the wrong sign, "" if there is none
    registered : corrected world in which the film is segmented, None if it is the stated one
    suspects : effects that could have caused the faults"""

    faults: list[Fault] = field(default_factory=list)
    remarks: list[str] = field(default_factory=list)
    mirror: str = ""
    registered: World | None = None
    suspects: list[str] = field(default_factory=list)

    def fail(self, code: str, message: str) -> None:
        """Add a fault."""
        self.faults.append(Fault(code, message))


def check_impacts(impacts: int, landings: int, flying: int, edged: Sequence[str], found: Sanity) -> bool:
    """Whether impacts can be judged. If not, adds a remark that only flights are diagnosed, or a fault if fewer than
    two releases have flights (`flying`).

    If blocks stick, few impacts are followed by a flight; then `landings`, which include impacts after which a block
    stays on the ground, count. `edged`: blocks with corners whose angle was not measured."""
    least = FEWEST_REBOUNDS if landings >= FEWEST_IMPACTS else FEWEST_IMPACTS
    stay = f", {landings - impacts} more end the flight of a block for good" if landings > impacts else ""
    why = ""
    if impacts < least:
        why = (
            f"{counted(impacts, 'impact')} {'is' if impacts == 1 else 'are'} too few to separate causes: at least "
            f"{least} are needed{stay}"
        )
    elif edged:
        why = f"The angle of {', '.join(edged)} was not measured, so that impacts on corners cannot be followed"
    if why and flying < FEWEST_RELEASES:
        found.fail(FEW_IMPACTS, why)
    elif why:
        found.remarks.append(f"{why}. The flights were diagnosed alone: nothing can be said of impacts")
    elif impacts < FEWEST_IMPACTS:
        found.remarks.append(
            f"only {counted(impacts, 'impact')} {'is' if impacts == 1 else 'are'} followed by a flight{stay}"
        )
    return not why


def _check_releases(releases: int, found: Sanity) -> None:
    if releases < FEWEST_RELEASES:
        found.fail(
            FEW_RELEASES,
            f"{counted(releases, 'release')} {'is' if releases == 1 else 'are'} too few to separate causes: at least "
            f"{FEWEST_RELEASES} are needed",
        )


def check_film(experiment: Experiment, film: Film) -> Sanity:
    """Checks of the recorded frames: numbers, time step, units, angles, axes, ground, sizes."""
    found = Sanity()
    gravity = window_gravity(experiment, film)
    _check_gravity_is_given(experiment, found)
    _check_time_step(experiment, film, found)
    _check_units(experiment, film, found)
    _check_recorded_gravity(experiment, gravity, found)
    _check_angles(experiment, film, found)
    if not found.faults:
        _check_axes_and_ground(experiment, film, gravity, found)
    if not found.faults and found.registered is None:
        _check_distance(experiment, film, gravity, found)
    _check_releases(len(film.release_names), found)
    return found


def _check_gravity_is_given(experiment: Experiment, found: Sanity) -> None:
    if experiment.gravity_m_s2 == 0:
        found.fail(WRONG_GRAVITY, "gravity_m_s2 is 0: without gravity no block falls")


def _check_time_step(experiment: Experiment, film: Film, found: Sanity) -> None:
    dt = np.diff(film.t_s)[np.diff(film.release) == 0]
    if not len(dt):
        found.fail(NO_FRAMES, "no release has two frames")
        return
    step = float(np.median(dt)) * experiment.fps
    if not 0.8 < step < 1.25:
        found.fail(
            FRAME_RATE,
            f"the frames are {np.median(dt):.6g} s apart, but {experiment.fps:g} frames/s make "
            f"{1 / experiment.fps:.6g} s: one of the two is wrong "
            "(slow-motion files often state the playback rate, not the frame rate of the recording)",
        )
    starts = np.searchsorted(film.release, np.arange(len(film.release_names) + 1))
    expected = [(film.t_s[b - 1] - film.t_s[a]) * experiment.fps + 1 for a, b in itertools.pairwise(starts)]
    lost = 1.0 - len(film.t_s) / max(1.0, sum(expected))
    if lost > 0.02:
        found.remarks.append(f"{100 * lost:.0f} % of the frames were lost")


def _check_units(experiment: Experiment, film: Film, found: Sanity) -> None:
    size = np.array([b.radius_m for b in experiment.blocks.values()])[film.release_block]
    setup = max(float(np.ptp(experiment.cross_section.points_m, axis=0).max()), 1e-9)
    extent = float(np.ptp(film.pose[:, POSITION], axis=0).max())
    if not _check_reach(experiment, film.pose[:, POSITION], found) and extent < 2e-3 * setup:
        found.fail(
            NO_MOTION,
            f"all positions lie within {extent:.3g} m of each other on a set-up "
            f"of {setup:.3g} m: wrong unit, or a block that never moved",
        )
    turn = np.abs(np.diff(film.pose[:, THETA]))[np.diff(film.release) == 0]
    travel = np.hypot(*np.diff(film.pose[:, POSITION], axis=0).T)[np.diff(film.release) == 0]
    moving = travel > 4 * film.noise[X]
    if moving.sum() > 50:
        rolling = float(np.median(turn[moving]) * np.median(size) / np.median(travel[moving]))
        _check_rolling(rolling, found)


def _check_rolling(rolling: float, found: Sanity) -> None:
    """Fault if blocks turn `rolling` times as fast as blocks that roll, which none does."""
    if rolling > MOST_ROLLING:
        found.fail(ANGLE_UNIT, f"blocks turn {rolling:.0f} times as fast as rolling would: are the angles in degrees?")


def _check_velocities(experiment: Experiment, data: ImpactTable, found: Sanity) -> None:
    """Faults of the units of the velocities before the impacts of a table."""
    speed, spin = np.hypot(*data.before[:, LINEAR_VELOCITY].T), np.abs(data.before[:, OMEGA])
    extent = float(np.ptp(experiment.cross_section.points_m, axis=0).max())
    usual, fall = float(np.median(speed)), float(np.sqrt(2.0 * experiment.gravity_m_s2 * extent))
    if usual > LARGEST_SPEED * fall:
        found.fail(
            LENGTH_UNIT,
            f"blocks strike at {usual:.3g} m/s (median), a fall over the whole cross-section gives {fall:.3g} m/s: are "
            "the velocities in millimetres per second?",
        )
    radius = np.array([block.radius_m for block in experiment.blocks.values()])[data.impact_block]
    _check_rolling(float(np.median(spin * radius)) / max(usual, 1e-9), found)


def _check_reach(experiment: Experiment, positions: Array, found: Sanity) -> bool:
    """Whether positions (n, 2) reach far beyond the cross-section, which is a fault."""
    reach = float(np.abs(experiment.cross_section.points_m).max())
    extent = float(np.quantile(np.abs(positions), 0.95))
    if too_far := extent > 20 * reach:
        found.fail(
            LENGTH_UNIT,
            f"positions reach {extent:.3g} where the cross-section reaches {reach:.3g} m: "
            "are they in millimetres or pixels?",
        )
    return too_far


def _check_recorded_gravity(experiment: Experiment, gravity: Array | None, found: Sanity) -> None:
    """Wrong lengths or times: an effect may explain a small error, but not a large one."""
    if gravity is None or found.faults:
        return
    ratio = float(np.hypot(*gravity)) / experiment.gravity_m_s2
    said = (
        f"blocks in flight accelerate by {np.hypot(*gravity):.3g} m/s², gravity is {experiment.gravity_m_s2:g}: "
        f"lengths would be wrong by a factor {ratio:.3g}, or the frame rate by {ratio**-0.5:.3g}"
    )
    if not GRAVITY_RATIO[0] < ratio < GRAVITY_RATIO[1]:
        found.fail(WRONG_GRAVITY, said)
    elif abs(ratio - 1.0) > REMARKABLE_GRAVITY:
        found.remarks.append(said)
    else:
        return
    found.suspects += ["scale_error", "frame_rate_error"]


def _check_axes_and_ground(experiment: Experiment, film: Film, gravity: Array | None, found: Sanity) -> None:
    upwards = gravity is not None and gravity[Y] > 0
    setup = setup_world(experiment)
    worlds = {axis: replace(setup, view=View(mirror=mirror)) for axis, mirror in MIRRORED_SIGNS.items()}
    below = {axis: share_below_ground(world, film) for axis, world in worlds.items()}
    deep = below[""] > IMPOSSIBLE_BELOW_GROUND
    inside = f"in {100 * below['']:.{0 if deep else 1}f} % of the frames the block's centre lies inside the ground"
    if upwards and below["y"] < POSSIBLE_BELOW_GROUND:
        found.mirror = "y"
    elif deep and below["x"] < POSSIBLE_BELOW_GROUND:
        found.mirror = "x"
    elif upwards:
        found.fail(
            UPWARD_GRAVITY, "blocks in flight accelerate upwards: is y measured downwards, from the top of the image?"
        )
        found.suspects.append("mirrored_axis")
    elif deep and (better := registered_world(setup, film, gravity)) is not None:
        found.registered, text = better
        found.remarks.append(f"{inside}, which {text} would explain; the segmentation of the film assumes it")
    elif deep and _ground_gives_way(setup, film):
        found.remarks.append(f"{inside}, which an embankment that yields or soft soil would explain")
    elif deep:
        found.fail(
            BELOW_GROUND, f"{inside}: the cross-section and the film do not belong together (origin, scale or axes)"
        )
        found.suspects += ["scale_error", "camera_tilt", "geometry_error"]
    elif below[""] > 0.002:
        found.remarks.append(inside)
    if found.mirror:
        found.registered = worlds[found.mirror]


def _ground_gives_way(setup: World, film: Film) -> bool:
    """Whether blocks start above the ground, and are later inside it only where it may give way: in an embankment, or
    not deeper than their height."""
    import shapely

    ground, step = setup.cross_section, max(1, len(film.t_s) // MOST_GROUND_FRAMES)
    first = np.searchsorted(film.release, np.arange(len(film.release_names)))
    radius = setup.radii_m[film.release_block[film.release[::step]]]
    position = film.pose[::step, POSITION]
    deep = ground.covers(position) & ground.covers(position + radius[:, None] * [0.0, 1.0])
    if (rise := ground.embankment) is not None:
        embankment = shapely.make_valid(shapely.Polygon(ground.points_m[rise.left : rise.right + 1]))
        shapely.prepare(embankment)
        deep &= ~shapely.covers(embankment, shapely.points(position))
    shares = deep.mean(), ground.covers(film.pose[first, POSITION]).mean()
    return bool(max(shares) < IMPOSSIBLE_BELOW_GROUND)


def _check_angles(experiment: Experiment, film: Film, found: Sanity) -> None:
    """Find angles that are given but were not measured: they never change although the block moves."""
    table = experiment.trajectories
    assert table is not None
    for b, name in enumerate(film.block_names):
        if table.loc[table["block"] == name, "theta_rad"].isna().all():
            continue  # left empty: nothing is stated
        own = [film.pose[film.release == r] for r in np.flatnonzero(film.release_block == b)]
        moved = [pose for pose in own if np.ptp(pose[:, POSITION], axis=0).max() > 10 * film.noise[X]]
        still = STILL_ANGLE_SDS * experiment.angle_noise_rad
        if not moved or any(np.std(pose[:, THETA]) > still for pose in moved):
            continue
        message = f"the angle of block {name} never changes, though the block moves: was theta_rad measured?"
        if experiment.blocks[name].shape == "circle":
            found.remarks.append(f"{message} Its spin and the effects on it cannot be judged")
        else:
            found.fail(CONSTANT_ANGLE, message)


def _check_distance(experiment: Experiment, film: Film, gravity: Array | None, found: Sanity) -> None:
    """Find films outside the cross-section, above the ground or deep in it: a wrong origin or a wrong block."""
    setup = setup_world(experiment)
    ends = experiment.cross_section.points_m[[0, -1], X]
    beside = float(((film.pose[:, X] < ends[0]) | (film.pose[:, X] > ends[1])).mean())
    if beside > MOST_BESIDE:
        found.fail(
            BESIDE_GROUND,
            f"in {100 * beside:.0f} % of the frames the block is outside the cross-section: "
            "they do not belong together (origin, scale or axes)",
        )
        return
    lowest, left = lowest_clearances(setup, film)
    landed = left > LANDED_FRAMES  # others may have ended in mid-air
    for b, name in enumerate(film.block_names):
        own, radius = lowest[landed & (film.release_block == b)], experiment.blocks[name].radius_m
        low = float(np.median(own)) if len(own) else 0.0
        size = f"{abs(low) * radius:.3g} m"
        if low < -DEEP_RADII or low > LARGEST_CLEARANCE_RADII:
            where = f"sinks {size} into the ground" if low < 0 else f"comes no closer to the ground than {size}"
            found.remarks.append(
                f"block {name} {where} (median of the releases), {abs(low):.1f} times its radius: are its size and the "
                "origin right?"
            )
    low = float(np.median(lowest[landed])) if landed.any() else 0.0
    if low > FAR_RADII and registered_world(setup, film, gravity) is None:
        found.fail(
            ABOVE_GROUND,
            f"the blocks come no closer to the ground than {low:.1f} times their radius (median of the releases): "
            "the cross-section and the film do not belong together (origin, scale or axes)",
        )


def check_table(experiment: Experiment, data: ImpactTable) -> Sanity:
    """Checks of an impact table: numbers, units, direction of the impacts, energy."""
    found = Sanity()
    _check_gravity_is_given(experiment, found)
    _check_releases(len(data.order), found)
    if found.faults:
        return found
    _check_reach(experiment, data.before[:, POSITION], found)
    _check_velocities(experiment, data, found)
    mass, inertia = np.array([(b.mass_kg, b.inertia_kg_m2) for b in experiment.blocks.values()])[data.impact_block].T
    energy = [
        0.5 * mass * (v**2).sum(axis=1) + 0.5 * inertia * w**2
        for v, w in (
            (data.before[:, LINEAR_VELOCITY], data.before[:, OMEGA]),
            (data.after[:, VELOCITY_AFTER], data.after[:, SPIN_AFTER]),
        )
    ]
    gains = float((energy[1] > 1.05 * energy[0]).mean())
    if gains > 0.5:
        found.fail(
            ENERGY_GAIN,
            f"{100 * gains:.0f} % of the impacts gain energy: "
            "are the columns before and after exchanged, or is an axis mirrored?",
        )
    elif gains > 0.02:
        found.remarks.append(f"{100 * gains:.0f} % of the impacts gain more than 5 % of kinetic energy")
    return found
