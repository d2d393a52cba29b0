"""The block is pushed sideways while it passes a band of heights."""

from rock2d.blind.reality import parameters
from rock2d.blind.reality.cause import Cause, Rng, Scale, random_sign


def sizes(form: int, share: float, rng: Rng, scale: Scale) -> dict[str, float]:
    floor = scale.low[1] + 1.5 * scale.size
    return {
        "push_m_s2": 0.8 * share * scale.gravity * random_sign(rng),
        "low_m": floor,
        "high_m": floor + 2.5 * scale.size,
    }


CAUSE = Cause(
    sizes,
    columns={"push_m_s2": parameters.WIND, "low_m": parameters.WIND_LOW, "high_m": parameters.WIND_HIGH},
    draw_order=0,
)
