"""Embankments and ditches on a natural slope: their points, zones and measure lines follow from a few sizes.

The ground rises to the left; blocks come from there. The facing of an embankment starts at its foot on the natural
ground. With a ditch, the facing goes further down to the bottom of the ditch, whose uphill wall rises to the natural
slope. Several embankments are numbered 1, 2, ... from uphill to downhill; the names of their zones and measure lines
end with the number, as in `crest_2`."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from rock2d.arrays import Array
from rock2d.scene.cross_section import (
    BACK_ZONE,
    CREST_ZONE,
    FACING_ZONE,
    SHORTEST_FACET,
    CrossSection,
    CrossSectionError,
)

DITCH_ZONE = "ditch"
ARRIVAL_LINE, CREST_LINE, FACING_LINES = "arrival", "crest", ("facing_1_3", "facing_2_3")
STEEP_BACK_DEG = 45.0  # a back that would fit if it were as steep as this is too flat
STEEPEST_WITH_LINES_DEG = 80.0  # on a steeper facing, no centroid comes near measure lines on it


class EarthworkError(ValueError):
    """An embankment or a ditch that does not fit the ground. `part` and `key` name the size that is wrong, `number` the
    embankment if there are several."""

    def __init__(self, message: str, part: str, key: str, number: int | None = None) -> None:
        super().__init__(message)
        self.part, self.key, self.number = part, key, number


@dataclass(frozen=True)
class EmbankmentSizes:
    """An embankment.

    Attributes
    ----------
    x_m : x of its uphill foot, on the natural ground
    height_m : height of the crest above the natural ground at the foot
    crest_m : width of the crest
    uphill_deg, downhill_deg : slopes of the facing and of the back; 90 is vertical"""

    x_m: float
    height_m: float
    crest_m: float
    uphill_deg: float
    downhill_deg: float


@dataclass(frozen=True)
class DitchSizes:
    """A ditch with a level bottom.

    Attributes
    ----------
    width_m : width of the bottom
    depth_m : depth of the bottom below the natural ground at the embankment's foot
    uphill_deg : slope of the uphill wall; 90 is vertical"""

    width_m: float
    depth_m: float
    uphill_deg: float


Works = tuple[EmbankmentSizes, DitchSizes | None]


def with_numbered_earthworks(ground: CrossSection, works: Mapping[int, Works]) -> CrossSection:
    """The ground with several embankments, numbered 1, 2, ... from uphill to downhill, and the ditches before them.

    `with_earthworks` builds them one after the other, so that the ground uphill of an embankment does not depend on it.
    Names of zones and measure lines end with the number.

    Raises EarthworkError as `with_earthworks`, and if embankments overlap or have another order."""
    before: EmbankmentSizes | None = None
    for number in sorted(works):
        embankment, ditch = works[number]
        try:
            if before is not None and embankment.x_m <= before.x_m:
                raise EarthworkError(
                    f"embankments are numbered from uphill to downhill, but the foot of number {number - 1} is at "
                    f"x = {before.x_m:.6g} m",
                    "embankment",
                    "x_m",
                )
            ground = with_earthworks(ground, embankment, ditch, number)
        except EarthworkError as error:
            error.number = number
            raise
        before = embankment
    return ground


def number_of_line(name: str) -> int | None:
    """The number of the embankment at the end of the name of a measure line; None for `crest` or `forest_edge`."""
    line, _, number = name.rpartition("_")
    is_numbered = line in (ARRIVAL_LINE, CREST_LINE, *FACING_LINES) and number.isdecimal()
    return int(number) if is_numbered else None


def is_line(name: str, line: str) -> bool:
    """Whether a measure line is `line`, with or without the number of an embankment."""
    return name == line or name == numbered(line, number_of_line(name))


def numbered(name: str, number: int | None) -> str:
    """The name of a zone or measure line of the embankment with that number."""
    return name if number is None else f"{name}_{number}"


def with_earthworks(
    ground: CrossSection, embankment: EmbankmentSizes, ditch: DitchSizes | None = None, number: int | None = None
) -> CrossSection:
    """The ground with an embankment, and a ditch before it.

    New zones are `uphill_face`, `crest`, `downhill_face` and `ditch`. New measure lines rise from the natural
    ground before the earthworks (`arrival`: at the ditch's uphill edge, or the embankment's height before its foot),
    from the uphill edge of the crest (`crest`) and, on facings up to 80 degrees, from 1/3 and 2/3 of the facing's
    height. Their names end with `number`, if it is given; the embankments with lower numbers must exist already.

    Raises EarthworkError if the parts do not meet the ground or overlap another embankment, CrossSectionError if the
    name of a new measure line is taken."""
    import shapely

    surface = shapely.LineString(ground.points_m)
    free_x = ground.points_m[:, 0].min()
    if number is not None and number > 1:
        free_x = ground.points_m[ground.embankments[number - 2].right, 0]
    _refuse_overlap(embankment.x_m, free_x, number, ("embankment", "x_m"))
    foot = np.array([embankment.x_m, ground.height_m(np.array([embankment.x_m]))[0]])
    if not np.isfinite(foot[1]):
        raise EarthworkError("the foot is outside the cross-section", "embankment", "x_m")
    crest = foot + np.array([_run(embankment.height_m, embankment.uphill_deg), embankment.height_m])
    edge = crest + np.array([embankment.crest_m, 0.0])
    if ground.covers(np.array([edge]))[0]:
        raise EarthworkError("the crest ends inside the ground", "embankment", "crest_m")
    back = _first_hit(surface, edge, -np.deg2rad(embankment.downhill_deg))
    if back is None:
        raise _too_long(ground, crest, edge)
    start, before = (foot, list[Array]()) if ditch is None else _ditch(surface, foot, embankment, ditch)
    _refuse_overlap(start[0], free_x, number, ("ditch", "width_m"))
    made = [*before, crest, edge]
    zones = [*[DITCH_ZONE] * len(before), FACING_ZONE, CREST_ZONE, BACK_ZONE]
    zones = [numbered(zone, number) for zone in zones]
    points, zones = _replaced(ground, start, made, back, zones)
    arrival_x = start[0] if before else max(foot[0] - embankment.height_m, free_x)
    arrival = np.array([arrival_x, ground.height_m(np.array([arrival_x]))[0]])
    top = points[:, 1].max() + embankment.height_m  # no block rises higher than this
    feet = _feet_of_lines(arrival, before[-1] if before else foot, crest, embankment)
    lines = dict(ground.measure_lines)
    for line in sorted(feet):
        name, low = numbered(line, number), feet[line]
        if name in lines:
            message = f"measure line {name}: the embankment has a line of this name"
            raise CrossSectionError(message, "measure_lines", line=name)
        lines[name] = np.array([low, [low[0], top]])
    return CrossSection(points, zones, lines)


def earth_moved_m2(natural: CrossSection, built: CrossSection) -> tuple[float, float]:
    """(fill above the natural ground, cut below it) in m² of the section, that is m³ per metre of embankment."""
    import shapely

    floor_m = float(min(ground.points_m[:, 1].min() for ground in (natural, built))) - 1.0
    before, after = (ground.body(floor_m) for ground in (natural, built))
    return (
        float(shapely.area(shapely.difference(after, before))),
        float(shapely.area(shapely.difference(before, after))),
    )


def _refuse_overlap(x_m: float, free_x_m: float, number: int | None, part_and_key: tuple[str, str]) -> None:
    if number is not None and number > 1 and x_m < free_x_m:
        part, key = part_and_key
        ends = f"before embankment {number - 1} ends at x = {free_x_m:.6g} m"
        raise EarthworkError(f"the {part} begins at x = {x_m:.6g} m, {ends}", part, key)


def _run(height: float, slope_deg: float) -> float:
    """Horizontal length of a slope."""
    return 0.0 if slope_deg == 90.0 else height / float(np.tan(np.deg2rad(slope_deg)))


def _first_hit(surface: object, start: Array, angle_rad: float) -> Array | None:
    """The first point of the surface on the ray from `start`; None if there is none."""
    import shapely

    x_min, y_min, x_max, y_max = shapely.bounds(surface)
    far = start + 2.0 * (x_max - x_min + y_max - y_min) * np.array([np.cos(angle_rad), np.sin(angle_rad)])
    found = shapely.get_coordinates(shapely.intersection(surface, shapely.LineString([start, far])))
    if not len(found):
        return None
    return np.asarray(found[np.argmin(np.hypot(*(found - start).T))])


def _too_long(ground: CrossSection, crest: Array, edge: Array) -> EarthworkError:
    """The error of an embankment whose back does not meet the ground, at the size that makes it too long."""
    import shapely

    right = ground.points_m[:, 0].max()
    key = "height_m"
    if _first_hit(shapely.LineString(ground.points_m), edge, -np.deg2rad(STEEP_BACK_DEG)) is not None:
        key = "downhill_deg"
    elif crest[0] < right < edge[0]:
        key = "crest_m"
    begins, ends = f"it begins at x = {edge[0]:.6g} m", f"the cross-section ends at x = {right:.6g} m"
    return EarthworkError(f"the downhill face does not meet the ground: {begins}, and {ends}", "embankment", key)


def _ditch(surface: object, foot: Array, embankment: EmbankmentSizes, ditch: DitchSizes) -> tuple[Array, list[Array]]:
    """The point where the ditch leaves the natural slope, and the corners of its bottom (one if it starts on level
    ground)."""
    import shapely

    right = foot - np.array([_run(ditch.depth_m, embankment.uphill_deg), ditch.depth_m])
    left = right - np.array([ditch.width_m, 0.0])
    start = _first_hit(surface, left, np.pi - np.deg2rad(ditch.uphill_deg))
    if start is None:
        message = "the uphill wall does not meet the ground within the cross-section"
        raise EarthworkError(message, "ditch", "width_m" if left[0] < shapely.bounds(surface)[0] else "uphill_deg")
    wall = float(np.hypot(*(start - left)))
    return start, [left, right] if wall > SHORTEST_FACET * ditch.width_m else [right]


def _replaced(
    ground: CrossSection, start: Array, made: list[Array], end: Array, zones: list[str]
) -> tuple[Array, list[str]]:
    """Points and zones of the ground with the points `made` in place of the ground between `start` and `end`."""
    import shapely

    surface = shapely.LineString(ground.points_m)
    along = shapely.line_locate_point(surface, shapely.points(ground.points_m))
    first, last = (float(shapely.line_locate_point(surface, shapely.Point(p))) for p in (start, end))
    tolerance = 1e-9 * surface.length
    kept_left, kept_right = along < first - tolerance, along > last + tolerance
    points = [*ground.points_m[kept_left], start, *made, end, *ground.points_m[kept_right]]
    left = list(ground.zones[: int(kept_left.sum())])
    right = list(ground.zones[len(ground.zones) - int(kept_right.sum()) :])
    return np.array(points), [*left, *zones, *right]


def _feet_of_lines(arrival: Array, foot: Array, crest: Array, embankment: EmbankmentSizes) -> dict[str, Array]:
    """Name -> foot of each measure line; `foot` is the foot of the facing."""
    feet = {ARRIVAL_LINE: arrival, CREST_LINE: crest}
    if embankment.uphill_deg <= STEEPEST_WITH_LINES_DEG:
        for share, name in zip((1 / 3, 2 / 3), FACING_LINES, strict=True):
            feet[name] = foot + share * (crest - foot)
    return feet
