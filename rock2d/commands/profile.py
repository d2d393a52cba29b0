"""The command `rock2d profile`: write a scenario and its picture from a table, drawing or terrain model."""

import re
import shlex
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from rock2d.errors import InputError
from rock2d.files.checked_yaml import Document
from rock2d.files.folders import atomic_file, check_file
from rock2d.files.scenario_reading import checked_scenario, load_scenario
from rock2d.files.surveys.profile import Profile, simplified
from rock2d.files.surveys.release_area import given_area, release_area
from rock2d.files.surveys.scenario_template import DIAMETER_M, likely_class, template_text
from rock2d.files.surveys.terrain import DRIVERS, along_line, down_fall_line, read_terrain
from rock2d.files.surveys.zones import ZoneTable, facets_with_zones, read_zones, zones_of_points

DRAWING = ".dxf"


@dataclass(frozen=True)
class ProfileOptions:
    """Options of `write_profile`.

    Attributes
    ----------
    line : x, y of the first and x, y of the last point of a section through a terrain model
    start : x, y of the point at which a section along the fall line begins
    layer : layer of a drawing
    zones : table of start, end (stations of the survey in m) and name
    tolerance_m : points that change the surface by less are left out
    release : stations of the survey between which blocks start; None: the area of `release_area`
    smooth : leave out the roughness of the soil classes"""

    line: Sequence[float] | None = None
    start: Sequence[float] | None = None
    layer: str | None = None
    zones: Path | None = None
    tolerance_m: float = 0.0
    release: tuple[float, float] | None = None
    smooth: bool = False


def write_profile(
    file: Path,
    out: Path,
    options: ProfileOptions = ProfileOptions(),
    *,
    overwrite: bool = False,
    report: Callable[[str], Any] = print,
) -> Profile:
    """Read a profile, write the scenario `out` and a picture beside it, and report the result.

    Raises InputError if the profile cannot be read, or if `out` exists."""
    if out.suffix.lower() not in (".yaml", ".yml"):
        raise InputError("expected a scenario file that ends in .yaml", out)
    for path in (out, out.with_suffix(".png")):
        if path.exists() and not overwrite:
            raise InputError("exists; --overwrite replaces it, --out chooses another file", path, code="results_exist")
        check_file(path)
    profile = _read(file, options)
    if options.tolerance_m > 0.0:
        profile = simplified(profile, options.tolerance_m)
    points, names, gaps = facets_with_zones(profile, _zones(file, options))
    profile = replace(profile, remarks=(*profile.remarks, *gaps))
    given = options.release
    area = release_area(profile, DIAMETER_M) if given is None else given_area(profile, given)
    name = re.sub(r"[^A-Za-z0-9_-]+", "_", out.stem).strip("_-") or "profile"
    with atomic_file(out) as part:
        part.write_text(template_text(profile, name, (points, names), area, options.smooth), encoding="utf-8")
        try:
            checked_scenario(Document(part), None)
        except InputError as error:  # an impossible site
            raise InputError(error.message, file, code=error.code) from None
    scenario = load_scenario(out)
    from rock2d.graphics.figure_style import save_figure
    from rock2d.graphics.trajectories import cross_section_figure

    picture = save_figure(
        cross_section_figure(scenario.make_cross_section(), profile.source, (area.low_m, area.high_m)),
        out.with_suffix(".png"),
    )
    length, fall = np.ptp(profile.points_m, axis=0)
    report(f"{profile.source}: {len(profile.points_m)} points, {length:.4g} m long, {fall:.4g} m of height")
    for remark in profile.remarks:
        report(f"  {remark}")
    report(f"start: {area}; {area.why}")
    report("  to change it: --release LOW HIGH, in stations of the survey, or x_m under incident in the scenario")
    report(f"soil by the names of the zones: {', '.join(f'{z} {likely_class(z)}' for z in dict.fromkeys(names))}")
    if scenario.roughness:
        report(f"rough ground in {', '.join(scenario.roughness)}, by soil class; --smooth leaves it out")
    report(f"written: {out} and {picture.name}; next: {shlex.join(['rock2d', 'run', str(out)])}")
    return profile


def _zones(file: Path, options: ProfileOptions) -> ZoneTable | None:
    """Zones of the table `options.zones`, else of a column of the survey, if it has one."""
    if options.zones is not None:
        return read_zones(options.zones)
    return None if file.suffix.lower() in (*DRIVERS, DRAWING) else zones_of_points(file)


def _read(file: Path, options: ProfileOptions) -> Profile:
    kind = file.suffix.lower()
    line, start, layer = options.line, options.start, options.layer
    if kind in DRIVERS:
        if (line is None) == (start is None):
            raise InputError("a terrain model needs either --line X0 Y0 X1 Y1 or --fall-line X Y", file)
        terrain = read_terrain(file)
        if line is not None:
            first, last = terrain.metric(np.reshape(line, (2, 2)))
            found = along_line(terrain, first, last, f"terrain model {file.name}")
        else:
            first = terrain.metric(np.array(start))[0]
            found = down_fall_line(terrain, first, f"fall line on terrain model {file.name}")
        return replace(found, remarks=(*terrain.remarks, *found.remarks))
    if line is not None or start is not None:
        raise InputError("--line and --fall-line are for terrain models (.tif, .asc)", file, code="wrong_kind")
    if kind == DRAWING:
        from rock2d.files.surveys.drawing import read_drawing

        return read_drawing(file, layer)
    if layer is not None:
        raise InputError("--layer is for drawings (.dxf)", file, code="wrong_kind")
    from rock2d.files.surveys.table import read_table

    return read_table(file)
