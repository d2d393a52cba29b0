"""Tables of every release: its impacts, its energy balance, how and where it ended."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rock2d.records.columns import IMPACT_COLUMNS
from rock2d.runs.engines import ENGINES
from rock2d.runs.simulation import Indicator, Simulation
from rock2d.scene.nearest_facet import nearest_facets

if TYPE_CHECKING:
    import pandas as pd

ENERGY_COLUMNS = ("release", "block")  # then one column for each term of the balance, in J
STOP_COLUMNS = ("block", "release", "stop", "t_s", "x_m", "y_m", "zone", "runout_m")


def impacts_table(run: Simulation) -> pd.DataFrame:
    """Every impact of every track; IMPACT_COLUMNS."""
    import pandas as pd

    rows = [{"release": t.release, "block": t.block, **impact} for t in run.tracks for impact in t.impacts]
    return pd.DataFrame(rows, columns=list(IMPACT_COLUMNS))


def energy_table(run: Simulation) -> pd.DataFrame:
    """The final balance of every track: release, block, and one column for each term, such as `initial_J`."""
    import pandas as pd

    return pd.DataFrame(
        [
            {"release": track.release, "block": track.block, **{f"{k}_J": v for k, v in track.energy_J.items()}}
            for track in run.tracks
        ]
    )


def stops_table(run: Simulation) -> pd.DataFrame:
    """How and where every release ended; STOP_COLUMNS.

    - zone: zone of the facet nearest to the centroid, None if the block left the cross-section
    - runout_m: horizontal distance from start to end, positive to the right"""
    import pandas as pd

    rows = []
    for track in run.tracks:
        t, x, y = map(float, track.knots[-1, :3])
        nearest = int(nearest_facets(track.knots[-1:, 1:3], run.cross_section.points_m)[0])
        zone = None if track.stop == "exit" else run.cross_section.zones[nearest]
        runout = x - float(track.knots[0, 1])
        rows.append((track.block, track.release, track.stop, t, x, y, zone, runout))
    return pd.DataFrame(rows, columns=list(STOP_COLUMNS))


INDICATORS = (
    Indicator("impacts", IMPACT_COLUMNS, impacts_table),
    Indicator("energy", ENERGY_COLUMNS, energy_table, lambda run: ENGINES[run.engine].audits_energy),
    Indicator("stops", STOP_COLUMNS, stops_table),
)
