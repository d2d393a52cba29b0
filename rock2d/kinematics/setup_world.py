"""The world of an experiment before any fit: its stated set-up with the paper's law."""

import numpy as np

from rock2d.arrays import Array
from rock2d.files.experiment import Experiment
from rock2d.laws.contact import ContactParameters, contact_table
from rock2d.scene.world import World

# the paper's Table 4, where the fit of the base law starts: k_l, k_ul / k_l, k_t, tan phi, k_r
TABLE_LAW = np.array([1.0e4, 6.0, 2.5e3, np.tan(np.pi / 6), 0.025])
TABLE_SIZE_M = 0.025  # size of the blocks of Table 4
TABLE_MASS_KG = 0.0226  # mean mass of the blocks of Table 4


def setup_world(experiment: Experiment) -> World:
    """The world of an experiment without effects, with the paper's Table 4 as its law."""
    table = contact_table(ContactParameters(), experiment.cross_section.zone_names)[None]
    return World(experiment.blocks, experiment.cross_section, table, experiment.gravity_m_s2)


def base_law_start(experiment: Experiment) -> Array:
    """Start of the fit of the base law: Table 4, scaled to the blocks' mass and gravity.

    With lengths in units of the block's size L and times in units of √(L / g), stiffness scales with m g / L; the
    rolling stiffness with m g L."""
    world = setup_world(experiment)
    size, mass = world.mean_size_m, world.fitted_mass_kg
    weight = mass / TABLE_MASS_KG * experiment.gravity_m_s2 / 9.81
    scale = np.array(
        [weight * TABLE_SIZE_M / size, 1.0, weight * TABLE_SIZE_M / size, 1.0, weight * size / TABLE_SIZE_M]
    )
    return TABLE_LAW * scale
