"""Experiment folders: releases, filmed or simulated, with their trajectories or impacts.

A folder holds `experiment.yaml` and one CSV, trajectories or impacts. Reading refuses values that cannot be true and
names file and line. A frame that the camera lost is a missing row or has empty cells, which become NaN."""

from __future__ import annotations

import csv
import hashlib
import json
import math
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from pydantic import Field, model_validator

from rock2d.errors import InputError, comma_list, counted
from rock2d.files.checked_yaml import Checked, Document, did_you_mean, mistake, shown, yaml_text
from rock2d.files.csv_tables import write_csv
from rock2d.files.folders import atomic_folder, path_inside
from rock2d.files.setup_keys import BlockKeys, CrossSectionKeys, Name, block_keys, warn_of_impossible_blocks
from rock2d.files.text_files import DECIMAL_COMMA, read_text
from rock2d.records.columns import IMPACT_COLUMNS, POSE_NAMES, RATES, STATE_NAMES, after
from rock2d.scene.blocks import Block
from rock2d.scene.cross_section import CrossSection

if TYPE_CHECKING:
    import pandas as pd

TRAJECTORY_COLUMNS = ("release", "block", "t_s", *POSE_NAMES)
REQUIRED_IMPACT_COLUMNS = ("release", "block", *STATE_NAMES, *map(after, STATE_NAMES[RATES]))
EXPERIMENT = "experiment.yaml"
MOST_BELOW = 5  # folders below that a message names
LARGEST_NUMBER = 1.0e9  # no measured number is larger
LARGEST_RELEASE = 10**9


class FromGravity(Checked):
    """What the fall of the blocks gave: their gravity is then no measurement."""

    which: Literal["fps", "scale"] = Field(description="Quantity that was computed: frame rate or scale")
    relative_error: float = Field(
        ge=0, le=1, description="Its standard error over its value; all speeds may be off alike by as much"
    )


class Camera(Checked):
    """The camera and its noise (1 sigma)."""

    fps: float = Field(gt=0, le=1.0e7, description="Frames per second")
    position_noise_m: float = Field(ge=0, le=1.0e3, description="Position noise, 1 sigma, each axis, in m")
    angle_noise_rad: float = Field(ge=0, le=1.0e3, description="Angle noise, 1 sigma, in rad")
    smear_offset_s: float = Field(
        default=0.0,
        ge=0,
        le=1.0e3,
        description="Offset of a block over its speed, 1 sigma of what all frames share, in s: "
        "where one side is darker, a smeared outline is found beside its middle",
    )
    from_gravity: FromGravity | None = Field(
        default=None, description="What was not measured but taken from the fall of the blocks; nothing"
    )


class ExperimentKeys(Checked):
    """`experiment.yaml`. SI units; x to the right, y up, angles counter-clockwise positive."""

    name: Name = Field(description="Name of the experiment")
    gravity_m_s2: float = Field(ge=0, le=1000, description="Gravity in m/s²")
    camera: Camera = Field(description="The camera and its noise (1 sigma)")
    cross_section: CrossSectionKeys = Field(description="The ground, seen from the side")
    blocks: dict[Name, BlockKeys] = Field(min_length=1, description="Block name -> its profile and mass")
    trajectories: str | None = Field(
        default=None, description="CSV inside the folder with columns " + ", ".join(TRAJECTORY_COLUMNS)
    )
    impacts: str | None = Field(
        default=None, description="CSV inside the folder with columns " + ", ".join(REQUIRED_IMPACT_COLUMNS)
    )

    @model_validator(mode="after")
    def _one_table(self) -> ExperimentKeys:
        if self.trajectories is None and self.impacts is None:
            message = "missing key 'trajectories' (or 'impacts'): the CSV of what was measured"
            raise mistake(message, code="missing_key", key="trajectories")
        if self.trajectories is not None and self.impacts is not None:
            raise mistake(
                "give trajectories or impacts, not both", "impacts", at="key", code="duplicate", key="impacts"
            )
        return self


