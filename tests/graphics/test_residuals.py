"""Residuals: median against the time since the start, distribution at the end."""

import numpy as np
import pandas as pd
import pytest

from rock2d.errors import InputError
from rock2d.graphics.residuals import residuals_figure


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
