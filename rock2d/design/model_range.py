"""Range of the results over models: other law, roughness, soil and shapes of blocks.

`rock2d run --compare` runs the same releases with one of these changed at a time."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, Any

import numpy as np

from rock2d.errors import InputError
from rock2d.files.scenario import Scenario
from rock2d.files.scenario_variants import with_change
from rock2d.runs.engines import ENGINES, compiled_engine
from rock2d.runs.model_comparison import COLUMNS_OF_QUANTITY, COLUMNS_OF_SHARE, Model, model_table
from rock2d.scene.earthworks import ARRIVAL_LINE, CREST_LINE, is_line, number_of_line
from rock2d.scene.soils import SOIL_CLASSES, rough_zones
from rock2d.wording import three_digits

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

Data = dict[str, Any]

AS_IN_FILE = "as in the file"
NATURAL_SOILS = tuple(name for name in SOIL_CLASSES if name not in ("asphalt", "compacted_fill"))
COMPARED_SHAPES = ("circle", "square", "rectangle")
RECTANGLE_ASPECT = 2.0
PANELS_IN_A_ROW = 4
SHOWN_VALUES = {
    "frequency": (*COLUMNS_OF_SHARE["frequency"], 100.0, "passes, % of released"),
    "per_arriving": (*COLUMNS_OF_SHARE["per_arriving"], 100.0, "passes, % of arriving"),
    "kinetic": (*COLUMNS_OF_QUANTITY["kinetic_J"], 1e-3, "energy, 95 %, kJ"),
    "height": (*COLUMNS_OF_QUANTITY["passing_height_m"], 1.0, "passing height, 95 %, m"),
}


def range_table(scenario: Scenario, engine: str, seed: int, releases: int) -> pd.DataFrame:
    """`model_comparison.model_table` of the scenario and its `other_models`."""
    return model_table([Model(AS_IN_FILE, scenario, engine), *other_models(scenario, engine)], seed, releases)


def other_models(scenario: Scenario, engine: str) -> Iterator[Model]:
    """The scenario with the other law, on rough or smooth ground, with soil one class softer and harder, and with
    blocks of other profiles of the same mass and area, as far as these make sense for the file."""
    own = compiled_engine(engine)
    for other in ENGINES.values():
        compiled = other.name == compiled_engine(other.name).name
        if other.law != own.law and compiled and _has_law(scenario, other.name):
            yield Model(f"{other.law} law", scenario, other.name)
    for name, change in _changes(scenario, own.law):
        yield Model(name, with_change(scenario, change), engine)


def _has_law(scenario: Scenario, engine: str) -> bool:
    try:
        for block in scenario.make_blocks().values():
            ENGINES[engine].parameters(scenario, block)
    except InputError:
        return False
    return scenario.diagnosed is None  # a diagnosis holds for one law


def _changes(scenario: Scenario, law: str) -> Iterator[tuple[str, Callable[[Data], None]]]:
    """Name of each model, and function that changes the data of the file."""

    def shift(step: int) -> Callable[[Data], None]:
        return lambda data: data["model"].update(soils=_shifted(data["model"]["soils"], step))

    def reshape(shape: str) -> Callable[[Data], None]:
        return lambda data: _reshape(data, scenario, shape)

    soils = scenario.model.soils or {}
    if law == "deterministic":
        rough = _roughness(scenario)
        if scenario.roughness:
            yield "smooth ground", lambda data: data.pop("roughness")
        elif rough:
            yield "rough ground", lambda data: data.update(roughness=rough)
    for name, step in (("softer soil", -1), ("harder soil", 1)):
        if soils:
            yield name, shift(step)
    profiles = {block.shape for block in scenario.make_blocks().values()}
    profiles |= {family.shape for own in scenario.populations.values() for family in own.families}
    if law == "deterministic" and scenario.diagnosed is None:
        for shape in COMPARED_SHAPES:
            if profiles != {shape}:
                yield f"{shape} blocks", reshape(shape)


def _roughness(scenario: Scenario) -> Data:
    """The roughness of each zone with a soil class."""
    zones, soils = scenario.make_cross_section().zone_names, scenario.model.soils or {}
    found = {zone: soils.get(zone, soils.get("default")) for zone in zones}
    return rough_zones(
        {zone: own if isinstance(own, str) else own.like for zone, own in found.items() if own is not None}
    )


def _shifted(soils: Data, step: int) -> Data:
    """Soils one class softer or harder. The softest and the hardest class, and numbers of the file, do not change."""
    return {
        zone: {**soil, "like": _neighbour(soil["like"], step)} if isinstance(soil, dict) else _neighbour(soil, step)
        for zone, soil in soils.items()
    }


def _neighbour(name: str, step: int) -> str:
    """The natural class with the next lower or higher restitution."""
    own = SOIL_CLASSES[name].restitution
    further = [n for n in NATURAL_SOILS if step * (SOIL_CLASSES[n].restitution - own) > 0.0]
    return min(further, key=lambda n: abs(SOIL_CLASSES[n].restitution - own), default=name)


def _reshape(data: Data, scenario: Scenario, shape: str) -> None:
    """Blocks of another profile with the same mass and area."""
    aspect = {"aspect": RECTANGLE_ASPECT} if shape == "rectangle" else {}
    for name in data.get("blocks", {}):
        block = scenario.make_blocks()[name]
        side = float(np.sqrt(block.area_m2))
        sizes: dict[str, Data] = {
            "circle": {"diameter_m": block.size_m, "inertia": "solid_sphere"},
            "square": {"side_m": side},
            "rectangle": {"length_m": side * RECTANGLE_ASPECT**0.5, "height_m": side / RECTANGLE_ASPECT**0.5},
        }
        data["blocks"][name] = {"shape": shape, "mass_kg": block.mass_kg, **sizes[shape]}
    for population in data.get("populations", {}).values():
        population["families"] = [{"shape": shape, **aspect}]


def shown_lines(table: pd.DataFrame) -> list[tuple[str, list[str]]]:
    """(line, keys of SHOWN_VALUES) that matter for a design: loads at the arrival line and shares at the crest, of one
    embankment after the other; without an embankment, both at the last line of the file."""
    lines = list(table["line"].unique())
    arriving = [line for line in lines if is_line(line, ARRIVAL_LINE)] or lines[-1:]
    crests = [line for line in lines if is_line(line, CREST_LINE)] or lines[-1:]
    shares, loads = ["frequency", "per_arriving"], ["kinetic", "height"]
    shown = [*((line, shares) for line in crests), *((line, loads) for line in arriving)]
    return sorted(shown, key=lambda item: number_of_line(item[0]) or 0)


def at_shown_lines(table: pd.DataFrame) -> pd.DataFrame:
    """The rows of the lines of `shown_lines`."""
    return table[table["line"].isin([line for line, _ in shown_lines(table)])]


def short_ranges(table: pd.DataFrame) -> dict[tuple[str, str], str]:
    """(line, key of SHOWN_VALUES) -> range over the models in words, of the block with the largest value in each."""
    found = {}
    for line, keys in shown_lines(table):
        by_model = table[table["line"] == line].groupby("model")
        for key in keys:
            column, *_, factor, words = SHOWN_VALUES[key]
            largest = factor * by_model[column].max().dropna()
            if len(largest) > 1:
                unit = words.rpartition(", ")[2].split()[0]
                least, most = three_digits(largest.min()), three_digits(largest.max())
                found[line, key] = f"{least} to {most} {unit} over {len(largest)} models"
    return found


def range_remarks(table: pd.DataFrame) -> list[str]:
    """A sentence on each block and quantity: smallest and largest value over the models, and their models."""
    found = []
    for line, keys in shown_lines(table):
        for block, own in table[table["line"] == line].groupby("block", sort=False):
            for key in keys:
                column, *_, factor, words = SHOWN_VALUES[key]
                values = factor * own.set_index("model")[column].dropna()
                if len(values) > 1:
                    least = f"{three_digits(values.min())} ({values.idxmin()})"
                    most = f"{three_digits(values.max())} ({values.idxmax()})"
                    found.append(f"{block} at {line}, {words}: {least} to {most}")
    return found


def range_figure(table: pd.DataFrame) -> Figure:
    """Values and 95 % intervals of sampling with each model: shares at the crest, energy and height at arrival; one row
    of panels for each embankment."""
    from rock2d.graphics.figure_style import SMALL_PT, blank_figure, finish
    from rock2d.graphics.palette import block_colours

    panels = [(line, key) for line, keys in shown_lines(table) for key in keys]
    models = list(table["model"].unique())[::-1]
    blocks = list(table["block"].unique())
    columns = min(len(panels), PANELS_IN_A_ROW)
    rows = math.ceil(len(panels) / columns)
    figure = blank_figure(2.0 + 2.4 * columns, 1.0 + 0.34 * len(models) * rows + 0.4 * (rows - 1))
    axes = figure.subplots(rows, columns, squeeze=False, sharey=True).ravel()
    for axis in axes[len(panels) :]:
        axis.set_visible(False)
    for axis, (line, key) in zip(axes, panels, strict=False):
        column, low, high, factor, words = SHOWN_VALUES[key]
        for i, (block, colour) in enumerate(block_colours(blocks).items()):
            own = table[(table["line"] == line) & (table["block"] == block)].set_index("model").reindex(models)
            at = np.arange(len(models)) + 0.16 * (0.5 * (len(blocks) - 1) - i)
            value = factor * own[column].to_numpy(float)
            errors = np.abs(factor * own[[low, high]].to_numpy(float).T - value)
            axis.errorbar(value, at, xerr=errors, fmt="o", ms=4, lw=1.2, color=colour, label=block)
        axis.set_yticks(np.arange(len(models)), models)
        axis.set_xlim(left=0)
        axis.set_xlabel(f"{line}: {words}", fontsize=SMALL_PT)
        axis.grid(axis="x", color="#e4e4e4", lw=0.6)
    axes[0].legend(frameon=False, fontsize=SMALL_PT)
    return finish(figure, "How much depends on the model")
