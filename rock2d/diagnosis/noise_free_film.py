"""Films without noise, as written by a simulation: they get the noise of a camera before the diagnosis.

A diagnosis compares all residuals with noise, and no simulation is exact: the steps of the law change the velocity
after an impact by up to 0.002 √(g × radius) and the spin by 0.005 √(g / radius) (99 % of the impacts, steps of 0.2 rad
against 0.0125 rad). Without noise such errors would count as causes. `CAMERA_NOISE` hides them.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from rock2d.files.experiment import Experiment
from rock2d.kinematics.flights import Film
from rock2d.records.columns import POSITION, THETA

Array = np.ndarray

FAINTEST_NOISE = 5.0e-5  # in block sizes and rad; less noise counts as none
CAMERA_NOISE = 2.0e-2  # in the same units
NOISE_SEED = 1


def with_camera_noise(experiment: Experiment, film: Film) -> tuple[Experiment, list[str]]:
    """Add noise to positions or angles that have none in the segmented `film`.

    Returns the experiment and remarks; the same experiment and none if both have noise. An angle that was not measured,
    as for a circle without marks, stays constant.
    """
    assert experiment.trajectories is not None
    size = min(block.size_m for block in experiment.blocks.values())
    noisy_channels = film.measured & (film.noise > FAINTEST_NOISE * np.array([size, size, 1.0]))
    added, additions = np.zeros(3), []
    if not noisy_channels[POSITION].any():
        added[POSITION] = CAMERA_NOISE * size
        additions.append(f"{CAMERA_NOISE * size:.2g} m in positions")
    if not noisy_channels[THETA] and film.angle_known.any():
        added[THETA] = CAMERA_NOISE
        additions.append(f"{CAMERA_NOISE:.2g} rad in angles")
    if not additions:
        return experiment, []
    table = experiment.trajectories.copy()
    noise = np.random.default_rng(NOISE_SEED).normal(size=(len(table), 3)) * added
    noise[~table["release"].isin(film.release_names[film.angle_known]), THETA] = 0.0
    table[["x_m", "y_m", "theta_rad"]] += noise
    noisy = replace(
        experiment, trajectories=table, position_noise_m=max(experiment.position_noise_m, added[0]),
        angle_noise_rad=max(experiment.angle_noise_rad, added[THETA]),
    )  # fmt: skip
    return noisy, [
        f"The film shows no noise, like the output of a simulation, and no simulation is exact. It was diagnosed with "
        f"added camera noise, 1 sigma: {' and '.join(additions)}. For another noise, set outputs.position_noise_m and "
        "outputs.angle_noise_rad in the scenario and simulate again"
    ]