@dataclass(repr=False)
class Experiment:
    """A checked experiment.

    Attributes
    ----------
    fps, position_noise_m, angle_noise_rad : the camera's frame rate and its noise (1 sigma)
    blocks : name -> block
    trajectories : rows `TRAJECTORY_COLUMNS`, NaN where a frame was lost; or None
    impacts : rows of at least `REQUIRED_IMPACT_COLUMNS`, or None; exactly one of the two is given
    folder : where it was read from, None if made in memory
    smear_offset_s : offset of a block over its speed that all frames share, 1 sigma, in s
    from_gravity : whether frame rate or scale come from the fall of the blocks; None if they were measured"""

    name: str
    gravity_m_s2: float
    fps: float
    position_noise_m: float
    angle_noise_rad: float
    cross_section: CrossSection
    blocks: dict[str, Block]
    trajectories: pd.DataFrame | None = None
    impacts: pd.DataFrame | None = None
    folder: Path | None = field(default=None, compare=False)
    from_gravity: FromGravity | None = None
    smear_offset_s: float = 0.0

    def __post_init__(self) -> None:
        if (self.trajectories is None) == (self.impacts is None):
            raise ValueError("an experiment has either trajectories or impacts")

    def __repr__(self) -> str:
        kind, rows = kind_and_table(self)
        return (
            f"<Experiment {self.name}: {counted(rows['release'].nunique(), 'release')}, {kind} of "
            f"{counted(len(rows), 'row')}, {self.fps:g} frames/s\n blocks: {comma_list(self.blocks)}>"
        )


def seen_frames(experiment: Experiment, *, corners: bool = False) -> pd.DataFrame:
    """The rows of the trajectories without lost frames.

    If a release of a circle has no angle in any frame, its angles are set to 0. With `corners`, this holds for blocks
    of all shapes. Raises `InputError` if every frame is lost."""
    table = experiment.trajectories
    assert table is not None
    blocks = [name for name, block in experiment.blocks.items() if corners or block.shape == "circle"]
    if table["theta_rad"].isna().any():
        without = table["theta_rad"].isna().groupby(table["release"]).transform("all")
        table = table.assign(theta_rad=table["theta_rad"].mask(without & table["block"].isin(blocks), 0.0))
    table = table.dropna()
    if table.empty:
        raise InputError(
            "every frame of the film is lost: only a circle may be without theta_rad", experiment.folder, code="empty"
        )
    return table


def load_experiment(folder: str | Path) -> Experiment:
    """Read and check an experiment folder; raises `InputError` for the first mistake. Warns with `UnusualWarning` of
    blocks that nothing is like."""
    folder = Path(folder)
    if not folder.is_dir():
        raise InputError("no such experiment folder", folder, code="missing_file")
    file = path_inside(folder, EXPERIMENT, folder / EXPERIMENT)
    if not file.exists():
        raise InputError(_no_experiment(folder), folder, code="missing_file")
    document = Document(file)
    keys = document.check(ExperimentKeys)
    cross_section = keys.cross_section.make()
    blocks = {name: block.make(name) for name, block in keys.blocks.items()}
    warn_of_impossible_blocks(document, blocks, cross_section)
    tables: dict[str, pd.DataFrame] = {}
    for kind in ("trajectories", "impacts"):
        relative = getattr(keys, kind)
        if relative is None:
            continue
        path = path_inside(folder, relative, kind, error=document.error)
        if not path.exists():
            raise document.error(f"no file {shown(relative)} in {folder}", kind, code="missing_file")
        if kind == "trajectories":
            tables[kind] = read_trajectories(path, blocks)
        else:
            tables[kind] = read_impacts(path, blocks, cross_section.zone_names)
    return Experiment(
        name=keys.name,
        gravity_m_s2=keys.gravity_m_s2,
        fps=keys.camera.fps,
        position_noise_m=keys.camera.position_noise_m,
        angle_noise_rad=keys.camera.angle_noise_rad,
        cross_section=cross_section,
        blocks=blocks,
        trajectories=tables.get("trajectories"),
        impacts=tables.get("impacts"),
        folder=folder,
        from_gravity=keys.camera.from_gravity,
        smear_offset_s=keys.camera.smear_offset_s,
    )


def _no_experiment(folder: Path) -> str:
    """Message for a folder without an experiment; it names folders below that hold one."""
    try:
        found = sorted(file for depth in ("*", "*/*") for file in folder.glob(f"{depth}/{EXPERIMENT}"))
    except OSError:
        found = []
    below = [shown(str(file.parent.relative_to(folder))) for file in found]
    if not below:
        return f"there is no {EXPERIMENT} in this folder or below it"
    more = f" and {len(below) - MOST_BELOW} more" if len(below) > MOST_BELOW else ""
    return f"there is no {EXPERIMENT} in this folder; give one of those below it: {', '.join(below[:MOST_BELOW])}{more}"


