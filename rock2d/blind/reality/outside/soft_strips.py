"""Strips of the ground are much softer than the zone they lie in."""

import numpy as np

from rock2d.blind.reality import parameters
from rock2d.blind.reality.cause import Cause, Rng, Scale


def sizes(form: int, share: float, rng: Rng, scale: Scale) -> dict[str, float]:
    left = scale.low[0] + rng.uniform(0.0, 8.0) * scale.size
    return {
        "factor": float(np.exp(-2.0 * share)),
        "left_m": left,
        "width_m": 3.0 * scale.size,
        "period_m": 8.0 * scale.size,
    }


CAUSE = Cause(
    sizes,
    columns={
        "factor": parameters.STRIP_FACTOR,
        "left_m": parameters.STRIP_LEFT,
        "width_m": parameters.STRIP_WIDTH,
        "period_m": parameters.STRIP_PERIOD,
    },
    draw_order=2,
)
