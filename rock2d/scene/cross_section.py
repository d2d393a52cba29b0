"""The cross-section: a polyline with named zones, and the measure lines across it.

Points run from left to right with the air on the left of the direction of travel; vertical facings and
overhangs are allowed. A vertex where the ground turns away by more than `SMOOTH_TURN_RAD` is a *corner* of
the ground; smaller turns are joints of a smooth surface."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, NamedTuple, TypeVar

import numpy as np

from rock2d.arrays import Array
from rock2d.errors import comma_list

Parameters = TypeVar("Parameters")

SMOOTH_TURN_RAD = np.deg2rad(5.0)
LEAST_EMBANKMENT_RELIEF = 0.02  # share of the relief of the cross-section: lower embankments are roughness
LEVEL_GROUND_SHARE = 0.05  # share of the height of an embankment: ground that rises less is ditch or run-out
FACING_ZONE, CREST_ZONE, BACK_ZONE = "uphill_face", "crest", "downhill_face"
SHORTEST_FACET = 1e-9  # share of the cross-section's extent
TIME_LIMIT_FREE_FALLS = 10.0  # in √(2 L / g); the slowest of 1000 balls on a field slope took a third of it


class CrossSectionError(ValueError):
    """Points, zones or measure lines that do not form a cross-section.

    Attributes
    ----------
    key : "points_m", "zones" or "measure_lines"
    facet : index of the facet that is wrong (of two, the later one), or None
    line : name of the measure line that is wrong, or None"""

    def __init__(self, message: str, key: str = "", *, facet: int | None = None, line: str | None = None) -> None:
        super().__init__(message)
        self.key, self.facet, self.line = key, facet, line


@dataclass(frozen=True, eq=False, repr=False)
class CrossSection:
    """A checked cross-section.

    Attributes
    ----------
    points_m : (n + 1, 2) vertices of the surface
    zones : n zone names, one per facet
    measure_lines : name -> (2, 2) end points

    Raises
    ------
    CrossSectionError
        A ValueError, on a zero-length facet, a self-crossing, a missing or empty zone name, or a measure line
        without length.

    Examples
    --------
    >>> ground = CrossSection([[-1, 0.5], [0, 0], [2, 0]], ["slope", "ditch"], {"gate": [[1, 0], [1, 0.5]]})
    >>> ground.zone_names
    ('slope', 'ditch')
    >>> ground.height_m([-0.5, 1.0]).tolist()
    [0.25, 0.0]"""

    points_m: Array
    zones: tuple[str, ...]
    measure_lines: Mapping[str, Array] = field(default_factory=dict)

    def __repr__(self) -> str:
        left, right = self.points_m[[0, -1], 0]
        zones, lines = comma_list(dict.fromkeys(self.zones)), comma_list(self.measure_lines)
        return (
            f"<CrossSection from x = {left:.4g} to {right:.4g} m: {len(self.points_m)} points, zones {zones}; "
            f"measure lines: {lines or 'none'}>"
        )

    def __init__(
        self,
        points_m: Sequence[Sequence[float]] | Array,
        zones: Sequence[str],
        measure_lines: Mapping[str, Sequence[Sequence[float]] | Array] | None = None,
    ) -> None:
        points = np.array(points_m, float, order="C")  # a copy, because engines cache arrays by cross-section
        if points.ndim != 2 or points.shape[1] != 2 or len(points) < 2:
            raise CrossSectionError("points_m must be at least two [x, y] points", "points_m")
        if not np.isfinite(points).all():
            raise CrossSectionError("points_m must be finite numbers", "points_m")
        length = np.hypot(*np.diff(points, axis=0).T)
        extent = float(np.ptp(points, axis=0).max())
        if (length <= SHORTEST_FACET * extent).any():
            i = int(np.argmin(length))
            message = f"facet {i} (from point {i} to point {i + 1}) has zero length"
            raise CrossSectionError(message, "points_m", facet=i)
        if points[-1, 0] <= points[0, 0]:
            message = "points_m must run from left to right (last x greater than first x)"
            raise CrossSectionError(message, "points_m")
        _refuse_crossing(points)
        if len(zones) != len(points) - 1:
            message = f"zones must name every facet: {len(points) - 1} facets, {len(zones)} names"
            raise CrossSectionError(message, "zones")
        for i, zone in enumerate(zones):
            if not isinstance(zone, str) or not zone.strip():
                raise CrossSectionError(f"facet {i} has no zone name", "zones", facet=i)
        lines = {}
        for name, ends in (measure_lines or {}).items():
            line = np.asarray(ends, float)
            if line.shape != (2, 2) or not np.isfinite(line).all() or _same(*line):
                message = f"measure line {name} must be two different [x, y] points"
                raise CrossSectionError(message, "measure_lines", line=name)
            lines[name] = line
        object.__setattr__(self, "points_m", points)
        object.__setattr__(self, "zones", tuple(zones))
        object.__setattr__(self, "measure_lines", lines)

    @cached_property
    def zone_names(self) -> tuple[str, ...]:
        """Distinct zone names in order of first appearance; an index into it is a zone id."""
        return tuple(dict.fromkeys(self.zones))

    @cached_property
    def zone_ids(self) -> Array:
        """(n,) zone id of each facet."""
        ids = {name: i for i, name in enumerate(self.zone_names)}
        return np.array([ids[zone] for zone in self.zones], np.int64)

    @cached_property
    def tangents(self) -> Array:
        """(n, 2) unit vectors along the facets."""
        edge = np.diff(self.points_m, axis=0)
        return edge / np.hypot(*edge.T)[:, None]

    @cached_property
    def normals(self) -> Array:
        """(n, 2) unit normals, out of the ground."""
        return np.column_stack([-self.tangents[:, 1], self.tangents[:, 0]])

    @cached_property
    def turns_rad(self) -> Array:
        """(n + 1,) turning angle at each vertex, negative where the ground is convex; 0 at the two ends."""
        before, after = self.tangents[:-1], self.tangents[1:]
        cross = before[:, 0] * after[:, 1] - before[:, 1] * after[:, 0]
        return np.concatenate([[0.0], np.arctan2(cross, (before * after).sum(axis=1)), [0.0]])

    @cached_property
    def embankment(self) -> Embankment | None:
        """The embankment, detected by its shape: the vertex of greatest prominence and its flanks; None on a floor or a
        plain slope."""
        return _highest_embankment(self.points_m[:, 1])

    @cached_property
    def embankments(self) -> tuple[Embankment, ...]:
        """All embankments from left to right: those whose zones have numbers (`crest_1`, `crest_2`, ...), else the one
        that is detected by its shape, if any."""
        numbered = tuple(_numbered_embankments(self.points_m[:, 1], np.array(self.zones, object)))
        return numbered or ((self.embankment,) if self.embankment is not None else ())

    def height_m(self, x_m: Array) -> Array:
        """Highest height of the surface in m at positions `x_m` (any shape); NaN outside the cross-section."""
        x = np.asarray(x_m, float)
        height = np.full(x.shape, -np.inf)
        (x0, y0), (x1, y1) = self.points_m[:-1].T, self.points_m[1:].T
        near = (np.minimum(x0, x1) <= x.max(initial=-np.inf)) & (np.maximum(x0, x1) >= x.min(initial=np.inf))
        for i in np.flatnonzero(near):
            inside = (x >= min(x0[i], x1[i])) & (x <= max(x0[i], x1[i]))
            if x0[i] == x1[i]:
                y = np.full(x.shape, max(y0[i], y1[i]))
            else:
                y = y0[i] + (x - x0[i]) * (y1[i] - y0[i]) / (x1[i] - x0[i])
            height = np.where(inside, np.maximum(height, y), height)
        return np.where(np.isfinite(height), height, np.nan)

    def covers(self, points_m: Array) -> Array:
        """(n,) bool: whether points (n, 2) lie below the surface; False outside the cross-section."""
        import shapely

        outline = self.points_m
        possible = points_m[:, 1] <= outline[:, 1].max()  # fast answer for points high above
        if not possible.any():
            return possible
        lowest = np.min(points_m[:, 1], initial=outline[:, 1].min())
        ground = self.body(float(lowest - np.ptp(outline, axis=0).max()))
        shapely.prepare(ground)
        return np.asarray(shapely.covers(ground, shapely.points(points_m)))

    def body(self, floor_m: float) -> Any:
        """The ground between the surface and the level `floor_m`, a shapely geometry."""
        import shapely

        outline = self.points_m
        return shapely.make_valid(shapely.Polygon([*outline, (outline[-1, 0], floor_m), (outline[0, 0], floor_m)]))

    def foot_and_head(self, line_m: Array) -> tuple[Array, Array]:
        """The ends of a measure line (2, 2): the one nearer to the surface (the first, if equal) and the other."""
        import shapely

        near = shapely.distance(shapely.LineString(self.points_m), shapely.points(line_m))
        return (line_m[0], line_m[1]) if near[0] <= near[1] else (line_m[1], line_m[0])

    def subdivided(self, pieces: int) -> CrossSection:
        """The same surface with each facet divided into `pieces` equal parts."""
        step = np.arange(pieces) / pieces
        start, edge = self.points_m[:-1], np.diff(self.points_m, axis=0)
        points = (start[:, None] + step[None, :, None] * edge[:, None]).reshape(-1, 2)
        zones = [z for z in self.zones for _ in range(pieces)]
        return CrossSection(np.vstack([points, self.points_m[-1]]), zones, self.measure_lines)


def by_zone(parameters: Mapping[str, Parameters], zone_names: Sequence[str], law: str) -> list[Parameters]:
    """Parameters of each zone in the order of `zone_names`; the key "default" holds for zones that are not named.

    Raises ValueError, which names the `law`, if a zone has neither its own parameters nor a default."""
    ordered = []
    for zone in zone_names:
        found = parameters.get(zone, parameters.get("default"))
        if found is None:
            raise ValueError(f"no {law} parameters for zone {zone!r} and no default")
        ordered.append(found)
    return ordered


def _same(a: Array, b: Array) -> bool:
    """Whether two points are equal to rounding. As `numpy.allclose`, but much faster."""
    return bool((np.abs(a - b) <= 1e-8 + 1e-5 * np.abs(b)).all())


def _refuse_crossing(points: Array) -> None:
    import shapely

    line = shapely.LineString(points)
    if line.is_simple:
        return
    facets = shapely.linestrings(np.stack([points[:-1], points[1:]], axis=1))
    tree = shapely.STRtree(facets)
    for i, j in zip(*tree.query(facets, predicate="intersects"), strict=True):
        if j > i + 1:
            message = f"the cross-section crosses itself: facets {i} and {j}"
            raise CrossSectionError(message, "points_m", facet=int(j))
        if j == i + 1:
            u, v = points[i + 1] - points[i], points[j + 1] - points[j]
            if abs(u[0] * v[1] - u[1] * v[0]) <= 1e-12 * np.hypot(*u) * np.hypot(*v) and u @ v < 0:
                message = f"the cross-section folds back on itself: facets {i} and {j}"
                raise CrossSectionError(message, "points_m", facet=int(j))
    raise CrossSectionError("the cross-section crosses itself", "points_m")


def embankment_facets(cross_section: CrossSection) -> Array:
    """(n,) bool: the facets of all embankments, see `CrossSection.embankments`. All False on a floor or a plain
    slope."""
    return _facets(cross_section, [slice(bank.left, bank.right) for bank in cross_section.embankments])


def facing_facets(cross_section: CrossSection) -> Array:
    """(n,) bool: the facets of the facings of all embankments, that is their left flanks. All False on a floor or a
    plain slope."""
    return _facets(cross_section, [slice(bank.left, bank.crest) for bank in cross_section.embankments])


def ditch_facets(cross_section: CrossSection) -> Array:
    """(n,) bool: the facets of all ditches, see `ditch_before`."""
    return _facets(cross_section, [ditch_before(cross_section, bank) for bank in cross_section.embankments])


def _facets(cross_section: CrossSection, parts: Sequence[slice]) -> Array:
    found = np.zeros(len(cross_section.zones), bool)
    for part in parts:
        found[part] = True
    return found


def ditch_before(cross_section: CrossSection, bank: Embankment) -> slice:
    """The facets of the ditch of an embankment: the level ground at the foot of its left flank; may be empty."""
    y, foot = cross_section.points_m[:, 1], bank.left
    first = foot
    while first > 0 and abs(y[first - 1] - y[foot]) < LEVEL_GROUND_SHARE * bank.height_m:
        first -= 1
    return slice(first, foot)


def facet_zones(cross_section: CrossSection, facets: Array) -> Array:
    """(zones,) bool: the zones all of whose facets are in `facets` (n,) bool."""
    return ~np.isin(np.arange(len(cross_section.zone_names)), cross_section.zone_ids[~facets])


def site_time_limit_s(cross_section: CrossSection, gravity_m_s2: float) -> float:
    """Default time limit in s: 10 √(2 L / g), with the length L of the surface.

    √(2 L / g) is the time of a free fall over L. Raises ValueError without gravity."""
    if gravity_m_s2 <= 0.0:
        raise ValueError("without gravity there is no default time limit")
    length = float(np.hypot(*np.diff(cross_section.points_m, axis=0).T).sum())
    return float(TIME_LIMIT_FREE_FALLS * np.sqrt(2.0 * length / gravity_m_s2))


class Embankment(NamedTuple):
    """An embankment: indices of the vertices at its left foot, at the left and right end of its crest and at its right
    foot, and its height in m above the higher foot."""

    left: int
    crest: int
    crest_end: int
    right: int
    height_m: float


def _numbered_embankments(y: Array, zones: Array) -> Iterator[Embankment]:
    """The embankments whose zones have the numbers 1, 2, ..."""
    for number in itertools.count(1):
        face, crest, back = (
            np.flatnonzero(zones == f"{part}_{number}") for part in (FACING_ZONE, CREST_ZONE, BACK_ZONE)
        )
        if not (len(face) and len(crest) and len(back)):
            return
        left, right = int(face[0]), int(back[-1]) + 1
        height = float(y[crest[0]] - max(y[left], y[right]))
        yield Embankment(left, int(crest[0]), int(crest[-1]) + 1, right, height)


def _highest_embankment(y: Array) -> Embankment | None:
    """The vertex of greatest prominence with its two flanks; None if it is so low that it counts as roughness.

    Prominence: of the lowest points to the left and to the right, up to higher ground or an end, the height above the
    higher one."""
    best = None
    for top in range(1, len(y) - 1):
        higher = np.flatnonzero(y > y[top])
        before, after = higher[higher < top], higher[higher > top]
        start = int(before[-1]) if len(before) else 0
        end = int(after[0]) if len(after) else len(y) - 1
        base = max(y[start : top + 1].min(), y[top : end + 1].min())
        height = float(y[top] - base)
        if height <= (LEAST_EMBANKMENT_RELIEF * np.ptp(y) if best is None else best.height_m):
            continue
        left = right = top  # move outwards while the ground is raised, and down to the foot of the flanks
        while left > start and (y[left] > base + LEVEL_GROUND_SHARE * height or base <= y[left - 1] < y[left]):
            left -= 1
        while right < end and (y[right] > base + LEVEL_GROUND_SHARE * height or base <= y[right + 1] < y[right]):
            right += 1
        crest = left + np.flatnonzero(y[left : right + 1] >= y[top] - LEVEL_GROUND_SHARE * height)
        best = Embankment(left, int(crest[0]), int(crest[-1]), right, height)
    return best
