"""Close to its surface the ground attracts the block."""

from rock2d.blind.reality import parameters
from rock2d.blind.reality.cause import Cause, Rng, Scale


def sizes(form: int, share: float, rng: Rng, scale: Scale) -> dict[str, float]:
    return {"pull_m_s2": 2.0 * share * scale.gravity, "range_m": 1.5 * scale.size}


CAUSE = Cause(sizes, columns={"pull_m_s2": parameters.ATTRACTION, "range_m": parameters.ATTRACTION_RANGE}, draw_order=7)
