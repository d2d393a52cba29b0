"""Magnus lift: linear in the spin, or saturating with the ratio of rim speed to block speed."""

from rock2d.blind.reality import parameters
from rock2d.blind.reality.cause import Cause, Rng, Scale, random_sign


def sizes(form: int, share: float, rng: Rng, scale: Scale) -> dict[str, float]:
    return {"lift": random_sign(rng) * (0.03, 0.04)[form] * share, "arm_m": (0.0, 0.5 * scale.size)[form]}


CAUSE = Cause(sizes, forms=2, columns={"lift": parameters.LIFT, "arm_m": parameters.LIFT_ARM}, draw_order=2)
