"""Lens distortion: r (1 + k r²), or r / (1 - k r²); r over the extent of the image."""

import numpy as np

from rock2d.blind.reality.cause import Array, Cause, Rng, Scale, Values, View, random_sign


def sizes(form: int, share: float, rng: Rng, scale: Scale) -> dict[str, float]:
    return {"k": 0.05 * share * random_sign(rng), "division": float(form)}


def recorded(poses: Array, view: View, values: Values) -> Array:
    offset = poses[..., :2] - view.centre_m
    square = np.sum((offset / view.extent_m) ** 2, axis=-1, keepdims=True)
    distortion = values["k"] * square
    divided = values["division"] > 0.0
    out = poses.copy()
    out[..., :2] = view.centre_m + offset * (1.0 / np.maximum(1.0 - distortion, 0.2) if divided else 1.0 + distortion)
    return out


CAUSE = Cause(sizes, forms=2, recorded=recorded, draw_order=19)
