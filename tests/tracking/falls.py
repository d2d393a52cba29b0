"""Releases of known motion on a small set-up, to be filmed and tracked."""

from dataclasses import replace

import numpy as np
from rock2d_tracking.camera import PixelMap
from rock2d_tracking.following import Follower, motion_for_setup
from rock2d_tracking.setup_file import Setup

from rock2d.engines.batch import run_batch, world_ensemble
from rock2d.files.experiment import Experiment
from rock2d.laws.contact import contact_table
from rock2d.scene.cross_section import CrossSection
from rock2d.scene.world import World
from tests.kinematics.synthetic_films import LAW, film_table
from tests.laboratory import CUBE, SLAB, SPHERE

SIZE_PX = (640, 400)
CAMERA = PixelMap(6e-4, (100.0, 320.0))
CROSS_SECTION = CrossSection([[-0.3, 0.0], [0.18, 0.0], [0.22, 0.06], [0.6, 0.06]], ["ditch", "uphill_face", "crest"])
BLOCKS = {"sphere": SPHERE, "cube": CUBE, "slab": replace(SLAB, name="slab")}
STATES = [[0.0, 0.10, 0.3, 0.9, -1.6, -40.0], [0.0, 0.11, 1.0, 0.8, -1.5, -30.0], [0.0, 0.12, -0.4, 0.8, -1.4, 25.0]]
SYMMETRY = {"sphere": 2 * np.pi, "cube": np.pi / 2, "slab": np.pi}


def followed(film: list[np.ndarray], setup: Setup, size_px: tuple[int, int]) -> Follower:
    """What follows the blocks of a film, after it has."""
    follower = Follower(film, setup, size_px, motion_for_setup(film, setup, len(film)))
    follower.follow(film)
    return follower


def falls(frames: int = 220, fps: float = 1000.0) -> Experiment:
    """One release of each block, `frames` frames long, without noise."""
    world = World(BLOCKS, CROSS_SECTION, contact_table(LAW, CROSS_SECTION.zone_names)[None])
    t = np.tile(np.arange(frames) / fps, (3, 1))
    ensemble, tables = world_ensemble(world)
    ids = {"block_ids": np.arange(3), "table_ids": tables}
    result = run_batch(ensemble, np.array(STATES), **ids, time_limit_s=frames / fps, times_s=t)
    table = film_table(list(BLOCKS), t, result.samples)
    return Experiment("falls", 9.81, fps, 0.0, 0.0, CROSS_SECTION, dict(BLOCKS), trajectories=table)
