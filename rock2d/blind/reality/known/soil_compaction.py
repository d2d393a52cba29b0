"""Compaction: the stiffness grows with the blows and saturates, or grows with the logarithm of their number."""

from rock2d.blind.reality.cause import Cause, Rng, Scale


def sizes(form: int, share: float, rng: Rng, scale: Scale) -> dict[str, float]:
    return {"growth": 3.0 * share, "blows": 12.0} if form == 0 else {"growth": 1.0 * share, "blows": 0.0}


CAUSE = Cause(sizes, forms=2, draw_order=9)
