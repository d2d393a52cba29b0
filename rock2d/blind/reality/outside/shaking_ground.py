"""All ground swings up and down like a shaking table."""

import numpy as np

from rock2d.blind.reality import parameters
from rock2d.blind.reality.cause import Cause, Rng, Scale


def sizes(form: int, share: float, rng: Rng, scale: Scale) -> dict[str, float]:
    rate = 2.0 * np.pi * rng.uniform(1.0, 3.0) * np.sqrt(scale.gravity / scale.size)
    return {
        "amplitude_m": 0.6 * share * scale.speed / rate,
        "rate_rad_s": rate,
        "phase_rad": rng.uniform(0.0, 2.0 * np.pi),
    }


CAUSE = Cause(
    sizes,
    columns={
        "amplitude_m": parameters.SHAKE_AMPLITUDE,
        "rate_rad_s": parameters.SHAKE_RATE,
        "phase_rad": parameters.SHAKE_PHASE,
    },
    draw_order=3,
)
