"""Registration: a rough correction of camera or cross-section, so that a film can be segmented.

The segmentation needs a ground to which the blocks come down. If the blocks lie inside the stated ground, a wrong scale
or tilt of the camera, or a cross-section that differs from the survey, may be the reason. The correction is good enough
for the segmentation and for a first fit of the law. The diagnosis then finds the cause among all effects."""

import contextlib
import itertools
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from rock2d.arrays import Array
from rock2d.effects import catalogue
from rock2d.effects.changes import aim_and_width
from rock2d.engines.geometry import block_arrays, ground_arrays
from rock2d.kinematics.flights import Film, clearances
from rock2d.scene.world import View, World

CAMERA_GRID = 21  # tried positions of the kept point along x and along y, within the image width
CROSS_SECTION_GRID = 9  # number of tried values of each parameter of the cross-section
MOST_GROUND_FRAMES = 20000  # approximate number of frames that are checked against the ground
MOST_REGISTRATION_FRAMES = 5000  # approximate number of frames that are searched for the lowest points
BEYOND_CATALOGUE = 0.1  # largest excess of scale and tilt (rad) over the ranges of the catalogue
USUAL_DEPTH_RADII = 0.2  # usual penetration of blocks into soil, in block radii
ASIDE_RADII = 0.05  # penalty in block radii for a kept point one image width aside of the middle
POSSIBLE_BELOW_GROUND = 0.05  # largest acceptable share of the frames with the centroid in the ground
LARGEST_CLEARANCE_RADII = 0.5  # block radii between the ground and the lowest points of most releases


def share_below_ground(world: World, film: Film) -> float:
    """Share of frames with the centroid inside the ground."""
    step = max(1, len(film.t_s) // MOST_GROUND_FRAMES)
    pose = world.view.true(film.pose[::step])
    return float(world.cross_section.covers(pose[:, :2]).mean())


def lowest_clearances(world: World, film: Film) -> tuple[Array, Array]:
    """For each release (releases,): least clearance of the block in radii, negative in the ground; and the number of
    frames after it."""
    step = max(1, len(film.t_s) // MOST_REGISTRATION_FRAMES)
    blocks = [(block_arrays(b), b.radius_m) for b in world.blocks.values()]
    ground = ground_arrays(world.cross_section)
    starts = np.searchsorted(film.release, np.arange(len(film.release_names) + 1))
    lowest = []
    for b, (first, last) in zip(film.release_block, itertools.pairwise(starts), strict=True):
        block, radius = blocks[b]
        clearance = clearances(block, ground, world.view.true(film.pose[first:last:step]))
        low = int(np.argmin(clearance))
        lowest.append((clearance[low] / radius, last - first - 1 - low * step))
    least, left = np.array(lowest).T
    return least, left


def registered_world(world: World, film: Film, gravity: Array | None) -> tuple[World, str] | None:
    """A corrected world in which most releases come down just to the ground, and the correction in words; None if there
    is none.

    gravity : (2,) recorded acceleration of flights in m/s², None if it is not known"""

    def miss(other: World) -> float:
        """Misfit in block radii: distance of the lowest points of the releases from a usual depth, and from each other,
        with a penalty for a picture that keeps a point aside of the middle of the set-up."""
        low, middle, high = np.quantile(lowest_clearances(other, film)[0], (0.25, 0.5, 0.75))
        aside = 0.0 if other.view == world.view else np.hypot(*np.subtract(other.view.fixed_m, aim)) / width
        return float(abs(middle + USUAL_DEPTH_RADII) + high - low + ASIDE_RADII * aside)

    aim, width = aim_and_width(world.cross_section)
    best, text = min([*_cameras(world, gravity), *_cross_sections(world)], key=lambda tried: miss(tried[0]))
    clearance = float(np.median(lowest_clearances(best, film)[0]))
    fits = abs(clearance) < LARGEST_CLEARANCE_RADII and share_below_ground(best, film) < POSSIBLE_BELOW_GROUND
    return (best, text) if fits else None


def _cameras(world: World, gravity: Array | None) -> Iterator[tuple[World, str]]:
    """Worlds with a camera whose tilt and scale give the recorded gravity, for many positions of its axis; none if
    they are far beyond the ranges of the catalogue."""
    if gravity is None:
        return
    (x, y), width = aim_and_width(world.cross_section)
    scale = float(np.hypot(*gravity)) / max(world.gravity_m_s2, 1e-9)
    tilt = float(np.arctan2(gravity[0], -gravity[1]))
    for name, value in (("scale_error", scale), ("camera_tilt", tilt)):
        size = catalogue()[name].parameters[0]
        if not size.low - BEYOND_CATALOGUE <= value <= size.high + BEYOND_CATALOGUE:
            return
    text = (
        f"an image turned by {np.degrees(tilt):z.1f}° (camera_tilt) and {scale:.3f} times as large as stated "
        "(scale_error)"
    )
    grid = width * np.linspace(-1.0, 1.0, CAMERA_GRID)
    for right in grid:
        for up in grid:
            yield replace(world, view=View(tilt, scale, kept_m=(x + right, y + up))), text


def _cross_sections(world: World) -> Iterator[tuple[World, str]]:
    """Worlds with a cross-section that differs from the survey."""
    effect = catalogue()["geometry_error"]
    what, unit = ("facing", "ditch"), "embankment heights"
    if world.cross_section.embankment is None:
        what, unit = ("ground", "ground"), "block sizes"
    turns, rises = (np.linspace(p.low, p.high, CROSS_SECTION_GRID) for p in effect.parameters)
    for turn, rise in itertools.product(turns, rises):
        text = (
            f"a {what[0]} turned by about {np.degrees(turn):z.0f}° and a {what[1]} raised by about {rise:z.2f} {unit} "
            "(geometry_error)"
        )
        with contextlib.suppress(ValueError):  # a cross-section that would cross itself
            yield effect.apply(world, [turn, rise]), text
