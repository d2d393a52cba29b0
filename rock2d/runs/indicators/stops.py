"""Stops: how and where every release ended, and its runout."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rock2d.runs.indicators.indicator import Indicator
from rock2d.scene.nearest_facet import nearest_facets

if TYPE_CHECKING:
    import pandas as pd

    from rock2d.runs.simulation import Simulation

STOP_COLUMNS = ("block", "release", "stop", "t_s", "x_m", "y_m", "zone", "runout_m")


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


INDICATOR = Indicator("stops", STOP_COLUMNS, stops_table)
