"""The recorded orientation lags behind the recorded position."""

import numpy as np

from rock2d.blind.reality.cause import Array, Cause, Rng, Scale, Values, View


def sizes(form: int, share: float, rng: Rng, scale: Scale) -> dict[str, float]:
    return {"lag_s": 0.4 * share * np.sqrt(scale.size / scale.gravity)}


def recorded(poses: Array, view: View, values: Values) -> Array:
    out = poses.copy()
    for i, release in enumerate(poses):
        out[i, :, 2] = np.interp(view.times_s - values["lag_s"], view.times_s, release[:, 2])
    return out


CAUSE = Cause(sizes, recorded=recorded, draw_order=5)
