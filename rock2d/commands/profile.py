"""The command `rock2d profile`: a table, drawing or terrain model in, a scenario and its picture out."""

from __future__ import annotations

import csv
import re
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from rock2d.errors import InputError
from rock2d.files.folders import check_file, write_whole
from rock2d.files.scenario import load_scenario
from rock2d.files.surveys.profile import Profile, simplified
from rock2d.files.surveys.scenario_template import ZoneRange, scenario_of
from rock2d.files.surveys.terrain import DRIVERS, along_line, down_fall_line, read_terrain
from rock2d.files.text_files import is_number, read_text


def write_profile(
    file: Path,
    out: Path,
    *,
    line: Sequence[float] | None = None,
    start: Sequence[float] | None = None,
    layer: str | None = None,
    zones: Path | None = None,
    tolerance_m: float = 0.0,
    overwrite: bool = False,
    report: Callable[[str], Any] = print,
) -> Profile:
    """Read a profile, write the scenario `out` and a picture beside it, and report what was done.

    Parameters
    ----------
    line : x, y of the first and x, y of the last point of a section through a terrain model
    start : x, y of the point at which the fall line begins, instead
    layer : layer of a drawing
    zones : a table of start, end (stations in m) and name

    Raises InputError for what cannot be read, and if `out` exists.
    """
    if out.suffix.lower() not in (".yaml", ".yml"):
        raise InputError("expected a scenario file that ends in .yaml", out)
    if out.exists() and not overwrite:
        raise InputError(
            "exists; --overwrite replaces it, --out chooses another file", out, code="results_exist"
        )
    check_file(out)
    profile = _read(file, line, start, layer)
    if tolerance_m > 0.0:
        profile = simplified(profile, tolerance_m)
    name = re.sub(r"[^A-Za-z0-9_-]+", "_", out.stem).strip("_-") or "profile"
    text = scenario_of(profile, name, _zones(zones) if zones is not None else ())
    write_whole(out, text)
    scenario = load_scenario(out)
    from rock2d.graphics.cross_section_figure import cross_section_figure
    from rock2d.graphics.figure_style import save_figure

    picture = save_figure(
        cross_section_figure(scenario.make_cross_section(), profile.source), out.with_suffix(".png")
    )
    length, fall = np.ptp(profile.points_m, axis=0)
    report(f"{profile.source}: {len(profile.points_m)} points, {length:.4g} m long, {fall:.4g} m of height")
    for remark in profile.remarks:
        report(f"  {remark}")
    report(f"written: {out} and {picture.name}; next: rock2d run {out}")
    return profile


def _read(
    file: Path, line: Sequence[float] | None, start: Sequence[float] | None, layer: str | None
) -> Profile:
    kind = file.suffix.lower()
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
        raise InputError(
            "--line and --fall-line are for terrain models (.tif, .asc)", file, code="wrong_kind"
        )
    if kind == ".dxf":
        from rock2d.files.surveys.drawing import read_drawing

        return read_drawing(file, layer)
    if layer is not None:
        raise InputError("--layer is for drawings (.dxf)", file, code="wrong_kind")
    from rock2d.files.surveys.table import read_table

    return read_table(file)


def _zones(file: Path) -> list[ZoneRange]:
    rows = []
    for n, row in enumerate(csv.reader(read_text(file).splitlines()), 1):
        cells = [cell.strip() for cell in row]
        if not any(cells) or (n == 1 and not is_number(cells[0])):
            continue
        try:
            rows.append(ZoneRange(float(cells[0]), float(cells[1]), cells[2]))
        except (ValueError, IndexError):
            raise InputError("expected start, end and name of a zone", file, n, 1, code="bad_table") from None
    return rows
