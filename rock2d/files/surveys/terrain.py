"""Profiles from terrain models (GeoTIFF, ESRI ASCII grid): along a straight line, or down the fall line."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from rock2d.arrays import Array
from rock2d.errors import InputError, require
from rock2d.files.surveys.profile import PROFILE_EXTRA, Profile, checked_profile, station_and_height
from rock2d.files.surveys.table import METRES
from rock2d.files.text_files import require_regular

# The suffix chooses the driver, so that no file can call another of the many drivers.
DRIVERS = {".tif": "GTiff", ".tiff": "GTiff", ".asc": "AAIGrid", ".grd": "AAIGrid"}
STEP_CELLS = 0.5  # distance of profile points, in cells
MOST_STEPS = 20_000
NO_DATA_M = -1.0e9  # height where nothing is known, while a grid is projected
LEVEL_SLOPE = 1e-4  # slope below which the fall line ends


@dataclass(frozen=True)
class Terrain:
    """Heights on a grid.

    Attributes
    ----------
    x_m, y_m : ascending coordinates of the cell centres
    height_m : (y, x), NaN where nothing is known
    from_file : converts points (n, 2) from the coordinates of the file to x and y in m; None if they are the same
    remarks : changes in words"""

    x_m: Array
    y_m: Array
    height_m: Array
    from_file: Callable[[Array], Array] | None = None
    remarks: tuple[str, ...] = ()

    def metric(self, points: Array) -> Array:
        """(n, 2) x and y in m of points in the coordinates of the file."""
        points = np.atleast_2d(np.asarray(points, float))
        return points if self.from_file is None else self.from_file(points)

    @property
    def cell_m(self) -> float:
        """Distance of the cells."""
        return float(np.diff(self.x_m).mean())

    @cached_property
    def _bilinear(self) -> Any:
        from scipy.interpolate import RegularGridInterpolator

        return RegularGridInterpolator((self.y_m, self.x_m), self.height_m, bounds_error=False, fill_value=np.nan)

    def heights_m(self, points_m: Array) -> Array:
        """Bilinear heights at points (n, 2); NaN beside the grid, or where nothing is known."""
        return np.asarray(self._bilinear(np.atleast_2d(points_m)[:, ::-1]))

    def known_heights_m(self, points_m: Array, source: str) -> Array:
        """`heights_m`; raises InputError, which names the `source`, if a height is not known."""
        points, heights = np.atleast_2d(points_m), self.heights_m(points_m)
        if not np.isfinite(heights).all():
            x, y = points[np.flatnonzero(~np.isfinite(heights))[0]]
            raise InputError(f"{source}: no height is known at x = {x:.6g}, y = {y:.6g}", code="bad_value")
        return heights


def read_terrain(path: Path) -> Terrain:
    """A terrain model whose first band is the height in m. If it is in degrees, it is projected to the UTM zone of its
    centre.

    Raises InputError if it cannot be read, is rotated against the axes, or states another unit than m."""
    require("rasterio", f"rasterio is missing, which reads terrain models: {PROFILE_EXTRA}")
    require_regular(path)
    import rasterio

    try:
        with rasterio.open(path, driver=DRIVERS[path.suffix.lower()]) as grid:
            _check_metres(grid, path)
            return _terrain(grid, path)
    except rasterio.errors.RasterioError as error:
        raise InputError(f"no GeoTIFF or ESRI ASCII grid that can be read: {error}", path, code="bad_table") from None


def _check_metres(grid: Any, path: Path) -> None:
    """Raise InputError if the coordinates (unless they are degrees) or the heights are stated in another unit than m.
    Without a stated unit, they are in m."""
    units = {"heights": grid.units[0] or ""}
    if grid.crs is not None and not grid.crs.is_geographic:
        name, length_m = grid.crs.units_factor
        units["coordinates"] = name if length_m != 1.0 else "m"
    for what, unit in units.items():
        if unit.lower() not in METRES:
            message = f"the {what} are in {unit!r}: expected metres; convert coordinates and heights to m"
            raise InputError(message, path, code="bad_value")


def _terrain(grid: Any, path: Path) -> Terrain:
    if grid.crs is not None and grid.crs.is_geographic:
        return _projected(grid, path)
    affine = grid.transform
    if affine.b != 0.0 or affine.d != 0.0:
        raise InputError("the grid is rotated against the axes", path, code="bad_value")
    heights = grid.read(1, masked=True).astype(float).filled(np.nan)
    x = affine.c + affine.a * (np.arange(grid.width) + 0.5)
    y = affine.f + affine.e * (np.arange(grid.height) + 0.5)
    if affine.e < 0.0:
        y, heights = y[::-1], heights[::-1]
    return Terrain(x, y, np.ascontiguousarray(heights))


def _projected(grid: Any, path: Path) -> Terrain:
    """A grid in degrees, in the UTM zone of its centre."""
    import rasterio
    from rasterio.vrt import WarpedVRT
    from rasterio.warp import transform

    west, south, east, north = grid.bounds
    if not (-180.0 <= west < east <= 180.0 and -80.0 <= south < north <= 84.0):
        raise InputError("is in degrees and reaches beyond the UTM zones", path, code="bad_value")
    zone = int(min((0.5 * (west + east) + 180.0) // 6.0, 59.0)) + 1
    target = f"EPSG:{(32600 if south + north >= 0.0 else 32700) + zone}"

    def from_file(points: Array) -> Array:
        return np.column_stack(transform(grid_crs, target, *np.atleast_2d(points).T))

    grid_crs = grid.crs
    bilinear = rasterio.enums.Resampling.bilinear
    with WarpedVRT(grid, crs=target, resampling=bilinear, nodata=NO_DATA_M, dtype="float64") as metric:
        found = _terrain(metric, path)
    said = f"projected from degrees to {target}; points are given as longitude and latitude"
    return replace(found, from_file=from_file, remarks=(said,))


def along_line(terrain: Terrain, start_m: Array, end_m: Array, source: str) -> Profile:
    """The profile along the straight line between two points (2,).

    Raises InputError if it leaves the ground that is known."""
    length = float(np.hypot(*(np.asarray(end_m) - start_m)))
    if length < terrain.cell_m:
        raise InputError(f"the line is shorter than a cell of {terrain.cell_m:g} m", code="bad_value")
    way = np.linspace(0.0, length, int(np.ceil(length / (STEP_CELLS * terrain.cell_m))) + 1)
    points = np.asarray(start_m) + (way / length)[:, None] * (np.asarray(end_m) - start_m)
    heights = terrain.known_heights_m(points, source)
    return checked_profile(np.column_stack([way, heights]), source)


def down_fall_line(terrain: Terrain, start_m: Array, source: str) -> Profile:
    """The profile down the steepest slope from a point (2,) until the ground is level or no longer known.

    Raises InputError if the point is not on the terrain, or on level ground."""
    step, half = STEP_CELLS * terrain.cell_m, 0.5 * terrain.cell_m
    points = [np.asarray(start_m, float)]
    heights = [float(terrain.known_heights_m(points[0], source)[0])]
    for _ in range(MOST_STEPS):
        around = points[-1] + half * np.array([[1, 0], [-1, 0], [0, 1], [0, -1]])
        east, west, north, south = terrain.heights_m(around)
        slope = np.array([east - west, north - south]) / (2.0 * half)
        steepness = float(np.hypot(*slope))
        if not steepness > LEVEL_SLOPE:  # level, or NaN at the edge
            break
        onward = points[-1] - step * slope / steepness
        height = float(terrain.heights_m(onward)[0])
        if not height < heights[-1]:  # a hollow, or the edge
            break
        points.append(onward)
        heights.append(height)
    if len(points) < 3:
        raise InputError(f"{source}: no fall line starts there, because the ground is level", code="bad_value")
    return checked_profile(station_and_height(np.column_stack([points, heights])), source)
