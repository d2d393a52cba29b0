"""Offset of the angle: constant, or varying by a tenth from release to release."""

import numpy as np

from rock2d.blind.reality.cause import Array, Cause, Rng, Scale, Values, View, random_sign


def sizes(form: int, share: float, rng: Rng, scale: Scale) -> dict[str, float]:
    offset = 0.4 * share * random_sign(rng)
    return {"offset_rad": offset, "jitter_rad": 0.1 * abs(offset) if form == 1 else 0.0}


def recorded(poses: Array, view: View, values: Values) -> Array:
    jitter = np.random.default_rng([view.seed, 12]).normal(0.0, 1.0, len(poses))
    out = poses.copy()
    out[..., 2] += values["offset_rad"] + values["jitter_rad"] * jitter[:, None]
    return out


CAUSE = Cause(sizes, forms=2, recorded=recorded, draw_order=20)
