"""Releases of known motion on a small set-up, to be filmed and tracked."""

from __future__ import annotations

import numpy as np
import pandas as pd
from rock2d_tracking.camera import PixelMap

from rock2d.engines.batch import run_batch, world_ensemble
from rock2d.files.experiment import Experiment
from rock2d.laws.contact import ContactParameters, parameter_table
from rock2d.scene.blocks import make_block
from rock2d.scene.cross_section import CrossSection
from rock2d.scene.world import World

SIZE_PX = (640, 400)
CAMERA = PixelMap(6e-4, (100.0, 320.0))
CROSS_SECTION = CrossSection(
    [[-0.3, 0.0], [0.18, 0.0], [0.22, 0.06], [0.6, 0.06]], ["ditch", "uphill_face", "crest"]
)
BLOCKS = {
    "sphere": make_block("sphere", "circle", 0.022, "solid_sphere", diameter_m=0.025),
    "cube": make_block("cube", "square", 0.0233, side_m=0.019),
    "slab": make_block("slab", "rectangle", 0.0231, length_m=0.035, height_m=0.014),
}
STATES = [
    [0.0, 0.10, 0.3, 0.9, -1.6, -40.0],
    [0.0, 0.11, 1.0, 0.8, -1.5, -30.0],
    [0.0, 0.12, -0.4, 0.8, -1.4, 25.0],
]
SYMMETRY = {"sphere": 2 * np.pi, "cube": np.pi / 2, "slab": np.pi}


def falls(frames: int = 220, fps: float = 1000.0) -> Experiment:
    """One release of each block, `frames` frames long, without noise."""
    law = ContactParameters(1.1e4, 7.0e4, 3.0e3, 32.0, 0.03)
    world = World(BLOCKS, CROSS_SECTION, parameter_table(law, CROSS_SECTION.zone_names)[None])
    t = np.tile(np.arange(frames) / fps, (3, 1))
    ensemble, tables = world_ensemble(world)
    result = run_batch(
        ensemble,
        np.array(STATES),
        block_ids=np.arange(3),
        table_ids=tables,
        time_limit_s=frames / fps,
        times_s=t,
    )
    pose = result.samples
    table = pd.DataFrame({
        "release": np.repeat(np.arange(3), frames), "block": np.repeat(list(BLOCKS), frames), "t_s": t.ravel(),
        "x_m": pose[..., 0].ravel(), "y_m": pose[..., 1].ravel(), "theta_rad": pose[..., 2].ravel(),
    })  # fmt: skip
    return Experiment("falls", 9.81, fps, 0.0, 0.0, CROSS_SECTION, dict(BLOCKS), trajectories=table)
