"""One side of the block is much softer than the others."""

import numpy as np

from rock2d.blind.reality import parameters
from rock2d.blind.reality.cause import Cause, Rng, Scale


def sizes(form: int, share: float, rng: Rng, scale: Scale) -> dict[str, float]:
    return {"log_ratio": 2.5 * share, "angle_rad": rng.uniform(-np.pi, np.pi)}


CAUSE = Cause(sizes, columns={"log_ratio": parameters.SIDE_LOG_RATIO, "angle_rad": parameters.SIDE_ANGLE}, draw_order=4)
