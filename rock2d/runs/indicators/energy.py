"""The energy balance of every release, of engines with an energy audit."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rock2d.runs.engines import ENGINES
from rock2d.runs.indicators.indicator import Indicator

if TYPE_CHECKING:
    import pandas as pd

    from rock2d.runs.simulation import Simulation

ENERGY_COLUMNS = ("release", "block")  # then one column for each term of the balance, in J


def energy_table(run: Simulation) -> pd.DataFrame:
    """The final balance of every track: release, block, and one column for each term, such as `initial_J`."""
    import pandas as pd

    return pd.DataFrame(
        [
            {"release": track.release, "block": track.block, **{f"{k}_J": v for k, v in track.energy_J.items()}}
            for track in run.tracks
        ]
    )


INDICATOR = Indicator("energy", ENERGY_COLUMNS, energy_table, lambda run: ENGINES[run.engine].audits_energy)
