"""Wrong scale: the same in x and y, or with a difference of a tenth of the error between them."""

import numpy as np

from rock2d.blind.reality.cause import Array, Cause, Rng, Scale, Values, View, random_sign


def sizes(form: int, share: float, rng: Rng, scale: Scale) -> dict[str, float]:
    error = 0.14 * share * random_sign(rng)
    uneven = 0.05 * error if form == 1 else 0.0
    return {"x": 1.0 + error + uneven, "y": 1.0 + error - uneven}


def recorded(poses: Array, view: View, values: Values) -> Array:
    out = poses.copy()
    out[..., :2] = view.centre_m + (poses[..., :2] - view.centre_m) * np.array([values["x"], values["y"]])
    return out


CAUSE = Cause(sizes, forms=2, recorded=recorded, draw_order=17)
