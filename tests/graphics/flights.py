"""Free flights on a level floor, simulated and measured."""

import numpy as np
import pandas as pd

from rock2d.records.track import Track
from rock2d.scene.blocks import make_block
from rock2d.scene.cross_section import CrossSection
from tests import laboratory

FLOOR = CrossSection([[-2, 0], [2, 0]], ["floor"], {"gate": [[0.5, 0], [0.5, 0.4]]})
BLOCKS = {
    "ball": make_block("ball", "circle", 0.02, "solid_sphere", diameter_m=0.05),
    "cube": make_block("cube", "square", 0.02, side_m=0.04),
}


def flight(block: str, release: int, vx_m_s: float = 1.0, seconds: float = 0.4) -> Track:
    """A free flight from 1 m."""
    return laboratory.flight(release, block, [0.0, 1.0, 0.2, vx_m_s, 0.0, 3.0], seconds, aloft=True)


def rows_of(track: Track, dx_m: float = 0.0) -> pd.DataFrame:
    t = np.arange(0, 0.4, 0.01)
    x, y, theta = track.states(t)[:, :3].T
    columns = {"t_s": t, "x_m": x - dx_m, "y_m": y, "theta_rad": theta}
    return pd.DataFrame({"release": track.release, "block": track.block, **columns})
