"""Air rises in a band of the set-up and carries the block."""

from rock2d.blind.reality import parameters
from rock2d.blind.reality.cause import Cause, Rng, Scale


def sizes(form: int, share: float, rng: Rng, scale: Scale) -> dict[str, float]:
    # narrow, because a wide band would act like another gravity
    left = scale.low[0] + rng.uniform(0.0, 4.0) * scale.size
    return {"lift_m_s2": 1.2 * share * scale.gravity, "left_m": left, "right_m": left + 3.0 * scale.size}


CAUSE = Cause(
    sizes,
    columns={
        "lift_m_s2": parameters.UPDRAUGHT,
        "left_m": parameters.UPDRAUGHT_LEFT,
        "right_m": parameters.UPDRAUGHT_RIGHT,
    },
    draw_order=9,
)
