"""The unloading stiffness of the ground, and so its restitution, changes along the section in one slow wave."""

import numpy as np

from rock2d.blind.reality import parameters
from rock2d.blind.reality.cause import Cause, Rng, Scale


def sizes(form: int, share: float, rng: Rng, scale: Scale) -> dict[str, float]:
    return {
        "log_factor": 1.2 * share,
        "wave_number_rad_m": 2.0 * np.pi / (scale.high[0] - scale.low[0]),
        "phase_rad": rng.uniform(0.0, 2.0 * np.pi),
    }


CAUSE = Cause(
    sizes,
    columns={
        "log_factor": parameters.WAVE_LOG_FACTOR,
        "wave_number_rad_m": parameters.WAVE_NUMBER,
        "phase_rad": parameters.WAVE_PHASE,
    },
)
