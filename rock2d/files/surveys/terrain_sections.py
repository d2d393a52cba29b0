"""Straight cross-sections of the terrain along the paths of releases, from a start towards the stops.

The heights of the terrain model are used only near the known starts and stops: elsewhere, a terrain model that was made
from tracks is a guess. There the ground continues with one inclination."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from rock2d.arrays import Array
from rock2d.errors import InputError
from rock2d.files.field_releases import FieldReleases
from rock2d.scene.cross_section import CrossSection

if TYPE_CHECKING:
    from rock2d.files.surveys.terrain import Terrain

EDGE_ZONE = "edge"  # zone of the ground at the start
BEHIND_M, LENGTH_M = 5.0, 250.0  # extent of a section behind the start and ahead of it
TRUSTED_CELLS = 1.0  # cells around the known starts and stops within which heights are trusted
LINE_STEP_M, LINE_HEIGHT_M = 10.0, 50.0  # spacing and length of measure lines
NEARBY_M = 10.0  # standard deviation of the weights by which starts nearby determine a direction


@dataclass(frozen=True)
class TerrainSections:
    """The terrain of a field test, and the releases with known starts and stops.

    Attributes
    ----------
    terrain : heights
    known : releases with starts and stops
    zones : name -> inclination in degrees from which the ground belongs to it; below all of them, to the lowest
    edge_m : length of the zone `EDGE_ZONE` from the start on
    beyond_deg : inclination of the ground beyond the known starts and stops; positive: it rises"""

    terrain: Terrain
    known: FieldReleases
    zones: Mapping[str, float]
    edge_m: float
    beyond_deg: float = 0.0

    def direction_rad(self, start_m: Array) -> float:
        """Direction from a start (2,) to the stops: the weighted mean of the known releases, of which those that start
        nearby have the largest weights."""
        apart = np.hypot(*(self.known.starts_m - start_m).T)
        nearest = apart.min()
        weight = np.exp(-0.5 * ((apart - nearest) / NEARBY_M) ** 2)
        ways = self.known.stops_m - self.known.starts_m
        east, north = (weight[:, None] * ways).sum(axis=0)
        return float(np.arctan2(north, east))

    @cached_property
    def lateral_sd_rad(self) -> float:
        """Standard deviation of the directions of the known releases about `direction_rad`."""
        ways = self.known.stops_m - self.known.starts_m
        expected = np.array([self.direction_rad(start) for start in self.known.starts_m])
        turn = np.angle(np.exp(1j * (np.arctan2(ways[:, 1], ways[:, 0]) - expected)))
        return float(np.sqrt(np.mean(turn**2)))

    def section(self, start_m: Array, direction_rad: float) -> CrossSection:
        """The ground along a straight line through a start (2,); x is the horizontal distance from the start.

        Raises InputError if the start is outside the terrain."""
        step = 0.5 * self.terrain.cell_m
        way = np.arange(-BEHIND_M, LENGTH_M + step, step)
        ahead = np.array([np.cos(direction_rad), np.sin(direction_rad)])
        points = np.asarray(start_m) + way[:, None] * ahead
        heights = self.terrain.heights_m(points)
        at_start = int(np.searchsorted(way, 0.0))
        trusted = self._trusted(points, start_m) & np.isfinite(heights)
        trusted[:at_start] = np.isfinite(heights[:at_start])
        if not trusted[: at_start + 1].all():
            x, y = start_m
            raise InputError(f"no height is known around the start at x = {x:.6g}, y = {y:.6g}", code="bad_value")
        last = int(np.argmin(trusted)) if not trusted.all() else len(way)
        heights[last:] = heights[last - 1] + (way[last:] - way[last - 1]) * np.tan(np.radians(self.beyond_deg))
        return CrossSection(np.column_stack([way, heights]), self._zone_names(way, heights))

    def mean_section(self) -> CrossSection:
        """The section through the mean start, with measure lines at the distances `lines_m`."""
        start = self.known.starts_m.mean(axis=0)
        ground = self.section(start, self.direction_rad(start))
        feet = ground.height_m(self.lines_m)
        lines = {f"at_{x:g}_m": [[x, y], [x, y + LINE_HEIGHT_M]] for x, y in zip(self.lines_m, feet, strict=True)}
        return CrossSection(ground.points_m, ground.zones, lines)

    @cached_property
    def lines_m(self) -> Array:
        """Distances from the start, every 10 m, up to the farthest known stop."""
        return np.arange(LINE_STEP_M, self.known.distances_m.max() + LINE_STEP_M, LINE_STEP_M)

    def _zone_names(self, way: Array, heights: Array) -> list[str]:
        inclination = np.degrees(np.arctan(-np.diff(heights) / np.diff(way)))
        ordered = sorted(self.zones.items(), key=lambda item: -item[1])
        lowest = min(self.zones, key=self.zones.__getitem__)
        names = [next((name for name, least in ordered if deg >= least), lowest) for deg in inclination]
        return [EDGE_ZONE if end <= self.edge_m else name for name, end in zip(names, way[1:], strict=True)]

    def _trusted(self, points: Array, start_m: Array) -> Array:
        import shapely

        area = self._known_area
        if not area.covers(shapely.Point(start_m)):  # a start beyond the known ones
            area = shapely.union(area, shapely.Point(start_m)).convex_hull.buffer(self._margin_m)
        return np.asarray(shapely.covers(area, shapely.points(points)))

    @property
    def _margin_m(self) -> float:
        return TRUSTED_CELLS * self.terrain.cell_m

    @cached_property
    def _known_area(self) -> Any:
        import shapely

        places = np.vstack([self.known.starts_m, self.known.stops_m])
        hull = shapely.convex_hull(shapely.MultiPoint(places))
        area = hull.buffer(self._margin_m)
        shapely.prepare(area)
        return area
