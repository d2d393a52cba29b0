"""Blocks that lie still on the ground at the end of their releases: how high above it, and how inclined against it.

A polygon lies on one of its sides and a circle touches the ground, whatever happened before. So rest poses show without
any law of contact whether ground, scale and tracked angle are as stated."""

from __future__ import annotations

from collections.abc import Hashable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Self

import numpy as np

from rock2d.arrays import Array
from rock2d.kinematics.flights import Film
from rock2d.records.columns import POSE, POSITION, THETA, X, Y
from rock2d.scene.blocks import Block
from rock2d.scene.nearest_facet import nearest_facets
from rock2d.scene.world import World
from rock2d.statistics import MAD_TO_SD

REST_FRAMES = 10  # number of last frames of a release in which a block at rest does not move
STILL_SDS = 8.0  # largest range of their positions, in standard deviations of the noise
FARTHEST_RADII = 2.0  # largest distance from the ground of a block that lies on it, in radii
STEEPEST_SIDE_RAD = np.deg2rad(10.0)  # largest angle between a side on which a block lies and the ground
FEWEST_RESTS = 5  # fewest rests of a block
OUTLYING_REST_SDS = 5.0  # distance of a rest from the trend of its block along x, in robust standard deviations
# 1 sigma of what all rests of a block share: the accuracy of its size, and the depth to which it sinks into the ground,
# in radii; the accuracy of its sides, and hills of the ground, in rad
SHARED_HEIGHT_RADII, SHARED_ANGLE_RAD = 0.02, 0.005


@dataclass
class RestPoses:
    """Rests of a film.

    Attributes
    ----------
    release, block : (r,) index of release and block
    pose : (r, 3) mean of the last recorded poses
    sd : (r, 2) standard deviation of height in m and angle in rad from rest to rest of the same block"""

    release: Array
    block: Array
    pose: Array
    sd: Array

    @classmethod
    def of(cls, film: Film, world: World) -> Self:
        """The rests of a film that lie on the ground of a world, of all blocks with enough of them."""
        release, block, pose = still_poses(film, world)
        lies = heights_and_angles(world, block, pose)
        radius = world.radii_m[block]
        keep = (np.abs(lies[:, 0]) < FARTHEST_RADII * radius) & (np.abs(lies[:, 1]) < STEEPEST_SIDE_RAD)
        sd = np.tile(film.noise[[Y, THETA]], (len(block), 1)) / np.sqrt(REST_FRAMES)
        for b in range(len(world.blocks)):
            own = keep & (block == b)
            if own.sum() < FEWEST_RESTS:
                keep &= ~own
                continue
            away = np.abs(_without_trend(pose[own, X], lies[own]))
            sd[own] = np.maximum(MAD_TO_SD * np.median(away, axis=0), sd[own])
            keep[own] = (away < OUTLYING_REST_SDS * sd[own]).all(axis=1)
        return cls(release[keep], block[keep], pose[keep], sd[keep])

    def __len__(self) -> int:
        return len(self.release)

    def only(self, releases: Array) -> Self:
        """The rests of some releases, given as a mask. The row of a block belongs to its first rest, so the others stay
        only with that one."""
        keep = releases[self.release] & np.isin(self.block, self.blocks[releases[self.first_release]])
        return replace(self, release=self.release[keep], block=self.block[keep], pose=self.pose[keep], sd=self.sd[keep])

    @cached_property
    def blocks(self) -> Array:
        """(k,) blocks with rests."""
        return np.unique(self.block)

    @cached_property
    def first_release(self) -> Array:
        """(k,) first release with a rest of each of `blocks`."""
        return np.array([self.release[self.block == b][0] for b in self.blocks], np.int64)

    def key(self, world: World) -> Hashable:
        """Key of everything in a world on which `residuals` depend."""
        profiles = [(block.semi_axes_m, block.corners_m.tobytes()) for block in world.blocks.values()]
        return world.view, world.cross_section.points_m.tobytes(), tuple(profiles)

    def residuals(self, world: World) -> Array:
        """(k, 3) mean height, mean angle, and slope of the line of rests along the ground, of each of `blocks` in a
        world, in standard deviations; 0 on average if the blocks lie on the ground."""
        return self.standardised(heights_and_angles(world, self.block, self.pose), world)

    def standardised(self, lies: Array, world: World) -> Array:
        """(k, 3, ...) `residuals` from heights and angles (r, 2, ...).

        What all rests of a block share is known less well than their mean, so it is added to its error."""
        found = np.zeros((len(self.blocks), 3, *lies.shape[2:]))
        for row, b in enumerate(self.blocks):
            own = self.block == b
            error, away_m = self.sd[own][0] / np.sqrt(own.sum()), self.pose[own, X] - self.pose[own, X].mean()
            found[row, :2] = lies[own].mean(axis=0)
            found[row, 0] /= np.hypot(error[0], SHARED_HEIGHT_RADII * world.radii_m[b])
            found[row, 1] /= np.hypot(error[1], SHARED_ANGLE_RAD)
            if spread_m2 := np.mean(away_m**2):
                slope = np.tensordot(away_m, lies[own, 0], 1) / (own.sum() * spread_m2)
                found[row, 2] = slope / np.hypot(error[0] / np.sqrt(spread_m2), SHARED_ANGLE_RAD)
        return found


