"""A field test: its key in a scenario, and the table of where each block was released and where it came to rest."""

from __future__ import annotations

import csv
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from pydantic import Field, model_validator

from rock2d.arrays import Array
from rock2d.errors import InputError
from rock2d.files.checked_yaml import Checked, mistake
from rock2d.files.setup_keys import FARTHEST_M, Name
from rock2d.files.text_files import read_text

RELEASE_PLACE_COLUMNS, STOP_PLACE_COLUMNS = ("release_x_m", "release_y_m"), ("stop_x_m", "stop_y_m")


class FieldTestKeys(Checked):
    """Releases of real blocks with measured starts and stops. The ground is the terrain along their paths."""

    folder: str = Field(
        description="Folder of the data, relative to the data root (--data or ROCK2D_DATA); the root may also be that "
        "folder, or one between"
    )
    releases: str = Field(default="releases.csv", description="Table of starts and stops in that folder")
    terrain: str = Field(default="terrain.asc", description="Terrain model (GeoTIFF, ESRI ASCII grid) in that folder")
    block_ids: dict[Name, int] = Field(
        min_length=1, description="Name of a block under blocks -> its block_id in the table"
    )
    zones: dict[Name, float] = Field(
        min_length=1,
        description="Zone name -> inclination in degrees from which the ground belongs to it; the steepest that holds "
        "counts, below all of them the lowest, which must be 0 or less",
    )
    edge_m: float = Field(
        default=0.0, ge=0, le=100, description="Length of the ground at the start that is zone edge, in m"
    )
    beyond_deg: float = Field(
        default=0.0,
        ge=-30,
        le=80,
        description="Inclination of the ground beyond the known starts and stops, where the terrain is a guess; "
        "positive: it rises",
    )
    calibrate_on: list[Name] = Field(
        min_length=1, description="Blocks on which the soil is calibrated to predict the others"
    )

    @model_validator(mode="after")
    def _blocks_and_ground_are_clear(self) -> FieldTestKeys:
        names: dict[int, str] = {}
        for name, number in self.block_ids.items():
            if names.setdefault(number, name) != name:
                raise mistake(f"block_id {number} is also that of {names[number]}", "block_ids", name)
        if min(self.zones.values()) > 0.0:
            raise mistake("one zone must begin at 0 degrees or less", "zones")
        return self


@dataclass(frozen=True)
class FieldReleases:
    """n releases.

    Attributes
    ----------
    names : (n,) of the releases
    blocks : (n,) of their blocks
    starts_m, stops_m : (n, 2) horizontal places; NaN where no stop is given"""

    names: tuple[str, ...]
    blocks: tuple[str, ...]
    starts_m: Array
    stops_m: Array

    def __len__(self) -> int:
        return len(self.names)

    @property
    def distances_m(self) -> Array:
        """(n,) horizontal distance from start to stop."""
        return np.hypot(*(self.stops_m - self.starts_m).T)

    def subset(self, chosen: Array) -> FieldReleases:
        """The chosen releases: (n,) bool or indices."""
        index = np.arange(len(self))[chosen]
        return FieldReleases(
            tuple(self.names[i] for i in index), tuple(self.blocks[i] for i in index),
            self.starts_m[index], self.stops_m[index],
        )  # fmt: skip

    def of_blocks(self, *blocks: str) -> Array:
        """(n,) bool: whether a release is one of these blocks."""
        return np.isin(self.blocks, blocks)


def read_releases(path: Path, block_ids: Mapping[str, int], stops: bool = True) -> FieldReleases:
    """Read a table (CSV) with the columns release, block_id, release_x_m, release_y_m and, with `stops`, stop_x_m and
    stop_y_m. Further columns are ignored. Of releases with identical numbers only the first is kept.

    Raises InputError with the line of the first mistake."""
    rows = list(csv.reader(read_text(path).splitlines()))
    header = [cell.strip() for cell in rows[0]] if rows else []
    needed = ("release", "block_id", *RELEASE_PLACE_COLUMNS, *(STOP_PLACE_COLUMNS if stops else ()))
    for name in needed:
        if name not in header:
            raise InputError(f"missing column {name}", path, 1, 1, code="bad_table", key=name)
    names = {number: name for name, number in block_ids.items()}
    found: dict[str, tuple[str, list[float]]] = {}
    for n, cells in enumerate(rows[1:], 2):
        if not any(cell.strip() for cell in cells):
            continue
        row = dict(zip(header, (cell.strip() for cell in cells), strict=False))
        release, block, numbers = _numbers(row, needed, path, n)
        if block not in names:
            known = ", ".join(map(str, sorted(names)))
            raise InputError(
                f"unknown block_id {block}; block_ids of the scenario: {known}", path, n, 1, code="unknown_name"
            )
        if release in found:
            raise InputError(f"release {release} stands twice", path, n, 1, code="bad_table")
        found[release] = names[block], numbers
    if not found:
        raise InputError("there are no releases", path, 1, 1, code="empty")
    values = np.array([numbers for _, numbers in found.values()])
    stop = values[:, 2:] if stops else np.full((len(values), 2), np.nan)
    blocks = tuple(block for block, _ in found.values())
    releases = FieldReleases(tuple(found), blocks, values[:, :2], stop)
    return releases.subset(_without_repeats(blocks, values)) if stops else releases


def _without_repeats(blocks: tuple[str, ...], values: Array) -> Array:
    """Indices of the releases that repeat no earlier one: two measured releases never agree in every digit."""
    first: dict[tuple[str, bytes], int] = {}
    for i, block in enumerate(blocks):
        first.setdefault((block, values[i].tobytes()), i)
    return np.array(sorted(first.values()))


def _numbers(row: Mapping[str, str], needed: tuple[str, ...], path: Path, n: int) -> tuple[str, int, list[float]]:
    for name in needed:
        if not row.get(name):
            raise InputError(f"column {name} is empty", path, n, 1, code="bad_table", key=name)
    try:
        block = int(row["block_id"])
        numbers = [float(row[name]) for name in needed[2:]]
    except ValueError as error:
        raise InputError(f"expected numbers: {error}", path, n, 1, code="bad_table") from None
    if not np.isfinite(numbers).all() or max(map(abs, numbers)) > FARTHEST_M:
        raise InputError("expected finite numbers of m in local coordinates", path, n, 1, code="bad_table")
    return row["release"], block, numbers