def read_trajectories(path: str | Path, blocks: Collection[str]) -> pd.DataFrame:
    """Trajectories CSV as a frame of `TRAJECTORY_COLUMNS`; raises `InputError` with file and line."""
    import pandas as pd

    lines, table = _read_table(path, TRAJECTORY_COLUMNS, ())
    frame = pd.DataFrame(_typed(path, lines, table, {"block": blocks}, may_be_empty=POSE_NAMES))
    if frame[["x_m", "y_m"]].isna().any(axis=1).all():
        raise InputError("every frame is lost: no row has x_m and y_m", path, code="empty")
    release, t = frame["release"].to_numpy(), frame["t_s"].to_numpy()
    order = np.argsort(release, kind="stable")
    stuck = np.flatnonzero((np.diff(release[order]) == 0) & (np.diff(t[order]) <= 0))
    if stuck.size:
        row, before = order[stuck[0] + 1], order[stuck[0]]
        message = f"column t_s: times must increase within a release: {t[row]:g} after {t[before]:g} s"
        raise InputError(message + f" in release {release[row]}", path, lines[row], code="bad_table", key="t_s")
    return frame[list(TRAJECTORY_COLUMNS)]


def read_impacts(path: str | Path, blocks: Collection[str], zones: Collection[str]) -> pd.DataFrame:
    """Impacts CSV: `REQUIRED_IMPACT_COLUMNS`, perhaps more of `IMPACT_COLUMNS`; empty cells are NaN."""
    import pandas as pd

    names = {"block": blocks, "zone": zones}
    optional = [name for name in IMPACT_COLUMNS if name not in REQUIRED_IMPACT_COLUMNS]
    lines, table = _read_table(path, REQUIRED_IMPACT_COLUMNS, optional)
    may_be_empty = [name for name in IMPACT_COLUMNS if "after" in name or name in optional]
    frame = pd.DataFrame(_typed(path, lines, table, names, may_be_empty))
    return frame[[name for name in IMPACT_COLUMNS if name in frame]]


def write_experiment(folder: str | Path, experiment: Experiment) -> None:
    """Write a folder that `load_experiment` reads back; whole or not at all (see `atomic_folder`)."""
    with atomic_folder(folder, "experiment") as partial:
        write_experiment_files(partial, experiment)


def write_experiment_files(folder: Path, experiment: Experiment) -> None:
    """Write `experiment.yaml` and its CSV into an existing folder."""
    kind, table = kind_and_table(experiment)
    write_csv(folder / f"{kind}.csv", table)
    keys = {**_stated(experiment), kind: f"{kind}.csv"}
    head = "# SI units; x to the right, y up, angles counter-clockwise positive; noise is 1 sigma\n"
    text = head + yaml_text(keys, width=110)
    (folder / EXPERIMENT).write_text(text, encoding="utf-8")


def digest(experiment: Experiment) -> str:
    """16 hexadecimal digits of a hash of what was stated and measured: the same experiment by another name has the
    same."""
    stated, (_, table) = {**_stated(experiment), "name": ""}, kind_and_table(experiment)
    return hashlib.sha256(f"{json.dumps(stated)}\n{table.to_csv()}".encode()).hexdigest()[:16]


def kind_and_table(experiment: Experiment) -> tuple[str, pd.DataFrame]:
    """ "trajectories" or "impacts", and this table of the experiment."""
    if experiment.trajectories is not None:
        return "trajectories", experiment.trajectories
    assert experiment.impacts is not None
    return "impacts", experiment.impacts


def _stated(experiment: Experiment) -> dict[str, Any]:
    """The keys of `experiment.yaml`, without that of the table."""
    cross_section = {
        "points_m": experiment.cross_section.points_m.tolist(),
        "zones": list(experiment.cross_section.zones),
        "measure_lines": {name: line.tolist() for name, line in experiment.cross_section.measure_lines.items()},
    }
    return {
        "name": experiment.name,
        "gravity_m_s2": float(experiment.gravity_m_s2),
        "camera": {
            "fps": float(experiment.fps),
            "position_noise_m": float(experiment.position_noise_m),
            "angle_noise_rad": float(experiment.angle_noise_rad),
            **({"smear_offset_s": float(experiment.smear_offset_s)} if experiment.smear_offset_s else {}),
            **({"from_gravity": given.model_dump()} if (given := experiment.from_gravity) is not None else {}),
        },
        "cross_section": {key: value for key, value in cross_section.items() if value},
        "blocks": {name: block_keys(block) for name, block in experiment.blocks.items()},
    }


