"""Measured against simulated: which releases are shown, how far apart they are, and their residuals."""

import numpy as np
import pandas as pd
import pytest

from rock2d.errors import InputError
from rock2d.graphics.overlays import overlay_figure, residuals_figure
from tests.graphics.flights import BLOCKS, FLOOR, flight, rows_of


def test_overlay_takes_the_closest_and_the_farthest_release():
    tracks = [flight("ball", i) for i in range(21)]
    measured = pd.concat([rows_of(t, dx_m=1e-3 * t.release) for t in tracks])
    figure = overlay_figure(FLOOR, BLOCKS, measured, tracks)
    titles = [a.get_title().split("\n") for a in figure.axes[:4]]
    assert [t[0] for t in titles] == [
        "release 0, closest", "release 10, median", "release 18, 90th percentile", "release 20, farthest"
    ]  # fmt: skip
    assert [t[1] for t in titles] == [f"rms distance {d:.1f} mm" for d in (0, 10, 18, 20)]
    with pytest.raises(InputError, match="no measured release"):
        overlay_figure(FLOOR, BLOCKS, measured.assign(release=500), tracks)


def test_residuals_show_the_median_since_each_release_began():
    parts = []
    for release in range(11):
        t = 5.0 * release + np.arange(20) * 0.004  # every release starts at another time of the clock
        off = {"dx_m": 1e-3 * release, "dy_m": 0.0, "dtheta_rad": 0.1 * release * np.arange(20) / 19}
        parts.append(pd.DataFrame({"release": release, "block": "cube", "t_s": t, **off}))
    figure = residuals_figure(pd.concat(parts))
    x_median, _, theta_median = (axis.lines[0].get_xydata() for axis in figure.axes[:3])
    assert x_median[:, 0] == pytest.approx(np.arange(20) * 0.004)
    assert x_median[:, 1] == pytest.approx(np.full(20, 5.0))  # mm
    assert theta_median[-1, 1] == pytest.approx(0.5)
    counts = [patch.get_height() for patch in figure.axes[3].patches]
    assert sum(counts) == 11
    with pytest.raises(InputError, match="no residuals"):
        residuals_figure(pd.concat(parts).iloc[:0])
