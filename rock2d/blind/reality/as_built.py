"""Shapes as they are built, which may differ from the stated ones: cross-section, roughness, corners of the blocks."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from rock2d.blind.reality.data_model import Array, Block, Setup

STEEPEST_FACING_RAD = np.deg2rad(85.0)
HILL_WAVES = 5
HILL_PIECES = 8  # straight pieces of ground in a wavelength of hills


def setup_as_built(setup: Setup, error: dict[str, float], size_m: float) -> Setup:
    """The set-up with its facing turned about its foot, or its ditch raised by `rise` times the embankment's height.

    Without an embankment all ground is inclined about its centre, or raised by `rise` times the size of a block.
    """
    points = np.array(setup.points_m, float)
    turn, rise = error.get("turn_rad", 0.0), error.get("rise", 0.0)
    if setup.face is None:
        points[:, 1] += rise * size_m + np.tan(turn) * (points[:, 0] - points[:, 0].mean())
        return replace(setup, points_m=points)
    foot, crest = setup.face
    run, height = points[crest] - points[foot]
    angle = np.clip(np.arctan2(height, run) + turn, np.deg2rad(5.0), STEEPEST_FACING_RAD)
    shear = height / np.tan(angle) - run
    if crest + 1 < len(points):
        shear = min(shear, 0.9 * (points[crest + 1, 0] - points[crest, 0]))
    share = (points[foot : crest + 1, 1] - points[foot, 1]) / height
    points[foot : crest + 1, 0] += shear * share
    if setup.ditch is not None:
        points[setup.ditch[0] : setup.ditch[1] + 1, 1] += rise * height
    return replace(setup, points_m=points)


def rough_profile(points: Array, rough: dict[str, float]) -> tuple[Array, Array]:
    """A rough profile through the vertices of the set-up, and the facet of the set-up below each of its pieces.

    Neighbouring heights are correlated; the slopes of the pieces have the standard deviation `sd_rad`.
    """
    rng = np.random.default_rng(int(rough["profile"]))
    memory = 0.5
    out, pieces = [points[:1]], []
    for f in range(len(points) - 1):
        edge = points[f + 1] - points[f]
        length = float(np.hypot(*edge))
        count = max(2, round(length / rough["spacing_m"]))
        height = np.zeros(count + 1)
        sd = np.tan(rough["sd_rad"]) * length / count / np.sqrt(2.0 * (1.0 - memory))
        for k in range(1, count):
            height[k] = memory * height[k - 1] + np.sqrt(1.0 - memory**2) * rng.normal(0.0, sd)
        share = np.arange(1, count + 1)[:, None] / count
        out.append(points[f] + share * edge + height[1:, None] * np.array([-edge[1], edge[0]]) / length)
        pieces += [f] * count
    rough_points = np.concatenate(out)
    steps = np.maximum(np.diff(rough_points[:, 0]), 1e-3 * rough["spacing_m"])
    rough_points[1:, 0] = rough_points[0, 0] + np.cumsum(steps)
    return rough_points, np.array(pieces)


def hilly_profile(points: Array, hills: dict[str, float]) -> tuple[Array, Array]:
    """The ground with smooth hills and dips along x, and the facet of `points` below each of its pieces.

    Waves of random phase, with wavelengths of 0.6 to 1.4 `wavelength_m`, make the heights; their root mean square is
    about `height_m`.
    """
    rng = np.random.default_rng(int(hills["profile"]))
    spread = 0.6 + 0.8 * (np.arange(HILL_WAVES) + rng.random(HILL_WAVES)) / HILL_WAVES
    numbers = 2.0 * np.pi / (hills["wavelength_m"] * spread)
    phases = rng.uniform(0.0, 2.0 * np.pi, HILL_WAVES)
    lengths = np.hypot(*np.diff(points, axis=0).T)
    counts = np.ceil(HILL_PIECES * lengths / hills["wavelength_m"]).astype(int)
    pieces = np.repeat(np.arange(len(counts)), counts)
    share = np.concatenate([np.arange(count) / count for count in counts])[:, None]
    out = np.vstack([points[pieces] + share * (points[pieces + 1] - points[pieces]), points[-1:]])
    waves = np.cos(out[:, :1] * numbers + phases).sum(axis=1)
    out[:, 1] += hills["height_m"] * np.sqrt(2.0 / HILL_WAVES) * waves
    return out, pieces


def block_outline(block: Block, edges: dict[str, float] | None, form: int) -> tuple[Array, float, int]:
    """Corners in m, radius of the circles that they carry, and number of corners that share a contact (0: a circle).

    A circle gives its centre and radius. With rounded edges (form 0) a polygon gives the inset polygon, with cut edges
    (form 1) twice as many corners.
    """
    if block.vertices_m is None:
        return np.zeros((1, 2)), block.radius_m, 0
    corners = np.array(block.vertices_m, float)
    if edges is None:
        return corners, 0.0, 1
    cut = edges["share"] * block.half_width_m
    ahead, behind = np.roll(corners, -1, axis=0) - corners, np.roll(corners, 1, axis=0) - corners
    ahead /= np.hypot(*ahead.T)[:, None]
    behind /= np.hypot(*behind.T)[:, None]
    if form == 1:
        half = 0.5 * cut
        return np.stack([corners + half * behind, corners + half * ahead], axis=1).reshape(-1, 2), 0.0, 2
    sine = np.abs(ahead[:, 0] * behind[:, 1] - ahead[:, 1] * behind[:, 0])
    return corners + cut * (ahead + behind) / sine[:, None], cut, 1