def still_poses(film: Film, world: World) -> tuple[Array, Array, Array]:
    """Releases (n,) that end at rest, their blocks (n,) and mean last recorded poses (n, 3). A polygon without a
    measured angle is left out: its height depends on the angle."""
    smooth = np.array([block.smooth for block in world.blocks.values()])
    ends = np.searchsorted(film.release, np.arange(len(film.release_names)), side="right")
    releases, poses = list[int](), list[Array]()
    for release in np.flatnonzero(film.angle_known | smooth[film.release_block]).tolist():
        pose = film.pose[max(ends[release] - REST_FRAMES, 0) : ends[release]]
        if np.ptp(pose[:, POSITION], axis=0).max() < STILL_SDS * film.noise[:2].max():
            releases.append(release)
            poses.append(pose.mean(axis=0))
    found = np.array(releases, np.int64)
    return found, film.release_block[found], np.array(poses).reshape(-1, 3)


def heights_and_angles(world: World, block: Array, pose: Array) -> Array:
    """(n, 2) height in m of the side on which a block lies above the ground of a world, and the angle in rad between
    side and ground, for recorded poses (n, 3) of the centroid. A smooth block has the angle 0."""
    true = world.view.true(pose[:, POSE])
    along, below = ground_below(world, true)
    away = true[:, POSITION] - below
    distance = along[:, X] * away[:, Y] - along[:, Y] * away[:, X]
    found = np.zeros((len(block), 2))
    for b, shape in enumerate(world.blocks.values()):
        own = block == b
        turn = true[own, THETA] - np.arctan2(along[own, Y], along[own, X])
        if shape.smooth:
            found[own, 0] = distance[own] - shape.height_above_lowest_point_m(turn)
        else:
            reach, angle = _lowest_side(shape, turn)
            found[own] = np.column_stack([distance[own] - reach, angle])
    return found


def ground_below(world: World, true: Array) -> tuple[Array, Array]:
    """Directions (n, 2) of the facets that are nearest to true poses (n, 3), and points (n, 2) of them."""
    points = world.cross_section.points_m
    facet = nearest_facets(true[:, POSITION], points)
    along = points[facet + 1] - points[facet]
    return along / np.hypot(*along.T)[:, None], points[facet]


def _without_trend(x_m: Array, lies: Array) -> Array:
    """(n, 2) heights and angles less their robust lines along x: a wrong slope of ground or picture is no scatter."""
    from scipy.stats import theilslopes

    left = np.empty_like(lies)
    for k, values in enumerate(lies.T):
        slope = theilslopes(values, x_m).slope if np.ptp(x_m) else 0.0
        left[:, k] = values - slope * x_m
    return left - np.median(left, axis=0)


def _lowest_side(block: Block, turn: Array) -> tuple[Array, Array]:
    """Distance (n,) in m of the centroid of a polygon from the side that is nearest to the direction of the ground, and
    the angle (n,) in rad of that side, at orientations `turn` (n,) against the ground."""
    side = np.roll(block.corners_m, -1, axis=0) - block.corners_m
    angle = np.angle(np.exp(1j * (turn[:, None] + np.arctan2(side[:, Y], side[:, X]))))
    lowest = np.argmin(np.abs(angle), axis=1)
    return block.side_distances_m[lowest], angle[np.arange(len(turn)), lowest]