def _read_table(
    path: str | Path, required: Sequence[str], optional: Sequence[str]
) -> tuple[list[int], dict[str, list[str]]]:
    """Line number of each row, and column name -> cells as text. One line is one row."""
    text = read_text(path).replace("\r\n", "\n").replace("\r", "\n")
    rows = [(number, line) for number, line in enumerate(text.split("\n"), 1) if line.strip()]
    if not rows:
        raise InputError(f"the file is empty; expected the columns {','.join(required)}", path, 1, code="empty")
    if '"' in text:
        rows = [(number, _without_quotes(line, path, number)) for number, line in rows]
    (top, line), rows = rows[0], rows[1:]
    header = [cell.strip() for cell in line.split(",")]
    known = [*required, *optional]
    if len(header) == 1 and (";" in line or "\t" in line):
        also = "; numbers need a decimal point, not a comma" if "," in text else ""
        raise InputError(f"cells must be separated by commas{also}", path, top, code="bad_table")
    for i, name in enumerate(header):
        if name in header[:i]:
            raise InputError(f"column {shown(name)} stands twice", path, top, code="duplicate", key=name)
        if name not in known:
            free = [column for column in known if column not in header]
            hint = did_you_mean(name, free)
            message = f"unknown column {shown(name)}{hint}; expected {','.join(required)}"
            raise InputError(message, path, top, code="unknown_key", key=name)
    for name in required:
        if name not in header:
            message = f"column {name} is missing; expected {','.join(required)}"
            raise InputError(message, path, top, code="missing_key", key=name)
    if not rows:
        raise InputError("there is no row below the header", path, top, code="empty")
    for number, line in rows:
        if line.count(",") != len(header) - 1:
            message = f"expected {len(header)} cells, found {line.count(',') + 1}"
            if line.count(",") >= len(header) and (found := DECIMAL_COMMA.search(line)):
                message += f"; {shown(found[0])} looks like a decimal comma, write a decimal point"
            raise InputError(message, path, number, code="bad_table")
    columns = zip(*[line.split(",") for _, line in rows], strict=True)
    table = dict(zip(header, ([cell.strip() for cell in column] for column in columns), strict=True))
    return [number for number, _ in rows], table


def _without_quotes(line: str, path: str | Path, number: int) -> str:
    try:
        cells = next(csv.reader([line], strict=True))
    except (csv.Error, StopIteration):
        raise InputError("a quote that does not close on its line", path, number, code="bad_table") from None
    for cell in cells:
        if DECIMAL_COMMA.fullmatch(cell.strip()):
            message = f"{shown(cell)} has a decimal comma, write a decimal point"
            raise InputError(message, path, number, code="bad_table")
        if "," in cell:
            raise InputError("a cell must not contain a comma", path, number, code="bad_table")
    return ",".join(cells)


def _typed(
    path: str | Path,
    lines: list[int],
    table: dict[str, list[str]],
    texts: Mapping[str, Collection[str]],
    may_be_empty: Collection[str],
) -> dict[str, object]:
    """Columns as int, float and checked text; `texts` gives the allowed words of each text column."""
    columns: dict[str, object] = {}
    for name, cells in table.items():
        if "" in cells and name not in may_be_empty:
            message, line = f"column {name}: an empty cell", lines[cells.index("")]
            raise InputError(message, path, line, code="bad_value", key=name)
        if name in texts:
            known = {*texts[name], ""}
            for line, word in zip(lines, cells, strict=True):
                if word not in known:
                    message = f"column {name}: {shown(word)} is not in experiment.yaml"
                    message += did_you_mean(word, texts[name])
                    raise InputError(message, path, line, code="unknown_name", name=word)
            columns[name] = cells
        elif name == "release":
            columns[name] = np.array(_numbers(path, lines, name, cells, _release_number), np.int64)
        else:
            columns[name] = np.array(_numbers(path, lines, name, cells, finite_number), float)
    block_of: dict[int, str] = {}
    for line, release, block in zip(lines, map(int, table["release"]), table["block"], strict=True):
        before = block_of.setdefault(release, block)
        if before != block:
            message = f"column block: release {release} was {before!r}, here {block!r}"
            raise InputError(message, path, line, code="bad_table", key="block")
    return columns


def _numbers(
    path: str | Path, lines: list[int], name: str, cells: list[str], convert: Callable[[str], float]
) -> list[float]:
    try:
        return [convert(cell) for cell in cells]
    except ValueError:
        pass
    for number, cell in zip(lines, cells, strict=True):
        try:
            convert(cell)
        except ValueError:
            expected = "a whole number >= 0" if convert is _release_number else "a finite number"
            message = f"column {name}: expected {expected}, found {shown(cell)}"
            raise InputError(message, path, number, key=name) from None
    raise AssertionError("unreachable")


def _release_number(cell: str) -> int:
    if not (cell.isascii() and cell.isdigit() and len(cell) <= 10 and int(cell) <= LARGEST_RELEASE):
        raise ValueError
    return int(cell)


def finite_number(cell: str) -> float:
    """A number that can be measured, nan for an empty cell. Raises ValueError."""
    if not cell:
        return math.nan  # a frame that was lost
    value = float(cell)
    # float() also takes nan, infinity and 1_000
    if not abs(value) <= LARGEST_NUMBER or "_" in cell or not cell.isascii():
        raise ValueError
    return value
