"""Mirrored axis: x is recorded with the wrong sign, or the angle. There is no size."""

from rock2d.blind.reality.cause import Array, Cause, Rng, Scale, Values, View


def sizes(form: int, share: float, rng: Rng, scale: Scale) -> dict[str, float]:
    return {"x": -1.0, "theta": 1.0} if form == 0 else {"x": 1.0, "theta": -1.0}


def recorded(poses: Array, view: View, values: Values) -> Array:
    out = poses.copy()
    out[..., 0] *= values["x"]
    out[..., 2] *= values["theta"]
    return out


CAUSE = Cause(sizes, forms=2, recorded=recorded, draw_order=21)
