"""Effect of shape on the distance: a sphere, a cube and a slab of equal mass and volume, with the same soils."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np

from rock2d.field_tests.descents import Descents
from rock2d.field_tests.forecasts import Forecast, forecast
from rock2d.field_tests.likelihood import Unknowns
from rock2d.files.field_releases import FieldReleases
from rock2d.scene.blocks import Block, make_block

if TYPE_CHECKING:
    import pandas as pd

Array = np.ndarray

SLAB = (2.0, 1.0)  # length and depth of a slab over its height
SHOWN_PERCENTILES = (5.0, 10.0, 50.0, 90.0, 95.0)
SHAPE_STREAM = 9  # first number of a spawn key


def shapes_of(mass_kg: float, density_kg_m3: float) -> dict[str, Block]:
    """A sphere, a cube and a slab (length : height : depth as 2 : 1 : 1) of this mass and density."""
    volume = mass_kg / density_kg_m3
    diameter = (6.0 * volume / np.pi) ** (1.0 / 3.0)
    side = volume ** (1.0 / 3.0)
    height = (volume / (SLAB[0] * SLAB[1])) ** (1.0 / 3.0)
    return {
        "sphere": make_block("sphere", "circle", mass_kg, "solid_sphere", diameter_m=diameter),
        "cube": make_block("cube", "square", mass_kg, side_m=side),
        "slab": make_block("slab", "rectangle", mass_kg, length_m=SLAB[0] * height, height_m=height),
    }


def shape_forecasts(
    unknowns: Unknowns, soils: Array, blocks: dict[str, Block], seed: int,
    on_progress: Callable[[int], Any] = lambda count: None,
) -> dict[str, Forecast]:  # fmt: skip
    """Forecast of each block, released once from every known start with each of these soils."""
    assert unknowns.scenario.terrain is not None
    starts = unknowns.scenario.terrain.known.starts_m
    names = tuple(name for name in blocks for _ in starts)
    places = np.tile(starts, (len(blocks), 1))
    releases = FieldReleases(tuple(map(str, range(len(names)))), names, places, np.full_like(places, np.nan))
    own_seed = int(np.random.SeedSequence(seed, spawn_key=(SHAPE_STREAM,)).generate_state(1)[0])
    descents = Descents(unknowns.scenario, releases, 1, own_seed, other_blocks=blocks)
    found = forecast(unknowns, [descents], soils, on_progress)
    return {name: found.subset(releases.of_blocks(name)) for name in blocks}


def shape_table(found: dict[str, Forecast]) -> pd.DataFrame:
    """Percentiles of the simulated distances of each shape, without discrepancy."""
    import pandas as pd

    rows = [(name, *np.percentile(own.samples_m, SHOWN_PERCENTILES)) for name, own in found.items()]
    return pd.DataFrame(rows, columns=["shape", *(f"q{p:02.0f}_m" for p in SHOWN_PERCENTILES)])
