"""Zones along a survey: tables of start, end and name, and the zones of the facets of a profile."""

import itertools
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from pydantic_core import PydanticCustomError

from rock2d.arrays import Array
from rock2d.errors import InputError
from rock2d.files.setup_keys import plain_name
from rock2d.files.surveys.profile import Profile
from rock2d.files.surveys.table import ZONE_COLUMNS, check_metres, column_of, number, profile_columns, text_rows
from rock2d.files.text_files import reads_as_number

DEFAULT_ZONE = "slope"
START_COLUMNS, END_COLUMNS, NAME_COLUMNS = ("start", "from"), ("end", "to"), ("name", *ZONE_COLUMNS)


class ZoneRange(NamedTuple):
    """A zone between two stations of the survey in m, and the line of its table."""

    start_m: float
    end_m: float
    name: str
    line: int


class ZoneTable(NamedTuple):
    """Zones from left to right that do not overlap."""

    file: Path
    ranges: Sequence[ZoneRange]


def read_zones(file: Path) -> ZoneTable:
    """Read a table of zones, one zone a line: start, end (stations of the survey in m) and name, in this order or in
    the order of a header. Raises InputError with the line of the first mistake."""
    rows, _ = text_rows(file)
    columns = [0, 1, 2]
    if not any(map(reads_as_number, rows[0][1])):
        line, header = rows.pop(0)
        found = [column_of(header, names) for names in (START_COLUMNS, END_COLUMNS, NAME_COLUMNS)]
        if None in found:
            message = f"expected the columns start, end and name, found {', '.join(header)[:80]!r}"
            raise InputError(message, file, line, 1, code="bad_table")
        columns = [column for column in found if column is not None]
        check_metres([header[column] for column in columns[:2]], file, line)
    ranges = [_range(*_start_end_name(cells, columns, file, line), file, line) for line, cells in rows]
    if not ranges:
        raise InputError("the table names no zone", file, 1, 1, code="empty")
    ranges.sort()
    for one, other in itertools.pairwise(ranges):
        if other.start_m < one.end_m:
            message = (
                f"zones overlap: {other.name} begins at {other.start_m:g} m, inside {one.name}, which reaches from "
                f"{one.start_m:g} to {one.end_m:g} m (line {one.line})"
            )
            raise InputError(message, file, other.line, 1, code="bad_table")
    return ZoneTable(file, ranges)


def zones_of_points(file: Path) -> ZoneTable | None:
    """Zones of a table of stations and heights with a column zone or soil: the zone of a point holds from there to the
    point of the next line. None without such a column. Raises InputError with the line of the first mistake."""
    rows, _ = text_rows(file)
    line, header = rows[0]
    zone = column_of(header, ZONE_COLUMNS)
    if zone is None or len(columns := profile_columns(header, file, line)) > 2:
        return None
    station = columns[0]
    ranges = []
    for (line, cells), (_, following) in itertools.pairwise(rows[1:]):
        start, end = sorted(number(row[station], file, line) for row in (cells, following))
        if len(cells) <= zone or not cells[zone]:
            raise InputError("expected the name of a zone, found nothing", file, line, 1, code="bad_table")
        if start < end:
            ranges.append(_range(start, end, cells[zone], file, line))
    return ZoneTable(file, sorted(ranges))


def _start_end_name(cells: Sequence[str], columns: Sequence[int], file: Path, line: int) -> tuple[float, float, str]:
    if len(cells) <= max(columns):
        message = f"expected start, end and name of a zone, found {', '.join(cells)[:60]!r}"
        raise InputError(message, file, line, 1, code="bad_table")
    start, end = (number(cells[column], file, line) for column in columns[:2])
    return start, end, cells[columns[2]]


def _range(start: float, end: float, name: str, file: Path, line: int) -> ZoneRange:
    try:
        plain_name(name)
    except PydanticCustomError as error:
        raise InputError(f"name of a zone: {error.message()}", file, line, 1, code="bad_table") from None
    if name == "default":
        raise InputError("a zone must not be called default", file, line, 1, code="bad_table")
    if not start < end:
        message = f"zone {name} ends at {end:g} m, not beyond its start at {start:g} m"
        raise InputError(message, file, line, 1, code="bad_table")
    return ZoneRange(start, end, name, line)


def facets_with_zones(profile: Profile, zones: ZoneTable | None) -> tuple[Array, list[str], list[str]]:
    """The points of the profile (n, 2) with further points where zones begin or end, the zone of each facet, and
    remarks about stretches without a zone, which are "slope".

    Raises InputError for a zone outside the profile, and for a profile with overhangs."""
    points = profile.points_m
    if zones is None:
        return points, [DEFAULT_ZONE] * (len(points) - 1), []
    x = points[:, 0]
    if not (np.diff(x) > 0.0).all():
        message = "a profile with overhangs or vertical faces has no zones by station: edit the scenario instead"
        raise InputError(message, zones.file, code="wrong_kind")
    remarks = _gaps(profile, zones)
    bounds = sorted(float(profile.stations.x_m(bound)) for zone in zones.ranges for bound in zone[:2])
    inside = [bound for bound in bounds if x[0] < bound < x[-1]]
    stations = np.union1d(x, inside)
    middles = profile.stations.station_m(0.5 * (stations[1:] + stations[:-1]))
    names = [
        next((zone.name for zone in zones.ranges if zone.start_m <= middle <= zone.end_m), DEFAULT_ZONE)
        for middle in middles
    ]
    return np.column_stack([stations, np.interp(stations, x, points[:, 1])]), names, remarks


def _gaps(profile: Profile, zones: ZoneTable) -> list[str]:
    """Remarks about stretches without a zone, with the line of the next zone (the last zone at the end)."""
    first, last = sorted(map(float, profile.stations.station_m(profile.points_m[[0, -1], 0])))
    reached, remarks = first, []
    negligible = 1e-6 * (last - first)
    for zone in (*zones.ranges, zones.ranges[-1]._replace(start_m=last, end_m=last)):
        if (zone.start_m < last and zone.end_m <= first) or zone.start_m > last:
            message = f"zone {zone.name}, {zone.start_m:g} to {zone.end_m:g} m, lies beside the survey"
            raise InputError(
                f"{message}, which reaches from {first:g} to {last:g} m", zones.file, zone.line, 1, code="bad_table"
            )
        if zone.start_m - reached > negligible:
            remarks.append(
                f"{zones.file.name}:{zone.line}: no zone from {reached:g} to {zone.start_m:g} m; the ground there is "
                f"zone {DEFAULT_ZONE}"
            )
        reached = max(reached, zone.end_m)
    return remarks
