"""Tilted camera: the image is turned about its centre, or about another point with a small keystone."""

import numpy as np

from rock2d.blind.reality.cause import Array, Cause, Rng, Scale, Values, View, random_sign


def sizes(form: int, share: float, rng: Rng, scale: Scale) -> dict[str, float]:
    turn = 0.12 * share * random_sign(rng)
    if form == 0:
        return {"turn_rad": turn, "off_x": 0.0, "off_y": 0.0, "keystone": 0.0}
    off_x, off_y = rng.uniform(-0.2, 0.2, 2)
    return {"turn_rad": turn, "off_x": off_x, "off_y": off_y, "keystone": 0.02 * share * random_sign(rng)}


def recorded(poses: Array, view: View, values: Values) -> Array:
    pivot = view.centre_m + view.extent_m * np.array([values["off_x"], values["off_y"]])
    c, s = np.cos(values["turn_rad"]), np.sin(values["turn_rad"])
    turned = (poses[..., :2] - pivot) @ np.array([[c, s], [-s, c]])
    out = poses.copy()
    out[..., :2] = pivot + turned / (1.0 + values["keystone"] * turned[..., 1:] / view.extent_m)
    out[..., 2] += values["turn_rad"]
    return out


CAUSE = Cause(sizes, forms=2, recorded=recorded, draw_order=16)
