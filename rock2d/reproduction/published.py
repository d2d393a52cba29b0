"""Published data: the experiment, the results of the paper's two models, and its statements on first impacts."""

import numpy as np

from rock2d.scene.blocks import make_block

RELEASES = 50  # per block
BLOCKS = ("sphere", "cube", "parallelepiped")
LINES = ("line_1", "line_2", "line_3")

# Table 1: the masses; the densities given there contradict them
SETUP_BLOCKS = {
    block.name: block
    for block in (
        make_block("sphere", "circle", 0.0220, "solid_sphere", diameter_m=0.025),
        make_block("cube", "square", 0.0233, side_m=0.019),
        make_block("parallelepiped", "rectangle", 0.0231, length_m=0.035, height_m=0.014),
    )
}
HEIGHT_M, CREST_M = 0.083, 0.055  # of the embankment
GRAVITY_M_S2 = 9.81

# Table 2: passing frequencies in %, a row for each block, a column for each line
EXPERIMENT = np.array([[100, 86, 42], [86, 32, 0], [82, 6, 0]])
PROBABILISTIC = np.array([[94, 90, 40], [100, 32, 0], [100, 10, 0]])
DETERMINISTIC = np.array([[100, 98, 42], [100, 46, 2], [100, 18, 0]])

COLUMNS = {"deterministic": DETERMINISTIC, "probabilistic": PROBABILISTIC}  # of the paper's models

# Table 3 without the slope reductions
REBOUND_PARAMETERS = {
    "ditch.friction_angle_deg": 0.0, "facing.friction_angle_deg": 11.0,
    "ditch.momentum_half_kg_m_s": 0.025, "facing.momentum_half_kg_m_s": 0.04,
    "ditch.tangential_restitution": 0.85, "facing.tangential_restitution": 0.89,
}  # fmt: skip
SLOPE_REDUCTION_DEG = {"sphere": 0.0, "cube": 6.0, "parallelepiped": 40.0}
# Table 4
CONTACT_PARAMETERS = {
    "k_t_N_m": 2.5e3, "friction_angle_deg": 30.0, "k_l_N_m": 1.0e4, "k_r_Nm_rad": 0.025, "k_ul_N_m": 6.0e4,
}  # fmt: skip

DROP_M = 0.30

# statements of the paper on first impacts as numbers (assumptions, see `MEANINGS`)
SPHERE_IN_DITCH = RELEASES  # "always occurred in the ditch"
CUBE_ON_FACING = (3, 20)  # "some direct impacts were located on the facing": least and largest number
PARALLELEPIPED_ON_FACING = 40  # "a vast majority": least number
OFF_NORMAL_DEG = 20.0  # "mainly normal to the embankment facing": largest mean angle to its normal
OFF_NORMAL_SD_DEG = 10.0  # larger angles have the likelihood of a normal distribution with this sd
MEANINGS = (
    f"'The first impact in the ditch or on the mountain-side facing': all {RELEASES} of each block in one of the two.",
    f"The sphere's first impact 'always occurred in the ditch': {SPHERE_IN_DITCH} of {RELEASES}.",
    f"'Some direct impacts' of the cube on the facing: {CUBE_ON_FACING[0]} to {CUBE_ON_FACING[1]} of {RELEASES}.",
    f"'A vast majority' of the parallelepiped's first impacts on the facing: at least {PARALLELEPIPED_ON_FACING}.",
    f"'Mainly normal to the embankment facing': within {OFF_NORMAL_DEG:.0f}° of its normal on average; beyond, less "
    f"likely as a normal distribution of {OFF_NORMAL_SD_DEG:.0f}°.",
)


def passed(percent: np.ndarray) -> np.ndarray:
    """(blocks, lines) number of RELEASES that passed, from a table of passing frequencies in %."""
    return np.rint(percent * RELEASES / 100).astype(int)


def counts_by_last_line(percent: np.ndarray, block: str) -> np.ndarray:
    """(lines + 1,) number of releases of a block by the last line they passed (none, 1, 2, 3), from a table (blocks,
    lines) of passing frequencies in %."""
    return -np.diff(passed(percent)[BLOCKS.index(block)], prepend=RELEASES, append=0)
