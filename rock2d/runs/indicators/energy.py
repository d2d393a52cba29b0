"""The energy audit of every release, from engines that keep one."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

from rock2d.records.track import Track
from rock2d.runs.engines import ENGINES
from rock2d.runs.indicators.indicator import Indicator

if TYPE_CHECKING:
    import pandas as pd

ENERGY_COLUMNS = ("release", "block")  # then one column for each term of the engine's balance, in J


def energy_table(tracks: Iterable[Track]) -> pd.DataFrame:
    """The closing balance of every track: release, block and one column a term, with its unit: `initial_J`, ..."""
    import pandas as pd

    return pd.DataFrame(
        [
            {
                "release": track.release,
                "block": track.block,
                **{f"{k}_J": v for k, v in track.energy_J.items()},
            }
            for track in tracks
        ]
    )


INDICATOR = Indicator(
    "energy",
    ENERGY_COLUMNS,
    lambda run: energy_table(run.tracks),
    lambda run: ENGINES[run.engine].audits_energy,
)
