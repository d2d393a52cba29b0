"""Wrong frame rate; in the second form the frames also come early or late by random times."""

import numpy as np

from rock2d.blind.reality.cause import Cause, Rng, Scale, random_sign


def sizes(form: int, share: float, rng: Rng, scale: Scale) -> dict[str, float]:
    factor = float(np.exp(0.14 * share * random_sign(rng)))
    return {"factor": factor, "jitter": 0.0 if form == 0 else 0.5 * share}


CAUSE = Cause(sizes, forms=2, draw_order=18)
