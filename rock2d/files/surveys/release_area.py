"""Release areas: the upper half of the highest stretch of a profile that is steep enough to be a rockfall source."""

from typing import NamedTuple

import numpy as np

from rock2d.arrays import Array
from rock2d.errors import InputError
from rock2d.files.surveys.profile import Profile, simplified

STEEP_DEG = 45.0  # least slope of a rockfall source (GNS Science, Otago rockfall study, 2022)
SIMILAR_DEG = 5.0  # facets that are flatter than the steepest one by at most this belong to its stretch
LEAST_DROP_M, LEAST_DROP = 2.0, 0.05  # least height of a stretch, also as a share of the relief
# Share of the relief: points closer to the line than this, or than half a block, are roughness.
NEGLIGIBLE = 0.02
LEAST_AREA_SIZES = 0.4  # length of the shortest release area over the size of the block: blocks tip over an edge


class Stretch(NamedTuple):
    """A steep part of a profile: its points from top to bottom."""

    points_m: Array

    @property
    def drop_m(self) -> float:
        return float(self.points_m[0, 1] - self.points_m[-1, 1])

    @property
    def slope_deg(self) -> float:
        along, down = self.points_m[-1] - self.points_m[0]
        return float(np.degrees(np.arctan2(-down, along)))

    def __str__(self) -> str:
        return f"x = {self.points_m[0, 0]:.4g} to {self.points_m[-1, 0]:.4g} m"


class ReleaseArea(NamedTuple):
    """Range of x in which blocks start, and the reason in words."""

    low_m: float
    high_m: float
    why: str

    def __str__(self) -> str:
        return f"x = {self.low_m:.4g} to {self.high_m:.4g} m"


def release_area(profile: Profile, block_m: float) -> ReleaseArea:
    """The upper half of the highest stretch that is steeper than STEEP_DEG, else of the steepest stretch.

    `block_m` is the size of the block. Only the upper half, because a block from the foot of a face has a shorter fall
    than the design must consider."""
    relief = float(np.ptp(profile.points_m[:, 1]))
    points = simplified(profile, min(0.5 * block_m, NEGLIGIBLE * relief)).points_m
    slopes = np.degrees(np.arctan2(-np.diff(points[:, 1]), np.diff(points[:, 0])))
    least = min(LEAST_DROP_M, LEAST_DROP * relief)
    steep = [s for s in _stretches(points, slopes >= STEEP_DEG) if s.drop_m >= least]
    if steep:
        chosen, *others = sorted(steep, key=lambda stretch: -stretch.points_m[0, 1])
        why = f"the highest stretch of at least {STEEP_DEG:g}°"
        if others:
            why += f" (further ones: {'; '.join(f'{s}, {s.slope_deg:.0f}°' for s in others)})"
    else:
        drops = -np.diff(points[:, 1])
        steepest = int(np.argmax(np.where(drops >= min(least, drops.max()), slopes, -np.inf)))
        similar = _stretches(points, slopes >= slopes[steepest] - SIMILAR_DEG)
        chosen = next(s for s in similar if (s.points_m[:-1] == points[steepest]).all(axis=1).any())
        why = f"the steepest stretch; no ground is as steep as {STEEP_DEG:g}°"
    low, high = _upper_half(chosen, profile.points_m[0, 0], profile.points_m[-1, 0], block_m)
    return ReleaseArea(
        low, high, f"upper half of {chosen}, {chosen.slope_deg:.0f}° and {chosen.drop_m:.3g} m high: {why}"
    )


def given_area(profile: Profile, bounds: tuple[float, float]) -> ReleaseArea:
    """The release area between two stations of the survey. Raises InputError if it lies beside the profile."""
    low, high = sorted(profile.stations.x_m(station) for station in bounds)
    if not profile.points_m[0, 0] <= low < high <= profile.points_m[-1, 0]:
        ends = sorted(profile.stations.station_m(profile.points_m[[0, -1], 0]))
        raise InputError(
            f"--release {bounds[0]:g} {bounds[1]:g}: expected two stations of the survey, which reaches from "
            f"{ends[0]:g} to {ends[1]:g} m",
            option="release",
        )
    return ReleaseArea(low, high, "as given with --release")


def _stretches(points: Array, steep: Array) -> list[Stretch]:
    """Runs of steep facets."""
    edges = np.flatnonzero(np.diff(np.r_[False, steep, False]))
    return [Stretch(points[i : j + 1]) for i, j in zip(edges[::2], edges[1::2], strict=True)]


def _upper_half(stretch: Stretch, left: float, right: float, block_m: float) -> tuple[float, float]:
    """Range of x of the upper half, at least LEAST_AREA_SIZES blocks long and half a block away from the ends of
    the profile."""
    x, y = stretch.points_m.T
    middle = float(np.interp(0.5 * stretch.drop_m, y[0] - y, x))
    low = min(max(float(x[0]), left + 0.5 * block_m), right - block_m)
    return low, max(middle, low + LEAST_AREA_SIZES * block_m)
