"""A slope profile: horizontal station and height, with the slope falling to the right, simplified."""

from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from rock2d.arrays import Array
from rock2d.errors import InputError
from rock2d.scene.cross_section import CrossSection, CrossSectionError

PROFILE_EXTRA = "pip install 'rock2d[profile]'"  # for drawings and terrain models
MOST_POINTS = 100_000
FEWEST_POINTS = 2
MOST_STATIONS = 5  # stations of overhangs in a remark


class Stations(NamedTuple):
    """How x follows from the stations of the survey: x = origin_m + direction × station."""

    origin_m: float = 0.0
    direction: float = 1.0

    def x_m(self, station_m: Any) -> Any:
        """x of a station of the survey."""
        return self.origin_m + self.direction * station_m

    def station_m(self, x_m: Any) -> Any:
        """Station of the survey at an x."""
        return (x_m - self.origin_m) * self.direction


AS_SURVEYED = Stations()


@dataclass(frozen=True)
class Profile:
    """Points of a slope profile.

    Attributes
    ----------
    points_m : (n, 2) station and height in m, left to right
    source : origin in words
    remarks : changes and hints in words
    stations : conversion to the stations of the survey, in which zones and release areas are given"""

    points_m: Array
    source: str
    remarks: tuple[str, ...] = ()
    stations: Stations = AS_SURVEYED


def checked_profile(points_m: Array, source: str) -> Profile:
    """The profile of these points (n, 2) without repeated points; it falls to the right and starts at x = 0.

    Raises InputError if there are too few or too many points, if one is not finite, or if they form no surface."""
    points = np.asarray(points_m, float)
    if points.ndim != 2 or points.shape[1:] != (2,) or not FEWEST_POINTS <= len(points) <= MOST_POINTS:
        raise InputError(f"{source}: expected 2 to {MOST_POINTS} points, found {len(points)}", code="bad_table")
    if not np.isfinite(points).all():
        row = int(np.flatnonzero(~np.isfinite(points).all(axis=1))[0]) + 1
        raise InputError(f"{source}: point {row} is not a pair of finite numbers", code="bad_table")
    remarks = []
    if points[0, 0] > points[-1, 0]:
        points = points[::-1]
    keep = np.r_[True, np.hypot(*np.diff(points, axis=0).T) > 0.0]
    if not keep.all():
        remarks.append(f"{(~keep).sum()} repeated points left out")
    points = points[keep]
    stations = Stations(-float(points[0, 0]))
    if points[0, 1] < points[-1, 1]:
        stations = Stations(float(points[-1, 0]), -1.0)
        points = points[::-1]
        remarks.append(f"mirrored, so that it falls to the right: x = {stations.origin_m:.6g} m - station")
    elif points[0, 0] != 0.0:
        remarks.append(f"stations reduced by {points[0, 0]:.6g} m, so that they begin at 0")
    shifted = np.column_stack([stations.x_m(points[:, 0]), points[:, 1]])
    if (back := np.flatnonzero(np.diff(shifted[:, 0]) < 0.0)).size:
        at = ", ".join(f"{stations.station_m(x):.6g}" for x in shifted[back, 0][:MOST_STATIONS])
        remarks.append(f"the ground overhangs after the station {at}: check that the numbers are right")
    try:
        CrossSection(shifted, ["ground"] * (len(shifted) - 1))
    except CrossSectionError as error:
        raise InputError(f"{source}: {error}", code="bad_cross_section") from None
    return Profile(shifted, source, tuple(remarks), stations)


def station_and_height(points_m: Array) -> Array:
    """(n, 2) station and height of points on a map (n, 3: x, y, height): the station is the distance along them. Points
    (n, 2) are returned unchanged."""
    if points_m.shape[1] == 2:
        return points_m
    way = np.concatenate([[0.0], np.hypot(*np.diff(points_m[:, :2], axis=0).T).cumsum()])
    return np.column_stack([way, points_m[:, 2]])


def simplified(profile: Profile, tolerance_m: float) -> Profile:
    """The profile without points that change the surface by less than the tolerance (Douglas and Peucker 1973)."""
    import shapely

    line = shapely.LineString(profile.points_m).simplify(tolerance_m, preserve_topology=True)
    points = np.asarray(line.coords)
    if len(points) == len(profile.points_m):
        return profile
    remark = f"{len(profile.points_m)} points simplified to {len(points)}, within {tolerance_m:g} m"
    return replace(profile, points_m=points, remarks=(*profile.remarks, remark))
