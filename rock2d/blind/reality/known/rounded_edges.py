"""Rounded edges: corners are circular, or cut off; `share` is relative to half the width of the block."""

from rock2d.blind.reality.cause import Cause, Rng, Scale


def sizes(form: int, share: float, rng: Rng, scale: Scale) -> dict[str, float]:
    return {"share": (0.9, 0.7)[form] * share}


CAUSE = Cause(sizes, forms=2, draw_order=5)
