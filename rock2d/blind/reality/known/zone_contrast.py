"""Contrast between zones: loading stiffness of the facing, or stiffness and friction of the whole embankment."""

import numpy as np

from rock2d.blind.reality.cause import Cause, Rng, Scale, random_sign


def sizes(form: int, share: float, rng: Rng, scale: Scale) -> dict[str, float]:
    stiffness = float(np.exp(random_sign(rng) * np.log(5.0) * share))
    if form == 0:
        return {"k_l": stiffness, "k_ul": 1.0, "mu": 1.0}
    return {"k_l": stiffness, "k_ul": stiffness, "mu": float(np.exp(random_sign(rng) * np.log(2.2) * share))}


CAUSE = Cause(sizes, forms=2, draw_order=8)
