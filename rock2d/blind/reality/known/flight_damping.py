"""Damping in flight: the spin decays at the same rate as the velocity, or at 0.7 of it."""

import numpy as np

from rock2d.blind.reality import parameters
from rock2d.blind.reality.cause import Cause, Rng, Scale


def sizes(form: int, share: float, rng: Rng, scale: Scale) -> dict[str, float]:
    rate = 0.1 * share * np.sqrt(scale.gravity / scale.size)
    return {"rate_1_s": rate, "spin_rate_1_s": (1.0, 0.7)[form] * rate}


CAUSE = Cause(
    sizes,
    forms=2,
    columns={"rate_1_s": parameters.VELOCITY_DECAY, "spin_rate_1_s": parameters.SPIN_DECAY},
    draw_order=1,
)
