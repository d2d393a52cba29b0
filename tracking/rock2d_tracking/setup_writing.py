"""Writing the set-up file of a film whose camera is known."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from rock2d.files.checked_yaml import yaml_text
from rock2d.files.experiment import Experiment
from rock2d.files.folders import write_whole
from rock2d.files.setup_keys import block_keys
from rock2d_tracking.camera import PixelMap


def write_setup(path: Path, experiment: Experiment, camera: PixelMap, releases: Sequence[str]) -> None:
    """Write what `setup_file.Setup` reads; `releases`: the block of each."""
    keys = {
        "name": experiment.name,
        "gravity_m_s2": float(experiment.gravity_m_s2),
        "camera": {
            "fps": float(experiment.fps),
            "scale": {"metres_per_pixel": float(camera.metres_per_pixel)},
            "up": "up" if camera.up < 0 else "down",
            "origin_px": [float(v) for v in camera.origin_px],
            "origin_m": [float(v) for v in camera.origin_m],
            "tilt_deg": float(np.rad2deg(camera.tilt_rad)),
        },
        "cross_section": {
            "points_m": experiment.cross_section.points_m.tolist(),
            "zones": list(experiment.cross_section.zones),
        },
        "blocks": {name: block_keys(block) for name, block in experiment.blocks.items()},
        "releases": list(releases),
    }
    write_whole(path, yaml_text(keys))
