"""The camera slides during each release, each time in another direction."""

import numpy as np

from rock2d.blind.reality.cause import Array, Cause, Rng, Scale, Values, View


def sizes(form: int, share: float, rng: Rng, scale: Scale) -> dict[str, float]:
    return {"speed_m_s": 0.5 * share * scale.speed}


def recorded(poses: Array, view: View, values: Values) -> Array:
    direction = np.random.default_rng([view.seed, 13]).uniform(0.0, 2.0 * np.pi, len(poses))
    slide = values["speed_m_s"] * np.stack([np.cos(direction), np.sin(direction)], axis=-1)
    out = poses.copy()
    out[..., :2] -= slide[:, None, :] * (view.times_s - view.times_s[0])[:, None]
    return out


CAUSE = Cause(sizes, recorded=recorded, draw_order=6)
